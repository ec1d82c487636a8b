# SPDX-License-Identifier: MIT
"""Visibility: which samples are seen from where, and at which cosine of incidence.

Faces are two-sided: the cosine is |cos|, and the line of sight starts on the viewer's side of the face. For
closed bodies and for rooms with viewpoints in free space this is the same as one-sided faces, because the
back is hidden by the body itself; and many meshes in the wild are not consistently oriented. A surface
modelled as a single sheet counts as one surface, whichever side is seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from nbv.scanning.sensor import Sensor, View
from nbv.scanning.triangulation import both_see
from nbv.visibility.requirement import ROUNDING, Requirement, SightLimits
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.viewpoints import Candidates
from scenes.checks import BoolArray, FloatArray, frozen_copy, read_only_view
from scenes.rays.raycast import RayCaster
from scenes.run.memory import threads
from texture.engine.compiled import compiled

Progress = Callable[[str, int, int], None]
BYTES_A_SAMPLE = 120  # that a look from one position at all samples takes: indices, distances, cosines, ends

_LIFT = 1e-6  # of the distance, or of the mesh's extent where that is larger: Embree works in float32


def lines_of_sight(
    caster: RayCaster,
    position: FloatArray,
    samples: SurfaceSamples,
    limits: SightLimits,
    among: NDArray[np.int64],
) -> tuple[NDArray[np.int64], FloatArray]:
    """Return which samples `among` (k,) are seen from `position` (3,) in `limits`, and their cosines (m,).

    The position is in world coordinates, metres.
    """
    here = (read_only_view(np.ascontiguousarray(position)), samples.points, samples.normals)
    gate = (limits.min_range_m, limits.max_range_m)
    among, distance, cosine = select_facing(*here, among, limits.min_cosine - ROUNDING, *gate)
    if limits.precision is not None:
        keep = limits.hold(distance, np.abs(cosine))
        among, distance, cosine = among[keep], distance[keep], cosine[keep]
    if not len(among):
        return among, distance
    ends = lift_samples(*here, among, distance, cosine, _LIFT, samples.extent_m, samples.tolerance_m)
    seen = ~caster.are_blocked(ends, position[None])
    return among[seen], np.abs(cosine[seen])


def visible_from_positions(
    caster: RayCaster,
    positions: FloatArray,
    samples: SurfaceSamples,
    limits: SightLimits,
    *,
    n_threads: int | None = None,
    progress: Progress | None = None,
) -> csr_array:
    """Cosines (n_positions, n_samples), sparse, of the samples seen from each position in any direction.

    Positions (p, 3) are world coordinates, metres. Samples that stand for no area are not looked at. The
    result does not depend on the number of threads; `progress` is called with ("visibility", done, total).
    """
    everything = np.flatnonzero(samples.areas > 0)
    rows = []
    with threads(BYTES_A_SAMPLE * len(samples), n_threads) as pool:
        seen = pool.map(lambda p: lines_of_sight(caster, p, samples, limits, everything), positions)
        for done, row in enumerate(seen, start=1):
            rows.append((row[0].astype(np.int32), row[1]))
            if progress is not None:
                progress("visibility", done, len(positions))
    return stack_rows(rows, len(samples))


def visible_from_view(
    caster: RayCaster, view: View, samples: SurfaceSamples, limits: SightLimits
) -> tuple[NDArray[np.int64], FloatArray]:
    """Return which samples (m,) a view sees inside its aperture and `limits`, and their cosines (m,).

    The second device of a triangulating sensor must see them too.
    """
    pose, sensor = view.world_from_sensor, view.sensor
    local = (samples.points - pose.translation) @ pose.rotation
    seen, cosine = lines_of_sight(
        caster, pose.translation, samples, limits, np.flatnonzero(sensor.sees(local))
    )
    if sensor.partner is None:
        return seen, cosine
    way = samples.points[seen] - pose.translation
    both = both_see(
        caster,
        samples.points[seen],
        directions=way,
        normals=samples.normals[seen],
        partner=sensor.partner,
        world_from_sensor=pose,
    )
    return seen[both], cosine[both]


def orient(
    visible: csr_array, positions: FloatArray, rotations: FloatArray, points: FloatArray, sensor: Sensor
) -> csr_array:
    """Split each position's row into one row for each of its orientations: what is in the sensor's aperture.

    Of `visible` (p, n) from `visible_from_positions` values are kept; ones of 8 bits save memory where only
    visibility counts. Rotations (d, 3, 3) or (p, d, 3, 3) are world from sensor, the same for all positions
    (p, 3) or each one's own; points (n, 3) are the samples, metres. In (p * d, n) row i * d + j belongs to
    position i and orientation j.
    """
    rows = []
    for i, position in enumerate(positions):
        row = slice(visible.indptr[i], visible.indptr[i + 1])
        index, values = visible.indices[row], visible.data[row]
        offset = points[index] - position
        for rotation in rotations if rotations.ndim == 3 else rotations[i]:
            inside = sensor.sees(offset @ rotation)
            rows.append((index[inside], values[inside]))
    return stack_rows(rows, visible.shape[1])


def orientations_that_see(
    offsets: FloatArray, rotations: FloatArray, sensor: Sensor, enough: int = 1
) -> NDArray[np.int64]:
    """Count the orientations (d, 3, 3) in whose aperture world-frame `offsets` (n, 3) lie, up to `enough`."""
    times = np.zeros(len(offsets), np.int64)
    for rotation in rotations:
        open_ones = np.flatnonzero(times < enough)
        if not len(open_ones):
            break
        times[open_ones] += sensor.sees(offsets[open_ones] @ rotation)
    return times


def stack_rows(rows: Sequence[tuple[NDArray[np.integer[Any]], NDArray[Any]]], n_columns: int) -> csr_array:
    """Return the sparse matrix whose rows are given as (sorted columns (m,), values (m,))."""
    ends = np.cumsum([0] + [len(index) for index, _ in rows])
    small = np.int32 if ends[-1] <= np.iinfo(np.int32).max else np.int64  # scipy keeps both in the larger
    index = np.concatenate([np.zeros(0, small), *(index for index, _ in rows)], dtype=small)
    data = np.concatenate([values for _, values in rows]) if rows else np.zeros(0)
    return csr_array((data, index, ends.astype(small)), shape=(len(rows), n_columns))


@compiled
def select_facing(
    position: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    among: NDArray[np.int64],
    min_cosine: float,
    min_range_m: float,
    max_range_m: float,
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Return which samples `among` are in range and steep enough, their distances and signed cosines."""
    index = np.empty(len(among), np.int64)
    distance, cosine = np.empty(len(among)), np.empty(len(among))
    n = 0
    for k in among:
        x, y, z = position[0] - points[k, 0], position[1] - points[k, 1], position[2] - points[k, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if not (length > 0.0 and min_range_m <= length <= max_range_m):
            continue
        slope = (x * normals[k, 0] + y * normals[k, 1] + z * normals[k, 2]) / length
        if abs(slope) >= min_cosine:
            index[n], distance[n], cosine[n] = k, length, slope
            n += 1
    return index[:n].copy(), distance[:n].copy(), cosine[:n].copy()


@compiled
def lift_samples(
    position: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    index: NDArray[np.int64],
    distance: FloatArray,
    cosine: FloatArray,
    lift: float,
    extent_m: float,
    tolerance_m: float,
) -> FloatArray:
    """Return where lines of sight to the samples `index` end: off their surface, on the viewer's side.

    `lift` is the share of the distance, or of `extent_m` where that is larger, by which they are moved along
    the normal; they may end `tolerance_m` before the sample, at most half way.
    """
    ends = np.empty((len(index), 3))
    for i in range(len(index)):
        k = index[i]
        off = math.copysign(lift * max(distance[i], extent_m), cosine[i])
        nearer = min(tolerance_m / distance[i], 0.5)
        for axis in range(3):
            towards = position[axis] - points[k, axis]
            ends[i, axis] = points[k, axis] + normals[k, axis] * off + towards * nearer
    return ends


Reason = Literal[
    "hidden", "out_of_range", "grazing", "out_of_aperture", "too_sparse", "too_uncertain", "too_few_views"
]
REASONS: tuple[Reason, ...] = get_args(Reason)
_SIEVES: tuple[Reason, ...] = (
    "hidden",
    "out_of_range",
    "grazing",
    "too_sparse",
    "too_uncertain",
    "out_of_aperture",
)
_AT_A_TIME = 8  # positions; fixed, so that no result depends on the number of threads


@dataclass(frozen=True, slots=True, eq=False)
class Reachability:
    """Samples that some candidate could measure as required, and why the others cannot be.

    Attributes
    ----------
    reachable : (n,) bool
        Samples that at least one candidate pose could measure as required.
    reason : (n,) int8
        For the others the index into `REASONS`; -1 for reachable ones. "hidden": no candidate has a free
        line of sight; "out_of_range": those that have one are too near or too far; "grazing": of the rest all
        see it too flat; "too_sparse", "too_uncertain": of the rest none measures it densely, or exactly,
        enough; "out_of_aperture": no candidate direction points there; "too_few_views": fewer than k
        candidates could.
    n_candidates : int
        Poses tried.
    """

    reachable: BoolArray
    reason: NDArray[np.int8]
    n_candidates: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "reachable", frozen_copy(self.reachable, np.bool_))
        object.__setattr__(self, "reason", frozen_copy(self.reason, np.int8))

    def include(self, met: BoolArray) -> Reachability:
        """Return the same with the samples (n,) that views have met, which need not be candidates."""
        return Reachability(self.reachable | met, np.where(met, -1, self.reason), self.n_candidates)


