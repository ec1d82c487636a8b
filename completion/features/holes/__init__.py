# SPDX-License-Identifier: MIT
"""Rows, grids and bolt circles of holes in plates."""
