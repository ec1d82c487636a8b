# SPDX-License-Identifier: MIT
"""Applied features: read from a file, placed in the surfaces of scans, and laid into them."""
