# SPDX-License-Identifier: MIT
"""Where rays meet the planes of the faces that Embree names, in float64, compiled.

Imported only when a ray caster is built, because numba takes a while to load. The functions hold no lock
while they run. Rays are rows of (n, 3) arrays; one origin of shape (1, 3) serves all directions.
"""

from __future__ import annotations

import numpy as np
from numba import float64, int32, njit, types, uint64, void
from numpy.typing import NDArray

from scenes.checks import FloatArray
from scenes.rays.local_mesh import LocalMesh
from scenes.run.stored_code import can_store

_BLOCK = 64  # rays whose planes are met side by side, in vector registers
_VECTORS = types.Array(float64, 2, "C", readonly=True)
_NUMBERS = types.Array(float64, 1, "C", readonly=True)
_FACES = types.Array(int32, 2, "C", readonly=True)
_HIT_FACES = types.Array(int32, 1, "C", readonly=True)


COMPILED = {"nogil": True, "cache": can_store(), "error_model": "numpy", "no_cfunc_wrapper": True}
INLINED = {"error_model": "numpy", "forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of parts of compiled loops: without an entry for the interpreter, which must not call them."""


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
    with np.errstate(all="ignore"):  # where the compiler is switched off
        _meet(mesh.vertices, mesh.faces, mesh.centre, origins, directions, face, *out)


@njit(**INLINED)
def _clip(value: float, low: float, high: float) -> float:
    """Return `value` within low..high; NaN becomes `low`."""
    value = value if value > low else low
    return value if value < high else high


@njit(**INLINED)
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


@njit(**INLINED)
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
