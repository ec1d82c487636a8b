# SPDX-License-Identifier: MIT
"""Hole patterns: rows, grids and bolt circles of equal holes in a plane."""
