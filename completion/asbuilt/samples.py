# SPDX-License-Identifier: MIT
"""Samples of a design's exposed surface, and what each scan says of each: measured, or why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt import limits
from completion.asbuilt.beams import NOT_USED, Gates, Surfaces
from completion.asbuilt.extra import ExtraCells
from completion.asbuilt.findings import SAMPLE_REASONS, Hider, Samples
from completion.evidence.sight import ScanSight, pixel_of, sight_of
from completion.observe.observation import Observation
from completion.observe.rays import dot, minus
from completion.observe.tolerance import Tolerance
from scenes.checks import ArrayValue, BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster
from scenes.run.mapping import trim
from texture.engine.compiled import compiled

_GOLDEN = (0.7548776662466927, 0.5698402909980532)  # steps of an even sequence in the unit square
_OFF = 0.1  # of COVERED_M, before a face, where rays start
_MEASURED, _HIDDEN, _BEHIND, _VIEW, _RANGE, _OBLIQUE, _NOT_MET, _NOISY = range(len(SAMPLE_REASONS))
_RANK = np.array([9, 7, 6, 2, 3, 4, 8, 5], np.int8)  # of each reason: what tells most counts


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSamples(ArrayValue):
    """Samples (n,) of exposed surface.

    `points`, `normals` (n, 3), `triangle` and `element` (n,), the `area_m2` (n,) that each stands for, and
    which are of no closed body, `is_open` (n,): seen from both sides.
    """

    points: FloatArray
    normals: FloatArray
    triangle: NDArray[np.int64]
    element: NDArray[np.int32]
    area_m2: FloatArray
    is_open: BoolArray

    def of_element(self, surface: int) -> NDArray[np.int64]:
        """Return the rows (k,) of an element's samples, which lie together."""
        ends = np.searchsorted(self.element, [surface, surface + 1])
        return np.arange(ends[0], ends[1])


def sample_design(mesh: LabelledMesh, surfaces: Surfaces, caster: RayCaster, scale: float) -> SurfaceSamples:
    """Sample the surface of a design evenly, where nothing of it covers it, element by element."""
    area = np.where(surfaces.is_solid, mesh.face_areas(), 0.0)
    ends = np.cumsum(area)
    each = max((limits.SAMPLE_M * scale) ** 2, float(ends[-1]) / limits.MOST_SAMPLES)
    n = int(ends[-1] / each)
    triangle = np.searchsorted(ends, (np.arange(n) + 0.5) * each)
    a, b = ((0.5 + step * np.arange(1, n + 1)) % 1.0 for step in _GOLDEN)
    root = np.sqrt(a)
    weights = np.column_stack([1 - root, root * (1 - b), root * b])
    points = np.einsum("nk,nkj->nj", weights, mesh.corners[triangle])
    normals = surfaces.normal[triangle]
    start = points + _OFF * limits.COVERED_M * scale * normals
    hits = caster.first_hit(start, normals)
    inside = np.einsum("ij,ij->i", surfaces.normal[hits.face], normals) > 0
    inside &= ~surfaces.is_open[hits.face]
    covered = hits.hit & (inside | (hits.ranges < limits.COVERED_M * scale))
    free = np.flatnonzero(~covered)
    free = free[np.argsort(surfaces.element[triangle[free]], kind="stable")]
    triangle = triangle[free]
    element = surfaces.element[triangle]
    areas, is_open = np.full(len(free), each), surfaces.is_open[triangle]
    return SurfaceSamples(points[free], normals[free], triangle, element, area_m2=areas, is_open=is_open)


