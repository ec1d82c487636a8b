# SPDX-License-Identifier: MIT
"""Limits of where one stands and what is seen: floors, rooms, places, coverage; with unit and origin.

Lengths are metres, shares are 0..1. The rules of floors and rooms were tried on the built-in rooms, on
furnished rooms and on houses drawn as BIM models (`tests/nbv/visibility/standing`); "by eye" means that a
value was set on these, and that no range was measured within which results stay the same.
"""

from __future__ import annotations

import numpy as np

# Floors
CELL_M = 0.1
"""Side of a cell of floor. Half the depth of a stair's tread (0.2 m and more), and less than the foot of a
tripod."""
LEAST_SPAN_M = 0.05
"""Free space that is lower is nobody's: half a cell."""
HEADROOM_M = 1.8
"""That a person needs who puts up a tripod: the height of a tall person."""
STEP_M = 0.25
"""The highest riser of stairs that building codes allow (0.2 m), and a little."""
SILL_M = 0.1
"""Lower steps are part of one level patch, and places that differ by less stand at one height; furniture
drops by more all round. At this height panes stop what falls. By eye."""
WALKABLE = float(np.cos(np.radians(45.0)))
"""Cosine of the steepest surface that is floor, and that tours lead over: 45 deg, as in maps for walking
figures (Recast, Mononen 2009)."""
CHEST_M = 1.2
"""Height above the floor at which walls and panes stop who walks. Cupboards and counters that one could
mistake for floor are not higher. By eye."""
SMALL_M2 = 2.0
"""Level patches of at most this area that drop all round are furniture: the top of a large table. By eye."""
ALMOST_ALL = 0.9
"""Share that counts as all: of an outline that drops all round; of floor that turns its back, the inside of a
solid; of the wished samples that must count. By eye."""
TABLE_DROP = 0.35
"""Share of the outline that drops where no step leads to: tables against a wall. By eye."""
SEAT_DROP = 0.2
"""The same of patches of at most `SMALL_M2`: seats and shelves between walls. By eye."""
FOOT_M = 0.25
"""Radius of a tripod's feet. By eye."""
RAMP_DEG = 5.0
"""The steepest ramp that a tripod stands on, degrees. By eye."""
UNEVEN_M = 0.02
"""By how much floor under a tripod may be uneven beside that. By eye."""

# Rooms
OVER_FURNITURE_M = 1.9
"""Height above the floor at which rooms are told apart: over furniture, under the heads of doors. By eye."""
NEAR_FLOOR_M = 1.5
"""Cells farther from the nearest floor are not over furniture. By eye."""
MOST_HEADROOM_M = 6.0
"""Higher space counts as so high: lintels are looked for below it. By eye."""
LINTEL_M = 0.12
"""By which the head of a doorway lies lower than the ceilings beside it: a little more than `SILL_M`. By
eye."""
WALL_M = 0.7
"""The thickest wall with a doorway. By eye."""
DOOR_HEAD_M = 2.6
"""The highest head of a doorway. By eye."""
WIDE_DOOR_M = 2.0
"""From this width on the head is at most `GATE_HEAD_M` high; a beam across a room is wider and higher. By
eye."""
GATE_HEAD_M = 2.2
"""The highest head of such a wide doorway. By eye."""
NARROW_M = 0.5
"""Half the width of a doorway without lintel. By eye."""
WIDER = 2.0
"""How many times wider the rooms on both its sides must be. By eye."""
STOREY_M = 1.5
"""Floors higher than this above the lowest of a storey are of the next one: landings of stairs lie lower,
half storeys higher. By eye."""
STOREY_M2 = 1.0
"""Area of a level patch that makes a storey; treads are smaller. By eye."""
ROOM_M2 = 0.5
"""Smaller parts of a floor are niches; what is too narrow for a tripod is the inside of a wall. By eye."""
MAJORITY = 0.5
"""More than half: of a floor that turns its back where models are orderly; of a room's floor under the sky;
of the level rays from a floor that meet no wall."""
ORDERLY = 0.1
"""Of the largest floors no more than this share turns its back from the second half on in a model whose faces
are turned rightly. By eye."""
OPEN_SIDE = 0.25
"""Share of a room's outline that is open to what lies under the sky: one side of four. Then it is outside. By
eye."""
ROOFED = 0.2
"""Share of the floor within walls that lies under ceilings; with less the model has no ceilings, and floors
with walls around are rooms. By eye."""
PASSAGE_CELLS = 3
"""Fewer cells side by side are no way from room to room: 0.3 m, less than a person's shoulders."""
BELOW_CEILING_M = 0.1
"""By which pictures cut a room open below its ceiling. By choice: one cell."""

# Places for the sensor
SPACING_M = 0.5
"""Between candidate positions, and at most where no floor was seen. By choice: time grows with its square."""
WIDE_SPACING_M = 1.0
"""The same on floors of more than `LARGE_M2`, for cameras, each place of which has 42 directions or more. By
choice."""
LARGE_M2 = 60.0
"""Area of floor from which on positions are so far apart: 240 places, some 10,000 poses of a camera."""
MOST_SITE_POSITIONS = 50_000
"""That can be tried in rooms: 1e9 lines of sight to 20,000 samples, some five minutes on one core."""
MOST_POSITIONS = 600
"""Of a lattice without rooms: beyond it the lattice is coarser. By choice: time grows with it."""
SAME_M = 1e-6
"""Coordinates that differ by less are the same: rounding of files and of turned scenes."""
SAME_SCENE_M, SAME_SCENE = 0.05, 0.01
"""A beam ends at the surface of a scene to within so many metres, or that part of its range. By choice:
models of buildings as designed are off by centimetres."""
FOREIGN, MOSTLY_SAME = 0.02, 0.5
"""A scan of which a smaller share of beams does so is of another place; one below the second is doubted,
since furniture may hide the half of a bare model. By choice."""
CLEARANCE_FINENESS = 5.0
"""Samples of the surface along the clearance: distances are then right to a hundredth of it (half the
diagonal of a cell over the clearance, squared, halved)."""
PATCH_TOLERANCE_M = 0.01
"""By which centres of patches may lie off the mesh. By eye."""
LIFT_M = 0.01
"""Off a face: where the air before it is asked for. By choice: less than boards are thick."""
FINER = 4.0
"""Times as many samples, at most, as in a scene of which all counts. By choice: time grows with it."""

# What is seen, and what completion knows
GRAZING_COSINE = 0.02
"""Cosine of incidence below which nothing counts as seen (88.9 deg): there a pixel's footprint is 50 times
its width."""
INCIDENCE_DEG = 60.0
"""Incidence that counts as measured where nothing else is asked, degrees. By choice: a beam's footprint is
then twice as long as wide."""
ROUNDING_M = 1e-3
"""A sample may lie so far from the measured surface, beside noise and slope. By eye."""
STEEPEST_SLOPE = 10.0
"""Tangent of incidence (84 deg) up to which the slope of a pixel is allowed for. By eye."""
CLOSE_M = 0.02
"""Inferred surface so near to the true one counts as right. By choice: reports name it."""
SAME_WAY = float(np.cos(np.radians(30.0)))
"""Cosine of the normals of one surface, at least: 30 deg. By eye."""
NEAR_SPACINGS = 2.0
"""Unreachable samples so many spacings apart belong together: samples are drawn at random, and gaps are up to
about twice their mean. By eye."""
