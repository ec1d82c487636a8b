# SPDX-License-Identifier: MIT
"""Limits of the separation of things. Where no measurement is named, a limit was set by eye."""

from __future__ import annotations

# Linking of pixels

STEEP = 6.0
"""Spacings of pixels up to which neighbours are linked: a surface seen at 80 degrees."""
N_SIGMA = 3.0
"""Standard deviations up to which a deviation is noise."""
ACROSS_PX = 3
"""Pixels over which neighbours are linked: pixels between may have no return, or belong to two surfaces."""

# What belongs to the room

OFF_PLANE = 0.012
"""Share of its size by which a thing rises above its support at least; measured on simulated views."""
OFF_ROOM_M = 0.02
"""Metres from a wall, a floor or a ceiling up to which a point is of it: skirting, plaster, carpets."""
FLAT_M = 0.06
"""Metres from a wall within which what is fixed to it stays: frames, switches, pictures."""
WITHIN = 0.9
"""Share of the points of a thing of which something holds that is said of the thing."""
DEEP, DEEPEST_M = 0.5, 0.3
"""Widths behind what was measured of a thing that it takes up, and metres at most: half of what is round."""
TALLEST_M = 2.1
"""Metres above the floor up to which a thing may rise whose top is out of sight: higher ones may be walls."""
END = 0.03
"""Share of the height of a thing at its foot and top in which is looked whether it goes on."""
HIDDEN = 0.3
"""Share of the ends of a thing at its foot or top that are out of sight, from which that is."""
SHAFT_M = 1.2
"""Metres above the floor up to which it may rise if its foot is out of sight too: columns are seen so."""
SHAFT_SHARE, RISING_M, JOINED = 0.8, 0.4, 0.25
"""Share of its pixels that are then of one surface; metres that it rises, and share of its sides at which it
goes on into the room, from which it is the end of a wall."""
SLENDER = 2.5
"""Times its width that something whose top is out of sight rises, from which it may be a post."""
PIPE_DIAMETERS = 8.0
"""Diameters from which a level cylinder is a pipe."""
BUILT_IN_M = 0.1
"""Metres below a ceiling from which something reaches it, and is part of the building."""

# Supports

LEAST_SUPPORT_M2 = 0.01
"""Square metres of a level surface on which something stands at least."""
PASSED = 0.2
"""Share of the hull of a level surface that beams passed, from which its pieces are supports."""
INSIDE = 0.6
"""Share of the foot of a thing that lies inside the support on which it stands."""
GROUND_M2 = 1.0
"""Square metres of a level surface from which the largest is the ground where no floor is known."""
ALONG = 0.75
"""Share of the length of a support along the foot of what is on it from which that is a back or an arm."""
FACING_DOWN = 0.2
"""Cosine with down from which a plane above all scanners is of a ceiling, which may slope."""
BELOW = 0.05
"""Share of its points below a support up to which a thing may stand on it."""
FOOT = 0.1
"""Share of the height of a thing that is its foot."""
GAP_M = 0.03
"""Metres between a support and the lowest point of what stands on it; more where pixels are farther apart."""
N_SUPPORTS = 64
"""Level surfaces that are looked at, the largest ones."""

# Things

LEAST_PIXELS = 60
"""Pixels of a thing in the scan that shows most of it at least."""
LEAST_SHARE = 0.001
"""Share of the pixels of the scan that shows most of it at least."""
GLIMPSE_CUT, GLIMPSE_SHARE = 0.5, 0.01
"""Share of its outline that is cut from which a thing is not told, unless it fills this share of a scan."""
LEAST_SPACINGS = 6.0
"""Spacings of pixels along the second longest side of a thing's box at least."""
UNEXPLAINED, RADIAL = 0.5, 2.0
"""Share of pixels of no surface, and depth as a multiple of the width, from which beams met two surfaces."""
STANDS_M = 0.12
"""Metres above a floor from which what was measured of a thing does not reach it."""
N_POINTS = 1500
"""Points of a part of a thing that are kept to compare scans."""
OVERLAP = 0.05
"""Share of the cells of the smaller of two parts, in two scans, that the other has too if they are one."""
CELL_M = 0.03
"""Metres: cells of space in which parts from several scans are compared, unless pixels are farther apart."""
SIDE_PX = 6
"""Pixels beside an outline in which is looked what is there: pixels between that meet both are left out."""
CUT_SHARE, CUT_PIXELS = 0.02, 4
"""Share of the outline of a thing, and pixels, from which it counts as cut by the border or an occluder."""
LEAN_M = 0.01
"""Metres beyond what is of the wall, noise and sampling, up to which a thing leans at it."""
BEHIND_M = 1.5
"""Metres behind a thing up to which a wall is part of what bounds it."""
