# SPDX-License-Identifier: MIT
"""Files: scenes, scans and points read and written by suffix, and described."""
