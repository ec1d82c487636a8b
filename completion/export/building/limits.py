# SPDX-License-Identifier: MIT
"""Limits of building elements and dimensions: each with its unit and where it comes from.

Layouts of drawings, constants of formats and places that are sampled stay where they are used.
"""

from __future__ import annotations

import numpy as np

# Directions
ALONG_DEG = 5.0
"""Degrees between planes that may be the two faces of a body. Chosen by eye: walls are built to less."""
PARALLEL_DEG = 1.0
"""Degrees to which the faces of a body are parallel, or within three deviations. Chosen by eye."""
N_SIGMA = 3.0
"""Standard deviations within which angles may be equal: 1 in 370 is farther."""
PARALLEL = float(np.cos(np.radians(5.0)))
"""Cosine of `ALONG_DEG`, between walls that have a width between them, and between a side and its wall."""
SQUARE = float(np.cos(np.radians(20.0)))
"""Cosine of a side to the direction that it ends an opening in: 20 deg. Chosen by eye."""
ENDS_IT = 0.5
"""Cosine between a plane's normal and an axis, 60 deg, from which on the plane ends a cylinder. Chosen by
eye."""

# Bodies
MOST_THICKNESS_M = 0.6
"""Metres: greatest thickness that is called a wall or a slab. Outer walls of brick, block and insulation
are .3 to .5 m thick (DIN 4172 has 49 cm as its thickest wall of usual bricks); what is farther apart back
to back is a shaft, a cupboard or a room that was not scanned."""
THIN_M = 0.02
"""Metres: what is thinner is no body and no gap, and within it of a wall a place is on the wall. Chosen by
eye: above range noise, below the thinnest board of a partition."""
SLACK_M = 0.01
"""Metres from either face, within which another surface is that face. Chosen by eye."""
LEAST_OVERLAP_M2 = 0.05
"""Square metres of an overlap of two faces. Chosen by eye."""
LEAST_WIDE_M = 0.1
"""Metres: width of an overlap, and of what counts as gone through, since outlines of openings are off by a
cell or two."""
STANDING_M = 1.5
"""Metres: height of what encloses no room, to be a wall and no furniture, and of a column. Chosen by
eye."""
SLAB_M2 = 2.0
"""Square metres of what encloses no room, to be a slab and no table. Chosen by eye."""

# Storeys and rooms
HEADROOM_M = 1.8
"""Metres that people need above a floor, and from one storey to the next. Chosen by eye."""
LEAST_ROOM_M2 = 1.0
"""Square metres of a floor, a ceiling, and a room. Chosen by eye: closets are as small."""
ENCLOSED = 0.9
"""Share of a room's outline at which a wall stands, from which it is closed: the rest are open doorways."""
LEAST_LEVEL_M2 = 0.25
"""Square metres measured below a level plane, which is no floor then, and of floor below ceiling at which
there is a height. Chosen by eye."""
LEAST_PART_M = 0.5
"""Metres: least width of a room, height of the part of a wall in a storey, and by which an element may
begin below its storey's floor. Chosen by eye."""
SAME_STOREY_M = 0.2
"""Metres by which floors of one storey may differ, as steps do. Chosen by eye."""
LEAST_ROOM_M = 0.3
"""Metres: of a width, a height, and the stretch along which walls face each other, and between a wall and
the floor or ceiling that it ends at. Chosen by eye."""
MAJORITY = 0.5
"""Share that is most of it: of an outline whose walls face inwards, a plane that another one covers, an
opening that beams went through, last cells that beams went by, an opening within another outline."""

# Openings
LEAST_OPENING_M = 0.2
"""Metres of an opening's width and height. Chosen by eye."""
LEAST_OPENING_M2 = 0.2
"""Square metres of an opening. Chosen by eye."""
NEAR_FACE_M = 0.05
"""Metres behind a wall's face at which openings are looked for, radius of the thinnest column, and width of
what is left of a face beside a body. Chosen by eye."""
RECTANGLE = 0.85
"""Of the rectangle around it that an opening must fill to be one. Chosen by eye."""
BESIDE_CELLS = 2.0
"""Cells between a side of an opening and what was measured of its wall. Chosen by eye."""
DOOR_M = 0.1
"""Metres above the floor, or a wall's lower edge, at which a door may begin. Chosen by eye: a threshold."""
DOOR_WIDTH_M = (0.5, 2.5)
"""Metres: least and greatest width of a door. Two leaves of 1.25 m are the widest of DIN 18101; what is wider
and reaches the floor is a passage, or a wall of glass."""
SAME_SIDE = 0.05
"""Of the extent, within which short sides are parts of the longest one there. Chosen by eye."""

# Columns and pipes
FOOT_M = 0.15
"""Metres between a column and the floor that it stands on. Chosen by eye: a skirting."""
PIPE_M = 0.3
"""Metres: greatest radius and least length of a pipe. Chosen by eye."""
SLENDER = 2.0
"""Diameters in a pipe's length. Chosen by eye."""
RUN_DIAMETERS = 10.0
"""Diameters in a run of pipes, all its segments together. Chosen by eye: bottles and rolls have 2 to 5."""
BEND_DIAMETERS = 3.0
"""Diameters from the end of a straight segment to where its axis meets that of the next: a long-radius elbow
of 90 deg takes 1.5 (ASME B16.9), one of 120 deg 2.6, and ends are seen short."""
PITCH_DIAMETERS = 4.0
"""Diameters between the axes of pipes side by side. Chosen by eye: room for fittings; legs stand farther
apart."""
SAME_RADIUS = 0.1
"""Share by which radii of one run may differ: nominal sizes of pipes differ by a quarter (ISO 6708)."""
SAME_POST = 0.7
"""Of the footprint of two walls across each other, which are the sides of one post then. Chosen by eye."""
LEAST_ARC = np.pi / 2
"""Radians of a cylinder's turn that were measured: less does not show that it is round. Chosen by eye."""
NEAR_CELLS = 3.0
"""Cells between measured cells and the plane that they were measured up to. Chosen by eye."""
NEARLY_ALL = 0.95
"""Share of a cylinder's measured cells, beyond which the plane that ends it may cut off some, and of a fold
measured on both sides. Chosen by eye."""
LEAST_EXISTENCE = 0.8
"""Probability that there is an element, from which on dimensions of it are relied on. Chosen by eye."""
LEAST_MEASURED = 0.5
"""Share of what a dimension rests on that must be measured to rely on it: most of it."""
MEASURED_SHARE = 0.999
"""Share from which on an element is called measured: all of it but for rounding of outlines."""
FINE_M = 0.002
"""Metres of a splinter that programs cannot draw, and by which surfaces may go on beyond a room: its
outline is that of fitted planes."""
LEAST_ELEMENT_M2 = 1e-3
"""Square metres of an element in IFC. Chosen by eye."""
