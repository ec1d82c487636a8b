# SPDX-License-Identifier: MIT
"""Limits of the room: how things are built and sensors held.

Where no measurement is named, a limit was set by eye.
"""

from __future__ import annotations

# Which way is up: densities of directions, degrees

LEAN_DEG = 1.0
"""Degrees: how far built floors and walls lean from level and upright, one standard deviation.

DIN 18202 allows .2 to .6 deg over 1 to 4 m.
"""
WIDEST_DEG = 20.0
"""Degrees: standard deviation of a plane's normal at most; what is known less tells nothing either way."""
LEVEL_SHARE = 0.30
"""Share of planes that are level, of those by whose normals up is found. By eye, as the next ones."""
FACING_UP = 1.5
"""How many times as often a level plane is seen from above as it would be by chance: sensors stand low."""
ALONG_SHARE = 0.35
"""Share that is upright along one of two horizontal directions at right angles: walls, furniture."""
UPRIGHT_SHARE = 0.12
"""Share that is upright in any direction."""
ROLL_DEG = 8.0
"""Degrees: how far cameras are held from level sideways, one standard deviation."""
PITCH_DEG = (20.0, 28.0)
"""Degrees: how far cameras look down, mean and standard deviation."""
HELD_SHARE, FILE_SHARE = 0.75, 0.15
"""Prior shares of cameras that are held so, and of those whose world has z up; the rest are held anyhow."""
FILE_DEG = 1.5
"""Degrees: how far z of a world of cameras is from up where it is meant to be."""
SCANNER_SHARE, SCANNER_DEG = 0.99, 5.0
"""Prior share of turning scanners that stand upright, and how well, degrees, one standard deviation."""
FILE_AXES = (0.6, 0.25)
"""Prior shares of files of points whose z is up, and whose y is up as in computer graphics."""
LEAST_FACING = 0.5
"""Cosine between the cameras' mean up and z from which z of their world may be meant as up."""
LEAST_HELD = 0.5
"""Length of the mean of the cameras' upper sides from which they are held alike."""
LEAST_TURNED = 0.8
"""Length of the cameras' mean viewing direction from which they look one way, so that they have a roll."""
MARGIN = 20.0
"""Odds within which planes do not decide between two directions: pieces of a wall are not independent."""
PRIOR_MARGIN = 5.0
"""Odds by which the sensor's attitude must then decide between them."""
APART_DEG = 10.0
"""Degrees from which two directions are different answers to what is up."""
N_LARGEST, N_CROSSED = 30, 14
"""How many of the largest planes' normals are tried as up, and of how many the cross products."""
LEAST_CROSS = 0.7
"""Sine between two normals from which their cross product is tried."""
N_REFINED, REFINED_DEG = 16, 4.0
"""How many of the best directions, so far apart in degrees, are refined."""
EXACT_SD = 2.0
"""Standard deviations within which up is taken to be an axis of the world itself: it was meant to be."""

# Pieces of one plane

COPLANAR_SD = 2.5
"""Deviations up to which two pieces may be off one plane."""
COPLANAR_M = 0.04
"""Metres: deviation up to which it is told at all: 4 cm at 3 sd would join across 24 cm."""
COPLANAR_ODDS, OTHERS_WITHIN_M = 5.0, 2.0
"""Odds for one plane against another one anywhere within so many metres."""
BOW = 0.002
"""Metres a metre: how far built floors and walls stray from planes over a distance; DIN 18202 allows 3 mm."""
WIDEST_TURN_DEG = 15.0
"""Degrees about the vertical up to which pieces of a wall may be turned against each other."""
SHIFTED_SD = 1.5
"""Deviations by which the fit to all may shift the largest piece."""
ROUGHER = 1.2
"""How much larger a piece's mean square about the fit to all may be than about its own."""
FLOOR_BELOW_M, CEILING_ABOVE_M = 0.9, 0.4
"""Metres: how far a floor lies below the mean height of the sensors at least, and a ceiling above it."""
WIDE_M2 = 4.0
"""Square metres of a floor that may be nearer below sensors: no table is as large; robots carry them low."""
N_BEAMS = 20_000
"""Beams that are looked at for this."""
ABSORBING_M2, ABSORBING_SHARE = 0.04, 0.01
"""Square metres, and share of a scan's pixels of surfaces, from which a plane takes up points of none."""
ON_PLANE_SD, ON_PLANE_M = 2.5, 0.02
"""Deviations up to which such points lie on it, and the deviation in metres up to which that is told."""
AROUND_PX, SPECK_PX = 7, 60
"""Pixels across of the window most of which must lie on it, and from which a part of them is no speck."""

