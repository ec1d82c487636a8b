# SPDX-License-Identifier: MIT
"""Limits of planning: of the online planner, of plans of a known scene, of real scans without a model.

Lengths are metres, shares are 0..1. "By eye" means that no range was measured within which plans stay the
same. The two limits of normals that a compiled loop reads stand beside it (`nbv.online.voxels`).
"""

from __future__ import annotations

import numpy as np

# Voxels, and floor that was seen
SURE_SD = 3.0
"""Standard deviations of the range by which a voxel must lie off it to be before or behind it: 3 of 1,000 by
chance."""
NEAR_VOXELS = 2.0
"""Sides of a voxel within which distances along a beam are kept: the surface runs between two of them."""
MOST_VIEW_PIXELS = 1_000_000
"""Pixels kept of a scan to tell how well places were measured, 20 bytes each; never finer than half a voxel.
By choice: memory."""
FEWEST_VOTES = -2
"""Least votes of a voxel that beams went through, so that two scans that end in it outweigh all that went
through it before."""
STEADY_SD = 16.0
"""Standard deviations of the range that a slope reaches over: one side's slope then errs by about 5 deg."""
FLATTEST = 0.05
"""Cosine of incidence (87 deg) below which a normal more likely joins two surfaces than belongs to one,
unknown faces do not count, and a ray does not meet the front of a surface."""
FINE_ENOUGH_M = 0.1
"""Side of a voxel down to which large volumes get more voxels. By choice."""
TALLEST_M = 3.0
"""No tripod is taller. By eye."""
LOWEST_M = 0.2
"""What a scanner stands on lies at least so far below it, and candidates where no floor was seen lie so far
apart. By eye."""
STRIDE_M = 0.5
"""Floor that nobody has seen yet is stepped over where it is no wider: less than a person's stride. By
eye."""

# Gain
TRUSTED_RAYS = 50.0
"""Rays, of some 400 a view, as which all that was known before a look counts. By eye."""
REMEMBERED = 0.8
"""Weight of what rays have met before, beside those of the last scan: of the last five scans. By eye."""
CONTINUED_M = (0.5, 1.0, 2.0, 4.0)
"""Distances from what was measured up to which the chances that a surface goes on are counted apart. By
choice."""
FLATTEST_EXPECTED = 0.17
"""Cosine of incidence (80 deg) below which a scan is not expected to measure surface: flatter than this scans
seldom tell a surface."""
STEEP = float(np.cos(np.radians(80.0)))
"""The same of plans of a known scene."""
KNOWN_WORTH = 0.05
"""Worth of meeting the requirement on surface that is known, beside seeing the unknown. By eye."""
RENEWED = 1.04
"""Growth of the number of scans after which they are completed anew: after each of the first 25, then more
seldom. By choice: time."""

# Plans of a known scene
REGISTRATION_COSINE = float(np.cos(np.radians(75.0)))
"""Cosine of incidence below which surface does not help registration. By eye."""
MOST_TRIES = 5
"""Plans made anew without views that cannot be joined to the others, or with another height. By choice."""
GRID_M = 5.0
"""The rule of thumb of a station every five metres (docs/results/building-study.md)."""
INSTRUMENT_M = 1.6
"""Height of an instrument above the floor: eye height, one of the default heights of a tripod. Floor plans
are cut there where no station says otherwise."""
ONE_DOORWAY_M = 1.0
"""Cells of one doorway are nearer to each other: doors are about so wide. By eye."""
BODY_M = 0.15
"""Radius of the sensor's head, which is carried along a tour, and step of the lattice in the air: it fits
through no smaller gap. By eye."""
LEVEL_M = 0.05
"""Floors that differ by less are looked at together: by choice, half a cell."""
SAMPLES_A_BODY = 4.0
"""Samples of the surface along a body's radius: distances to it are then right to 2 %."""

# Real scans without a model
THINNING_CELL_M = 0.05
"""Cell of the lattice by which points are thinned, so that near surface has no more say than far. By
choice."""
STRAY_SHARE = 0.002
"""Share of these cells that may lie beyond the volume on either side: stray echoes. By eye."""
NOTICED_SHARE = 0.005
"""Share of contradicted facets of scans that are placed together from which on a warning names the pair. By
eye."""
MOST_SCAN_PIXELS = 120_000
"""Of a scan; of larger ones every k-th row and column is used. By choice: time grows with it."""
LONGEST_EDGE = 6.0
"""Pixels, and standard deviations, that an edge between neighbouring pixels may span: 80 deg of incidence."""
RIM_M = 0.01
"""Surface so near to a face of the region is in it, however noisy. By eye."""
MOST_CELL_FACES = 1.5
"""Cell faces that the surface in a cell may fill: a slanted one is up to 1.7 times as large as the face."""
NEAR_M = 1.0
"""A scan farther from every station that was planned is none of them; a place farther from seen floor is in
none of its rooms. By choice."""
BELOW_M = 0.3
"""A place so far below a storey's lowest floor still belongs to it. By eye."""
REACH_PX = 4.0
"""Pixels over which a pixel without a normal is as its neighbours are. By eye."""
