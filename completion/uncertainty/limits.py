# SPDX-License-Identifier: MIT
"""Limits of uncertainty: smooth errors and warps, each with unit and origin.

Lengths are metres and angles radians unless said. Sizes of samples and blocks, and guards against rounding,
stand where they are used. "By eye" stands for a value that was tried on examples, without a measurement.
"""

from __future__ import annotations

# Pipeline
LEAST_COSINE = 0.05
"""Of incidence, 87 deg, below which a beam tells nothing of a surface."""
STUDENT_FREEDOM = 30.0
"""Degrees of freedom of a surface's residuals: one that is bent by itself says little. By choice."""
LEAST_WEIGHT = 1e-3
"""Of a length's probability, below which it is left out. By choice."""
FEWEST_PIXELS = 1_500
"""Of a surface in a scan, from which on it tells anything of smooth errors. By eye."""

# Space warp
LEAST_LOG_EVIDENCE = 5.0
"""Nats by which a warp must be more probable than none; else there is none."""
FEWEST_POINTS = 60
"""Of a surface that tells of a warp. By eye."""
