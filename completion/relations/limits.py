# SPDX-License-Identifier: MIT
"""Limits of relations: which come into question, hold and are imposed, each with unit and origin.

Lengths are metres and angles radians unless said. Sizes of samples and blocks, and guards against rounding,
stand where they are used. "By eye" stands for a value that was tried on examples, without a measurement.
"""

from __future__ import annotations

import numpy as np

# Evidence
ASIDE = np.radians(10.0)
"""From a relation, within which directions lie that have nothing to do with it."""
SHARE = 0.05
"""Of the size of all, and of a radius, within which lengths do."""
LEAST_ALONE = float(np.log(100.0))
"""Natural logarithm of odds, ln 100: kinds of which many sets of surfaces come into question need it."""
FAR_SD = 6.0
"""Standard deviations from which on a relation does not come into question: one true one in 500 million is
missed.
"""
MOST_DIRECTION_SD = float(np.radians(5.0))
"""Of a direction that relations are inferred of, 5 deg: half of `ASIDE`. By choice."""
DIRECTION_GATE = float(np.radians(6.0))
"""Within which directions come into question, 6 deg. By choice."""
GATE_SD = 3.0
"""Standard deviations of an angle within which directions come into question besides: three."""

# Constraint
LEAST_TOLD = 1e-3
"""Of what is told best, below which a direction or a mirror is not told. By choice."""

# Equations
LEAST_APART = 0.2
"""Sine of half an angle between two directions, below which they do not tell the mirror between them."""

# Estimate
EXACT_SD = 1e-2
"""Standard deviations by which an equation that is determined may miss: too little to be seen in any
test.
"""
DETERMINED_SHARE = 1e-6
"""Of its own variance, to which what is accepted already determines an equation. By choice."""
PART_SHARE = 1e-6
"""Of the greatest share, from which a relation has a part in what determines an equation. By choice."""

# Graph
MOST_FRAME_SD = float(np.radians(10.0))
"""Of a direction, both ways together, that takes part in a frame: 10 deg, `ASIDE`."""
MOST_RADIUS_SD = 0.1
"""Of a radius that may be doubtful: a tenth. By choice."""
FEWEST_ACROSS = 3
"""Directions across the first of an Atlanta frame: with two it is a Manhattan frame."""

# Pipeline
LEAST_LOG_EVIDENCE = 0.7
"""Of a proposal by itself, about ln 2: hardly more than a word for it."""
LEAST_GROUP = float(np.log(20.0))
"""Of all that hang together: ln 20, "strong" (Kass & Raftery 1995)."""
HARDLY = 0.05
"""Probability below which a relation hardly holds: the usual 5 %."""
USUAL_TOLERANCE = np.radians(0.1)
"""Of buildings: walls stand within .1 to .2 deg of square."""
TOLERANCE_SPREAD = 1.5
"""Natural logarithms by which that differs from one to the next, standard deviation: a factor of 4.5."""
MEANT_SHARE = 0.7
"""Of the pairs that come into question are meant to be square or parallel. By eye."""
OFF_QUANTILE = 0.95
"""Of the distances by which a moved surface stands off its points: 95 %."""
MOST_OFF = 0.5
"""Of the scatter of its points about it, by which a surface may be moved off them: half cannot be seen in
them.
"""

# Proposals
SAME_SD = 4.0
"""Standard deviations within which two mirrors may be one, and the next of a row where it is expected."""
MOST_SPACING_SHARE = 0.25
"""Of a spacing that this may be: else chance puts one there."""
FLAT_ANGLE = float(np.radians(1.0))
"""Round angles nearer than 1 deg to 0 or 90 deg are relations of their own."""
