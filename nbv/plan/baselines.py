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

from nbv.coverage.coverage import Coverage
from nbv.coverage.measurement import CoverageTally
from nbv.online.gain import Accumulator
from nbv.plan.plan import Plan
from nbv.scanning.sensor import Sensor
from nbv.visibility.limits import GRAZING_COSINE
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.visibility import visible_from_positions
from scenes.checks import FloatArray, InputError
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

PLAN = "this plan"
_MOST_VIEWS = 100
_N_RUNS = 30


@dataclass(frozen=True, slots=True, eq=False)
class Baseline:
    """One planner's coverage: `met` (n_runs, n_views), the share that is met after each view of each run."""

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
class BaselineChoice:
    """What all baselines choose from: the plan's candidates and samples.

    `before` tells what scans have measured that were taken before, `visible` (n_positions, n_samples) the
    cosines of what each position sees, in any direction.
    """

    candidates: Candidates
    sensor: Sensor
    requirement: Requirement
    samples: SurfaceSamples
    before: CoverageTally
    visible: csr_array

    def seen_by(self, number: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Return the samples (m,) that pose `number` sees, and their cosines (m,)."""
        pose = self.candidates.pose(number)
        index, cosine = self.row(number // self.candidates.n_directions)
        inside = self.sensor.sees((self.samples.points[index] - pose.translation) @ pose.rotation)
        return index[inside], cosine[inside]

    def row(self, position: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Return the samples (m,) that a position sees in any direction, and their cosines (m,)."""
        here = slice(self.visible.indptr[position], self.visible.indptr[position + 1])
        return self.visible.indices[here], self.visible.data[here]

    def met_by(self, numbers: Iterable[int]) -> list[float]:
        """Share of the area that meets the requirement after each of the poses."""
        times, curve = self.before.n_met.copy(), []
        limits = self.requirement.limits(self.sensor)
        for number in numbers:
            index, cosine = self.seen_by(number)
            origin = self.candidates.positions[number // self.candidates.n_directions]
            distance = np.linalg.norm(self.samples.points[index] - origin, axis=1)
            times[index[limits.hold(distance, cosine)]] += 1
            met = times >= self.requirement.k
            curve.append(float(self.samples.areas[met].sum()) / self.samples.total_m2)
        return curve


def compare_with_baselines(
    caster: RayCaster,
    plan: Plan,
    *,
    scans: Sequence[RangeImage] = (),
    rng: np.random.Generator | int | None = None,
    n_threads: int | None = None,
) -> tuple[Baseline, ...]:
    """Measure the baselines with as many views as a plan has (at most 100), and the plan beside them.

    The plan is a fresh one, with its full coverage: the baselines choose from its candidates, for its sensor
    and requirement, and are measured on its samples: none reaches the target with fewer views than its lower
    bound. All begin with what `scans` have measured that were taken before. `rng` is for the 30 random runs,
    and the starts of the 30 farthest-point runs; the result does not depend on the number of threads. The
    plan comes first, named "this plan", then random, farthest-point, visibility-only greedy and greedy.

    Raises
    ------
    InputError
        A plan without views, or one that was read from a file.
    """
    candidates, coverage, rng = plan.candidates, plan.coverage, np.random.default_rng(rng)
    if not plan.views:
        raise InputError("a plan without views cannot be compared with anything")
    if candidates is None or not isinstance(coverage, Coverage) or coverage.history is None:
        raise InputError("a plan that was read from a file does not tell its candidates; plan anew")
    n = min(len(plan.views), _MOST_VIEWS)
    samples, first_met = coverage.samples, coverage.history.first_met
    limits = plan.requirement.visibility(plan.sensor)
    visible = visible_from_positions(caster, candidates.positions, samples, limits, n_threads=n_threads)
    before = CoverageTally.start(caster, samples, plan.requirement)
    for scan in scans:
        before.add_scan(scan, is_given=True)
    choice = BaselineChoice(
        candidates=candidates, sensor=plan.sensor, requirement=plan.requirement, samples=samples,
        before=before, visible=visible,
    )  # fmt: skip
    mine = [float(samples.areas[first_met <= number].sum()) / samples.total_m2 for number in range(1, n + 1)]
    random = [rng.integers(candidates.n_poses, size=n).tolist() for _ in range(_N_RUNS)]
    spread = [farthest_poses(candidates, run[0], n) for run in random]
    runs = (
        ("random", False, random),
        ("farthest-point", False, spread),
        ("visibility-only greedy", True, [greedy_poses(choice, GRAZING_COSINE, before.n_views, n)]),
        ("greedy", True, [greedy_poses(choice, plan.requirement.min_cosine, before.n_met, n)]),
    )
    return (
        Baseline(PLAN, False, np.array([mine])),
        *(
            Baseline(name, knows, np.array([choice.met_by(run) for run in poses]))
            for name, knows, poses in runs
        ),
    )


def greedy_poses(choice: BaselineChoice, min_cosine: float, times: NDArray[np.int32], n: int) -> list[int]:
    """Numbers of `n` poses, each of which sees most new area at `min_cosine` or better.

    Samples are new until they were seen as often as required; `times` (n_samples,) they were before. When
    nothing new is left to see, all counts as new again.
    """
    areas = choice.samples.areas
    rows = [choice.row(i) for i in range(choice.candidates.n_positions)]
    good = [index[cosine >= min_cosine - 1e-12] for index, cosine in rows]
    points = choice.samples.points
    offsets = [points[index] - choice.candidates.positions[i] for i, index in enumerate(good)]
    accumulator = Accumulator.of(offsets, choice.candidates, choice.sensor)
    wanted = np.maximum(choice.requirement.k - times, 0)
    left, chosen = wanted.copy(), list[int]()
    while len(chosen) < n:
        worth = np.where(left > 0, areas, 0.0)
        number = accumulator.best([worth[index] for index in good])
        if number is None and (left == wanted).all():
            return chosen + [0] * (n - len(chosen))  # no pose sees anything
        if number is None:
            left = wanted.copy()
            continue
        index, cosine = choice.seen_by(number)
        left[index[cosine >= min_cosine - 1e-12]] -= 1
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