def exposed_share(samples: SurfaceSamples, surfaces: Surfaces, face_area: FloatArray) -> FloatArray:
    """Share (F,) of each face that nothing covers."""
    face = surfaces.face[samples.triangle]
    area = np.bincount(face[face >= 0], samples.area_m2[face >= 0], len(face_area))
    return np.asarray(np.minimum(area / np.maximum(face_area, 1e-12), 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class SampleStates:
    """What all scans together say of samples (n,).

    `reason` index in `SAMPLE_REASONS`, 0 for measured; `blocker` what hides each (`Samples`); `hiders` what
    hides each element, largest first; `noise_m` (n, 2) standard deviation and range of beams too noisy.
    """

    reason: NDArray[np.int8]
    blocker: NDArray[np.int32]
    hiders: dict[int, tuple[Hider, ...]]
    noise_m: FloatArray


def judge_samples(
    samples: SurfaceSamples,
    observations: Sequence[Observation],
    labels: Sequence[NDArray[np.int32]],
    cells: ExtraCells,
    gates: Gates,
) -> SampleStates:
    """Look all samples (n,) up in every scan; `labels` are those of all pixels of each (`beams.Evidence`)."""
    n = len(samples.points)
    reason, blocker = np.full(n, _VIEW, np.int8), np.full(n, -1, np.int32)
    noise_m = np.full((n, 2), np.inf)
    hidden: list[tuple[NDArray[np.int64], NDArray[np.int32]]] = []
    tolerance = Tolerance(n_sigma=limits.GATE_SIGMAS, flatness_m=0.0, registration_m=0.0, max_m=np.inf)
    for seen, label in zip(observations, labels, strict=True):
        trim()
        left = np.flatnonzero(reason != _MEASURED)
        code, pixel = np.empty(len(left), np.int8), np.empty(len(left), np.int32)
        noise = seen.noise.constant_m, seen.noise.linear, seen.noise.quadratic_per_m
        at = samples.points, samples.normals, samples.is_open, samples.element
        _look_up(sight_of(seen, tolerance), label, left, *at, noise, gates, code, pixel)
        by = np.full(len(left), -1, np.int32)
        stopped = np.flatnonzero((code == _HIDDEN) | (code == _BEHIND))
        by[stopped] = label[pixel[stopped]]
        extra = stopped[by[stopped] < 0]  # or too noisy to tell, which a thing may hold all the same
        thing = cells.thing_at(seen.points_at(pixel[extra]))
        by[extra] = np.where(thing >= 0, -2 - thing, -1)
        better = np.flatnonzero(_RANK[code] > _RANK[reason[left]])
        reason[left[better]], blocker[left[better]] = code[better], by[better]
        noisy = np.flatnonzero(code == _NOISY)
        ranges = seen.scan.ranges.ravel()[pixel[noisy]]
        told = np.column_stack([seen.noise.sigma(ranges), ranges])
        noise_m[left[noisy]] = np.minimum(noise_m[left[noisy]], told)
        kept = np.flatnonzero(by < -1)
        hidden.append((left[kept], by[kept]))
    return SampleStates(reason, blocker, _hiders(samples, reason, hidden, observations), noise_m)


def _hiders(
    samples: SurfaceSamples,
    reason: NDArray[np.int8],
    hidden: Sequence[tuple[NDArray[np.int64], NDArray[np.int32]]],
    observations: Sequence[Observation],
) -> dict[int, tuple[Hider, ...]]:
    """What hides each element's samples that no scan measured, and from where."""
    rows = []
    for number, (index, by) in enumerate(hidden):
        left = reason[index] == _HIDDEN
        index, by = index[left], by[left]
        key = np.column_stack([samples.element[index], by, np.full(len(by), number)])
        rows.append(np.column_stack([key, index]).astype(np.int64))
    table = np.concatenate([*rows, np.zeros((0, 4), np.int64)]).astype(np.int64)
    found: dict[int, list[Hider]] = {}
    for (element, thing), part in _by_pair(table):
        area = float(samples.area_m2[np.unique(part[:, 3])].sum())
        who = f"extra-{-1 - thing}"
        stations = tuple(observations[k].scan.name for k in np.unique(part[:, 2]))
        found.setdefault(element, []).append(Hider(who, stations, area))
    return {k: tuple(sorted(held, key=lambda one: -one.area_m2)) for k, held in found.items()}


def _by_pair(table: NDArray[np.int64]) -> list[tuple[tuple[int, int], NDArray[np.int64]]]:
    """Rows (n, 4) by their first two columns."""
    if not len(table):
        return []
    table = table[np.lexsort(table.T[::-1])]
    starts = np.flatnonzero((np.diff(table[:, :2], axis=0) != 0).any(axis=1)) + 1
    return [((int(part[0, 0]), int(part[0, 1])), part) for part in np.split(table, starts)]


def samples_of(samples: SurfaceSamples, states: SampleStates) -> Samples:
    """Return samples with their states for the findings."""
    unknown = (states.reason != _MEASURED).astype(np.int8) * 2
    return Samples(
        points=samples.points,
        normals=samples.normals,
        element=samples.element,
        area_m2=samples.area_m2,
        state=unknown,
        reason=states.reason,
        blocker=states.blocker,
    )


@compiled
def _look_up(
    sight: ScanSight,
    label: NDArray[np.int32],
    left: NDArray[np.int64],
    points: FloatArray,
    normals: FloatArray,
    is_open: BoolArray,
    element: NDArray[np.int32],
    noise: tuple[float, float, float],
    gates: Gates,
    code: NDArray[np.int8],
    pixel: NDArray[np.int32],
) -> None:
    """Write what a scan says of the samples that are left (n,): reason and pixel."""
    eye = sight.eye
    for i in range(left.size):
        k = left[i]
        place = points[k, 0], points[k, 1], points[k, 2]
        ray = minus(place, eye.origin)
        facing = -(ray[0] * normals[k, 0] + ray[1] * normals[k, 1] + ray[2] * normals[k, 2])
        facing = abs(facing) if is_open[k] else facing
        pixel[i] = -1
        if facing <= 0.0:
            code[i] = _VIEW
            continue
        distance = np.sqrt(dot(ray, ray))
        cosine = facing / distance
        at = pixel_of(eye, sight.angles, place)
        if at < 0:
            code[i] = _VIEW
            continue
        pixel[i] = at
        r = sight.ranges[at]
        if not np.isfinite(r):
            code[i] = _RANGE
            continue
        if label[at] == NOT_USED:
            code[i] = _NOISY
            continue
        sigma = np.sqrt(noise[0] ** 2 + (noise[1] * r) ** 2 + (noise[2] * r * r) ** 2)
        posed = np.sqrt(gates.registration[0] ** 2 + (gates.registration[1] * r) ** 2)
        safe = max(cosine, limits.LEAST_COSINE)
        gate = (limits.GATE_SIGMAS * np.sqrt(sigma * sigma + posed * posed) + gates.gate_m) / safe
        gate += distance * eye.pixel_angle * np.sqrt(max(1.0 - safe * safe, 0.0)) / safe
        off = r - distance
        if off < -gate and not (label[at] == element[k] and -off * cosine <= gates.near_m):
            code[i] = _HIDDEN if label[at] < 0 else _BEHIND
        elif cosine < limits.LEAST_COSINE:
            code[i] = _OBLIQUE
        elif off <= gate or (label[at] == element[k] and off * cosine <= gates.near_m):
            code[i] = _MEASURED
        else:
            code[i] = _NOT_MET
