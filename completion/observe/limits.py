# SPDX-License-Identifier: MIT
"""Limits of observation: mixed pixels, key frames, noise, refits and shadows, each with unit and origin.

Lengths are metres and angles radians unless said. Sizes of samples and blocks, and guards against rounding,
stand where they are used. "By eye" stands for a value that was tried on examples, without a measurement.
"""

from __future__ import annotations

import numpy as np

# Mixed pixels
JUMP_SD = 12.0
"""Standard deviations of a range from which on two surfaces are apart: a pixel in the middle half of such a
jump lies three off either.
"""
BEFORE_BOTH_M = 0.02
"""Metres before the nearest range around it that a mixed beam is sure to have passed. By choice: twenty times
the flatness of surfaces, so that the nearer one keeps its own edge; on small things no mixed beam speaks."""
MIDDLE = 0.25
"""Share of a jump, to either side of its middle: its middle half."""
STEEP = 4.0
"""Times as much as beside it that ranges change in a jump. By eye."""
CLEAR_SD = 4.0
"""Standard deviations of a range by which it lies between two others: one in 16,000 by chance."""
WIDE_SHARE = 1 / 3
"""Of the jumps that have pixels between: a beam of 2 pixels shows in half of them, one of 1 in a quarter
(measured in ten rooms).
"""
FEWEST_JUMPS = 100
"""That tell how wide a beam is: of so many their share is known to .05."""

# Observation
NEW_SHARE = 0.2
"""Of what a frame measured, from which on it is a key frame. By eye."""
FINER = 2.0
"""Times as fine as before, from which on what was seen is new: a quarter of the area a pixel. By choice."""

# Range noise
FEWEST_TILES = 20
"""In a bin of ranges: the deviation of so many is known to a sixth."""
FACING_COSINE = 0.5
"""Of incidence, 60 deg, from which on a surface's own roughness stretches to less than twice along the
ray.
"""

# Refitting
GRAZING_COSINE = 0.1
"""Of incidence, 84 deg, below which a cylinder's ray tells nothing of it: its noise stretches tenfold."""
MOST_CONDITION = 1e12
"""Of normal equations: beyond it double precision leaves fewer than four digits."""
FEWEST_BLOCKS = 8
"""Whose means tell how residuals correlate: their variance is known to a half."""
LARGEST_RADIUS = 1e4
"""Of a cylinder over that before the step: it has run away to a plane. By choice."""

# Shadow
STRIP_SLACK_PX = 1.5
"""Pixels by which a shadow's strip may differ from its width. By eye."""
STRIP_SLACK = 0.25
"""Share of its width by which it may differ besides. By eye."""
WINDOW_LINES = 9.0
"""Rows or columns that tell once: disparities are found in windows about so wide."""
AGREEING_SHARE = 1 / 3
"""Of the strips that agree, at least: no direction across a baseline has so many."""
SURE_SD = 2.33
"""Standard deviations: 99 %, to one side."""
LEAST_JUMP = 0.03
"""Of inverse depth, 1 / m: a shadow of 1.35 pixels for a baseline of 7.5 cm at 600 pixels of focal length.
By eye.
"""

# Tiles
NORMAL_SD = np.radians(3.0)
"""Of a tile's normal that its side is chosen for at the median range, 3 deg. By eye."""
