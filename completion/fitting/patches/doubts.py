# SPDX-License-Identifier: MIT
"""Doubts: what a person should know of a fitted patch before relying on it."""

from __future__ import annotations

import numpy as np

from completion.fitting.patches.patch import SplinePatch
from completion.fitting.patches.result import PatchFit
from scenes.surfaces.catalogue import Cylinder, Plane

BEYOND = 3.0
"""Residuals (rms) from a boundary, from which on a point lies beyond it."""

_MANY = 0.05  # share of the points that lie beyond
_OFF_CYLINDER, _OFF_PLANE, _WORSE = 1e-6, 1e-9, 1.05  # radians, radians, ratio of rms
_GRID, _EDGE = 81, 0.02  # places along each side at which folds are looked for, a strip apart


def doubts_of(found: PatchFit, beyond: float) -> tuple[str, ...]:
    """Return what is doubtful of a patch, of whose points a share lies `beyond` its boundaries."""
    doubts = list[str]()
    if beyond > _MANY:
        doubts.append(
            f"{100 * beyond:.0f} % of the points lie beyond the boundaries: are the surfaces where they are "
            "said to be?"
        )
    if _is_folded(found.patch):
        doubts.append("the patch is folded: a surface cuts through the points, or they are no single sheet")
    for side, one in found.boundaries.items():
        angle = found.joins[side].angle
        if isinstance(one.surface, Cylinder) and angle > _OFF_CYLINDER:
            doubts.append(
                f"{side} is {angle:.1e} rad off its cylinder: more controls along it follow it closer"
            )
        elif isinstance(one.surface, Plane) and angle > _OFF_PLANE:
            doubts.append(f"{side} is {angle:.1e} rad off its plane: the patch has no width there")
    if found.ratio > _WORSE:
        doubts.append(
            f"the points' rms is {found.ratio:.2f} times that of a patch joined to nothing: they contradict "
            "a join, or a surface is not where it is said to be"
        )
    return tuple(doubts)


def _is_folded(patch: SplinePatch) -> bool:
    """Whether normals turn round between neighbours of a fine grid."""
    places = np.linspace(_EDGE, 1.0 - _EDGE, _GRID)
    uv = np.stack(np.meshgrid(places, places, indexing="ij"), axis=-1).reshape(-1, 2)
    normals = patch.normals(uv).reshape(_GRID, _GRID, 3)
    turned = (
        np.einsum("ijk,ijk->ij", *pair)
        for pair in ((normals[1:], normals[:-1]), (normals[:, 1:], normals[:, :-1]))
    )
    return any(bool((one < 0).any()) for one in turned)
