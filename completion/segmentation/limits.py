# SPDX-License-Identifier: MIT
"""Limits of segmentation: growing, competition, curvature and relief of regions, each with unit and origin.

Lengths are metres and angles radians unless said. Sizes of samples and blocks, and guards against rounding,
stand where they are used. "By eye" stands for a value that was tried on examples, without a measurement.
"""

from __future__ import annotations

import numpy as np

# Growing
MOST_MISFIT = 3.0
"""Of a tile: weighted square residual by freedom, 1 for noise; beyond it an edge crosses the tile. By eye."""
SEED_CUT = 0.25
"""Excess of the plane through 3 x 3 tiles over their noise, below which they are one surface. By eye."""

# Competition
SEAM_COST = 1.0
"""Of a neighbour on another surface: that of a pixel one standard deviation off."""
WITHIN_SHARE = 0.9
"""Of an island's pixels within tolerance of the surface around it: all but outliers. By eye."""
ENCLOSED_SHARE = 0.5
"""Of an island's outline next to that surface: most of it."""
FARTHEST = 2.0
"""Times the region's own ranges: planes that a ray meets later, or never, end there. By choice."""

# Curvature
CURVED_SD = 5.0
"""Standard deviations of the curvature, inflated for correlated residuals, from which on a region is
curved: one in two million by chance.
"""
RING_GROWTH = 1.3
"""By the smooth tiles around, that makes a patch a narrow one. By eye."""
LEAST_SAGITTA = 3.0
"""In units of what the surface may stray by: three standard deviations; less is a flat wall that is not
quite flat.
"""

# Pipeline
MOST_BULGE = 0.1
"""Pixel footprints that a tile on a cylinder of a few pixels' radius strays from its plane. By eye."""
FEWEST_TILES = 3
"""In a row or corner: fewer show neither plane nor cylinder."""

# Relief
CONTACT_PIXELS = 4
"""That lie between two pieces that touch at most. By eye."""
FEWEST_CONTACTS = 8
"""Pairs of pixels by which pieces touch. By eye."""
MEET_SD = 3.0 * np.sqrt(2.0)
"""Times their relief, by which two planes differ at a seam at most: both within three deviations."""
BLURRED_SD = 2.0
"""Times the noise, within which single ranges hardly tell two planes apart: two deviations."""
SAME_COSINE = np.cos(np.radians(5.0))
"""Of the normals of pieces that tell how uneven a plane is: 5 deg. By eye."""
FEWEST_PAIRS = 3
"""Of such pieces; fewer may be a ramp."""
STRAY = 2.0
"""Times what is expected, by which any piece may stray from the common plane. By eye."""
