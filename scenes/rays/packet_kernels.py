# SPDX-License-Identifier: MIT
"""Compiled loops that hand packets of 4, 8 or 16 rays to Embree.

Imported only when a ray caster is built, because numba takes a while to load. The loops hold no lock while
they run and write into the arrays they are given. Which rays reach Embree, and how, is said in
numpy by `scenes.rays.embree_single.usable_rays`.

A packet of Embree 4.4 (rtcore_ray.h) is a table of 32-bit numbers with a column for each ray ("lane"). Its
rows: origin x y z, tnear, direction x y z, time, tfar, mask, id, flags (RTCRay), normal x y z, u, v, primID,
geomID, instID, instPrimID (RTCHit).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import boolean, float64, int32, int64, njit, types, uint64, void
from numba.extending import intrinsic
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from scenes.rays.ray_kernels import COMPILED, INLINED

_N_ROWS, _TFAR, _MASK, _PRIMITIVE, _GEOMETRY = 24, 8, 9, 17, 18  # 21 rows are Embree's, the rest to spare
_VECTORS = types.Array(float64, 2, "C", readonly=True)
_CENTRE = types.Array(float64, 1, "C", readonly=True)
SPREAD = 0.05
"""Radians, and a share of the mesh's radius: wider packets are slower when they are walked through the tree
together. Measured: they begin to be at 0.04 to 0.2 on meshes of a million to 15,000 faces."""
_LEAST_COSINE = np.float32(math.cos(SPREAD))
_LARGEST = float(np.finfo(np.float32).max)  # what exceeds it is not finite in Embree


class PacketKernels(NamedTuple):
    """The compiled loops for packets of one width; see `compile_for`."""

    first_faces: Callable[..., int]
    any_hits: Callable[..., None]


@intrinsic
def _call(_typing: Any, function: Any, valid: Any, scene: Any, rays: Any, arguments: Any) -> Any:
    """Call the C function at an address with four pointers; no address is compiled in, so code is cached."""
    signature = types.void(function, valid, scene, rays, arguments)

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [value.type for value in values[1:]])
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])
        return context.get_dummy_value()

    return signature, generate


@njit(**INLINED)
def _aligned(n: int) -> NDArray[np.float32]:
    """Return n zeros of 32 bits at an address that Embree can load packets from."""
    room = np.zeros(n + 16, np.float32)
    skip = (-room.ctypes.data // 4) % 16
    return room[skip : skip + n]


@njit(**INLINED)
def _n_packets(n: int, width: int, columns: int) -> int:
    if columns == 0:
        return (n + width - 1) // width
    high = width // 4
    return (columns + 3) // 4 * ((n // columns + high - 1) // high)


@njit(**INLINED)
def _rays_of(packet: int, columns: int, n: int, first: NDArray[np.int64], count: NDArray[np.int64]) -> None:
    """Write which of n rays a packet casts: in each four lanes `count` consecutive ones from `first` on.

    Of an image a packet is a tile, four pixels wide.
    """
    high = len(first)
    if columns == 0:
        for four in range(high):
            first[four] = (packet * high + four) * 4
            count[four] = max(min(n - first[four], 4), 0)
    else:
        across = (columns + 3) // 4
        band = packet // across
        column = (packet - band * across) * 4
        for four in range(high):
            first[four] = (band * high + four) * columns + column
            count[four] = min(columns - column, 4) if first[four] < n else 0


@njit(**INLINED)
def _repeat(lanes: FloatArray, vector: FloatArray) -> None:
    """Give all lanes one vector (1, 3)."""
    for k in range(len(lanes)):
        lanes[k] = vector[0, k % 3]


@njit(**INLINED)
def _load(lanes: FloatArray, vectors: FloatArray, first: NDArray[np.int64], count: NDArray[np.int64]) -> None:
    """Copy the vectors of a packet's rays to `lanes` (3 * width,); NaN where a lane has no ray."""
    numbers = vectors.reshape(-1)
    for four in range(len(first)):
        start, end = first[four] * 3, count[four] * 3
        if end == 12:
            for k in range(12):
                lanes[four * 12 + k] = numbers[uint64(start + k)]
        else:
            for k in range(12):
                lanes[four * 12 + k] = numbers[start + k] if k < end else np.nan


@njit(**INLINED)
def _fill(
    packet: NDArray[np.float32],
    valid: NDArray[np.int32],
    centre: FloatArray,
    starts: FloatArray,
    ways: FloatArray,
    is_segment: bool,
) -> int:
    """Write a packet's rays and mask; return how many are usable. Lanes without a ray hold NaN.

    A segment ends at tfar; where it needs no ray, tfar already is the answer: -1 blocked, 0 free.
    """
    words, width = packet.view(np.int32), len(valid)
    c_x, c_y, c_z = centre[0], centre[1], centre[2]
    n_valid = 0
    for index in range(width):
        lane, k = uint64(index), uint64(3 * index)
        x, y, z = starts[k] - c_x, starts[k + uint64(1)] - c_y, starts[k + uint64(2)] - c_z
        a, b, c = ways[k], ways[k + uint64(1)], ways[k + uint64(2)]
        length = math.sqrt(a * a + b * b + c * c)
        finite = (abs(x) <= _LARGEST) & (abs(y) <= _LARGEST) & (abs(z) <= _LARGEST)
        finite &= (abs(a) <= _LARGEST) & (abs(b) <= _LARGEST) & (abs(c) <= _LARGEST)
        usable = finite & (length > 0)
        inverse = 1 / length
        packet[lane] = x
        packet[width + lane] = y
        packet[2 * width + lane] = z
        packet[4 * width + lane] = a * inverse
        packet[5 * width + lane] = b * inverse
        packet[6 * width + lane] = c * inverse
        reach = length if is_segment else np.inf
        packet[_TFAR * width + lane] = reach if finite else -1.0
        words[_PRIMITIVE * width + lane] = -1
        words[_GEOMETRY * width + lane] = -1
        valid[lane] = -1 if usable else 0
        n_valid += 1 if usable else 0
    return n_valid


