# SPDX-License-Identifier: MIT
"""Limits of registration: each with its unit and where it comes from.

Angles are radians, lengths metres in the unit of registration (1 m, less for small objects), unless said.
Numbers of candidates and rounds are by choice where nothing else is said: time grows with them.
"""

from __future__ import annotations

import numpy as np

# Facets: tiles of a scan
MOST_TILES = 20_000
"""Of a scan, about; larger images are cut into larger tiles. By choice: time grows with it."""
ROUGHEST = 2.0
"""Weighted square residual by freedom of a tile that counts as flat; 1 is expected of noise alone."""
MOST_BENT = 0.15
"""Of a tile's side, by which curved ones may stray. By choice."""
LEAST_FILL = 0.9
"""Share of a facet's pixels with a range. By choice: tiles at edges have less."""
LEAST_COSINE = 0.05
"""Of incidence that areas and variances of pixels are computed with: 87 deg."""
MOST_FACETS = 1500
"""Of a scan that are compared with other scans. By choice: `INDEPENDENT` of them count."""
LEAST_DISTANCE_M = 1e-12
"""So that nothing is divided by zero."""
SAME_SURFACE = 0.8
"""Cosine of the normals of two facets of one surface: 37 deg."""
OTHER_SURFACE = 0.5
"""Cosine of the normals of two facets that are not of one surface: 60 deg."""

# How far poses may still be off, metres, stage by stage
GATES_M = (0.3, 0.2, 0.12, 0.08, 0.05)
"""Between facets that meet, round by round; the last holds until nothing moves."""
GATE_M = GATES_M[0]
"""Between facets that meet at all: what poses may be off at most to be corrected."""
LAST_GATE_M = GATES_M[-1]
"""Between facets that meet at the end."""
NETWORK_GATES_M = (0.15, 0.1, 0.05)
"""The same for scans that are in one group already; the first also for residuals."""
COARSE_M = 0.2
"""Of candidates. By choice."""
MIDDLE_M = 0.08
"""After a short refinement, and the thickness of what counts as one plane. By choice."""
FINE_M = 0.01
"""After a full refinement, and between two facets at the same place. By choice."""

# Evidence of a pose
COARSE_VIOLATION = 3.0
"""Facets that agree which one that is violated outweighs, of candidates (Robertson & Fisher 2002). By
choice."""
VIOLATION = 20.0
"""The same in the end: ln(q / e) / ln((1 - e) / (1 - q)) is 19 for violations of e = .1 %
when right and q = 25 % when wrong."""
LEAST_SCORE = 0.4
"""Of a pose that is worth a mention, and what a correction may lose (a score is at most 2). By choice."""
MOST_VIOLATED = 0.02
"""Share of facets that beams may contradict in such a pose. By choice."""
LEAST_STIFFNESS = 0.001
"""Of 1 / 6, of a motion that does not slide. Measured: poses that were off by more than 1 cm had .0002 at
most (60 pairs of furnished rooms)."""
RIVAL = 0.5
"""Share of the best score from which on another pose is named as an alternative. By choice."""
TRUST = 7.78
"""Log odds of a right pose, changed by those below. Measured: logistic regression on the pairs and
strangers of 300 furnished rooms."""
BY_RIVAL = -3.96
"""For the second score as a share of the first; the same regression."""
BY_VIOLATION = -210.0
"""For the share of violated facets; the same regression."""
BY_BEYOND_PLANES = 1.43
"""For the logarithm of what agrees beyond three planes; the same regression."""
LEAST_BEYOND_PLANES = 0.005
"""Added to that, so that it has a logarithm: six facets of 1200."""
CLAIMED_FROM = ((0.001, 0.97), (0.01, 0.8), (0.05, 0.6), (0.2, 0.4))
"""Accepted share of false claims, and the probability from which on a pose is claimed. Measured on pairs of
furnished rooms and on pairs that have nothing in common."""
CLAIMABLE = CLAIMED_FROM[-1][1]
"""Probability from which on a pose may be claimed at any level."""

