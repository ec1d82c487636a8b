# SPDX-License-Identifier: MIT
"""The oracle of `scenes.rays.ray_kernels`, in numpy: what ray casting computes before and after Embree.

Functions of one name have one meaning and the same results, to the last bit. Rays are rows of (n, 3) arrays;
one origin of shape (1, 3) serves all directions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from scenes.rays.local_mesh import LocalMesh
from scenes.rays.ray_kernels import PackedRays

LARGEST = float(np.finfo(np.float32).max)


def pack_rays(origins: FloatArray, directions: FloatArray, centre: FloatArray) -> PackedRays:
    """Return the rays that are finite and have a direction, in their own order."""
    with np.errstate(all="ignore"):
        length = np.sqrt(_dot(directions, directions))
        return _pack(origins - centre, directions, length)._replace(reach=None)


def pack_segments(
    origins: FloatArray, targets: FloatArray, centre: FloatArray, blocked: BoolArray
) -> PackedRays:
    """Return the segments that need a ray; write to `blocked` (n,) the answer for the others.

    A segment that is not finite is blocked, one without length is free.
    """
    with np.errstate(all="ignore"):
        way = targets - origins
        blocked[:] = ~(_finite(origins - centre) & _finite(way))
        return _pack(origins - centre, way, np.sqrt(_dot(way, way)))


def meet(
    mesh: LocalMesh,
    origins: FloatArray,
    directions: FloatArray,
    face: NDArray[np.int32],
    ranges: FloatArray,
    weights: FloatArray,
    cosine: FloatArray,
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
    ranges, weights, cosine : (n,), (n, 3), (n,) float
        Written: metres, corner weights, |cosine of incidence|; inf, 0 and 0 for a miss.
    """
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


def _pack(local: FloatArray, way: FloatArray, length: FloatArray) -> PackedRays:
    which = np.flatnonzero(_finite(local) & _finite(way) & (length > 0))
    starts = np.broadcast_to(local, way.shape)[which].astype(np.float32)
    unit = way[which] * (1 / length[which])[:, None]
    return PackedRays(starts, unit.astype(np.float32), length[which].astype(np.float32), which)


def _finite(vectors: FloatArray) -> BoolArray:
    """Tell which rows hold numbers that float32 can hold."""
    return np.asarray((np.abs(vectors) <= LARGEST).all(axis=1), np.bool_)


def _share(value: FloatArray) -> FloatArray:
    """Return `value` within 0..1, and 0 for NaN, which a face without area gives."""
    share: FloatArray = np.fmin(np.fmax(value, 0.0), 1.0)
    return share


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Row by row, added in this order: the compiled kernel does the same to the last bit."""
    product: FloatArray = a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
    return product
