# SPDX-License-Identifier: MIT
"""Weights of the models of back sides, fitted on the tuning kinds by `python -m benchmarks run backs-fit`."""

from __future__ import annotations

MIRROR_WEIGHTS = (-8.56, -2.14, 0.78, -0.97, -0.22, 1.42, 1.75, -1.14, -4.52, 0.32, -2.41, -1.12, 2.93)
AXIS_WEIGHTS = (-8.30, 5.77, -6.76, 3.49, 6.90, -0.66, 1.34)
TURN_WEIGHTS = (-1.39, -1.00, -14.04, -0.57, -2.50, 3.58)
VOLUMES = {
    "axis": (0.867, 1.347),
    "mirrors": (0.216, 1.176),
    "mirror": (0.289, 1.672),
    "none": (0.415, 1.953),
}
"""Quantiles of true over closed volume that hold 80 % of kinds they were not taken from, of 340 views."""
EXTENTS = {
    "axis": (0.095, 0.098),
    "mirrors": (0.108, 0.045),
    "mirror": (0.071, 0.215),
    "none": (0.018, 0.205),
}
"""Shares of its size by which a thing is at most wider and deeper than its closed shape: 95 % quantiles of
kinds they were not taken from, of 340 views."""
