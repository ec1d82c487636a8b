# SPDX-License-Identifier: MIT
"""Weights of the models of unseen sides of parts, fitted by `python -m benchmarks run part-backs-fit`."""

from __future__ import annotations

MIRROR_WEIGHTS = (0.0,) * 8
AXIS_WEIGHTS = (0.0,) * 9
