# SPDX-License-Identifier: MIT
"""Analysis of textures: window, lattice, quality, self-check."""