# Floors and ceilings

LEAST_FLOOR_M2 = 0.04
"""Square metres of a floor or ceiling at least."""
OFF_LEVEL_M, BEYOND_FLOOR = 0.04, 0.03
"""Metres beyond a floor or ceiling, and the share of the points there, from which it is none."""

# Walls

SCAN_BEAMS, N_ROLE_BEAMS = 10_000, (60_000, 400_000)
"""Beams of each scan that are looked at for the roles of planes, and how many of all at least and at most."""
FLOOR_SHARE, WALL_SHARE = 0.002, 0.01
"""Shares of all surfaces' pixels, in the scan in which it has most, from which a level plane may be a floor,
and an upright one a wall."""
LEAST_WALL_M2, LEAST_WALL_M = 0.15, 0.3
"""Square metres of walls at least, and metres each way: smaller ones are of furniture."""
PASSED_M = 0.06
"""Metres behind a plane from which a beam's end passed it."""
BESIDE_M = 2.0
"""Metres beside a wall up to which beams that crossed its plane are kept: doors are sought there."""
OUTLYING = 0.01
"""Share of a plane's points left out on each side of its rectangle."""
ALONG = 0.996
"""Cosine of 5 degrees, up to which lines of the plan are along each other."""
COLUMN_M = 0.1
"""Metres: width of the columns in which beams above what was measured are looked for."""
PAST_END_M = 0.1
"""Metres a wall goes on past its end: corners are rounded, and not measured to the end."""
BOUNDING = 0.5
"""Share of what was measured of a wall that bounds a room at least."""
ABOVE_FLOOR_M, BELOW_M, SLACK_M = 2.0, 0.3, 0.05
"""Metres above the floor up to which a wall stands on it; below others; and slack of all its sides."""
BEHIND_M, OPENING_M = 0.05, 0.08
"""Metres behind a wall from which a place is behind it, and to a beam through it within which it is not."""

BOUNDING_SHARE = 0.1
"""Share of what was measured of a wall before which a room lies from which it bounds that room."""

# Layout

N_WALL_POINTS = 20_000
"""Points of each wall by which is told where along it it was measured."""
STOREY_M = 1.5
"""Metres between the heights of scanners from which they stand in two storeys."""
SLAB_M = 0.1
"""Metres below the floor of a storey, and above its ceiling, to which its plan holds."""
BAND_M = 0.1
"""Metres above the floor and below the ceiling from which beams tell that there is a room."""
ASIDE_M = 0.12
"""Metres before and behind a wall at which is looked what it parts: other lines may be nearer to it."""
FARTHEST_M = 3.0
"""Metres past what was measured to which a wall's corner is sought, and a floor, wall or ceiling goes on."""

PLAN_M, PLAN_CELLS = 0.05, 160_000
"""Metres: squares of the plan by which cells are told apart, and how many there may be."""
AROUND_M = 1.5
"""Metres around what beams crossed that the plan shows."""
SHORT_M = 0.1
"""Metres before a point at which a beam no longer tells that its way was free."""
CROSSINGS = 2
"""Beams from which a place counts as crossed."""
FREE_M2, UNSEEN_M2 = 4.0, 0.8
"""Metres of boundary without a wall that a square metre is worth: crossed but outside; inside but unseen."""
STANDING_M2 = 100.0
"""Square metres that count as crossed where a scanner stands: it is in a room."""
LEAST_FREE_M2 = 0.25
"""Square metres of a room that beams crossed at least."""
SUPPORT_M = 1.0
"""Metres from what was measured of a wall in which it becomes less likely by a factor of e."""
JAMB = 0.7
"""Probability that behind a wall's seen end something stands at right angles to it."""
PARTED = 0.5
"""Share of the border between two cells at which a wall stands from which they are of different rooms."""
