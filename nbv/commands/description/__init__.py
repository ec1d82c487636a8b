# SPDX-License-Identifier: MIT
"""Description: what outputs of unseen hold, for `unseen info`."""
