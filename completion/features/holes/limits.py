# SPDX-License-Identifier: MIT
"""Limits of patterns of holes, each with its unit and where it comes from.

A spacing is the distance between points of a plate. "By eye" stands for a value that was tried on simulated
plates, without a measurement of its own. Numbers of points, places and rounds that a search takes are by
choice: they stand where they are used.
"""

import numpy as np

# Plates
PLATE_POINTS = 150
"""Points of a plate. By eye."""
PLATE_SHARE = 0.02
"""Of all points that are a plate. By eye."""
SLAB_SD = 4.0
"""Noises on either side of a plate: 1 in 16,000 of its points is farther off."""
EXACT_PLATE = 1e-5
"""Of the diagonal: noise of points without any. By eye."""
EXACT_SPACING = 0.03
"""Of the spacing: noise that makes no difference. By eye."""
ALIGNED = np.cos(np.radians(25.0))
"""Cosine between a point's normal and its plate's: normals of few neighbours scatter. By eye."""
COVERED = 1.2
"""Spacings from a point within which surface was measured: .7 are the corners of a square grid. By eye."""
DENSITY_WIDTH = 6.0
"""Spacings, deviation of the window over which density is averaged. By eye."""
INNER_SQUARE = 0.6
"""Radii, half a square that lies in its hole: a square within the circle has .71."""
FULL_SHARE = 0.25
"""Of the points expected in that square: more fill the hole. By eye."""
FEW_POINTS = 1.5
"""Points in that square, which strays may be: one."""

# Candidates
BEYOND_RIM = 3.0
"""Spacings beyond a rim in which the plate begins where it was not lost. By eye."""
LOST_SHARE = 0.3
"""Before anything is measured: of sectors that are lost beyond a rim, of sectors of a lost patch that reach
farther than is looked at, and of places in a patch. By choice: a third is lost of the plates of the null."""
LEAST_RADIUS = 1.8
"""Spacings, of a hole: smaller circles are empty by chance. By eye."""
MOST_RADIUS = 0.22
"""Of the plate's longest side. By eye."""
RIM_BAND = 1.5
"""Spacings: width of a ring about a hole, of the bands on either side of a rim, and of those above and below.
By eye."""
EMPTY_SHARE = 0.12
"""Of the points expected in a disc, at most. By eye: strays are a tenth."""
MET_SHARE = 0.3
"""Of the points expected on a ring, at least. By eye."""
SURE_NATS = 3.0
"""Of a candidate, from which surface fills a hole, and that a large hole loses at most where its pattern
places it: odds of twenty. By choice."""
LARGE_RADIUS = 8.0
"""Spacings, of circles that are moved and widened at once: their rims are soft by little beside them. By
eye."""

# Beams, bores and rims
BORE_BAND = 0.35
"""Spacings on either side of a rim, within which points are on the bore. By eye."""
BORE_DEPTH = 2.0, 3.0
"""Radii, and spacings, below a plate, in which a bore is looked for. By eye."""
SEEN_NATS = 1.5
"""Of a sector with a wall, and from which a hole is seen. By eye."""
CHANCE_SECTORS = 2
"""Sectors that have a wall by chance, and that lack one. By eye."""
BOSS_FACTOR = 3.0
"""Times a sector's nats, against a hole, where the wall is on the outer side. By eye."""
SIGN_NATS = 4.0
"""Of a beam that went through, for a hole, and of a sector of a whole part without a wall, against it: odds
of fifty. By eye."""
MOST_PASSED = 3
"""Beams that count, since neighbours stray together. By eye."""
NONE_PASSED_NATS = 2 * SURE_NATS
"""Against a hole, where all behind the plate echoes and no beam came through. By eye."""
RIM_GAP = 0.8
"""Spacings from a rim, within which an edge has a wall, and between neighbouring rims: holes that touch are
slots. By eye."""
WALLED_SHARE = 0.6
"""Of the edges of a plate, from which on the part is whole; and of the holes of a pattern with a measured
wall. By eye."""
INNER_BORE = 0.85
"""Of the radius, in which beams that pass are a hole's. By eye."""

# Proposals
N_COUNTS = 10.0
"""Counts that a pattern might have had. By eye."""
EXACT_CANDIDATE = 0.1
"""Spacings, to which a candidate's centre and radius are known at best. By eye."""
SINGULAR = -20.0
"""Log of a determinant against that of parameters that move holes independently: what is less fixes no
pattern. By eye."""
SOFT_PLACE = 0.3
"""Spacings, to which the place of a hole is known. By eye: of random places and of patterns that are
found."""
MOST_IN_LINE = 24
"""Holes on either side of a candidate, or on a circle. By choice: time grows with them."""
NEARBY = 0.7
"""Spacings between a candidate and its place in a pattern. By eye."""
ALIKE = 0.6, 0.05
"""Spacings, and shares of the radius, by which radii of equal holes differ. By eye."""
LEAST_HOLES = 3
"""Holes of a row or a circle that are seen: two are a row wherever they are."""

# Weighing and refinement
WEB_WIDTH = 0.8
"""Of the radius: half the width of a web that is looked at. By eye."""
OPEN_SECTORS = 5
"""Of sixteen, side by side and without a rim, of a notch: 112 deg. By eye."""
OPEN_ALIKE = 4
"""The same where all holes lack the same ones. By eye."""
WEB_POINTS = 4.0
"""Expected on a web that can tell: none are there by chance one time in 55."""
MOST_HOLE_NATS = 3 * SURE_NATS
"""By which one hole counts for or against a pattern. By eye: strays are no holes once in 8,000."""
RADIUS_STEP = 0.15
"""Of the logarithms of radii for which that is measured. By eye."""
UNSEEN_NATS = -0.5
"""Of a hole that nobody saw: less than of none, so that windows end. By eye."""
SOFT_WINDOW = 0.2
"""Spacings, to which a proposal's holes are placed while its window is chosen. By eye."""
SOFT_REFINED = 0.05
"""Spacings, to which holes of a refined pattern are placed. By eye."""
HOPELESS_NATS = -7.0
"""Before refinement, of the most evident pattern: less is not refined. By eye."""
FURTHER_NATS = 0.0
"""The same of further ones: evidence is for them."""
FALSE_FITS = 0.01
"""Of blank plates on which a pattern of any kind that was asked for is found. By choice."""
DOUBTFUL_FITS = 0.5
"""The same of what is ambiguous. By choice."""
PARALLEL = 0.99
"""Cosine between axes of holes that two plates share: 8 deg. By eye."""
MOST_MOVE = 0.8
"""Spacings by which centres and the radius move while they are sampled. By eye."""
SOFT_RIM = 0.15
"""Spacings, to which a rim is known at first. By eye."""
WALL_POINTS = 6
"""Points on a measured wall. By eye."""
WALL_DEPTH = BORE_DEPTH[0]
"""Radii below the plate, in which a wall is looked for."""
NO_WALL = 0.1
"""Spacings: residuals of what is no wall. By eye."""
