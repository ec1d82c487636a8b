# SPDX-License-Identifier: MIT
"""Oracles of ray casting: which rays Embree may see, one by one, and where they meet planes, in numpy.

Functions of one name have one meaning and the same results, to the last bit. Rays are rows of (n, 3) arrays;
one origin of shape (1, 3) serves all directions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray
from scenes.rays.local_mesh import LocalMesh

LARGEST = float(np.finfo(np.float32).max)


def usable_ray(local, way):
    """Origin, unit direction and length of one ray in float32, or None where Embree may not see it."""
    if not all(abs(number) <= LARGEST for number in (*local, *way)):
        return None
    length = np.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2])
    if not length > 0:
        return None
    return np.float32(local), np.float32(way * (1 / length)), np.float32(length)


def meet(
    mesh: LocalMesh,
    origins: FloatArray,
    directions: FloatArray,
    face: NDArray[np.int32],
    out: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Write where rays meet the planes of the faces (n,) that they hit; face -1 is a miss.

    The range is that of the plane, kept between the face's corners: a ray that grazes its face meets the
    plane anywhere. Weights are those of the point at that range, kept inside the face.

    Parameters
    ----------
    mesh : LocalMesh
        The triangles.
    origins, directions : (n, 3) or (1, 3), (n, 3) float
        World coordinates, metres; directions of any length.
    face : (n,) int32
        From Embree.
    out : (n,), (n, 3), (n,) float
        Written: ranges in metres, corner weights, |cosine of incidence|; inf, 0 and 0 for a miss.
    """
    ranges, weights, cosine = out
    hit = np.flatnonzero(face >= 0)
    ranges[:], weights[:], cosine[:] = np.inf, 0.0, 0.0
    corner, second, third = (mesh.vertices[mesh.faces[face[hit], k]] for k in range(3))
    first_edge, second_edge = second - corner, third - corner
    along = directions[hit]
    along = along / np.sqrt(_dot(along, along))[:, None]
    offset = corner - ((origins if len(origins) == 1 else origins[hit]) - mesh.centre)
    normal = np.cross(first_edge, second_edge)
    slope, depth = _dot(along, normal), _dot(offset, along)
    depths = np.stack([depth, depth + _dot(first_edge, along), depth + _dot(second_edge, along)])
    nearest, furthest = np.maximum(depths.min(axis=0), 0.0), np.maximum(depths.max(axis=0), 0.0)
    with np.errstate(all="ignore"):
        reached = np.fmin(np.fmax(_dot(offset, normal) / slope, nearest), furthest)
        inside = along * reached[:, None] - offset
        inverse = 1 / _dot(normal, normal)
        v = _share(_dot(np.cross(inside, second_edge), normal) * inverse)
        w = _share(_dot(np.cross(first_edge, inside), normal) * inverse)
        cosine[hit] = _share(np.abs(slope) * np.sqrt(inverse))
    u = np.maximum(1 - v - w, 0.0)
    ranges[hit] = reached
    weights[hit] = np.stack([u, v, w], axis=1) * (1 / (u + v + w))[:, None]


def _share(value: FloatArray) -> FloatArray:
    """Return `value` within 0..1, and 0 for NaN, which a face without area gives."""
    share: FloatArray = np.fmin(np.fmax(value, 0.0), 1.0)
    return share


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Row by row, added in this order: the compiled kernel does the same to the last bit."""
    product: FloatArray = a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
    return product
