# SPDX-License-Identifier: MIT
"""Weights of the models of back sides, fitted on the tuning kinds by `python -m benchmarks run backs-fit`."""

from __future__ import annotations

MIRROR_WEIGHTS = (-9.44, -0.74, 0.87, -1.11, -0.65, 1.74, 1.74, -1.12, -3.97, 0.48, -2.23, -1.41, 2.66)
AXIS_WEIGHTS = (-6.88, 3.70, -9.01, 1.17, 8.19, -1.67, 1.40)
TURN_WEIGHTS = (-2.83, 0.41, -20.99, 0.41, -0.72, 4.32)
VOLUMES = {
    "axis": (0.5, 1.2),
    "mirrors": (0.4, 1.2),
    "mirror": (0.3, 1.2),
    "none": (0.2, 1.1),
}
"""10 % and 90 % quantiles of true over closed volume, by what shaped the closed mesh."""