def find_reachable(
    caster: RayCaster,
    samples: SurfaceSamples,
    candidates: Candidates,
    sensor: Sensor,
    requirement: Requirement,
    *,
    n_threads: int | None = None,
    progress: Progress | None = None,
) -> Reachability:
    """Find which samples some candidate can measure, and why it cannot measure the others.

    Positions are tried a few at a time, and only on samples that stand for some area and that no earlier ones
    could measure; `n_threads` cast.
    """
    limits = requirement.limits(sensor)
    passed = np.zeros((len(_SIEVES), len(samples)), dtype=np.bool_)
    times, counts = np.zeros(len(samples), np.int64), samples.areas > 0
    order = _spread_order(candidates.n_positions)
    shared = candidates.rotations_at(0) if candidates.directions.ndim == 2 else None

    def look(i: int) -> _SievedSamples:
        rotations = candidates.rotations_at(i) if shared is None else shared
        view = (caster, candidates.positions[i], rotations, samples, pending, sensor, limits, requirement.k)
        return _look_from(*view)

    with threads(2 * BYTES_A_SAMPLE * len(samples), n_threads) as pool:
        for start in range(0, len(order), _AT_A_TIME):
            pending = np.flatnonzero((times < requirement.k) & counts)
            for seen in pool.map(look, order[start : start + _AT_A_TIME]):
                for sieve, through in zip(passed, seen.through, strict=True):
                    sieve[through] = True
                times[seen.through[-1]] += seen.times
            if progress is not None:
                progress("reachability", min(start + _AT_A_TIME, len(order)), len(order))
    reachable = times >= requirement.k
    stopped = [REASONS.index(reason) for reason in _SIEVES]
    reason = np.select([reachable, *~passed], [-1, *stopped], REASONS.index("too_few_views"))
    return Reachability(reachable, reason.astype(np.int8), candidates.n_poses)


