# SPDX-License-Identifier: MIT
"""Patches as STEP: one B-spline face, with the controls and knots of the patch."""

from __future__ import annotations

from typing import Any

import numpy as np

from completion.exchange.step.curves.kernel import kernel, kernel_point
from completion.exchange.step.step_file import NamedFace, step_bytes
from completion.fitting.patches.patch import SplinePatch
from scenes.checks import FloatArray
from scenes.scan.colour import surface_bytes

_MM = 1000.0
_TOLERANCE = 1e-6  # mm


def patch_step(patch: SplinePatch, name: str = "patch") -> bytes:
    """Return a patch in metres as a STEP file in millimetres: a B-spline face within its four boundaries.

    Raises
    ------
    InputError
        OCP is not installed (the message names the cure), or the kernel cannot write it.
    """
    surface = spline_surface(patch.moved(_MM, np.zeros(3)))
    face = kernel().BRepBuilderAPI.BRepBuilderAPI_MakeFace(surface, _TOLERANCE).Face()
    red, green, blue = surface_bytes(np.array([1]))[0].tolist()
    return step_bytes(face, [NamedFace(face, name, "MEASURED", (red, green, blue))], name)


def spline_surface(patch: SplinePatch) -> Any:
    """Return the kernel's B-spline surface; lengths are those of the patch."""
    n, m, _ = patch.controls.shape
    held = kernel().collections.Array2_gp_Pnt(1, n, 1, m)
    for row in range(n):
        for column in range(m):
            held.SetValue(row + 1, column + 1, kernel_point(patch.controls[row, column]))
    knots, counts = zip(*(_counted(one) for one in patch.knots), strict=True)
    told = (*knots, *counts, *patch.degree, False, False)
    return kernel().Geom.Geom_BSplineSurface(held, *told)


def _counted(knots: FloatArray) -> tuple[Any, Any]:
    """The knots without repetition, and how often each stands there, as arrays of the kernel."""
    values, counts = np.unique(knots, return_counts=True)
    held = kernel().collections.Array1_double(1, len(values))
    times = kernel().collections.Array1_int(1, len(values))
    for place, (knot, count) in enumerate(zip(values.tolist(), counts.tolist(), strict=True), start=1):
        held.SetValue(place, knot)
        times.SetValue(place, count)
    return held, times
