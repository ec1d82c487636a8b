# SPDX-License-Identifier: MIT
"""Weights of the models of unseen sides of parts, fitted by `python -m benchmarks run part-backs-fit`."""

from __future__ import annotations

MIRROR_WEIGHTS = (-9.72, 0.62, -1.59, 0.23, 4.30, 0.04, 1.10, 0.21)
AXIS_WEIGHTS = (-9.46, 1.86, -0.71, 0.17, 5.34, 3.14, 1.54, 1.22, -1.02, 1.18)
