# SPDX-License-Identifier: MIT
"""Effects: everything by which an instrument's scan differs from exact ranges."""