# Errors
INDEPENDENT = 20.0
"""Facets of a whole image whose errors are independent: lenses bend whole walls, which neighbours share.
Of facets that two scans share, their part of it. By choice."""
LEAST_MEETINGS = 20
"""Facets of two scans that meet before they count: `INDEPENDENT`."""
LEAST_FOR_MOTION = 12
"""Facets that meet of a motion, or of two planes that are one surface: twice a motion's six numbers."""
MAD_TO_SD = 1.4826
"""Of a normal distribution: 1 / quantile(3 / 4)."""
SURE = 3.0
"""Standard deviations from which on a difference is no chance: 1 in 370."""
BOUND = 2.0
"""Standard deviations within which a pose is taken to be known: 95 %."""
ROBUST_PRIOR = 2.0
"""Robust standard deviations from which on an offset counts for little, of poses with a prior. By choice."""
NOTICED_M = 0.001
"""By which poses are to be off before they are moved: surfaces are no flatter (`FLATNESS_M`)."""
CONTRADICTED_SHARE = 0.1
"""Of what two scans measured, from which on contradictions are worth a warning. By choice."""
CONTRADICTED_M2 = 0.1
"""The same in square metres. By choice."""

# Directions
PARALLEL = np.cos(np.radians(5.0))
"""Cosine between planes of one direction: 5 deg. By choice."""
LEAST_TURN = np.radians(5.0)
"""Less is no other turn: 5 deg, as `PARALLEL`."""
ALONG = np.cos(np.radians(15.0))
"""Cosine within which shifts are along one direction, and facets of one plane face alike: 15 deg. By
choice."""
SAME_DIRECTION = np.cos(np.radians(6.0))
"""Cosine of directions that a rotation brings together, and of up in two scans: 6 deg. By choice."""
SAME_ANGLE = np.radians(4.0)
"""By which angles between directions may differ: 4 deg. By choice."""
LEAST_SINE = 0.3
"""Of the angle between two directions that fix a rotation: 17 deg."""
LEAST_VOLUME = LEAST_SINE
"""Triple product of three directions that fix a place."""
N_DIRECTIONS = 9
"""Of a scan's planes that propose poses, those of the largest area. By choice: time grows with the fourth
power."""

# Views and their samples
N_SAMPLES = 1200
"""Facets by which poses are compared: sampling error of a share at most .015."""
N_JUDGES = 400
"""Facets of each scan that judge poses which are not settled yet: sampling error at most .025."""
N_SCREENS = 57
"""Facets of each scan that screen poses: sampling error at most .07."""
STAND = 0.1
"""Of the radius, within which a scanner sees what it stands on, which moves with it. By choice."""
LEAST_SPREAD_M = 1.5
"""Metres: root mean square distance of points to their middle that is scaled to the unit of registration, a
desk."""
N_POINTS = 5000
"""Points of a scan that give this. By choice."""
CELLS = 6
"""Along the edge of the cube map in which facets are counted by what they face: 15 deg."""

# Candidates: how many, and in what steps
N_ROTATIONS = 40
"""From pairs of directions."""
N_VOTES = 9
"""Offsets along a direction."""
N_FEW_VOTES = 4
"""Of them, where all places along a third direction are tried."""
SAME_OFFSET_M = 0.05
"""Offsets that are one vote. By choice."""
STEP_M = COARSE_M
"""Along a direction that no plane fixes."""
N_SHARED = 4
"""Directions of each scan that may be the shared plane."""
N_HEIGHTS = 2
"""Offsets along a shared direction."""
TURN_STEP = np.radians(5.0)
"""Between turns about a shared plane: 5 deg shift what is 2 m off by less than `COARSE_M`."""
CELL_M = 0.15
"""Of shifts that are voted for, and between heights of facets that meet. By choice: below `COARSE_M`."""
FACING_TURN = 0.94
"""Cosine of what facets face that vote for a shift: 20 deg."""
ALONG_PLANE = 0.8
"""Cosine to the shared direction from which on facets fix no shift: 37 deg."""
N_PEAKS = 3
"""Shifts of a turn."""
N_TURN_CANDIDATES = 4000
"""Kept, by votes."""
EVERY = 6
"""Facet of the sample that votes."""
N_TURNS = 2000
"""Rotations of free forms, some 20 deg apart."""
N_FORM_FACETS = 160
"""Of each free form that vote."""
FORM_CELL = 0.35
"""Of the smaller scan's spread, a cell of shifts: what a turn of 20 deg shifts it by."""
FACING_FORM = 0.92
"""Cosine of what facets face that vote: 23 deg, for turns 20 deg apart."""
N_FORM_CANDIDATES = 3000
"""Kept, by votes."""

