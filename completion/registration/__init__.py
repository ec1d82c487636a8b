# SPDX-License-Identifier: MIT
"""Registration: the poses of scans from any start, how well they are known, and when they cannot be."""
