# SPDX-License-Identifier: MIT
"""Local mesh: triangles round their own centre, so that float32 holds them well."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, InputError

_LARGEST = float(np.finfo(np.float32).max)  # Embree works in float32: what exceeds this is not finite there


class LocalMesh(NamedTuple):
    """Triangles round their own centre.

    Attributes
    ----------
    vertices : (n, 3) float
        Metres from `centre`.
    faces : (m, 3) int32
        Vertex indices.
    centre : (3,) float
        World coordinates, metres.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    centre: FloatArray


def local_mesh(points: FloatArray, faces: NDArray[np.int32]) -> LocalMesh:
    """Return copies of the points (n, 3) that the faces (m, 3) use, moved to their own centre, and the faces.

    Points that no face uses do not count: a stray one must not move the centre.

    Raises InputError: a mesh too wide for float32.
    """
    used = np.zeros(len(points), np.bool_)
    used[faces.reshape(-1)] = True
    if not used.all():
        points, faces = points[used], (np.cumsum(used, dtype=np.int32) - 1)[faces]
    centre = np.zeros(3)
    if len(points):
        low, high = points.min(axis=0), points.max(axis=0)
        centre = low / 2 + high / 2
        if np.abs(high - centre).max() > _LARGEST:
            raise InputError(
                f"the mesh spans {(high - low).max():g} m; Embree's float32 ends at {_LARGEST:g}"
            )
    return LocalMesh(points - centre, faces.copy(), centre)