@njit(error_model="numpy", inline="always")
def _is_coherent(packet: NDArray[np.float32], width: int, apart: float) -> bool:
    """Tell whether a packet's rays go nearly the same way from nearly the same place.

    Nearly: within `SPREAD` of the first one's direction, and within `apart` metres, squared, of its origin.
    Lanes that hold NaN do not count.
    """
    x, y, z = packet[0], packet[width], packet[2 * width]
    a, b, c = packet[4 * width], packet[5 * width], packet[6 * width]
    nearest, furthest = np.float32(1), np.float32(0)
    for index in range(width):
        k = uint64(index)
        along = packet[4 * width + k] * a + packet[5 * width + k] * b + packet[6 * width + k] * c
        d, e, f = packet[k] - x, packet[width + k] - y, packet[2 * width + k] - z
        away = d * d + e * e + f * f
        nearest = along if along < nearest else nearest
        furthest = away if away > furthest else furthest
    return bool((nearest >= _LEAST_COSINE) & (furthest <= apart))


@cache
def compile_for(width: int) -> PacketKernels:
    """Return the loops for packets of 4, 8 or 16 rays; knowing the width, the compiler makes them faster."""

    @njit(
        int64(int64, int64, int64, int64, float64, _CENTRE, _VECTORS, _VECTORS, int64, int32[::1]), **COMPILED
    )
    def first_faces(
        intersect: int,
        scene: int,
        arguments: int,
        together: int,
        apart: float,
        centre: FloatArray,
        origins: FloatArray,
        directions: FloatArray,
        columns: int,
        face: NDArray[np.int32],
    ) -> int:
        """Write the first face (n,) that each ray hits, -1 for none; return how many rays were usable.

        `intersect` is the address of rtcIntersect4, 8 or 16; scene, arguments and `together`, the arguments
        of coherent packets, are addresses too. `apart` is for `_is_coherent`. Centre (3,), origins (n, 3) or
        (1, 3) and directions (n, 3) are in world coordinates, metres. `columns` are of the image whose pixels
        the rays are, row by row; 0 when they are a list.
        """
        packet, valid = _aligned(_N_ROWS * width), _aligned(width).view(np.int32)
        starts, ways = np.empty(3 * width), np.empty(3 * width)
        first, count = np.zeros(width // 4, np.int64), np.zeros(width // 4, np.int64)
        words = packet.view(np.int32)
        words[_MASK * width : (_MASK + 1) * width] = -1
        n, n_usable = len(directions), 0
        shared = len(origins) == 1
        if shared:
            _repeat(starts, origins)
        for p in range(_n_packets(n, width, columns)):
            _rays_of(p, columns, n, first, count)
            if not shared:
                _load(starts, origins, first, count)
            _load(ways, directions, first, count)
            n_valid = _fill(packet, valid, centre, starts, ways, False)
            if n_valid > 0:
                how = together if _is_coherent(packet, width, apart) else arguments
                _call(intersect, valid.ctypes.data, scene, packet.ctypes.data, how)
                n_usable += n_valid
            for four in range(width // 4):
                for k in range(count[four]):
                    face[uint64(first[four] + k)] = words[_PRIMITIVE * width + 4 * four + k]
        return n_usable

    @njit(void(int64, int64, int64, int64, float64, _CENTRE, _VECTORS, _VECTORS, boolean[::1]), **COMPILED)
    def any_hits(
        occluded: int,
        scene: int,
        arguments: int,
        together: int,
        apart: float,
        centre: FloatArray,
        origins: FloatArray,
        targets: FloatArray,
        blocked: BoolArray,
    ) -> None:
        """Write whether something lies between origin and target; True for what is not finite.

        `occluded` is the address of rtcOccluded4, 8 or 16; the others are as for `first_faces`, and targets
        may be a single one too.
        """
        packet, valid = _aligned(_N_ROWS * width), _aligned(width).view(np.int32)
        packet.view(np.int32)[_MASK * width : (_MASK + 1) * width] = -1
        starts, ends = np.empty(3 * width), np.empty(3 * width)
        first, count = np.zeros(width // 4, np.int64), np.zeros(width // 4, np.int64)
        ways = np.empty(3 * width)
        n = len(blocked)
        if len(origins) == 1:
            _repeat(starts, origins)
        if len(targets) == 1:
            _repeat(ends, targets)
        for p in range(_n_packets(n, width, 0)):
            _rays_of(p, 0, n, first, count)
            if len(origins) > 1:
                _load(starts, origins, first, count)
            if len(targets) > 1:
                _load(ends, targets, first, count)
            for k in range(3 * width):
                ways[k] = ends[k] - starts[k]
            if _fill(packet, valid, centre, starts, ways, True) > 0:
                how = together if _is_coherent(packet, width, apart) else arguments
                _call(occluded, valid.ctypes.data, scene, packet.ctypes.data, how)
            for lane in range(min(width, n - p * width)):
                blocked[p * width + lane] = packet[_TFAR * width + lane] < 0

    return PacketKernels(first_faces, any_hits)
