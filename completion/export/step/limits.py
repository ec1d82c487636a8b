# SPDX-License-Identifier: MIT
"""Limits of STEP files: each with its unit and where it comes from.

Counts of steps, samples and points of tables stay where they are used: time grows with them.
"""

from __future__ import annotations

import numpy as np

# Sampling distances
TOUCH_REACH = 1.6
"""Sampling distances between a contact and its curve. Chosen by eye."""
MEASURED_REACH = 2.5
"""Sampling distances from a place of a face to a point that was measured. Chosen by eye."""
CONTACT_REACH = 3.0
"""Sampling distances beyond which points do not touch, and contacts are not of a curve even where surfaces
part slowly. Chosen by eye."""
FAR_REACH = 4.0
"""Sampling distances of an added edge from points, of a region from a cone's tip that it has, and radius
from which on points show a whole surface. Chosen by eye."""
SAME_REACH = 0.5
"""Sampling distances between curves that are one, or meet, and between places asked: half the
resolution."""
CORNER_REACH = 0.35
"""Sampling distances: corners that are nearer are one. Chosen by eye."""
COINCIDENT_REACH = 0.05
"""Sampling distances between curves that coincide. Chosen by eye."""
OPEN_COST = 2.0
"""Sampling distances of unmeasured fold that are worth less than a region that stays open. Chosen by
eye."""
STUB = 1.5
"""Sampling distances: no end without a corner is shorter. Chosen by eye."""
SEWING_REACH = 0.02
"""Sampling distances within which edges are one. Chosen by eye."""

# Angles, radians unless said
STEEP = 0.2
"""Sine of the angle between curves, from which on they cross well: 12 deg. Chosen by eye."""
FLAT_SINE = 0.035
"""Sine of the angle between surfaces of a model, below which they touch: 2 deg. Chosen by eye."""
PARALLEL = 1e-8
"""Radians between a cylinder's axis and a plane along it: over 100 mm, `TOLERANCE`."""
MOST_TURN = np.radians(12.0)
"""Radians between steps along a curve. Chosen by eye."""
SMOOTH_ANGLE = np.radians(30.0)
"""Radians, below which surfaces may be meant to touch. Chosen by eye."""
SEAM_ANGLE = np.radians(8.0)
"""Radians between the points of a sphere and its seam. Chosen by eye."""
SECTOR_ANGLE = np.radians(3.0)
"""Radians of the least free sector in which a seam lies. Chosen by eye."""

# Shares
MAJORITY = 0.5
"""Share of an added edge and of a face that must have been measured, and of a region's points that its face
must hold: most of it."""
MEASURED = 0.95
"""Share of a face from which on it counts as measured. Chosen by eye."""
END_QUANTILE = 0.005
"""Quantile of heights at which a region ends, so that single points do not lengthen it."""
SMALL_SHARE = 0.02
"""Share of all points of a region that may be left out. Chosen by eye."""
EXACT_VOLUME = 1e-5
"""Share of a model's volume that rounded vertices may change. Chosen by eye."""
LEAST_POINTS = 6
"""Points, of which fewer have no contacts. Chosen by eye."""

# Exactness of the kernel, millimetres
TRACING_EXACT = 1e-9
"""Millimetres, or radians, that a traced point or a seam may be off: a thousandth of `TOLERANCE`."""
TOLERANCE = 1e-6
"""Millimetres: least tolerance of vertices and edges; the kernel's own confusion is 1e-7."""
SPLINE_EXACT = 2e-6
"""Millimetres that splines may be off: twice `TOLERANCE`."""
