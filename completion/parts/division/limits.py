# SPDX-License-Identifier: MIT
"""Limits of dividing and closing parts: each with its unit and where it comes from.

Counts of points, rounds and samples stay where they are used: time grows with them.
"""

from __future__ import annotations

import numpy as np

# Which points a surface explains
CUT = 3.5
"""Standard deviations within which a point is explained: 1 in 2150 is farther by chance."""
MOST_DEVIATION = 2.0
"""Tolerances: where a surface is known worse, it does not grow. Chosen by eye."""
LEAST_ANGLE = np.radians(15.0)
"""Radians between normals, below which points are distinguished by their places. Chosen by eye."""
PLANE_RADIUS = 1e4
"""Extents of the points: surfaces of larger radii are planes. Chosen by eye."""
STILL_SHARE = 0.01
"""Share of the points that change, below which a surface has grown. Chosen by eye."""
MOST_OF_FACE = 0.85
"""Share of the points of a face that a surface explains to be grown from it. Chosen by eye."""
LEAST_POINTS = 8
"""Points of a surface: one more than a torus has parameters. Chosen by eye."""

# Labels
STEP = 0.5
"""Cost of two neighbours that differ: alone among ten, a point needs 3.2 deviations."""
EXPLAINED_COST = 0.5
"""Cost of a deviation of one, 1 / 2: what costs less is explained."""
ISLAND = 5
"""Points: smaller islands of a label take that around them. Chosen by eye."""
NEARLY_ALL = 0.95
"""Share of triangles beside a hole, or of points of a face, that must be of one surface. Chosen by eye."""
CLEAR_GAIN = 0.5
"""Nats a point by which one kind of surface is better than another: of fewer points less is known, but for
ripple."""
LEAST_KEPT = 40
"""Points that are kept of a thinned part. Chosen by eye."""

# Borders
APART = CUT
"""Tolerances between two surfaces, from which on a point's error hardly decides which of them it is given."""
LEAST_INSIDE = 0.3
"""Of the points of a face, that lie clear of the faces beside. Chosen by eye."""

# Free forms
MANY_FACES = 100
"""Faces, from which on it is asked how many points they have. Ten have .8 of them on parts for tuning."""
LEAST_OF_MANY = 0.5
"""Share of the points that so many faces of a part have. Of parts for tuning twenty have .58 and more."""

# Noise
CHANCE = 0.01
"""Probability that noise makes a paraboloid look wrong. Chosen by eye."""
RESOLUTION = 0.01
"""Of the sampling distance: no difference of surfaces shows below it."""
NEAR_RMS = 6.0
"""Rms of a plane's points, within which those on no surface count as its own. Chosen by eye."""

# Meshes
CREASE = np.radians(40.0)
"""Radians between triangles, beyond which a surface has an edge there. Chosen by eye."""
FLAT_ANGLE = 1e-3
"""Radians, below which triangles are one plane. Chosen by eye."""
SAGGING = 0.9
"""Quantile of what triangles are off their surface that counts as their error. Chosen by eye."""
VERTICES_COVER = 0.5
"""Share of the area that vertices stand for, from which on they are enough: more than half."""
LEAST_VERTICES = 1_000
"""Vertices, below which a mesh is sampled. Chosen by eye."""
WIDEST_HOLE = 0.5
"""Of a turn that a hole in a cylinder may take: beyond it the other side could be meant."""

# Tessellated models
ROUNDED_OFF = 1e-7
"""Of the size, within which vertices are one: what single precision does to them."""
MODEL_PRECISIONS = 2e-6, 2e-5, 2e-4, 6e-4
"""Of the size, that corners of a mesh may be off its model: files round, kernels trim, meshers drift."""
HARDLY_MORE = 2.0
"""Times the area that the loosest precision leaves unexplained, up to which a tighter one is preferred."""
SCANNED = 0.95
"""Share of the area that nothing exact explains, from which on a mesh was scanned."""
CHAIN = 4
"""Patches that bend on from one to the next and are on no surface, from which on they are of a free form."""
MODEL_SHARE = 0.75
"""Of the area that exact surfaces explain, from which on a mesh is a model's: hardly any of a scanned one."""
FREE_FORM = 0.005
"""Share of the area on no surface of a known kind that is told. Chosen by eye."""
EXACTLY_FLAT = 1e-4
"""Radians, below which triangles of a model are one plane: tangent fillets begin beyond it. Chosen by eye."""
ROUNDED = 0.01
"""Of the precision, that a corner of a sliver may be rounded by: what turns its normal."""
THIN = 4.0
"""Of the precision, that a triangle is wide whose normal says nothing."""
FACET_TURN = np.radians(36.0)
"""Radians between neighbouring chords of a curved surface: ten to a turn."""
FACET_SLOPE = np.radians(25.0)
"""Radians between a chord and the surface at its middle."""
FACET_SIZES = np.log(8.0)
"""Ratio of areas of neighbouring chords, by its logarithm, from which a surface may start."""
SAG_RATIO, TURN_RATIO = 10.0, 6.0
"""Of the usual sag of a surface's chords, and of its usual turn across them, beyond which a patch is none."""
WIDER = 1.5
"""Of the usual turn across chords, beyond which a wide one is a flat: meshers divide a face evenly."""
MOST_TURN = np.radians(60.0)
"""Radians that a curved surface turns by across a chord, along a diagonal too. Chosen by eye."""
MOST_OF_SURFACE = 0.5
"""Of the area of a curved surface, that one of its chords has: a plane between two chords has more."""
HOPELESS = 30.0
"""Of the precision, that corners are off a surface after a first adjustment, beyond which it is none."""
EXACT = 0.1
"""Of the precision, that a few triangles are off the surface that they make. Chosen by eye."""
