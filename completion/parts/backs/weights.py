# SPDX-License-Identifier: MIT
"""Weights of the models of unseen sides of parts, fitted by `python -m benchmarks run part-backs-fit`."""

from __future__ import annotations

MIRROR_WEIGHTS = (-9.72, 0.62, -1.59, 0.23, 4.30, 0.04, 1.10, 0.21)
AXIS_WEIGHTS = (-6.81, 2.04, -0.64, -0.03, 5.62, 3.52, 1.79, 2.63, 1.41)
