# SPDX-License-Identifier: MIT
"""Inspection: a design checked against scans, its files, what changed, and where to stand next."""
