# SPDX-License-Identifier: MIT
"""Baselines: what simple planners reach with as many views, on the same candidates and sensor.

"random" takes any candidate; "farthest-point" the one that stands and looks farthest from all before;
"visibility-only greedy" what sees most that was not yet seen, at any angle; "greedy" what meets the
requirement on most new area. The last two know the scene. All are measured on the same samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from nbv.coverage.measurement import CoverageTally
from nbv.online.view_evaluation import Accumulator
from nbv.scanning.sensors.sensor import Sensor
from nbv.scanning.view import View
from nbv.visibility.requirement import GRAZING_COSINE, Requirement
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.visibility import visible_from_positions
from scenes.checks import FloatArray, InputError
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

PLAN = "this plan"
_MOST_SAMPLES = 4000
_MOST_VIEWS = 100
_N_RUNS = 30


@dataclass(frozen=True, slots=True, eq=False)
class Baseline:
    """One planner's coverage.

    Attributes
    ----------
    name : str
        Which planner.
    knows_scene : bool
        Whether it was told the scene.
    met : (n_runs, n_views) float
        Share of the area that meets the requirement after each view.
    """

    name: str
    knows_scene: bool
    met: FloatArray

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`: medians over the runs, shares of the area."""
        curve = np.median(self.met, axis=0).tolist()
        return {"knows_scene": self.knows_scene, "runs": len(self.met), "met": curve[-1], "curve": curve}

    def views_to(self, share: float) -> FloatArray:
        """Views (n_runs,) after which `share` is met; inf where it is not."""
        reached = self.met >= share - 1e-9
        return np.where(reached.any(axis=1), reached.argmax(axis=1) + 1.0, np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """A planning instance with the visibility of its samples: what all baselines choose from.

    Attributes
    ----------
    candidates, sensor, requirement, samples
        The instance; samples are thinned to about 4,000.
    before : CoverageTally
        What scans have measured that were taken before.
    visible : (n_positions, n_samples) csr
        Cosines of what each position sees, in any direction.
    """

    candidates: Candidates
    sensor: Sensor
    requirement: Requirement
    samples: SurfaceSamples
    before: CoverageTally
    visible: csr_array

    def seen(self, number: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Return the samples that pose `number` sees, and their cosines."""
        pose = self.candidates.pose(number)
        index, cosine = self.row(number // self.candidates.n_directions)
        inside = self.sensor.sees((self.samples.points[index] - pose.translation) @ pose.rotation)
        return index[inside], cosine[inside]

    def row(self, position: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Return the samples that a position sees in any direction, and their cosines."""
        here = slice(self.visible.indptr[position], self.visible.indptr[position + 1])
        return self.visible.indices[here], self.visible.data[here]

    def met_by(self, numbers: Iterable[int]) -> list[float]:
        """Share of the area that meets the requirement after each of the poses."""
        times, curve = self.before.n_met.copy(), []
        limits = self.requirement.limits(self.sensor)
        for number in numbers:
            index, cosine = self.seen(number)
            origin = self.candidates.positions[number // self.candidates.n_directions]
            distance = np.linalg.norm(self.samples.points[index] - origin, axis=1)
            times[index[limits.hold(distance, cosine)]] += 1
            met = times >= self.requirement.k
            curve.append(float(self.samples.areas[met].sum()) / self.samples.total_m2)
        return curve


def compare_with_baselines(
    caster: RayCaster,
    samples: SurfaceSamples,
    candidates: Candidates,
    sensor: Sensor,
    requirement: Requirement,
    views: tuple[View, ...],
    *,
    scans: Sequence[RangeImage] = (),
    rng: np.random.Generator | int | None = None,
    n_threads: int | None = None,
) -> tuple[Baseline, ...]:
    """Measure the baselines with as many views as a plan has (at most 100), and the plan beside them.

    Parameters
    ----------
    caster : RayCaster
        The true scene.
    samples : SurfaceSamples
        Where coverage is measured; every k-th of them, so that about 4,000 remain.
    candidates : Candidates
        What all choose from.
    sensor, requirement : Sensor, Requirement
        What scans, and what counts.
    views : tuple of View
        The plan.
    scans : sequence of RangeImage
        Scans that were taken before; all planners begin with what they have measured.
    rng : Generator, int or None
        For the 30 random runs, and the starts of the 30 farthest-point runs.
    n_threads : int, optional
        Threads that cast; the result does not depend on it.

    Returns
    -------
    tuple of Baseline
        The plan first, named "this plan", then random, farthest-point, visibility-only greedy and greedy.

    Raises
    ------
    InputError
        A plan without views.
    """
    if not views:
        raise InputError("a plan without views cannot be compared with anything")
    rng = np.random.default_rng(rng)
    n, views = min(len(views), _MOST_VIEWS), views[:_MOST_VIEWS]
    samples = thinned(samples, _MOST_SAMPLES)
    limits = requirement.visibility(sensor)
    visible = visible_from_positions(caster, candidates.positions, samples, limits, n_threads=n_threads)
    before, tally = (_tally_of(caster, samples, requirement, scans) for _ in range(2))
    instance, mine = (
        Instance(
            candidates=candidates,
            sensor=sensor,
            requirement=requirement,
            samples=samples,
            before=before,
            visible=visible,
        ),
        [],
    )
    for view in views:
        tally.add(view)
        mine.append(tally.met_m2() / samples.total_m2)
    random = [rng.integers(candidates.n_poses, size=n).tolist() for _ in range(_N_RUNS)]
    spread = [farthest_poses(candidates, run[0], n) for run in random]
    runs = (
        ("random", False, random),
        ("farthest-point", False, spread),
        ("visibility-only greedy", True, [greedy_poses(instance, GRAZING_COSINE, n)]),
        ("greedy", True, [greedy_poses(instance, requirement.min_cosine, n)]),
    )
    return (
        Baseline(PLAN, False, np.array([mine])),
        *(
            Baseline(name, knows, np.array([instance.met_by(run) for run in poses]))
            for name, knows, poses in runs
        ),
    )


def _tally_of(
    caster: RayCaster, samples: SurfaceSamples, requirement: Requirement, scans: Sequence[RangeImage]
) -> CoverageTally:
    """Return what scans have measured."""
    tally = CoverageTally.start(caster, samples, requirement)
    for scan in scans:
        tally.add_scan(scan)
    return tally


def greedy_poses(instance: Instance, min_cosine: float, n: int) -> list[int]:
    """Numbers of `n` poses, each of which sees most new area at `min_cosine` or better.

    When nothing new is left to see, all counts as new again.
    """
    areas = instance.samples.areas
    rows = [instance.row(i) for i in range(instance.candidates.n_positions)]
    good = [index[cosine >= min_cosine - 1e-12] for index, cosine in rows]
    points = instance.samples.points
    offsets = [points[index] - instance.candidates.positions[i] for i, index in enumerate(good)]
    accumulator = Accumulator.of(offsets, instance.candidates, instance.sensor)
    worth = np.where(instance.before.best_cosine >= min_cosine - 1e-12, 0.0, areas)
    left, chosen = worth.copy(), list[int]()
    while len(chosen) < n:
        number = accumulator.best([left[index] for index in good])
        if number is None and (left == worth).all():
            return chosen + [0] * (n - len(chosen))  # no pose sees anything
        if number is None:
            left = worth.copy()
            continue
        index, cosine = instance.seen(number)
        left[index[cosine >= min_cosine - 1e-12]] = 0.0
        chosen.append(number)
    return chosen


def farthest_poses(candidates: Candidates, start: int, n: int) -> list[int]:
    """Numbers of `n` poses from `start` on, each the farthest from all before.

    The distance of two poses is that of their positions as a share of the candidates' extent, and half the
    chord between their directions, as the sides of a right angle.
    """
    extent = max(float(np.linalg.norm(np.ptp(candidates.positions, axis=0))), 1e-9)
    shape = (candidates.n_positions, candidates.n_directions, 3)
    place = np.broadcast_to(candidates.positions[:, None] / extent, shape)
    poses = np.concatenate([place, np.broadcast_to(candidates.directions / 2, shape)], axis=2).reshape(-1, 6)
    squares = np.einsum("ij,ij->i", poses, poses)
    chosen, nearest = [start], np.full(len(poses), np.inf)
    while len(chosen) < n:
        last = chosen[-1]
        nearest = np.minimum(nearest, squares - 2 * (poses @ poses[last]) + squares[last])
        nearest[last] = -1.0
        chosen.append(int(np.argmax(nearest)))
    return chosen


def thinned(samples: SurfaceSamples, n_most: int) -> SurfaceSamples:
    """Return every k-th sample, each standing for k times its area, so that at most `n_most` remain."""
    k = -(-len(samples) // n_most)
    taken = slice(k // 2 if k > 1 else 0, None, k)
    areas = samples.areas[taken]
    return SurfaceSamples(
        points=samples.points[taken],
        normals=samples.normals[taken],
        areas=areas * (samples.total_m2 / areas.sum()),
        face=samples.face[taken],
        surface=samples.surface[taken],
        tolerance_m=samples.tolerance_m,
        in_morton_order=samples.in_morton_order,
    )
