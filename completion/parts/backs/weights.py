# SPDX-License-Identifier: MIT
"""Weights of the models of unseen sides of parts, fitted by `python -m benchmarks run part-backs-fit`."""

from __future__ import annotations

MIRROR_WEIGHTS = (-8.56, 0.71, -1.49, -0.17, 4.18, 0.06, 0.78, -0.45)
AXIS_WEIGHTS = (-6.95, 2.14, -0.59, 1.15, 5.72, 3.20, 2.09, 2.44, 1.23)