@dataclass(frozen=True, slots=True, eq=False)
class _SievedSamples:
    """Samples that pass each of `_SIEVES` from one position, and how many of its poses meet the last ones."""

    through: tuple[NDArray[np.int64], ...]
    times: NDArray[np.int64]


def _look_from(
    caster: RayCaster,
    position: FloatArray,
    rotations: FloatArray,
    samples: SurfaceSamples,
    among: NDArray[np.int64],
    sensor: Sensor,
    limits: SightLimits,
    k: int,
) -> _SievedSamples:
    """Return what one position sees of the samples `among`, sieve by sieve."""
    seen, cosine = lines_of_sight(caster, position, samples, SightLimits(), among)
    offset = samples.points[seen] - position
    distance = np.linalg.norm(offset, axis=1)
    held = np.logical_and.accumulate(
        [
            limits.in_range(distance),
            limits.steep_enough(cosine),
            limits.dense_enough(distance, cosine),
            limits.exact_enough(distance, cosine),
        ]
    )
    well = np.flatnonzero(held[-1])
    times = orientations_that_see(offset[well], rotations, sensor, k)
    met = times > 0
    return _SievedSamples((seen, *(seen[sieve] for sieve in held), seen[well[met]]), times[met])


def _spread_order(n: int) -> NDArray[np.int64]:
    """Return 0..n-1 in an order that spreads out, so that the first few positions settle most samples."""
    step = max(int(n * 0.6180339887), 1)
    while np.gcd(step, n) != 1:
        step += 1
    return np.arange(n) * step % n
