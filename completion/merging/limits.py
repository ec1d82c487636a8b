# SPDX-License-Identifier: MIT
"""Limits of merging: when parts are one surface, each with unit and origin.

Lengths are metres and angles radians unless said. Sizes of samples and blocks, and guards against rounding,
stand where they are used. "By eye" stands for a value that was tried on examples, without a measurement.
"""

from __future__ import annotations

import numpy as np

# Agreement
STEEPEST = 1.0
"""Radians of tilt that an unrelated surface may have as well. By choice."""
LEAST_COSINE = 0.5
"""Of the normals of two parts of one surface: 60 deg. By eye."""
LEAST_FACING = 0.8
"""Of those of a part and of the surface that it lies on: 37 deg. By eye."""

# Candidates
CANDIDATE_SD = 5.0
"""At a part's middle, beyond which no test is needed: none comes from one surface but once in two
million.
"""

# Gaps
STRIP_BRIDGES = 3
"""Neighbouring bridges that make a strip. By choice."""

# Pieces
VOTES = 5
"""Frames against one: what is found as often as not is missed by all with probability 1/32."""
AS_NEAR = 1.1
"""Times as far: frames from beyond see too coarsely to have a vote. By choice."""
MAJORITY = 0.5
"""Of a piece's points, and of a bridge's steps: most."""

# Pipeline
LEAST_LOG_ODDS = float(np.log(20.0))
"""That parts are one surface: ln 20, "strong" (Kass & Raftery 1995)."""
LEAST_SAMPLE_SHARE = 0.04
"""Of a small part's sample, that takes part in the common fit. By choice."""
APART_SD = 4.0
"""Standard deviations of its warp by which any part of a surface may stand off the common fit: one in
16,000 by chance.
"""
SMALL_SHARE = 0.05
"""Of another region's pixels: so small a part may lie on it without having its shape. By eye."""
