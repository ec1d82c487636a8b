# SPDX-License-Identifier: MIT
"""Houses."""
