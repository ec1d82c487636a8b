# SPDX-License-Identifier: MIT
"""Meshes of planes as grids of heights, and the movement of their vertices."""
