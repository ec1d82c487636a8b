# SPDX-License-Identifier: MIT
"""Cut mesh: what of a mesh lies below a level plane, as one looks into a building without its ceilings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh


def below(mesh: LabelledMesh, height_m: float) -> tuple[LabelledMesh, NDArray[np.int64]]:
    """Return the part of a mesh below a level plane, and of which face of the mesh each of its faces (m,) is.

    Faces that the plane cuts are cut along it and keep the side to which they turn.
    """
    corners = mesh.corners
    low = corners[..., 2] <= height_m
    n_low = low.sum(axis=1)
    whole = np.flatnonzero(n_low == 3)
    parts, of = [corners[whole]], [whole]
    for n in (1, 2):
        faces = np.flatnonzero(n_low == n)
        alone = np.argmax(low[faces] == (n == 1), axis=1)  # the corner that is alone on its side
        turned = corners[faces[:, None], (alone[:, None] + np.arange(3)) % 3]
        a, b, c = np.moveaxis(turned, 1, 0)
        ab, ac = _where_cut(a, b, height_m), _where_cut(a, c, height_m)
        triangles = [(a, ab, ac)] if n == 1 else [(ab, b, c), (ab, c, ac)]
        parts += [np.stack(triangle, axis=1) for triangle in triangles]
        of += [faces] * len(triangles)
    found, source = np.concatenate(parts), np.concatenate(of)
    numbers = np.arange(3 * len(found), dtype=np.int32).reshape(-1, 3)
    return LabelledMesh(found.reshape(-1, 3), numbers, mesh.face_surface[source]), source


def _where_cut(one: FloatArray, other: FloatArray, height_m: float) -> FloatArray:
    """Points (n, 3) at a height on the lines from points (n, 3) on one side of it to those on the other."""
    share = (height_m - one[:, 2]) / (other[:, 2] - one[:, 2])
    return one + share[:, None] * (other - one)
