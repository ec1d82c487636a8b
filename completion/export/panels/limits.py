# SPDX-License-Identifier: MIT
"""Limits of the light model: each with its unit and where it comes from.

Cells are those of the surface's chart. Counts of steps, samples and places stay where they are used.
"""

from __future__ import annotations

import numpy as np

# Outlines
PRECISION_M = 1e-4
"""Metres, to which coordinates in a chart are rounded, and within which corners of the same surfaces are
one. Chosen by eye, below range noise."""
COLLINEAR_M = 1e-3
"""Metres in a chart: side of the square that a corner must span, and how far one vertex may be from itself
across a seam. Chosen by eye."""
LEAST_CELLS = 9
"""Cells of a part or a hole of an outline: a square of three. Chosen by eye."""
BESIDE_CELLS = 1.5
"""Cells between an outline or a fold and what was measured up to it: the next cell, and half of one for
both outlines."""
EDGE_REACH_CELLS = 4.0
"""Cells between an outline, the end of a fold, or a face, and the edge or corner that it belongs to. Chosen
by eye."""
MEETING_REACH_CELLS = 10.0
"""Cells, the same of an outline where it meets another surface. Chosen by eye."""
STRIP_CELLS = 4.5
"""Cells beside a fold that are filled or cut away: `EDGE_REACH_CELLS` and half a cell."""
CORNER_CELLS = 2.5
"""Cells: side of the square of the least corner of an outline. Chosen by eye."""
SLIVER_CELLS = 1.0
"""Cells of a face of its own; smaller ones join a neighbour. One cell is what the evidence resolves."""
OUTLINE_ERROR_CELLS = 1.0
"""Cells that an outline may be off its polygon: what the evidence resolves."""
LEAST_CHAIN_CELLS = 4
"""Cells of an outline that follow an edge. Chosen by eye."""
GUIDE_SINE = float(np.sin(np.radians(10.0)))
"""Sine of the angle between lines that cross in a corner: 10 deg. Chosen by eye."""

# Folds
CHORD_M = 0.002
"""Metres that a facet of a cylinder is off it, at most. Chosen by eye: about range noise."""
LEAST_SINE = float(np.sin(np.radians(12.0)))
"""Sine of the angle between two planes that meet, and volume of three unit normals that meet in a corner:
12 deg. Chosen by eye."""
STEEP_COSINE = 0.15
"""Cosine between a plane's normal and an axis, below which the section runs along the axis: 81 deg. Chosen
by eye."""
FOLD_REACH_CELLS = 2.0
"""Cells between an outline and a fold that it reaches, between a fold that is known and another, and by
which an outline may follow an edge past where it was seen. Chosen by eye."""
FOLD_CELLS = 3.0
"""Cells of a fold at least, beside a fold at which a surface goes on, and between a corner and the third
surface's outline. Chosen by eye."""
BRIDGED_CELLS = 4.0
"""Cells of a fold along which only one of its two surfaces is there. Chosen by eye."""
CHANGE_CELLS = 5.0
"""Cells along which a surface goes on, or ends, otherwise than before. Chosen by eye."""
SAME_NODE_M = 4e-4
"""Metres between the places of two charts that are one node of a fold. Chosen by eye, above `PRECISION_M`."""
SAME_VERTEX_M = 6e-4
"""Metres between nodes of several folds that are one vertex. Chosen by eye, above `SAME_NODE_M`."""

# Slim faces beside edges
SLIM_REACH_CELLS = 8.0
"""Cells beside an edge that are looked at. Chosen by eye."""
SLIM_BRIDGED_CELLS = 15
"""Cells along an edge without points. Chosen by eye."""
SLIM_LENGTH_CELLS = 6.0
"""Cells of an edge at least. Chosen by eye."""
SLIM_WIDTH_CELLS = 1.5
"""Cells of a face across: `BESIDE_CELLS`, beyond which it is no rim of the surface."""
SLIM_POINTS = 8
"""Points of a face. Chosen by eye."""
SLIM_FLAT_CELLS = 0.4
"""Cells that a point may be off the face, beside three deviations. Chosen by eye."""
SLIM_SHARE = 0.7
"""Share of the points beside the edge that lie on the face. Chosen by eye."""
SLIM_SD_DEG = 5.0
"""Degrees, standard deviation of the angle at most. Chosen by eye."""
SLIM_LEAST_DEG = 20.0
"""Degrees between face and surface at the fold. Chosen by eye."""
SLIM_MEETS_CELLS = 2.5
"""Cells between the far side of a face and another surface that it meets. Chosen by eye."""

# The rest
SAME_PLACE = 0.25
"""Of the reach, within which places on a border are one node. Chosen by eye."""
WITHIN_BOUND = 0.95
"""Share of the places measured whose deviation stays within the bound: the usual level."""
