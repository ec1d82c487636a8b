# SPDX-License-Identifier: MIT
"""E57: structured laser scans, read, checked and written."""
