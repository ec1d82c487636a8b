# SPDX-License-Identifier: MIT
"""Limits of evidence: what beams tell of cells, each with unit and origin.

Lengths are metres and angles radians unless said. Sizes of samples and blocks, and guards against rounding,
stand where they are used. "By eye" stands for a value that was tried on examples, without a measurement.
"""

from __future__ import annotations

# Sight
LEAST_COSINE = 1e-3
"""Of incidence, 89.9 deg, that tolerances and footprints are reckoned with: a grazing beam's grow a
thousandfold and tell nothing.
"""
MARGIN_CELLS = 2.0
"""Around those of a chart that count with it. By choice."""
MARGIN_PIXELS = 1.0
"""Around an image that count with it. By choice."""

# Free space
FEWEST_BEAMS = 2
"""In a cell and those around it, that veto it where ranges are noisy: a single one may be an outlier."""

# Reach
WIDEST = 0.5
"""Radians that places seen by one pixel may be off its ray; more is not reckoned with. By choice."""

# Weighing
LIMB_PIXELS = 2.0
"""How wide a beam may be and still be half on the surface. By eye."""
NEAR_CELLS = 3
"""From the surface's own pixels, within which pixels of no surface count as its own. By eye."""
