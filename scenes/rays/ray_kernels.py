# SPDX-License-Identifier: MIT
"""What a ray caster computes in float64 before and after Embree, compiled.

Imported only when a ray caster is built, because numba takes a while to load. The functions hold no lock
while they run. Rays are rows of (n, 3) arrays; one origin of shape (1, 3) serves all directions.
"""

from __future__ import annotations

import logging
from typing import NamedTuple

import numpy as np
from numba import boolean, float32, float64, int32, int64, njit, types, uint8, uint64, void
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from scenes.rays.local_mesh import LocalMesh

_LARGEST = float(np.finfo(np.float32).max)  # what exceeds it is not finite in Embree
_NOT_FINITE, _POINT, _USABLE = 0, 1, 2  # states of a ray
_BLOCK = 64  # rays whose planes are met side by side, in vector registers
_VECTORS = types.Array(float64, 2, "C", readonly=True)
_NUMBERS = types.Array(float64, 1, "C", readonly=True)
_FACES = types.Array(int32, 2, "C", readonly=True)
_HIT_FACES = types.Array(int32, 1, "C", readonly=True)


class PackedRays(NamedTuple):
    """Rays that Embree may see: local, normalised, finite in float32, with a direction.

    Attributes
    ----------
    origins, directions : (k, 3) float32
        Relative to the mesh's centre; unit vectors.
    reach : (k,) float32, or None
        Where segments end, metres.
    which : (k,) int64, or slice
        Which of the given rays these are.
    """

    origins: NDArray[np.float32]
    directions: NDArray[np.float32]
    reach: NDArray[np.float32] | None
    which: NDArray[np.int64] | slice


def _can_store() -> bool:
    """Say whether numba finds a folder for compiled code."""
    try:
        njit(cache=True)(_can_store)
    except RuntimeError as error:
        logging.getLogger(__name__).warning("numba compiles anew in each process: %s", error)
        return False
    return True


COMPILED = {"nogil": True, "cache": _can_store(), "error_model": "numpy"}


def pack_rays(origins: FloatArray, directions: FloatArray, centre: FloatArray) -> PackedRays:
    """Return the rays (n, 3), world frame, that are finite and have a direction, in their own order."""
    return _packed(len(directions), origins, directions, centre, False)[0]


def pack_segments(
    origins: FloatArray, targets: FloatArray, centre: FloatArray, blocked: BoolArray
) -> PackedRays:
    """Return the segments that need a ray; write to `blocked` (n,) the answer for the others.

    A segment that is not finite is blocked, one without length is free.
    """
    packed, state = _packed(len(blocked), origins, targets, centre, True)
    np.equal(state, _NOT_FINITE, out=blocked)
    return packed


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
    with np.errstate(all="ignore"):  # where the compiler is switched off
        _meet(mesh.vertices, mesh.faces, mesh.centre, origins, directions, face, ranges, weights, cosine)


def _packed(
    n: int, starts: FloatArray, ends: FloatArray, centre: FloatArray, is_segment: bool
) -> tuple[PackedRays, NDArray[np.uint8]]:
    origins, directions = np.empty((len(starts), 3), np.float32), np.empty((n, 3), np.float32)
    reach, state = np.empty(n if is_segment else 0, np.float32), np.empty(n, np.uint8)
    with np.errstate(all="ignore"):  # where the compiler is switched off
        n_usable = _pack(centre, starts, ends, is_segment, origins, directions, reach, state)
    origins = np.broadcast_to(origins, (n, 3))
    which = slice(None) if n_usable == n else np.flatnonzero(state == _USABLE)
    return PackedRays(origins[which], directions[which], reach[which] if is_segment else None, which), state


@njit(
    int64(_NUMBERS, _VECTORS, _VECTORS, boolean, float32[:, ::1], float32[:, ::1], float32[::1], uint8[::1]),
    **COMPILED,
)
def _pack(
    centre: FloatArray,
    starts: FloatArray,
    ends: FloatArray,
    is_segment: bool,
    origins: NDArray[np.float32],
    directions: NDArray[np.float32],
    reach: NDArray[np.float32],
    state: NDArray[np.uint8],
) -> int:
    """Write rays for Embree and what may be done with them; return how many are usable."""
    n_usable = 0
    for index in range(len(state)):
        i = uint64(index)
        o, e = i if len(starts) > 1 else uint64(0), i if len(ends) > 1 else uint64(0)
        a, b, c = ends[e, 0], ends[e, 1], ends[e, 2]
        if is_segment:
            a, b, c = a - starts[o, 0], b - starts[o, 1], c - starts[o, 2]
        x, y, z = starts[o, 0] - centre[0], starts[o, 1] - centre[1], starts[o, 2] - centre[2]
        length = np.sqrt(a * a + b * b + c * c)
        inverse = 1 / length
        finite = (abs(x) <= _LARGEST) & (abs(y) <= _LARGEST) & (abs(z) <= _LARGEST)
        finite &= (abs(a) <= _LARGEST) & (abs(b) <= _LARGEST) & (abs(c) <= _LARGEST)
        usable = finite & (length > 0)
        origins[o, 0], origins[o, 1], origins[o, 2] = x, y, z
        directions[i, 0], directions[i, 1], directions[i, 2] = a * inverse, b * inverse, c * inverse
        if is_segment:
            reach[i] = length
        state[i] = _USABLE if usable else (_POINT if finite else _NOT_FINITE)
        n_usable += 1 if usable else 0
    return n_usable


