# SPDX-License-Identifier: MIT
"""Limits of columns, stairs and stated features, each with its unit and where it comes from.

"By eye" stands for a value that was tried on examples, without a measurement of its own. Numbers of points
and places that a search takes are by choice: they stand where they are used.
"""

import numpy as np

from scenes.inclination import LIMIT_DEG, Inclination

FEWEST_POINTS = 20
"""Points in which features are sought. By eye."""

# Upright structure
FLAT_COSINE = np.cos(np.radians(Inclination(0.0, LIMIT_DEG).limit_deg))
"""Of normals of level points along up: those of few neighbours are no better known than the limit."""
STEEP_SINE = np.sin(np.radians(Inclination(0.0, LIMIT_DEG).limit_deg))
"""Of normals of upright points along up: the same angle."""
LEAST_STEPS = 3
"""Of a flight: two give a rise and a going, a third confirms them."""
PATCH_POINTS = 12
"""Points of a level patch. By eye."""
NEAR_POINTS = 2.0
"""Typical distances between points of one patch. By eye."""
SAME_RISE = 0.12
"""Of a rise: how far a step is above or below where the flight has it. By eye."""
ASIDE_GOING = 0.35
"""Of a going: how far its middle is before or behind. By eye: parts of treads are hidden."""
TREAD_DEPTHS = (0.3, 2.0)
"""Goings, least and largest depth of a tread, with its nose and less what hides it. By eye."""
MOST_MISSED = 1
"""Steps in turn that nobody saw. By choice."""
BELOW_TREAD = 0.9
"""Of a rise, below the first tread: points of the floor are no riser's. By eye."""
SHAFT_SPACINGS = 4.0
"""Of the spacing: radius of a shaft, least. By eye."""
SHAFT_SIZE = 0.25
"""Of the size of the scene: radius of a shaft, largest. By eye."""
LEAST_BINS = 6
"""Of 24 directions round the axis: a quarter turn must be seen."""
SHAFT_POINTS = 20
"""Points of a shaft, or of a level about it. By eye."""
AROUND_SHAFT = 0.15
"""Of the radius, within which points lie about a shaft. By eye."""
ON_SHAFT = 0.03
"""Of the radius, within which points lie on a shaft. By eye."""
ON_SHAFT_SD = 4.0
"""The same in noises, where that is more: 1 in 16,000 points is farther off."""
ROUND_SHARE = 0.6
"""Of the points about a shaft that lie on it. By eye."""
BASE_RADII = 3.0
"""Radii of a shaft, within which its base lies. By eye."""
BEYOND_RADII = 5.0
"""Radii up to which levels beyond the base are looked at. By eye."""

# Stated features
LEAST_REVEAL_M = 0.02
"""Depth of a reveal: a sheet has none. By eye."""
TILT = float(np.radians(5.0))
"""Radians between surfaces that are one, and between axes: 5 deg. By eye."""
ALONG = float(np.cos(TILT))
"""Cosine between axes that are one."""
FACE_POINTS = 10
"""Points of a surface on a face that it is. By eye."""
LEAST_CORNER_M = 1e-3
"""Between corners of an outline: what is less is one corner twice."""
OFF_JOINT = 0.1
"""Of a radius, or of a joint's length, by which a surface misses its joint. By eye."""
ONE_SIDE = 0.8
"""Of a surface's measured points, on its side of a joint. By eye."""
NEAR_WALL_M = 0.10
"""Between the corners of an opening and its wall. By eye."""
ON_PLATE = 0.5
"""Of the radius of holes, by which their centres lie off their plate. By eye."""
