# SPDX-License-Identifier: MIT
"""Limits of extension: what encloses, meets and ends a surface, each with unit and origin.

Lengths are metres and angles radians unless said. Sizes of samples and blocks, and guards against rounding,
stand where they are used. "By eye" stands for a value that was tried on examples, without a measurement.
"""

from __future__ import annotations

import numpy as np

# Adjacency
DEEPEST_M = 0.5
"""Of an inset behind its wall: as thick as walls are."""
PARALLEL_COSINE = np.cos(np.radians(5.0))
"""Of a wall and its inset: 5 deg. By eye."""
APART_SD = 3.0
"""Standard deviations by which one plane lies behind another, or stands off what is claimed: three."""
THROUGH_SHARE = 0.5
"""Of a surface that is seen through the outline of the other: most of it."""
STANDING = (0.25, 0.75)
"""Beta prior that an upright thing goes on to a wall or floor: one in four does, known as of one case."""
MEETING_PAIRS = 8
"""Of neighbouring pixels on both. By eye."""
INNER_SHARE = 0.88
"""Of all measured points on the inner side of what encloses: some lie beyond windows that are half hidden.
By eye.
"""
LEAST_PIXELS = 0.02
"""Share of all measured points on the surface itself. By eye."""

# Claims
FACING_COSINE = np.cos(np.radians(20.0))
"""Of planes that may be taken for one another: 20 deg. By eye."""
CLAIM_SLOPE = np.tan(np.radians(5.0))
"""By which what is one surface was measured apart: 5 deg. By eye."""

SMALL_SHARE, SMALL_M2 = 0.002, 0.05
"""Of all measured area, and square metres: planes of less than both that are no part of the room stay as
measured unless asked for. In a furnished room they outnumber all others. By choice.
"""

# Confidence
WELL_SEEN_SHARE = 0.3
"""Of the outline: from here on the surface's own edges tell what they can. By eye."""
RAGGED_SHARE = 0.15
"""Of the rectangle: how far from its side the outermost cell of a line may lie. By eye."""
NEAREST = 0.02
"""Added to distances, in sizes of the surface, before their logarithm is taken: nearer is as near."""
UPRIGHT_SINE = 0.02
"""Added to a cylinder's lean before its logarithm is taken: axes nearer to a normal, 1 deg, are as
upright.
"""
EXACT_RADIUS = 1e-3
"""Of the radius, added to its deviation in the same way: radii that are known better are as well known."""
PROBABLE = 0.5
"""From which on silent cells are part of the rim of others: more likely than not."""
ENCLOSED = 0.9
"""Share of a rim that is to be measured or inferred surface: a mouth of a tenth is as wide as its part."""
MOSTLY = 0.5
"""The same for shadows on walls, of which one side may border on what is dark."""

# Extent
INNER_POINTS = 0.98
"""Share of a surface's points that lie on the inner side of what it ends at: all but outliers and what
noise puts beyond.
"""
SIDEWAYS_COSINE = 0.7
"""Between a plane's normal and the direction whose side it closes: 45 deg, nearest to that side."""
LEAST_CONFIDENCE = {"conservative": 0.8, "standard": 0.5, "bold": 0.2}
"""Probability below which a place is left unknown."""
LEAST_OF_ROOM = {"conservative": 0.9, "standard": 0.8, "bold": 0.5}
"""The same for floors, walls and ceilings: a wall past a corner that nobody saw is wrong as a whole.

Of places above .8, .94 of floors and .93 of walls were right in kinds of scenes that were left out of the
fit, flats, rooms and walks in turn; of those from .5 to .8, .6 of floors and half of walls.
"""
SPECK_CELLS = 4
"""Cells of an inferred part of a floor, wall or ceiling at least."""
FULL_TURN_ARC = np.radians(90.0)
"""Seen of a cylinder that is closed around its back: 90 deg. By eye."""
MOST_RADIUS_SD = 0.05
"""Of the radius: less certain cylinders are not closed. By eye."""
OUTLYING_SHARE = 0.002
"""Of the measured points, left out on each side of their rectangle. By choice."""

# Features
PAST_SIDE = 0.95
"""Probability of surface just past a side of an opening that was seen: of those that were fitted so, all
had it.
"""
FEWEST_CELLS = 3
"""Across the face of an opening that is a surface of its own. By choice."""
