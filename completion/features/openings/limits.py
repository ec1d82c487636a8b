# SPDX-License-Identifier: MIT
"""Limits of openings, each with its unit and where it comes from.

"By eye" stands for a value that was tried on examples, without a measurement of its own. Numbers of beams,
cells and places that a search takes are by choice: they stand where they are used.
"""

import numpy as np

# Beams at a wall
BLOCKED = 0.20
"""Share of beams that something stops before the wall. By eye, for furnished rooms."""
STRAY = 0.01
"""Share of beams that end anywhere: returns at edges of time-of-flight scans. By eye."""
MEETS = 1 - BLOCKED - STRAY
"""Share of beams that end where the model says."""
LEAST_SLOPE = 0.05
"""Sine between beam and wall: flatter beams do not tell where they cross it. By eye: 3 deg."""
NEAR_SD = 6.0
"""Deviations of the range within which a beam ends at the wall: a beam in 10^9 is farther off."""
OPEN_NEIGHBOURS = 2
"""Pixels beside one that goes on which go on too. Measured: strays without any turned a frame by 3 deg."""
ON_FACE_SD = 3.0
"""Deviations of the range, within which a point lies on a face, and beyond which a leaf lies behind it: 1 in
370."""

# Proposals
CELL_M = 0.05
"""Side of a cell of a wall's chart, where beams are as close. By eye."""
CELL_GAPS = 1.5
"""Distances between beams in a cell, where beams lie farther apart than cells are wide. By eye."""
PLACE_M = 0.25
"""Side of a place whose density of beams tells that distance. By eye."""
DENSE_SHARE = 0.75
"""Of these places, those with the closest beams. By eye."""
MOST_CELL_NATS = 6.0
"""Nats that one cell may tell: those of one beam that stops where an opening is claimed, about."""
BESIDE_NATS = MOST_CELL_NATS / 3
"""Nats that a cell between beams may tell. By eye."""
DEAR_NATS = MOST_CELL_NATS / 2
"""Nats of a cell where most of a rectangle was not seen. By eye."""
LEAST_SEEN = 0.4
"""Share of a rectangle. By eye: of the rectangle around all that is seen, boxes hide less."""
CELL_PRICE = 0.1
"""Nats that each cell of a rectangle costs: what was not seen is not worth claiming. By eye."""
LEAST_NATS = 25.0
"""Of a rectangle that is looked at more closely. By eye: some four cells."""
LEAST_SIDE_M = 0.3
"""Width and height of an opening. By eye."""
LEAST_PROPOSED_M = LEAST_SIDE_M / 2
"""Width and height of a rectangle that is proposed: part of it may be hidden."""
SPECK_M2 = 0.02
"""Area of wall: smaller pieces do not tell how far it goes. By eye: eight cells."""

# Sides of a recess
TILE_M = 0.10
"""Length of a tile along a side: errors within one are shared. By eye; measured: deviations without tiles
were 2.7 to 3.9 times too small."""
AROUND_BEST_SD = 5.0
"""Deviations about the best place, over which its likelihood is looked at closely: all but 1 in 10^6."""
UNTOLD_SHARE = 0.4
"""Of the reach: a place whose deviation is larger is not known. By eye; places all over the reach deviate by
.58 of it."""
END_M = CELL_M
"""From the ends of a side: beams there may be of the next side."""
MOST_DEPTH_M = 0.5
"""Depth of a niche: walls are thinner, what is deeper is a room. By eye."""
PLUMB = np.radians(1.0)
"""Radians, deviation of frames from the vertical. By eye: 17 mm a metre."""
SIDE_GAPS = 2.5
"""Distances between beams that a side is sought over at least. By eye."""
ABOUT_M = 0.3
"""About a side, where beams tell that distance. By eye."""
FAR_SHARE = 0.7
"""Of the reach, within which a side counts as found. By eye."""
INFLATION = 1.9
"""By which deviations of sides were too small. Measured: median of simulated walls 104 to 109."""
FLOOR_M = 0.15
"""Between an opening's foot and the floor that it stands on. By eye: a high threshold."""

# Decision
TILE_NATS = 4.0
"""Nats of a tile that confirms or contradicts: of one beam that goes on where wall is claimed, about 4.5."""
DECIDED_NATS = TILE_NATS / 2
"""By which a tile is wall or open. By eye: odds of seven."""
MOST_BEAM_NATS = 4.6
"""Nats that one beam may tell: ln(1 / STRAY), rounded."""
BAND_M = 0.06
"""Width of the strips beside a side, in which tiles lie. By eye."""
BEYOND_M = 0.24
"""Width of the strip outside these, in which beams that pass tell that the wall ends. By eye: door frames and
shelves are less wide."""
REFUTED_SHARE = 0.3
"""Of a side's tiles that contradict it. Measured: with more contradicted than confirmed it refuses all eleven
of 60 plain walls beyond 20 nats."""
MISTAKEN_SHARE = 0.03
"""Of tiles of true sides that contradict them: a hundredth in a simulated house, thrice that here."""
MISTAKE_LEVEL = 0.01
"""Of the test that the tiles of a side are no more than such mistakes. By choice."""
FEWEST_SIDES = 2
"""Confirmed sides of an opening. By choice: with fewer it has no corner."""
REVEALED = 10
"""Points on reveals from which on they are seen. By eye."""
AROUND_SHARE = 0.8
"""Of a niche's area that must be wall around it. By eye: frames of pictures have less."""
LEAST_NICHE_M = 0.03
"""Depth of a niche. By eye."""
FEWEST_IMAGES = 50
"""Images that a beam answered for: fewer tell nothing of a mirror. By eye."""
IMAGE_TOLERANCE = 0.02, 3.0
"""Metres a metre, and deviations of the range, within which a beam ends at an image: `ON_FACE_SD` beside
errors of the plane. By eye."""
DOOR_M = 1.6
"""Height from which on what stands on the floor is a doorway. By eye."""
CLOSED_M = 0.15
"""Depth up to which the leaf of a closed door lies behind its wall. By eye."""

# Walls, floors, and what is told once
FEWEST_SILENT = 60
"""Beams without a return that may be a pane. By eye."""
MOSTLY = 0.5
"""Of the beams of a rectangle without a return, and of what lies behind a wall and stands before it too, as a
mirror has it: most. By choice."""
BESIDE_M = 0.5
"""Round what was measured of a wall, where openings are sought. By eye."""
LEAST_WALL_M = 0.4
"""Width and height of a wall: an opening and what stands beside it."""
SAME_WAY = 0.98
"""Cosine, 11 deg: least between the directions into two refused or found holes that are one. By choice."""
LEAST_WALL_POINTS = 500
"""Points of a plane in which openings are sought. By eye."""
LEAST_LEVEL_POINTS = 200
"""Points of a level plane. By eye."""
FLOOR_CELL_M = 0.25
"""Cells of a floor, of which people need three each way: .75 m."""
SHARED_AREA = 0.2
"""Of the smaller of two openings that cannot both be there. By eye."""
SAME_M = LEAST_SIDE_M / 2
"""Between the middles of what is one opening, beside half its width."""
