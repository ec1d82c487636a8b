# SPDX-License-Identifier: MIT
"""Agreement of beams with faces: which beams of a face lie on one surface, and how much of it they show.

The beams of a face may be of the face, of things before it and of things behind it. Its surface is where most
area lies: the mode of the distances, then a robust plane, to which those belong that are within a gate about
the level of their own scan. A gate about the level of all would cut off scans whose poses are off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt import limits
from completion.asbuilt.beams import Evidence
from completion.asbuilt.faces import DesignFaces
from completion.observe.observation import Observation
from completion.observe.sensor_modes import N_MODES, displacements, range_displacements
from scenes.checks import ArrayValue, BoolArray, FloatArray, IntArray
from scenes.run.mapping import trim
from texture.engine.compiled import compiled

N_SHARED = N_MODES + 2
"""Errors that a sensor has alike over its image, of unit variance."""

_ROUNDS = 4
_MOST_HELD = 4_000  # beams of a face whose surface is fitted


@dataclass(frozen=True, slots=True, eq=False)
class FaceBeams(ArrayValue):
    """Beams (n,) by face and scan, evenly taken from all that belong to faces.

    Attributes
    ----------
    face, scan : (n,) int32
        Ascending by face, then by scan.
    points : (n, 3) float
        Where they ended, metres, at the poses as given.
    distance : (n,) float
        From the face, outwards.
    normal : (n, 3) float
        Of the face there.
    columns : (n, 5) float
        Derivative of the distance by the parameters of the face.
    uv : (n, 2) float
        Place on the face, -1 to 1.
    sigma : (n,) float
        Standard deviation of the distance by the range noise.
    area : (n,) float
        Of the face that a beam stands for, square metres.
    shared : (n, 12) float
        Derivative by the errors of the sensor.
    """

    face: NDArray[np.int32]
    scan: NDArray[np.int32]
    points: FloatArray
    distance: FloatArray
    normal: FloatArray
    columns: FloatArray
    uv: FloatArray
    sigma: FloatArray
    area: FloatArray
    shared: FloatArray

    def of_faces(self) -> list[slice]:
        """Where the beams of each face that has any are."""
        ends = np.flatnonzero(np.diff(self.face, prepend=-1, append=-1))
        return [slice(a, b) for a, b in pairwise(ends)]


def beams_on_faces(
    observations: Sequence[Observation],
    pixels: Sequence[IntArray],
    evidence: Sequence[Evidence],
    faces: DesignFaces,
    *,
    scale: float,
    with_far: bool,
) -> FaceBeams:
    """Gather the beams (n,) of F faces; those that ended farther off, as a displaced one's, as of F + f."""
    parts = [
        _of_scan(number, seen, flat, found, faces, scale=scale, is_far=is_far)
        for is_far in (False, True)[: 1 + with_far]
        for number, (seen, flat, found) in enumerate(zip(observations, pixels, evidence, strict=True))
    ]
    face, scan = (np.concatenate([part[k] for part in parts]) for k in range(2))
    order = np.lexsort((scan, face))
    columns = [np.concatenate([part.pop() for part in parts])[order] for _ in range(len(parts[0]))][::-1]
    trim()
    shared, scan, points, normal = np.empty((len(order), N_SHARED)), columns[1], columns[2], columns[4]
    for number, seen in enumerate(observations):
        own = np.flatnonzero(scan == number)
        shared[own] = _shared(seen, points[own], normal[own], scale)
    return FaceBeams(*[*columns, shared])


def _of_scan(
    number: int,
    seen: Observation,
    flat: IntArray,
    found: Evidence,
    faces: DesignFaces,
    *,
    scale: float,
    is_far: bool,
) -> list[NDArray[np.int32] | FloatArray]:
    trim()
    own = -2 - found.face if is_far else found.face
    chosen = np.flatnonzero(own >= 0)
    order = chosen[np.argsort(own[chosen], kind="stable")]
    face = own[order]
    count = np.bincount(face, minlength=len(faces))
    step = np.maximum(np.ceil(count / limits.MOST_A_PAIR), 1).astype(np.int64)
    place = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
    kept = place % step[face] == step[face] // 2
    order, face = order[kept], np.ascontiguousarray(face[kept])
    points, rays = seen.points_at(flat[order]), seen.rays_at(flat[order])
    at = faces.places(face, points)
    cosine = np.maximum(np.abs(np.einsum("ij,ij->i", rays, at.normal)), limits.LEAST_COSINE)
    ranges = np.linalg.norm(points - seen.scan.origin, axis=1)
    # footprints smear a slanted surface by no more than neighbouring pixels do: noise along the ray is all
    sigma = np.maximum(seen.noise.sigma(ranges), 1e-4 * scale) * cosine
    area = found.area[order] / cosine * step[face]
    return [
        face + np.int32(len(faces) * is_far), np.full(len(face), number, np.int32), points, at.distance,
        at.normal, at.columns, at.uv, sigma, area,
    ]  # fmt: skip


