# SPDX-License-Identifier: MIT
"""Limits of flattening: each with its unit and where it comes from.

Nats are logarithms of likelihood. Counts of rounds and sizes of windows stay where they are used.
"""

from __future__ import annotations

# Areas and their borders
FLAT = 1 / 15
"""Of the step that pays for its border: less is none. Chosen by eye."""
EVIDENCE = 0.5
"""Nats a cell of border, up to which two pieces are one. Chosen by eye."""
PRICE = 2.0
"""Nats a cell of border: what a border may take where there is none. Chosen by eye."""
PIECE = 2.0
"""Nats for a piece, as `PRICE`. Chosen by eye."""
LEVEL_PRIOR = 4.5
"""Nats by which another area is more probably level with the plane than not, before it is measured: 1 in
90. Chosen by eye."""
PLANE_SHARE = 0.2
"""Of the largest area: smaller ones are not the plane. Chosen by eye."""
SHARED_BORDER = 0.05
"""Of its border: an area that shares no more of it with the plane is apart from it. Chosen by eye."""
BORDER_ERROR = 0.1
"""Of the ripple's sd, by which levels may be off for the place of a border. Chosen by eye."""
KNOWN_LEVEL = 0.3
"""Of the ripple's sd: levels that are known less well say nothing. Chosen by eye."""
NEAR_PLANE = 0.5
"""Of the ripple's sd: how far the mean of the plane may lie from zero. Chosen by eye."""
RIM_CELLS = 3
"""Cells beside a border that are not as high as their area: the border slopes, or is a cell off."""
LEAST_RIM_CELLS = 8
"""Cells of border at least. Chosen by eye."""
USUAL_SD = 3.0
"""Standard deviations within which heights count fully, and a vertex beside another plane lies on it too: 1
in 370 is farther."""

# Ripple
MOST_KNOWN = 0.7
"""Share of a window that must be known to learn from it. Chosen by eye."""
LEAST_STRENGTH = 0.7
"""Of the mean strength of ripple, from place to place. Chosen by eye."""
OUTLIER = 8
"""Times the middle size of errors, beyond which one does not count. Chosen by eye."""
MOST_WINDOW = 0.5
"""Of the canvas: areas with larger windows are whitened on all of it. Chosen by eye."""
JUMP_OUTLIER = 4.5
"""Standard deviations of the differences of neighbours, beyond which one is a jump: 1 in 150,000 is by
chance."""
ENOUGH_KNOWN = 0.05
"""Of the cells around one that must be known to fill it. Chosen by eye."""
SPIKE = 6.0
"""Times their middle size, by which differences from all neighbours make a spike. Chosen by eye."""
FIRST_PRICE = 0.9
"""Of the root of a step's energy: the first, convex price of a step for each cell of its border. Chosen by
eye."""

# Relief
CLEAR_EVIDENCE = 10.0
"""Nats: what is as evident as this is left out of the error from which walls are drawn; 1 in 22,000."""
FARTHEST_SD = 5.0
"""Standard deviations: what is farther is no noise, 1 in 1.7 million."""
LEAST_SIDE_CELLS = 24
"""Cells along a side: half a window, of fewer no ripple is learned."""
LEAST_AREA_CELLS = 1000
"""Cells of an area: of fewer no ripple is learned. Chosen by eye."""
LEAST_RELIEF_CELLS = 4
"""Cells: errors of fewer are no relief, however evident. Chosen by eye."""
CLEAN_LEVEL = 0.25
"""Of the ripple's sd: how well the level of relief is known from which ripple is taken. Chosen by eye."""
OWN_SHAPE = 2.0
"""Times the ripple's sd: relief that varies by more has a shape of its own. Chosen by eye."""
GRAZING_COSINE = 0.05
"""Cosine of the angle of incidence, 87 deg: rays that run flatter are not moved along."""
