# SPDX-License-Identifier: MIT
"""Reachability: which surface some candidate could measure as required, and why the rest cannot be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nbv.scanning.sensor import Sensor
from nbv.visibility.requirement import Requirement, SightLimits
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.visibility import BYTES_A_SAMPLE, Progress, lines_of_sight, orientations_that_see
from scenes.checks import BoolArray, FloatArray, frozen_copy
from scenes.rays.raycast import RayCaster
from scenes.run.memory import threads

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

    def including(self, met: BoolArray) -> Reachability:
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

    def look(i: int) -> _Look:
        rotations = candidates.rotations_at(i) if shared is None else shared
        view = (caster, candidates.positions[i], rotations, samples, pending, sensor, limits, requirement.k)
        return _look_from(*view)

    with threads(2 * BYTES_A_SAMPLE * len(samples), n_threads) as pool:
        for start in range(0, len(order), _AT_A_TIME):
            pending = np.flatnonzero((times < requirement.k) & counts)
            for found in pool.map(look, order[start : start + _AT_A_TIME]):
                for sieve, through in zip(passed, found.through, strict=True):
                    sieve[through] = True
                times[found.through[-1]] += found.times
            if progress is not None:
                progress("reachability", min(start + _AT_A_TIME, len(order)), len(order))
    reachable = times >= requirement.k
    stopped = [REASONS.index(reason) for reason in _SIEVES]
    reason = np.select([reachable, *~passed], [-1, *stopped], REASONS.index("too_few_views"))
    return Reachability(reachable, reason.astype(np.int8), candidates.n_poses)


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
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
) -> _Look:
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
    return _Look((seen, *(seen[sieve] for sieve in held), seen[well[met]]), times[met])


def _spread_order(n: int) -> NDArray[np.int64]:
    """Return 0..n-1 in an order that spreads out, so that the first few positions settle most samples."""
    step = max(int(n * 0.6180339887), 1)
    while np.gcd(step, n) != 1:
        step += 1
    return np.arange(n) * step % n
