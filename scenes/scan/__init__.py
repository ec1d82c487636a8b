# SPDX-License-Identifier: MIT
"""Scans: range images, their projections and rays."""
