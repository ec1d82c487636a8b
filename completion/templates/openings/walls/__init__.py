# SPDX-License-Identifier: MIT
"""Walls: the beams that reach for one, recesses in it, and what the beams say of them."""
