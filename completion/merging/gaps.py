# SPDX-License-Identifier: MIT
"""Gaps: whether what lies between two parts of a surface was hidden, by all scans together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from completion.evidence.form import Form, place_of
from completion.evidence.sight import Ball, Eye, ScanSight, Views, look, pixel_of
from completion.merging.agreement import FittedPart
from completion.merging.limits import MAJORITY, STRIP_BRIDGES
from completion.observe.rays import Noise, deviation_at, triple
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Surface
from texture.engine.compiled import compiled, inlined

_BLOCK = 2**16  # ranges that are looked at together


class PackedScans(NamedTuple):
    """Scans without their pixels, which stay where they are: a loop takes no list of arrays."""

    numbers: FloatArray  # (n, 30) the eye and the noise of each
    angles: FloatArray  # of all scans, one after the other
    first: NDArray[np.int64]  # (n + 1,) where those of each scan begin
    address: NDArray[np.int64]  # (n,) of its ranges in memory
    farthest: FloatArray  # (n,) its greatest range, metres; -inf where nothing came back


@dataclass(frozen=True, slots=True, eq=False)
class Sights:
    """Some scans, packed for compiled loops."""

    packed: PackedScans
    views: Views
    ranges: tuple[FloatArray, ...]  # what the addresses lead to, kept alive

    @classmethod
    def of(cls, sights: Sequence[ScanSight]) -> Sights:
        """Pack scans."""
        ranges = tuple(np.ascontiguousarray(sight.ranges, dtype=np.float64) for sight in sights)
        packed = PackedScans(
            numbers=np.array([_numbers(sight) for sight in sights]),
            angles=np.concatenate([sight.angles for sight in sights]),
            first=np.cumsum([0, *(len(sight.angles) for sight in sights)]),
            address=np.array([range_m.ctypes.data for range_m in ranges], dtype=np.int64),
            farthest=np.array([_farthest(range_m) for range_m in ranges]),
        )
        return cls(packed, Views.of((sight.eye for sight in sights), packed.farthest), ranges)


def _farthest(ranges: FloatArray) -> float:
    """The greatest finite range, a block after the other; -inf where there is none."""
    blocks = np.array_split(ranges, len(ranges) // _BLOCK + 1)
    farthest = max(float(np.max(block, where=np.isfinite(block), initial=-np.inf)) for block in blocks)
    trim()
    return farthest


def _numbers(sight: ScanSight) -> FloatArray:
    eye = sight.eye
    tolerances = eye.pixel_angle, eye.n_sigma, eye.flatness_m, eye.registration_m, eye.max_m
    view = *eye.shape, eye.is_spherical, *eye.lens
    return np.array([*np.ravel(eye.turn), *eye.shift, *eye.origin, *view, *tolerances, *sight.noise])


@inlined
def eye_of(scans: PackedScans, scan: int) -> Eye:
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
def noise_of(scans: PackedScans, scan: int) -> Noise:
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


_N_ENDS = 40  # points of either part that bridges start from
_N_STEPS = 24
_SLACK = 1e-6  # of rounding, metres


def gap_is_hidden(part: FittedPart, other: FittedPart, sights: Sights) -> bool:
    """Tell whether a strip between two parts is wholly hidden or measured on the surface, by all scans.

    Bridges run on the other's surface from points of one part to points of the other. They make a strip
    where `STRIP_BRIDGES` of them, neighbours at either end, are closed: no step lies where a beam went
    through, and most are occluded or measured. Beside the strip it may be open: a window between two parts
    of a wall.
    """
    first, second = _ends(other.fit.surface, part.points, other.points)
    n = min(STRIP_BRIDGES, len(first), len(second))
    near_first = cKDTree(first).query(first, k=n)[1].reshape(len(first), n)
    near_second = cKDTree(second).query(second, k=n)[1].reshape(len(second), n)
    scale = max(part.scale, other.scale)
    order, n_reaching = _nearest_scans(first, second, other, sights.views)
    return _has_strip(
        sights.packed, order, n_reaching, other.form, scale, first, second, near_first, near_second
    )


def _nearest_scans(
    first: FloatArray, second: FloatArray, other: FittedPart, views: Views
) -> tuple[NDArray[np.int64], int]:
    """The scans that may see a bridge (n,), and how many of them measured so far that a beam may cross one.

    These come first, and those that stand nearest.

    No place of a bridge is farther from the middle than on the chart.
    """
    both = np.concatenate([first, second])
    low, high = both.min(axis=0), both.max(axis=0)
    middle = other.fit.surface.from_uv(((low + high) / 2)[None])[0]
    radius = float(np.hypot(*(high - low))) / 2
    chosen = np.flatnonzero(views.may_see(Ball(triple(middle), radius + _SLACK)))
    distance = np.sqrt(np.square(views.origin[chosen] - middle).sum(axis=1))
    too_far = views.farthest[chosen] < distance - radius - _SLACK
    order = np.lexsort([distance, too_far])
    return chosen[order], len(order) - int(too_far.sum())


@compiled
def _has_strip(
    scans: PackedScans,
    order: NDArray[np.int64],
    n_reaching: int,
    form: Form,
    sd: float,
    first: FloatArray,
    second: FloatArray,
    near_first: NDArray[np.int64],
    near_second: NDArray[np.int64],
) -> bool:
    """Tell whether some bridge, between ends (n, 2) and (m, 2), and its neighbours are all closed.

    Each bridge is followed once, when a strip wants it that none of those known to be open is in. `order`
    (scans,) is changed: a scan whose beam crossed a bridge probably crosses the next one, and at that step.
    """
    state = np.zeros((len(first), len(second)), np.int8)  # 1 closed, -1 open, 0 not known
    hint = np.zeros(1, np.int64)
    for i in range(len(first)):
        for j in range(len(second)):
            is_open = False
            for k in near_first[i]:
                is_open |= state[k, j] < 0
            for k in near_second[j]:
                is_open |= state[i, k] < 0
            for index in range(near_first.shape[1] + near_second.shape[1]):
                if is_open:
                    break
                a = near_first[i, index] if index < near_first.shape[1] else i
                b = j if index < near_first.shape[1] else near_second[j, index - near_first.shape[1]]
                if state[a, b] == 0:
                    ends = first[a, 0], first[a, 1], second[b, 0], second[b, 1]
                    state[a, b] = 1 if _is_closed(scans, order, n_reaching, form, sd, ends, hint) else -1
                is_open = state[a, b] < 0
            if not is_open:
                return True
    return False


@inlined
def _is_closed(
    scans: PackedScans,
    order: NDArray[np.int64],
    n_reaching: int,
    form: Form,
    sd: float,
    ends: tuple[float, float, float, float],
    hint: NDArray[np.int64],
) -> bool:
    """Hold the steps of a bridge against the scans until one crosses it, or none can and enough is seen."""
    across, up = ends[2] - ends[0], ends[3] - ends[1]
    seen, n_seen = np.zeros(_N_STEPS, np.bool_), 0
    for rank in range(order.size):
        if rank >= n_reaching and n_seen > MAJORITY * _N_STEPS:
            break
        scan = order[rank]
        eye, noise, address = eye_of(scans, scan), noise_of(scans, scan), scans.address[scan]
        angles = scans.angles[scans.first[scan] : scans.first[scan + 1]]
        for turn in range(_N_STEPS):
            k = (hint[0] + turn) % _N_STEPS
            along = (k + 0.5) / _N_STEPS
            place = place_of(form, ends[0] + along * across, ends[1] + along * up)
            pixel = pixel_of(eye, angles, place)
            if pixel < 0:
                continue
            measured = number_at(address, pixel)
            if not np.isfinite(measured):
                continue
            sentence = look(eye, form, place, sd, (measured, deviation_at(noise, measured)))
            if sentence.behind < -sentence.allowed:
                for place_in_order in range(rank, 0, -1):
                    order[place_in_order] = order[place_in_order - 1]
                order[0], hint[0] = scan, k
                return False
            if not seen[k]:
                seen[k] = True
                n_seen += 1
    return n_seen > MAJORITY * _N_STEPS


def _ends(surface: Surface, first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Chart coordinates of the points of both parts that bridges run between, those that face the other."""
    start, end = surface.to_uv(first), surface.to_uv(second)
    if np.isfinite(surface.period):
        end[:, 0] += np.rint((start[:, 0].mean() - end[:, 0]) / surface.period) * surface.period
    return _facing_sample(start, end), _facing_sample(end, start)


def _facing_sample(uv: FloatArray, other: FloatArray) -> FloatArray:
    """The nearest of `uv` to the other part, and as many from all over the rest of it."""
    distance = np.sqrt(_least_square(*uv.T.copy(), *other.T.copy()))
    order = np.argsort(distance, kind="stable")
    half = _N_ENDS // 2
    if len(order) <= _N_ENDS:
        return uv
    farther = order[half:]
    return np.asarray(uv[np.concatenate([order[:half], farther[:: max(1, len(farther) // half)][:half]])])


@compiled
def _least_square(u: FloatArray, v: FloatArray, other_u: FloatArray, other_v: FloatArray) -> FloatArray:
    """Squared distance (n,) from each of the places (n,), (n,) to the nearest of (m,), (m,).

    Some hundred of either are compared sooner than a tree is built.
    """
    least = np.full(u.size, np.inf)
    for j in range(other_u.size):
        for i in range(u.size):
            across, up = u[i] - other_u[j], v[i] - other_v[j]
            square = across * across + up * up
            least[i] = square if square < least[i] else least[i]
    return least