def _shared(seen: Observation, points: FloatArray, normals: FloatArray, scale: float) -> FloatArray:
    """What errors of the sensor do along normals: (n, 12)."""
    modes = np.concatenate([displacements(seen, points), range_displacements(seen, points, scale)])
    return np.asarray(np.einsum("mij,ij->im", modes, normals))


@dataclass(frozen=True, slots=True, eq=False)
class FaceSurface:
    """The surface that the beams of a face show.

    Attributes
    ----------
    face : int
        Its number.
    is_on : (n,) bool
        Which beams of the face are on it.
    is_core : (n,) bool
        Which are in the middle of those, and tell where it lies.
    residual : (n,) float
        How far each is off it, scans at their own levels, metres.
    area_m2 : float
        What they stand for.
    level : float
        Its offset from the face, metres.
    sd : float
        Of beams about it, robust.
    is_bent : bool
        Whether it is bent rather than flat.
    """

    face: int
    is_on: BoolArray
    is_core: BoolArray
    residual: FloatArray
    area_m2: float
    level: float
    sd: float
    is_bent: bool


def find_surface(
    beams: FaceBeams, part: slice, registration: FloatArray, *, scale: float, may_bend: bool
) -> FaceSurface:
    """Find the surface of a face from its beams (n,), and the registration's sd there (n,), metres."""
    y, area, sigma = beams.distance[part], beams.area[part], beams.sigma[part]
    own_scan, columns, uv = beams.scan[part], beams.columns[part], beams.uv[part]
    typical = median(sigma)
    start = _mode(y, area, max(2e-3 * scale, typical))
    held = _Held(y=y, scan=own_scan, sigma=sigma, registration=registration, start=start, scale=scale)
    best = _fit(held, columns)
    is_bent = False
    if may_bend and best.is_on.sum() > 3 * limits.FEWEST_BEAMS:
        bent = _fit(held, bend(columns, uv))
        gain = area[bent.is_on].sum() / max(area[best.is_on].sum(), 1e-12)
        reach = np.ptp(uv[bent.is_on], axis=0).max() if bent.is_on.any() else 0.0
        if reach > 1.0 and (gain > 1.05 or bent.sd < 0.8 * best.sd):
            best, is_bent = bent, True
    return FaceSurface(
        face=int(beams.face[part.start]),
        is_on=best.is_on,
        is_core=best.is_core,
        residual=best.residual,
        area_m2=float(area[best.is_on].sum()),
        level=best.level,
        sd=best.sd,
        is_bent=is_bent,
    )


def bend(columns: FloatArray, uv: FloatArray) -> FloatArray:
    """Columns (n, 5) of planes at places (n, 2) with those of bends."""
    return np.column_stack([columns[:, :3], np.square(uv)])


def _mode(y: FloatArray, area: FloatArray, width: float) -> float:
    """Where most area lies, within a width on either side."""
    low = y.min()
    cell = np.floor((y - low) / (width / 2)).astype(np.int64)
    held = np.convolve(np.bincount(cell, area), np.ones(5), "same")
    top = low + (np.argmax(held) + 0.5) * width / 2
    near = np.abs(y - top) <= width
    return median(y[near]) if near.any() else float(top)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    is_on: BoolArray
    is_core: BoolArray
    residual: FloatArray
    level: float
    sd: float


class _Held(NamedTuple):
    """Beams (n,) of a face: distance, scan, noise, registration's sd, metres; where the surface may start."""

    y: FloatArray
    scan: NDArray[np.int32]
    sigma: FloatArray
    registration: FloatArray
    start: float
    scale: float


