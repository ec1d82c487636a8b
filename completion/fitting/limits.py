# SPDX-License-Identifier: MIT
"""Limits of fits: each with its unit and where it comes from.

Numbers of points, starts and steps that a fit takes are no limits: time grows with them.
"""

from __future__ import annotations

import numpy as np

# Degenerate points
FLAT = 1e-9
"""Of the greatest singular value, below which one counts as zero: well above rounding, 1e-16 sqrt(n)."""
MOST_EXTENT_M = 1e60
"""Metres; fourth powers of coordinates stay below the largest double, 1.8e308. Its inverse is the least."""
LEAST_RADIUS = 4.0
"""Times the residuals' rms, for a radius: a layer of noise has two sides, some sd apart. Chosen by eye."""
CHANCE_OF_BEND = 1e-3
"""That noise on a plane shows as much of a bend (likelihood ratio, Wilks 1938). Chosen by eye."""
MOST_CONDITION = 1e13
"""Of scaled normal equations: beyond it fewer than three of a double's sixteen digits are left."""
LEAST_CURVATURE = 1e-6
"""Inverse rms radii of the points: radii a million times their extent count as flat. Chosen by eye."""

# Consensus
LEAST_ANGLE = np.radians(8.0)
"""Between the normals of a minimal set, radians: of closer ones noise decides the axis. Chosen by eye."""
LEAST_AGREEING = 0.2
"""Share of the points that must agree with the best surface. Chosen by eye."""

# Robust weights
TUKEY = 4.685
"""Sigma, Tukey's cut: 95 % efficient for normal residuals (Holland and Welsch 1977)."""
CUTS = (20.0, 14.0, 10.0, 7.0)
"""Sigma, from round to round before `TUKEY`: the scale is annealed, since these weights have local minima."""

# Rays
LEAST_SLOPE = 0.1
"""|Cosine| between ray and normal, below which rays graze: distances are ten times as long along them."""
STILL = 1e-10
"""Of the points' rms radius: a smaller step is the last. Chosen by eye, above rounding."""

# Selection
LEAST_RATIO = 20.0
"""Of evidence for a shape against another: "strong" (Kass and Raftery 1995)."""
ROUNDING = 1e-12
"""Of the points' extent: smaller residuals count as rounding. Some thousand times 2e-16."""

# Free-form patches
SQUARE = 1e-10
"""Radians: planes that are off by more leave no corner at which both joins hold. Above rounding."""
EXACT_JOIN = 1e-10
"""What others leave of an equation that is independent of them: above rounding."""
NEARLY_JOIN = 1e-5
"""The same of equations that were linearised."""
END_SHARE = 0.01
"""Of a strip's points, that lie beyond its ends: outliers. Chosen by eye."""
NEAREST_SHARE = 0.05
"""Of the points, those nearest to a surface, which show its trace. Chosen by eye."""
CLOSE_RADII = 0.3
"""From an axis, within which points are not unrolled about it. Chosen by eye."""
LEAST_TRACE = 0.2
"""Length of the mean trace of points about a boundary, of those of one: less has no direction. Chosen by
eye."""
BEYOND = 3.0
"""Residuals (rms) from a boundary, from which on a point lies beyond it: 1 in 740."""
MANY_BEYOND = 0.05
"""Share of the points beyond a boundary that is worth a warning. Chosen by eye."""
OFF_CYLINDER = 1e-6
"""Radians by which a join misses a cylinder: a polynomial of degree five follows .15 radians of it within
1e-7."""
OFF_PLANE = 1e-9
"""The same of a plane, which a patch meets exactly: above rounding."""
WORSE_RMS = 1.05
"""Times the rms without joins, from which on these are doubtful. Measured: 1.012 at most, three planes."""
SMOOTHING = 1e-9
"""Weight of the thin plate, a point: of a patch as large as its points scatter, far below their errors."""
CYLINDER_SPAN = 0.15
"""Radians about a cylinder that a span of the patch covers: degree five follows them within 1e-7."""
FAR_SIZES = 1.0
"""Sizes of the cloud: surfaces that are farther off bound nothing. Chosen by eye."""
MOST_STEP = 0.1
"""Of u and v that feet of points move at once: beyond it the linear picture does not hold. Chosen by eye."""
BESIDE = 0.05**2
"""Weight of a point's offset along the surface beside that across it; it keeps controls from sliding. Chosen
by eye."""
STILL_RMS = 2e-3
"""Share by which the rms falls in the last round. Chosen by eye."""
EVENNESS = 1e-7
"""Weight, a point, of parameters that run evenly, at most. Chosen by eye."""
EVEN_BY_NOISE = 4e-3
"""And of the squared rms at unit size: what is measured better is smoothed less. Chosen by eye."""
STILL_SURFACES = 0.01
"""Of a point's error, by which surfaces move in the last round. Chosen by eye."""
