# SPDX-License-Identifier: MIT
"""Limits of the unseen sides of parts, each with unit and origin.

Shares of size are of the diagonal of the part's box. "Tuned" stands for a value chosen on the tuning parts of
`benchmarks/cases/one_sided.py`.
"""

from __future__ import annotations

# Sample
N_POINTS, N_COARSE = 2500, 300
"""Samples of the measured surface: in all, and those of the first test of a mirror."""
N_NEAR = 12
"""Neighbours by which edges and open ends are told."""
REACH = 2.5
"""Sampling distances within which two places of a surface are one."""
GAP = 0.33
"""Share of a turn without a neighbour from which a place is at the end of what was measured."""
DEPTH = 0.002
"""Share of size by which a place lies before or behind measured surface; at least half a spacing."""
SEEN_FROM = 0.97
"""Share of the surface that is seen from a side from which a scan may have been taken."""
N_SIDES, MOST_SIDES = 400, 12
"""Sides that are tried, evenly over the sphere, and how many of those that show all are kept."""

# Mirrors
SAME_DEG, SAME_OFFSET = 1.0, 0.004
"""Degrees and shares of size within which two planes are one candidate."""
MOST_DIRECTIONS, MOST_REFINED = 60, 10
"""Directions that are tried, and candidates that are tested with all samples."""
OFF_PLANE = 0.03
"""Share of size off a mirror from which a sample says something."""
SAME_NORMAL = 0.94
"""Cosine of 20 degrees: normals of one surface at one place."""
MATCH_SD = 4.0
"""Joint standard deviations of two fitted surfaces, and of the mirror, within which they are one."""
EDGE_SD = 0.5
"""Sampling distances: standard deviation of the place of an edge."""
FACE_DATA = 6.0
"""Independent places by which one surface says where a mirror is: its errors are shared. By choice."""
SQUARE_DEG = 2.0
"""Degrees by which two mirrors may differ from a right angle."""

# Axes
N_SECTORS = 24
"""Sectors of a turn by which arcs are counted, and turns by which an axis is tested."""
COAXIAL_DEG = 0.7
"""Degrees between axes that are one; offsets as `SAME_OFFSET`."""
LEAST_ARC = 0.12
"""Share of a turn that a surface must show: an axis is not known from less."""
HALF = 0.5
"""Share of what a surface's best place shows of its turn, from which another place is turned too."""

# Assertion
MOST_REFUTED = 0.15
"""Share of a face's image that may be refuted; else none of it is asserted. Tuned."""
MOST_SD = 0.008
"""Share of size: asserted surface is known as well along its normal, one standard deviation."""