def _fit(held: _Held, columns: FloatArray) -> _Fit:
    """Fit a surface to what is near it, scans at their own levels, and narrow the gate round by round."""
    y, scan, sigma, registration, start, scale = held
    used = np.ascontiguousarray(columns[:, np.abs(columns).max(axis=0) > 1e-9])
    bounds = np.flatnonzero(np.diff(scan, prepend=-1, append=-1))  # scans ascend
    bound = limits.LEVEL_SD * _medians(registration, bounds)
    residual, on, core = y - start, np.empty(len(y), np.bool_), np.empty(len(y), np.bool_)
    sd = _settle(y, used, sigma, bounds, bound, limits.START_M * scale, (residual, on, core))
    return _Fit(on, core, residual, median(y[core]) if core.any() else start, sd)


@compiled
def median(values: FloatArray) -> float:
    """Median of values (n,): what numpy says, of few in a tenth of the time."""
    return float(np.median(values))


@compiled
def _medians(values: FloatArray, bounds: NDArray[np.int64]) -> FloatArray:
    """Median of values (n,) between each two neighbouring bounds."""
    out = np.empty(bounds.size - 1)
    for k in range(out.size):
        out[k] = np.median(values[bounds[k] : bounds[k + 1]])
    return out


@compiled
def _settle(
    y: FloatArray,
    columns: FloatArray,
    sigma: FloatArray,
    bounds: NDArray[np.int64],
    bound: FloatArray,
    gate: float,
    out: tuple[FloatArray, BoolArray, BoolArray],
) -> float:
    """Write the residuals, the beams on the surface and the core among them; return the robust sd, metres.

    Scan k has the beams from `bounds[k]` to `bounds[k + 1]`; they may share an offset of up to `bound[k]`.
    """
    residual, on, core = out
    n, sd = y.size, float(np.median(sigma))
    for k in range(n):
        on[k] = abs(residual[k]) <= gate + 2.0 * sigma[k]
    if on.any():  # a few beams of another surface at one end would turn the first plane
        sd = 1.4826 * float(np.median(np.abs(residual[on])))
    for k in range(n):
        on[k] = on[k] and abs(residual[k]) <= max(3.0 * sd, limits.WINDOW_SIGMAS * sigma[k])
        core[k] = on[k]
    for turn in range(2 * _ROUNDS):
        count = int(np.count_nonzero(core))
        if count < 2 * columns.shape[1]:
            break
        factors = _plane(y, columns, sigma, core, count)
        for k in range(n):
            total = 0.0
            for j in range(columns.shape[1]):
                total += columns[k, j] * factors[j]
            residual[k] = y[k] - total
        for scan in range(bound.size):
            part = residual[bounds[scan] : bounds[scan + 1]]
            held = part[core[bounds[scan] : bounds[scan + 1]]]
            if held.size:
                part -= min(max(float(np.median(held)), -bound[scan]), bound[scan])
        if turn < _ROUNDS:
            sd = 1.4826 * float(np.median(np.abs(residual[core])))
        for k in range(n):
            off = abs(residual[k])
            on[k] = off <= max(3.0 * sd, limits.WINDOW_SIGMAS * sigma[k])
            # what stands before a face is seen, what may lie behind it is not: only the middle has no side
            narrow = turn >= _ROUNDS - 1
            core[k] = off <= limits.CORE_SIGMAS * max(sd, sigma[k]) if narrow else on[k]
    return sd


@compiled
def _plane(y: FloatArray, columns: FloatArray, sigma: FloatArray, used: BoolArray, count: int) -> FloatArray:
    """Factors (k,) of columns (n, k) that fit the distances of `count` used beams (n,) best."""
    size, step = columns.shape[1], max(1, count // _MOST_HELD)
    information, right, seen = np.zeros((size, size)), np.zeros(size), 0
    for k in range(y.size):
        if not used[k]:
            continue
        if seen % step == 0:
            weight = 1.0 / (sigma[k] * sigma[k])
            for i in range(size):
                right[i] += weight * columns[k, i] * y[k]
                for j in range(size):
                    information[i, j] += weight * columns[k, i] * columns[k, j]
        seen += 1
    ridge = 1e-6 * np.trace(information) / size
    for i in range(size):
        information[i, i] += ridge
    factors: FloatArray = np.linalg.solve(information, right).astype(np.float64)
    return factors
