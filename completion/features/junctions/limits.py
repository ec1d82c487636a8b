# SPDX-License-Identifier: MIT
"""Limits of junctions and elbows, each with its unit and where it comes from.

"By eye" stands for a value that was tried on simulated pipes and fillets, without a measurement of its own.
Numbers of points, starts and rounds that a search takes are by choice: they stand where they are used.
"""

import numpy as np

# Patches of a cloud, and where they meet
SIDE_POINTS = 30
"""Points of a patch, or of one of two surfaces that meet. By eye."""
JOINT_POINTS = 2 * SIDE_POINTS
"""Points of a feature: it has two sides."""
PATCH_SD = 3.5
"""Sigmas from its surface, within which a point is on a patch: all but 1 in 2,000."""
PATCH_TURN = np.cos(np.radians(20.0))
"""Cosine between the normals of a point and of its patch: 20 deg. By eye."""
FLAT_SHARE = 0.02
"""Of its size, that a patch bends and counts as a plane: a radius of six sizes. By eye."""
TOUCHING_PAIRS = 6
"""Of neighbouring points, one on either patch. By eye."""
PARALLEL = np.cos(np.radians(15.0))
"""Cosine between the axes of two tubes that join along them: 15 deg. By eye."""
ACROSS = np.sin(np.radians(15.0))
"""Cosine between a tube's axis and the normal of a plane beside it: within the same 15 deg of its plane."""
TANGENT = np.cos(np.radians(25.0))
"""Cosine between normals on either side of a joint: 25 deg. By eye."""
LEAST_TURN = np.sin(np.radians(8.0))
"""Sine by which a pipe turns: 8 deg, `LEAST_ANGLE` of fits."""
SAME_TUBE = 0.2
"""Of a radius, by which two tubes of a pipe differ. By eye."""
MISS_RADII = 0.8
"""Radii by which axes of tubes miss each other. By eye."""
MISS_START = 1.0
"""The same of tubes that were found by consensus in the points of one feature. By eye."""
CORNER_RADII = 9.0
"""Radii from a tube to the corner of a bend. By eye."""
BEND_RADII = 2.2
"""Radii from the axes to points on a bend. By eye."""
ARM_RADII = 8.0
"""Radii along a tube, of what takes part in the fit of a bend. By eye."""
HALF = 0.5
"""Of all points, on a feature that is all of them; and likelihood of being noise, below which a point is on
the surface: even odds. By choice."""
SAME_JOINT = 0.5
"""Of the smaller radius, between the joints of two fits that are one. By eye."""

# Models
WITHIN_SD = 4.0
"""Sigmas within which a point belongs to a surface, and beyond which two surfaces are apart: all but 1 in
16,000."""
OUTLIERS = (0.002, 0.9)
"""Least and largest share of outliers in a mixture: so that both parts have a weight. By eye."""
LEAST_SIGMA = 1e-6
"""Of points at unit RMS: noise of points without any. By eye, above rounding."""
SAME_SURFACE = 1e-2
"""Of points at unit RMS: distance of two fits that are one. By eye."""
SHARPEST = np.radians(65.0)
"""Radians from a plane: a sharp edge that leans more is folded, and halves the room of outliers. By eye: 65
deg."""
ROUGHER = 3.0
"""Times the roughness of small neighbourhoods, beyond which residuals are no noise. By eye."""

# Decision
LOOSE = 0.3
"""Of a value of an elbow, or of the shorter side for the place of a joint, that its standard deviation is:
more is not known. By eye."""
OTHER_RADIUS = 0.15
"""Of a radius, by which another solution differs. By eye."""
TIGHTEST = 0.8
"""Radii of the tube, of a bend: sharper ones are mitres. By eye."""
VAGUE = 0.1
"""Of a junction's radius, that its standard deviation is. By eye."""
AHEAD_NATS = 10.0
"""Before another solution. Set after same-sided joints of like radii came out wrong with 30 % of outliers."""
OUTLIER_NATS = 0.015
"""More of that for each outlier: these lie less evenly than the mixture has it. By eye."""
MANY_OUTLIERS = 0.2
"""Share of outliers from which sides must be apart at their ends. By eye; measured: at 30 % and a noise of 1
mm, radii of 25 to 40 mm fail."""
