# SPDX-License-Identifier: MIT
"""Limits of profiles, each with its unit and origin."""

from __future__ import annotations

import numpy as np

SAME_DIRECTION = float(np.radians(0.5))
"""Radians within which directions may be one, where they are not known worse: half a degree. By choice."""
BUILT_SD = (float(np.radians(0.01)), 2e-6, 2e-6)
"""Of angles (radians), lengths and radii (metres), by which a face may be off its sweep for all that its
points tell: .01 deg, 2 um. The least draft of castings is fifty times that; files hold micrometres.
"""
FAR_SD = 6.0
"""Standard deviations from which on a face is not swept: as for relations."""
REACH = 4.0
"""Sampling distances within which ends meet in a corner: noise leaves two or three at an edge without a
face. By choice."""
WIDE_REACH = 10.0
"""The same of ends that nothing nearer meets, such as beside an edge break that is no face."""
FUZZ = 3.0
"""Times the root of noise and radius, over which a line and an arc that touch cannot be told apart: at
twice the root they are two deviations apart."""
GAP = 3.0
"""Sampling distances without a point that part a wall in two."""
LEAST_HEIGHT_SHARE = 0.5
"""Of the height between two caps over which a wall has points there. By choice."""
TURN_SHARE = 0.6
"""Of a turn that a surface of revolution goes on, in the mean of its profile: more than half, with slots."""
RIB = 4.0
"""Length over width from which a boss is a rib. By choice."""
SMOOTH = float(np.radians(12.0))
"""Between neighbours at their corner, below which they may be tangent: noise of .1 mm on arcs of 4 mm."""
SWEPT = float(np.radians(15.0))
"""Of a face to the motion of its points, below which it may be swept: a small cone on a noisy wall is."""
EXACT = 1e-6
"""Of the extent of a part: noise of exact points, as 32-bit numbers give them. By choice."""
GUARD = 2.0
"""Deviations of noise from a corner within which a point may be round it."""
CUT = 4.0
"""Deviations of noise from a wall within which its points are: one in 16,000 is farther off."""
NATS = 1.0
"""Of the logarithm of the number of points, times a parameter: the Bayesian information criterion (Schwarz
1978), in squares over those of noise.
"""
CELL_NOISES, CELL_SPACINGS = 4.0, 2.0
"""Deviations of noise, and sampling distances, that a place on a curve is wide at least. By choice."""
LEAST_SHARE = 0.1
"""Of a part that is swept, from which a cloud is divided anew in the profile."""
LEAST_P = 1e-4
"""Of the test that neighbours are one line or circle, below which they are not. By choice."""
SAME_NOISES, SAME_SPACINGS = 2.0, 0.2
"""Deviations of noise, and sampling distances, by which loops at other heights may differ in the mean."""
