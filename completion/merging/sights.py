# SPDX-License-Identifier: MIT
"""Sights: any number of scans as one compiled loop reads them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from completion.evidence.field_of_view import Views
from completion.evidence.sight import Eye, Sight
from completion.observe.rays import Noise
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from texture.engine.compiled import inlined

_BLOCK = 2**16  # ranges that are looked at together


class Packed(NamedTuple):
    """Scans without their pixels, which stay where they are: a loop takes no list of arrays."""

    numbers: FloatArray  # (n, 30) the eye and the noise of each
    angles: FloatArray  # of all scans, one after the other
    first: NDArray[np.int64]  # (n + 1,) where those of each scan begin
    address: NDArray[np.int64]  # (n,) of its ranges in memory
    farthest: FloatArray  # (n,) its greatest range, metres; -inf where nothing came back


@dataclass(frozen=True, slots=True, eq=False)
class Sights:
    """Some scans, packed for compiled loops."""

    packed: Packed
    views: Views
    ranges: tuple[FloatArray, ...]  # what the addresses lead to, kept alive

    @classmethod
    def of(cls, sights: Sequence[Sight]) -> Sights:
        """Pack scans."""
        ranges = tuple(np.ascontiguousarray(one.ranges, dtype=np.float64) for one in sights)
        packed = Packed(
            numbers=np.array([_numbers(one) for one in sights]),
            angles=np.concatenate([one.angles for one in sights]),
            first=np.cumsum([0, *(len(one.angles) for one in sights)]),
            address=np.array([one.ctypes.data for one in ranges], dtype=np.int64),
            farthest=np.array([_farthest(one) for one in ranges]),
        )
        return cls(packed, Views.of((one.eye for one in sights), packed.farthest), ranges)


def _farthest(ranges: FloatArray) -> float:
    """The greatest finite range, a block after the other; -inf where there is none."""
    blocks = np.array_split(ranges, len(ranges) // _BLOCK + 1)
    farthest = max(float(np.max(one, where=np.isfinite(one), initial=-np.inf)) for one in blocks)
    trim()
    return farthest


def _numbers(sight: Sight) -> FloatArray:
    eye = sight.eye
    tolerances = eye.pixel_angle, eye.n_sigma, eye.flatness_m, eye.registration_m, eye.max_m
    view = *eye.shape, eye.is_spherical, *eye.lens
    return np.array([*np.ravel(eye.turn), *eye.shift, *eye.origin, *view, *tolerances, *sight.noise])


@inlined
def eye_of(scans: Packed, scan: int) -> Eye:
    """The eye of a scan."""
    a = scans.numbers[scan]
    return Eye(
        turn=((a[0], a[1], a[2]), (a[3], a[4], a[5]), (a[6], a[7], a[8])),
        shift=(a[9], a[10], a[11]),
        origin=(a[12], a[13], a[14]),
        shape=(int(a[15]), int(a[16])),
        is_spherical=a[17] != 0.0,
        lens=(a[18], a[19], a[20], a[21]),
        pixel_angle=a[22],
        n_sigma=a[23],
        flatness_m=a[24],
        registration_m=a[25],
        max_m=a[26],
    )


@inlined
def noise_of(scans: Packed, scan: int) -> Noise:
    """The noise of a scan's ranges."""
    a = scans.numbers[scan]
    return Noise(a[27], a[28], a[29])


@intrinsic
def number_at(_typing: Any, address: Any, index: Any) -> Any:
    """Return the number of an index in the array of doubles at an address."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pointer = builder.inttoptr(arguments[0], ir.DoubleType().as_pointer())
        return builder.load(builder.gep(pointer, [arguments[1]]))

    return types.float64(address, index), generate