# Search: poses screened, refined shortly and fully; rounds and every so many-th facet
OF_ROOMS = (1500, 30, 10)
"""Poses that are screened, refined shortly and refined fully. By choice: time grows with them."""
OF_OBJECTS = (3000, 100, 20)
"""The same of free forms, which score little before they are close."""
SHORT = (4, 4)
"""Rounds, and every so many-th facet, of a short refinement."""
FULL = (12, 1)
"""Of a full one."""
LAST = (60, 1)
"""Of the last one: curved things creep into place."""
N_KEPT = 5
"""Distinct hypotheses of a pair."""
DISTINCT_TURN = np.radians(10.0)
"""Radians by which poses are distinct."""
DISTINCT_SHARE = 0.25
"""Of the spread by which poses are distinct."""
SLIDES_M = (-0.8, -0.5, -0.3, -0.2, -0.1, 0.1, 0.2, 0.3, 0.5, 0.8)
"""Along what facets fix least. By choice."""
N_SLIDES = 4
"""One after the other."""
BETTER = 0.01
"""Score by which a slide is better: twelve facets of the sample."""
N_JOINT = 8
"""Candidates of a joint placement that are refined."""
N_FREE_PLANES = 3
"""Planes that a pose can bring together: six numbers."""
N_SEEDS = 30
"""Facets whose planes are tried."""
LEAST_SHIFT_M = 0.5
"""Of a place onto itself: less is the same pose. By choice."""
N_SHIFTS = 300
"""Of a place onto itself that are screened."""
N_SHIFTS_REFINED = 8
"""Of them that are refined."""

# Least squares: when they end
SMALL_STEP = 1e-5
"""Metres, or of the reach, below which nothing moves any more."""
OF_SD = 0.05
"""Step in standard deviations of the pose itself, from which on nothing moves any more."""
RIDGE = 1e-4
"""Of the mean eigenvalue: what facets do not fix stays as it is."""
RIDGE_OF_GROUP = 1e-6
"""The same of a group, whose scans fix each other."""
N_ROUNDS = 15
"""Of a group, in which facets meet anew."""
SAME_PLANE_M = 0.03
"""Between a facet and the plane that it lies in."""
N_ROUNDS_PLANES = 8
"""Of poses and planes together."""
STILL_PLANES = 1e-7
"""Step, radians and metres, that ends these."""

# Prior of poses that came
N_ROUNDS_PRIOR = 40
"""In which facets meet anew."""
N_PRIORS = 30
"""Steps in which the scales of the prior are learned, in each of them."""
STILL_PRIOR_M = 1e-4
"""By which no facet moves any more in a round."""
FIRST_M = 0.05
"""How far off poses are taken to be at first."""
LEAST_SCALE_M = 1e-4
"""How well poses are taken to be known at most."""
MOST_SCALE_M = 1.0
"""How far off they are taken to be at most: where facets fix nothing the scale has no end."""
KNOWN_M = 1e-9
"""Scale of a scan that stays where it is."""
N_PARTNERS = 8
"""Scans that each one is compared with, those that it shares most with."""
THINNED = 8
"""Facets of which one shows what scans share."""
N_TOGETHER = 64
"""Scans that settle together, the others among these: (6 n)^3 operations."""
