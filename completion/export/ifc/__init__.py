# SPDX-License-Identifier: MIT
"""IFC4 files."""
