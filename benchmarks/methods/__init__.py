# SPDX-License-Identifier: MIT
"""Methods beside ours: a function of scans that returns a mesh of inferred surface takes part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module

import numpy as np
from numpy.typing import NDArray

from benchmarks.methods.meshes import ball_pivoting_of_scans, poisson_of_scans
from scenes.checks import FloatArray, InputError
from scenes.scan.range_image import RangeImage

Inference = Callable[[Sequence[RangeImage]], tuple[FloatArray, NDArray[np.int64]]]
"""From scans to vertices (n, 3), world coordinates in metres, and faces (m, 3) of inferred surface."""

METHODS: dict[str, Inference] = {"poisson": poisson_of_scans, "ball-pivoting": ball_pivoting_of_scans}


def inference_named(name: str) -> Inference:
    """Return a method by its name in `METHODS`, or as MODULE:FUNCTION.

    Raises InputError: there is no such method.
    """
    if name in METHODS:
        return METHODS[name]
    module, _, function = name.partition(":")
    try:
        found: Inference = getattr(import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        known = ", ".join(METHODS)
        raise InputError(f"no method {name!r}: give MODULE:FUNCTION or one of {known} ({error})") from error
    return found
