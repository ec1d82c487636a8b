# SPDX-License-Identifier: MIT
"""Limits of texture synthesis: filling, windows, lattices, examination; each with unit and origin.

Lengths are pixels, correlations -1..1, shares 0..1. Those marked "by eye" were set on the textures of
docs/results/texture.md, and no range was measured within which results stay the same. The budgets and marks
of compiled loops stand beside them (`texture.engine`).
"""

from __future__ import annotations

# Filling
MAX_ERROR_THRESHOLD = 0.3
"""Largest error of a match to begin with, pixels in 0..1: MaxErrThreshold of Efros's page."""
RELAXATION = 1.1
"""A pass without progress multiplies the threshold by this: Efros's page."""
EXACT_PIXELS = 4_000
"""A hole of so many pixels is searched exactly. By choice: time grows with pixels times samples."""
FEWEST_SAMPLES = 1_000
"""Samples that a coarser level must leave. By eye."""
SMALLEST_WINDOW = 9
"""Side of the window of a coarser level, at least. By eye."""

# Windows
SMALLEST_CHOICE = 7
"""Side of the smallest window that is chosen. By eye."""
LARGEST_CHOICE = 23
"""Side of the largest window that is chosen by the largest feature alone. By choice: time grows with its
square."""
FEATURE_END = 0.2
"""Autocorrelation below which a feature ends. By eye."""
FEATURE_RETURN = 0.5
"""Autocorrelation above which it returns: more alike than not."""
CLEARLY_BETTER = 0.9
"""Of the smaller window's penalty: what a larger one may have at most. By eye."""
OUT_OF_STEP_PENALTY = 5.0
"""For each period that a hole is out of step: a fifth of a period counts twice its distance
(`OUT_OF_STEP`)."""
PER_PERIOD = 1.6
"""Side of the window for each period: its Gaussian is four sigmas, window / 1.6, wide
(`texture.sampling.sample`)."""

# Lattices
LEAST_SPREAD = 1e-6
"""Of 8-bit levels: less is the transforms' rounding."""
TILES_PER_SIDE = 4
"""Tiles along an image's side whose phases are compared, at most. By choice."""
N_REPETITIONS = 8
"""Repetitions that a pixel is compared with. By choice: time."""
REPEATED = 0.35
"""Correlation from which a texture is said to repeat. By eye."""
VALLEY = 0.2
"""How far the correlation falls between a pixel and its repetition. By eye."""
NEARLY_AS_GOOD = 0.85
"""Of the highest correlation: a shorter repetition that is so good is the period. By eye."""
LEAST_OVERLAP = 0.25
"""Share of the pixels that must meet others for a correlation to be believed. By eye."""
IN_STEP = 0.1
"""Of the period: what a lattice may miss its own texture by, half of `OUT_OF_STEP`."""
ASIDE_DEG = 20.0
"""A second period points at least so far away from the first, degrees. By eye."""
NEIGHBOURHOOD = 128
"""Pixels around a hole in which its lattice is looked for, or its own size: by choice, some periods."""

# Samples and examination
DARKEST = 1 / 255
"""Brightness below one 8-bit level says nothing of the light."""
UNUSUAL = 3.0
"""Robust standard deviations from the median beyond which a pixel counts as that far: 3 of 1,000 of noise."""
IRRELEVANT = 0.05
"""Correlation of neighbours of a plain sample, at most: it explains 0.3 % of the variance."""
CLEARLY = 4.0
"""Standard deviations beyond the mean of real pieces from which a fill is none of them. By eye."""
MOSTLY = 0.5
"""Share of a fill that is copied verbatim, or confidence below which it is garbage: the half."""
OUT_OF_STEP = 0.2
"""Periods by which a fill misses its lattice; one that knows nothing of it is at 1/4 or 1/3."""