@njit(error_model="numpy", inline="always")
def _clip(value: float, low: float, high: float) -> float:
    """Return `value` within low..high; NaN becomes `low`."""
    value = value if value > low else low
    return value if value < high else high


@njit(error_model="numpy", inline="always")
def _gather(
    table: FloatArray,
    m: int,
    first: int,
    vertices: FloatArray,
    faces: NDArray[np.int32],
    origins: FloatArray,
    directions: FloatArray,
    face: NDArray[np.int32],
) -> None:
    """Write corners, origin and direction of the hits among m rays to the table's 15 rows of _BLOCK."""
    for index in range(m):
        i, k = uint64(first + index), uint64(index)
        if face[i] < 0:
            continue
        f, o = uint64(face[i]), i if len(origins) > 1 else uint64(0)
        for corner in range(3):
            vertex = uint64(faces[f, corner])
            for axis in range(3):
                table[(3 * corner + axis) * _BLOCK + k] = vertices[vertex, axis]
        for axis in range(3):
            table[(9 + axis) * _BLOCK + k] = origins[o, axis]
            table[(12 + axis) * _BLOCK + k] = directions[i, axis]


@njit(error_model="numpy", inline="always")
def _meet_planes(table: FloatArray, c_x: float, c_y: float, c_z: float) -> None:
    """Turn the table of `_gather` into range, three weights and |cosine|, row by row."""
    for index in range(_BLOCK):
        k = uint64(index)
        o_x = table[9 * _BLOCK + k] - c_x
        o_y = table[10 * _BLOCK + k] - c_y
        o_z = table[11 * _BLOCK + k] - c_z
        a, b, c = table[12 * _BLOCK + k], table[13 * _BLOCK + k], table[14 * _BLOCK + k]
        length = np.sqrt(a * a + b * b + c * c)
        a, b, c = a / length, b / length, c / length
        x, y, z = table[k], table[_BLOCK + k], table[2 * _BLOCK + k]
        e_x, e_y, e_z = table[3 * _BLOCK + k] - x, table[4 * _BLOCK + k] - y, table[5 * _BLOCK + k] - z
        g_x, g_y, g_z = table[6 * _BLOCK + k] - x, table[7 * _BLOCK + k] - y, table[8 * _BLOCK + k] - z
        x, y, z = x - o_x, y - o_y, z - o_z
        n_x, n_y, n_z = e_y * g_z - e_z * g_y, e_z * g_x - e_x * g_z, e_x * g_y - e_y * g_x
        slope = a * n_x + b * n_y + c * n_z
        depth = x * a + y * b + z * c
        second = depth + (e_x * a + e_y * b + e_z * c)
        third = depth + (g_x * a + g_y * b + g_z * c)
        nearest, furthest = depth if depth < second else second, depth if depth > second else second
        nearest, furthest = third if third < nearest else nearest, third if third > furthest else furthest
        nearest = nearest if nearest > 0 else 0.0
        furthest = furthest if furthest > 0 else 0.0
        reached = _clip((x * n_x + y * n_y + z * n_z) / slope, nearest, furthest)
        x, y, z = a * reached - x, b * reached - y, c * reached - z
        inverse = 1 / (n_x * n_x + n_y * n_y + n_z * n_z)
        v = (y * g_z - z * g_y) * n_x + (z * g_x - x * g_z) * n_y + (x * g_y - y * g_x) * n_z
        w = (e_y * z - e_z * y) * n_x + (e_z * x - e_x * z) * n_y + (e_x * y - e_y * x) * n_z
        v, w = _clip(v * inverse, 0.0, 1.0), _clip(w * inverse, 0.0, 1.0)
        u = _clip(1 - v - w, 0.0, 1.0)
        whole = 1 / (u + v + w)
        table[k] = reached
        table[_BLOCK + k], table[2 * _BLOCK + k], table[3 * _BLOCK + k] = u * whole, v * whole, w * whole
        table[4 * _BLOCK + k] = _clip(abs(slope) * np.sqrt(inverse), 0.0, 1.0)


@njit(
    void(
        _VECTORS,
        _FACES,
        _NUMBERS,
        _VECTORS,
        _VECTORS,
        _HIT_FACES,
        float64[::1],
        float64[:, ::1],
        float64[::1],
    ),
    **COMPILED,
)
def _meet(
    vertices: FloatArray,
    faces: NDArray[np.int32],
    centre: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    face: NDArray[np.int32],
    ranges: FloatArray,
    weights: FloatArray,
    cosine: FloatArray,
) -> None:
    table = np.ones(15 * _BLOCK)
    for first in range(0, len(face), _BLOCK):
        m = min(_BLOCK, len(face) - first)
        _gather(table, m, first, vertices, faces, origins, directions, face)
        _meet_planes(table, centre[0], centre[1], centre[2])
        for index in range(m):
            i, k = uint64(first + index), uint64(index)
            hit = face[i] >= 0
            ranges[i] = table[k] if hit else np.inf
            for corner in range(3):
                weights[i, corner] = table[(1 + corner) * _BLOCK + k] if hit else 0.0
            cosine[i] = table[4 * _BLOCK + k] if hit else 0.0
