# SPDX-License-Identifier: MIT
"""Columns and stairs."""
