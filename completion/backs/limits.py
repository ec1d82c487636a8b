# SPDX-License-Identifier: MIT
"""Limits of back sides, each with unit and origin.

Shares of size are of the diagonal of a thing's box. "Tuned" stands for a value chosen on the tuning kinds of
`benchmarks/cases/backs.py`; "prototype" for one of the first study, on 159 views of 50 kinds.
"""

from __future__ import annotations

# Views
TOLERANCE = 0.01
"""Share of size by which surfaces may differ and match. Prototype."""
TOLERANCE_SD = 3.0
"""Standard deviations of the range that it is at least."""
JUMP = 0.05
"""Share of size of a step in range that ends a thing or its occluder. Prototype."""
MARGIN = 1.0
"""Extents of the thing's pixels around them that are cut out of the image: mirrored points land there."""
SAME_NORMAL_PX = 0.018
"""Share of size of half the window of a normal; between 2 and 6 pixels. Tuned."""

# Seeing
SAME_NORMAL = 0.75
"""Cosine of 41 degrees up to which normals match. Prototype."""
LATERAL = 4.0
"""Tolerances along the surface within which a point is compared with a pixel's plane."""
LIMB_NEAR, LIMB_DEEP = 0.026, 0.06
"""Share of size across and along the line of sight within which a moved limb point lies on the limb."""

# Points
CELL = 0.012
"""Share of size of the cells of which one point each is kept. Prototype."""
N_POINTS, N_COARSE, N_LIMB = 1600, 500, 150
"""Points of the fine and of the coarse search, limb points of the coarse one. Prototype."""

# Mirrors
STEP_DEG, STEP, WIDEST = 4.0, 0.02, 0.62
"""Degrees and shares of size between tried planes, and their farthest place from the middle. Prototype."""
OFF_PLANE = 0.04
"""Share of size off a plane from which a mirrored point says something. Prototype."""
FREE_WEIGHT, LIMB_WEIGHT = 3.0, 0.4
"""What a contradicted point and a limb point count beside a matched one. Prototype."""
APART_DEG, APART, N_PEAKS = 13.0, 0.08, 8
"""Degrees or share of size between two peaks, and how many are refined. Prototype."""
N_HALVINGS = 5
"""Halvings of the grid about a peak: to 1/8 degree and 0.06 % of size."""
N_ROUNDS = 4
"""Least-squares rounds after it: the next ones change nothing that is seen."""
PIXEL_SD = 0.6
"""Pixels: standard deviation of the distance of two limbs that are each known to a pixel (2 / sqrt(12))."""
FACING_OFFSET = 0.35
"""Cosine between a normal and a mirror's from which a match tells the mirror's place: normals err."""
END_NEAR = 0.03
"""Share of size near the end of a side. By choice: four pixels."""
LEAST_PIXEL_SD = 0.3
"""Pixels: standard deviation of the place of an end, however many points say where it is (1 / sqrt(12))."""
LIMB_FACING = 0.5
"""Cosine between a mirror's normal and the way out of a limb from which the limb is an end."""
CORRELATED = 9.0
"""Neighbouring points that share one error: windows of normals overlap. By choice."""
SQUARE_DEG = 6.0
"""Degrees by which two mirrors may differ from a right angle. Prototype."""

# Axes
N_PAIRS, AXIS_NEAR, AXIS_ROUNDS, N_SECTORS = 150, 0.015, 4, 24
"""Pairs that are drawn; share of size within which a normal's line passes an axis; rounds of least squares;
sectors of the arc. Prototype."""
LEAST_LEVEL = 0.3
"""Horizontal part of a normal from which its line says where an axis is."""
TURNS = (3, 5, 6, 7, 8)
"""Turns that are tried about an axis, besides the full one; 2 and 4 are those of two mirrors."""

# Choice and assertion
OFFERED = 0.5
"""Probability from which a symmetry shapes the closed mesh. Prototype."""
VETO = 0.015
"""Share of size by which a beam must pass a place to refute it. Prototype."""
MOST_SD = 0.008
"""Share of size: asserted surface is known as well along its normal, one standard deviation. Tuned."""
SUPPORTED = 2
"""Turns of a point about an axis that were measured too, at least: handles and spouts have none."""
PASSED_SHARE = 0.2
"""Share of the decided turns of a point that beams may have passed. By choice."""
N_ROUND = 48
"""Turns by which a surface of revolution is asserted: 7.5 degrees."""
ASSERTED_CELL = 0.008
"""Share of size of the cells of which one asserted point each is kept: a pixel."""

# Closing
GRID, MOST_CELLS = 0.0125, 600_000
"""Share of size of the cells of a closed shape, and how many there are at most. Prototype."""
THIN_CELLS = 3.0
"""Cells across the least extent of a thing, at least."""
SKIN = 0.012
"""Share of size behind measured surface within which virtual beams do not carve. Prototype."""
FOOT = 0.08
"""Share of size above the support below which points are put down on it. Prototype."""
N_CARVED = 24
"""Turns by which a surface of revolution carves: 15 degrees. Prototype."""
SPECK = 0.02
"""Share of the largest piece below which a separate one is left out. By choice."""

# Depth
SEEN_DEPTH = 0.05
"""Share of size that is measured along the depth, from which a side or the top is seen."""
DEPTH_SLACK = 0.02
"""Share of size by which a depth whose end was seen may be off. Prototype: 94 % within."""
LEAST_EXTENT = 0.005
"""Share of size by which the measured extent may be too long at least: outermost points are read."""
BACK_FACE = 0.9
"""Quantile of implied surface along the depth that is a back face; small parts stand out. By choice."""
CORNER_APART = 0.05
"""Cells that no corner of the grid lies nearer to the closed surface, so that no triangle is so small
that its corners are one. By eye."""
