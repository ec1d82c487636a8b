# SPDX-License-Identifier: MIT
"""Cases."""
