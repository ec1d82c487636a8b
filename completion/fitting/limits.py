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
