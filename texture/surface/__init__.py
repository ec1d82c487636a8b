# SPDX-License-Identifier: MIT
"""Fills of real surfaces: shading apart, plain areas as such, large holes in tiles."""
