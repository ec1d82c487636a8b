# SPDX-License-Identifier: MIT
"""Limits of reading scans and scenes: which way is up, what a grid is, which units are doubted.

Each with unit and origin: lengths are metres, shares are 0..1, and what is marked "by eye" was set on the
public files of the tests without measuring a range within which results stay the same. How much
a file may hold: `scenes.io.checks.limits`.
"""

from __future__ import annotations

import numpy as np

# Which axis of a mesh is up
AXIS_LEAD = 1.15
"""How many times the score of z another axis must have: meshes are mostly z up. By eye."""

# Rooms and objects
WALLED = 0.7
"""Share of the level rays from a place that must meet the front of a face, for it to be walled in: one side
of four may be open. By eye."""
ENCLOSED = 0.3
"""Share of the places in the bounding box that must be walled in and have a floor. By eye."""
OPEN_FLOOR = 0.6
"""Share of the footprint that is floor seen from above, of a room without ceiling. By eye."""
ROOM_SIDE_M = 3.0
"""Least side of such a room. By eye."""
ROOM_HEIGHT_M = 1.5
"""Least height of such a room. By eye."""

# Grids of pixels
NARROWEST_STEP = 0.4
"""Of the angle between neighbours: where the step of the angles is looked for from. By eye."""
WIDEST_STEP = 3.0
"""The same, up to. By eye."""
FUNDAMENTAL = 0.85
"""Of the strongest wave in the spectrum of angles: the first so strong is the step, later ones are its
overtones. By eye."""
SHARP = 0.5
"""Strength of a wave that angles in steps have; 1 without any error, 0.1 at random for 100 points. By eye."""
LEVEL_ANGLE = np.radians(60.0)
"""Elevation, radians, up to which points tell the step of the azimuth: beyond it errors of angle count
twice."""
NEARLY_ALL = 0.95
"""Of the points that have a pixel of their own, and of the pixels between filled ones that have a point, in
bins that are wide enough. By eye."""
FILLED = 0.8
"""Share of the pixels between filled ones that have a point, in a grid of an instrument's own steps: glass
and sky leave gaps. By eye."""
FEWEST_POINTS = 100
"""Below which points tell no step, and are no scan. By choice."""
APART = np.radians(5.0)
"""Between consecutive points, radians: so far apart they are of neither one column nor one row. By eye."""
FARTHEST_M = 20_000.0
"""Median range of a moving scanner beyond which its trajectory is of another place. By choice."""
SPARSE = 1000
"""Pixels for each point beyond which no image is made, above `SPARSE_PIXELS` in all. By choice."""
SPARSE_PIXELS = 1_000_000
"""Pixels up to which an image is made however few points it has: 4 MB."""
RANGES_APART = 0.2
"""Relative difference of ranges in one pixel that are of two surfaces. By eye."""
MOST_APART = 0.3
"""Share of such pixels from which the points are of several stations. By eye."""
NARROW = np.cos(np.radians(60.0))
"""Cosine of the half angle up to which the image's middle is put where the points are. By eye."""
FEWEST_LINES = 4
"""Lines of angles that are an instrument's steps: the least number of beams that is sold."""
MOST_BEAMS = 256
"""Of a spinning lidar. By choice: twice the most that is sold."""
LINE_POINTS = 8
"""Mean number of points of a line of angles, so that random gaps make none. By choice."""
STRAY = 0.1
"""Of the median number of a line's points: fewer are strays between lines. By eye."""
N_WIDTHS = 24
"""Of gaps that are tried, each two thirds of the one before: down to 1/17,000. By choice."""
CARRIER_M = 2.5
"""Range up to which what carries the scanner ends: the roof of a car below it. By choice."""
CARRIER_GAP = 1.5
"""From there to all else, as a factor of the range. By eye."""
CARRIER_STRAYS = 0.005
"""Share of all points that may lie in that gap. By eye."""
PINHOLE_LIMIT_PX = 0.5
"""Median residual, pixels, above which an organised cloud is no pinhole image: points lie within their
pixels."""
SPHERICAL_LIMIT_PX = 1.0
"""The same of a spherical image. By eye."""
STEEP = np.radians(85)
"""Elevation, radians, beyond which an azimuth means little: it errs 11 times as much."""
ON_RAY_M = 1e-6
"""At 1 m; a point nearer to its ideal ray than this is stored as a range alone: float32 rounds so."""
LEAST_PIXELS = 1_000
"""That must meet a mesh from a place where a scan is taken of it. By choice."""

# Ranges and poses
OFF_RANGE = 1e-6
"""Relative: how far a range may be from its measured point's distance; files round both."""
CODE_CLOSE = 1e-3
"""Relative: codes for no return lie so close to the fullest number. By eye."""
CODE_SAME = 1e-5
"""Relative: what files round away."""
MOST_CODES = 8
"""Different codes, at most. By choice."""
LEAST_TIMES = 20
"""How often each must be there: measured ranges do not come again so often. By eye."""
CODE_GAP = 1.2
"""From the farthest real range to the codes, as a factor. By eye."""
CODE_STRAYS = 0.05
"""Of as many numbers as codes may lie in between: mixed pixels. By eye."""
CODE_SPREAD = 5
"""Rows and columns over which codes are spread: a true distance that comes again and again does so in one
place. By eye."""
MULTIPLES_OF_8 = 0.9
"""Share of depths that are multiples of 8 in images whose bits are turned; one in eight by chance, all of
depths below 8.2 m by turned bits. By eye."""
ENOUGH_POINTS = 200
"""Points that both images of a pair see, for their depths to be compared. By choice."""
BETTER = 2.0
"""How many times smaller the disagreement must be under another convention of the poses; medians of thousands
of points. By eye."""
GOOD = 0.03
"""Of the depth: above it the other convention explains nothing either. By eye."""
UNIT_TOLERANCE = 0.1
"""Relative: by which the length of a direction or of a quaternion may be off one. By choice."""
ORTHONORMAL_TOLERANCE = 1e-5
"""Of a rotation: float32 files carry rotations to about 1e-7, hand-typed ones to 1e-6."""
FILE_ROTATION = 1e-3
"""Of a rotation in a file of poses, which is then made orthonormal: float32 chains and five printed digits
stay below this."""
TIME_GAP_S = 0.02
"""Seconds between an image and its pose: the TUM benchmark's own limit for what belongs together."""

# Units that are doubted
FAR_M = 200.0
"""Median range beyond which the unit or the depth scale is doubted. By choice."""
SMALL_M = 0.05
"""Median range, or diagonal of a scene, below which it is. By eye."""
TINY_M = 5e-3
"""Median range below which a scan is refused: no scanner measures so near. By choice."""
LARGE_M = 1e3
"""Diagonal of a scene beyond which it is. By eye."""
MOSTLY_SEEN = 0.5
"""Share of a mesh's area, seen from the places given, below which a word is due. By choice."""
LARGE_PART_M = 20.0
"""Diagonal of a part beyond which it is. By eye."""
FINE_M = 1e-3
"""To which coordinates should be known; coarser ones were stored far from the origin in float32. By
choice."""

# Moving scanners
LONGEST_GAP_S = 1.0
"""Seconds between poses of a trajectory, across which no place is interpolated: a person turns within one."""
MOST_STRETCHES = 20_000
"""Of a walk that are scans together: half an hour at walking speed. By choice."""
NEW_SHARE = 0.2
"""Of the cells that a stretch of a walk measured: with more of them new it is read. As for key frames."""
