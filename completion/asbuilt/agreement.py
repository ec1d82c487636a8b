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

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt import limits
from completion.asbuilt.beams import Evidence
from completion.asbuilt.faces import DesignFaces
from completion.observe.observation import Observation
from completion.observe.sensor_modes import N_MODES, displacements, range_displacements
from scenes.checks import BoolArray, FloatArray, IntArray, freeze_arrays

N_SHARED = N_MODES + 2
"""Errors that a sensor has alike over its image, of unit variance."""

_ROUNDS = 4
_MOST_HELD = 4_000  # beams of a face whose surface is fitted


@dataclass(frozen=True, slots=True, eq=False)
class FaceBeams:
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

    def __post_init__(self) -> None:
        freeze_arrays(self)

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
    """Gather the beams of F faces; those that ended farther off, as a displaced element's do, as of F + f."""
    parts = [
        _of_scan(number, seen, flat, found, faces, scale=scale, is_far=is_far)
        for is_far in (False, True)[: 1 + with_far]
        for number, (seen, flat, found) in enumerate(zip(observations, pixels, evidence, strict=True))
    ]
    columns = [np.concatenate([part[k] for part in parts]) for k in range(len(parts[0]))]
    order = np.lexsort((columns[1], columns[0]))
    return FaceBeams(*(column[order] for column in columns))


def _of_scan(
    number: int,
    seen: Observation,
    flat: IntArray,
    found: Evidence,
    faces: DesignFaces,
    *,
    scale: float,
    is_far: bool,
) -> tuple[NDArray[np.int32] | FloatArray, ...]:
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
    return (
        face + np.int32(len(faces) * is_far), np.full(len(face), number, np.int32), points, at.distance,
        at.normal, at.columns, at.uv, sigma,
        area, _shared(seen, points, at.normal, scale),
    )  # fmt: skip


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
    corners : (2, 2) float
        Quantiles of what was measured along u and v, -1 to 1.
    """

    face: int
    is_on: BoolArray
    is_core: BoolArray
    residual: FloatArray
    area_m2: float
    level: float
    sd: float
    is_bent: bool
    corners: FloatArray


def find_surface(
    beams: FaceBeams, part: slice, registration: FloatArray, *, scale: float, may_bend: bool
) -> FaceSurface:
    """Find the surface of a face from its beams (n,), and the registration's sd there (n,), metres."""
    y, area, sigma = beams.distance[part], beams.area[part], beams.sigma[part]
    own_scan, columns, uv = beams.scan[part], beams.columns[part], beams.uv[part]
    typical = float(np.median(sigma))
    start = _mode(y, area, max(2e-3 * scale, typical))
    best = _fit(y, columns, own_scan, sigma, registration, start=start, scale=scale)
    is_bent = False
    if may_bend and best.is_on.sum() > 3 * limits.FEWEST_BEAMS:
        bent = _fit(y, bend(columns, uv), own_scan, sigma, registration, start=start, scale=scale)
        gain = area[bent.is_on].sum() / max(area[best.is_on].sum(), 1e-12)
        reach = np.ptp(uv[bent.is_on], axis=0).max() if bent.is_on.any() else 0.0
        if reach > 1.0 and (gain > 1.05 or bent.sd < 0.8 * best.sd):
            best, is_bent = bent, True
    on = uv[best.is_on] if best.is_on.any() else uv
    corners = np.quantile(on, [limits.CORNERS, 1 - limits.CORNERS], axis=0).T
    return FaceSurface(
        face=int(beams.face[part.start]),
        is_on=best.is_on,
        is_core=best.is_core,
        residual=best.residual,
        area_m2=float(area[best.is_on].sum()),
        level=best.level,
        sd=best.sd,
        is_bent=is_bent,
        corners=corners,
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
    return float(np.median(y[near])) if near.any() else float(top)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    is_on: BoolArray
    is_core: BoolArray
    residual: FloatArray
    level: float
    sd: float


def _fit(
    y: FloatArray,
    columns: FloatArray,
    scan: NDArray[np.int32],
    sigma: FloatArray,
    registration: FloatArray,
    *,
    start: float,
    scale: float,
) -> _Fit:
    """Fit a surface to what is near it, scans at their own levels, and narrow the gate round by round."""
    used = columns[:, np.abs(columns).max(axis=0) > 1e-9]
    residual, sd = y - start, float(np.median(sigma))
    names, own = np.unique(scan, return_inverse=True)
    level_sd = np.array([np.median(registration[own == k]) for k in range(len(names))])
    on = core = np.abs(residual) <= limits.START_M * scale + 2 * sigma
    for turn in range(2 * _ROUNDS):
        if core.sum() < 2 * used.shape[1]:
            break
        residual = y - used @ _plane(y, used, sigma, core)
        for k in range(len(names)):  # few: the scans that see this face
            mine = core & (own == k)
            if mine.any():
                bound = limits.LEVEL_SD * level_sd[k]
                residual[own == k] -= np.clip(np.median(residual[mine]), -bound, bound)
        if turn < _ROUNDS:
            sd = 1.4826 * float(np.median(np.abs(residual[core])))
        on = np.abs(residual) <= np.maximum(3 * sd, limits.WINDOW_SIGMAS * sigma)
        # what stands before a face is seen, what may lie behind it is not: only the middle has no side
        core = on if turn < _ROUNDS - 1 else np.abs(residual) <= limits.CORE_SIGMAS * np.maximum(sd, sigma)
    return _Fit(on, core, residual, float(np.median(y[core])) if core.any() else start, sd)


def _plane(y: FloatArray, columns: FloatArray, sigma: FloatArray, used: BoolArray) -> FloatArray:
    """Factors (k,) of columns (n, k) that fit the distances of used beams (n,) best."""
    index = np.flatnonzero(used)[:: max(1, int(used.sum()) // _MOST_HELD)]
    weight = 1.0 / sigma[index]
    held = columns[index] * weight[:, None]
    information = held.T @ held
    ridge = 1e-6 * np.trace(information) / len(information) * np.eye(len(information))
    return np.asarray(np.linalg.solve(information + ridge, held.T @ (weight * y[index])))
