# SPDX-License-Identifier: MIT
"""Weights of the models of back sides, fitted on the tuning kinds by `python -m benchmarks run backs-fit`."""

from __future__ import annotations

MIRROR_WEIGHTS = (-2.5, 0.6, -6.9, -0.6, 2.8, 0.5, 2.2, 0.7, *11 * (0.0,))
AXIS_WEIGHTS = (-1.4, 2.4, -4.3, 3.1, 0.1, -0.8, 0.1, 0.0)
TURN_WEIGHTS = (-4.0, 2.0, -4.0, 1.0, 0.0, 0.0)
VOLUMES = {
    "axis": (0.5, 1.2),
    "mirrors": (0.4, 1.2),
    "mirror": (0.3, 1.2),
    "none": (0.2, 1.1),
}
"""10 % and 90 % quantiles of true over closed volume, by what shaped the closed mesh."""
