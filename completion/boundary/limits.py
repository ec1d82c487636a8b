# SPDX-License-Identifier: MIT
"""Limits of boundaries: rims, edges fitted to them and their continuation, each with unit and origin.

Lengths are metres and angles radians unless said. Sizes of samples and blocks, and guards against rounding,
stand where they are used. "By eye" stands for a value that was tried on examples, without a measurement.
"""

from __future__ import annotations

import numpy as np

# Boundary pixels
NEAR_STEPS = 2.0
"""Between pixels, from a side, within which boundary pixels are of it. By eye."""
RAGGED_SHARE = 0.005
"""Of the rectangle: how far a side that is seen whole may differ from a line. By eye."""
OBLIQUE_SHARE = 0.03
"""Of the length: how far an end that an occluder cuts obliquely may differ from a line. By eye."""

# Continuation
LEAD_CELLS = 4.0
"""Between the end of a run and the hidden zone. By eye."""
CORNER_CELLS = 10.0
"""Of edge beside a seen corner that may be too few to fit a line to. By eye."""
SKIP_CELLS = 2.0
"""Outside the hidden zone that do not end a continuation. By eye."""

# Edges
MIN_POINTS = 8
"""Points of a run: fewer say nothing about a direction."""
GAP = 3.5
"""Steps between pixels that a run may lack."""
SLACK = (0.6, 0.15)
"""How far a point may lie from a curve, of its step across it and of its whole step: half, and some
noise.
"""
MOST_VOTES = 40
"""Of one line among those that are tried, so that long ones do not outvote all others. By choice."""
LEAST_STEPS = 3.0
"""Of a run, in steps between pixels. By eye."""
LEAST_SINE = 0.1
"""Of the angle between surfaces, 5.7 deg: where flatter ones meet is known ten times worse than either."""
SQUARE_COSINE = float(np.cos(np.radians(3.0)))
"""Between a plane's normal and an axis that cut in a circle: 3 deg, whose ellipse differs from it by 0.14
%.
"""
MOST_EDGES = 40
"""Of one surface: later ones are short. By choice: time grows with it."""
LEAST_ARC = np.radians(30.0)
"""Of a circle. By eye."""

# Hidden regions
GOES_ON = 0.9
"""Probability that a surface which goes on behind an occluder ends where its edge does, continued."""
MOST_COST_M = 1e4
"""Of a boundary: more than any surface has outline."""
