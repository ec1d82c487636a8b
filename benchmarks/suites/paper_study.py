# SPDX-License-Identifier: MIT
"""The study of the paper: how many views a simple room with two occluders costs, and how many its last parts.

For a cone of 60 deg and for a panoramic scanner: how many views it takes online (the room is
unknown), offline (it is known; with certified bounds) and by simple planners, until 95, 99 and 100 % of what
any candidate could measure is measured as required: seen at all, or within 75, 60 or 45 deg of the normal.
All choose from the same poses and are measured on the same samples. `examples/plot_paper_study.py` makes
the page.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from benchmarks.run import suite
from nbv import Candidates, CoverOptions, Requirement, Sensor, load_sensor, plan_views, sample_surface
from nbv.cover.instance import CoverInstance
from nbv.cover.pipeline import find_cover
from nbv.cover.swap_search import choose_greedily
from nbv.plan.baselines import farthest_poses
from nbv.visibility.candidates import scene_candidates
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.visibility import orient, visible_from_positions
from scenes import Pose, RayCaster, Scene, builtin_scene

SHARES = (0.95, 0.99, 1.0)
SEEN = 90  # degrees of a requirement that asks for visibility alone, up to 88.9
ANGLES = {SEEN: "every part seen", 75: "within 75\u00b0", 60: "within 60\u00b0", 45: "within 45\u00b0"}
SENSORS = {"generic60cone": "60\u00b0 aperture", "panorama": "panoramic, 360\u00b0 x 300\u00b0"}
N_RUNS, MOST_VIEWS = 30, 400  # of planners that choose blindly
POLISH_STEPS, FOOT_M = 20_000, 0.1


@dataclass(frozen=True)
class Problem:
    """One sensor in one room: the poses that all planners choose from, and which samples each sees.

    `seen` (poses, samples) holds the cosines of what is seen at all; `n_starts` runs are made online.
    """

    room: Scene
    sensor: Sensor
    candidates: Candidates
    samples: SurfaceSamples
    seen: csr_array
    n_starts: int
    n_threads: int

    @classmethod
    def of(
        cls, room: Scene, sensor: Sensor, spacing_m: float = 0.15, n_starts: int = 5, n_threads: int = 1
    ) -> "Problem":
        """Find what each candidate pose sees of samples that lie so far apart."""
        caster, free = room.ray_caster(n_threads), scene_candidates(room, sensor)
        candidates = free.at(stands_on_floor(caster, free.positions))
        samples, places = sample_surface(room.mesh, spacing_m), candidates.positions
        limits = Requirement(max_incidence_deg=SEEN).limits(sensor)
        seen = visible_from_positions(caster, places, samples, limits, n_threads=n_threads)
        matrix = orient(seen, places, candidates.rotations(), samples.points, sensor)
        return cls(room, sensor, candidates, samples, matrix, n_starts, n_threads)

    def instance(self, angle: int, share: float = 1.0) -> CoverInstance:
        """Return which pose meets the requirement on which sample."""
        met = self.seen.copy()
        met.data = (met.data >= Requirement(max_incidence_deg=angle).min_cosine - 1e-12).astype(np.float64)
        met.eliminate_zeros()
        return CoverInstance(met, self.samples.areas, share)

    @cached_property
    def blind(self) -> list[list[int]]:
        """Poses of the runs that choose at random."""
        rng = np.random.default_rng(0)
        return [
            list(map(int, run)) for run in rng.integers(self.candidates.n_poses, size=(N_RUNS, MOST_VIEWS))
        ]

    @cached_property
    def spread(self) -> list[list[int]]:
        """Poses of the runs that go farthest from all before, from the same starts."""
        n = min(MOST_VIEWS, self.candidates.n_poses)
        return [farthest_poses(self.candidates, run[0], n) for run in self.blind]


def stands_on_floor(caster: RayCaster, positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell below which positions (n, 3) the floor, at height 0, is free for a tripod of 20 cm."""
    feet = FOOT_M * np.array([[0, 0, 0], [1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
    starts = (positions[:, None] + feet).reshape(-1, 3)
    ranges = caster.first_hit(starts, np.tile([0.0, 0.0, -1.0], (len(starts), 1))).ranges
    return np.asarray((np.abs(ranges - starts[:, 2]) < 0.01).reshape(-1, len(feet)).all(axis=1))


@dataclass(frozen=True)
class Result:
    """What one way of choosing views reached.

    `runs` hold the share of the reachable area that is met after each view; `poses` the views of each run;
    `at_least` the certified bounds by share; `summary` makes one number of the runs' numbers of views.
    """

    runs: Sequence[NDArray[np.float64]]
    poses: Sequence[Sequence[Pose]] = ()
    at_least: Mapping[float, int] = field(default_factory=dict)
    summary: Callable[..., float] = np.median

    def views_to(self, share: float) -> NDArray[np.float64]:
        """Views of each run until the share is met; inf where it is not."""
        reached = [np.flatnonzero(run >= share - 1e-9) for run in self.runs]
        return np.array([found[0] + 1.0 if len(found) else np.inf for found in reached])

    def views(self, share: float) -> float:
        """Views until the share is met, of all runs together."""
        return float(self.summary(self.views_to(share)))

    @property
    def end(self) -> tuple[float, float]:
        """Median of the shares with which the runs end, and of their views."""
        last = [run[-1] for run in self.runs]
        return float(np.median(last)), float(np.median([len(run) for run in self.runs]))

    def cell(self, share: float) -> str:
        """Return the cell of a table: views, and in brackets the bound, or the worst of several runs."""
        views, n = self.views(share), self.views_to(share)
        if np.isinf(views):
            return f"no: {shown(self.end[0])} % after {self.end[1]:g}"
        if self.at_least:
            return f"{views:g} (\u2265 {self.at_least[share]})"
        never = int(np.isinf(n).sum())
        return f"{views:g}" + (f" ({f'{never} never' if never else f'{n.max():g}'})" if len(n) > 1 else "")


def shown(share: float) -> str:
    """Return a share in per cent, never rounded up to all."""
    return f"{np.floor(1000 * share + 1e-6) / 10:.1f}" if share < 1 - 1e-9 else "100"


def explored(problem: Problem, angle: int) -> Result:
    """Explore the room online, from several starts."""
    runs, poses = [], []
    for seed in range(problem.n_starts):
        plan = plan_views(
            problem.room,
            problem.sensor,
            max_incidence_deg=angle,
            target=1.0,
            candidates=problem.candidates,
            samples=problem.samples,
            rng=seed,
            n_threads=problem.n_threads,
        )
        assert plan.coverage is not None
        runs.append(np.array([view.met_fraction for view in plan.views]) / plan.coverage.reachable)
        poses.append([view.world_from_sensor for view in plan.views])
    return Result(runs, poses)


def planned(problem: Problem, angle: int) -> Result:
    """Plan offline, anew for each share, with certified bounds."""
    whole, runs, poses, at_least = problem.instance(angle), [], [], {}
    for share in SHARES:
        options = CoverOptions(polish_steps=POLISH_STEPS)
        cover = find_cover(problem.instance(angle, share), options, rng=0)
        runs.append(curve(whole, cover.chosen))
        poses.append([problem.candidates.pose(number) for number in cover.chosen])
        at_least[share] = cover.bound.views
    return Result(runs, poses, at_least, np.min)


def greedy(problem: Problem, angle: int, *, chosen_at: int | None = None) -> Result:
    """Choose what meets most new area; or what sees most at another angle than the one that counts."""
    chosen = choose_greedily(problem.instance(chosen_at or angle))
    return Result([curve(problem.instance(angle), chosen)])


def blind(problem: Problem, angle: int, *, spread: bool) -> Result:
    """Choose without looking at the room: at random, or far from all before."""
    whole = problem.instance(angle)
    return Result([curve(whole, run) for run in (problem.spread if spread else problem.blind)])


def curve(instance: CoverInstance, chosen: Sequence[int]) -> NDArray[np.float64]:
    """Share of the reachable weight that is met after each of the chosen."""
    left, met = instance.weights.copy(), []
    for number in chosen:
        index = instance.seen_by(number)
        met.append(float(left[index].sum()))
        left[index] = 0.0
    return np.cumsum(met) / instance.coverable_weight


@dataclass(frozen=True)
class Study:
    """A way of choosing views: a column of the tables."""

    name: str
    run: Callable[[Problem, int], Result]


ONLINE, OFFLINE = Study("online", explored), Study("offline", planned)
STUDIES = (
    ONLINE,
    OFFLINE,
    Study("greedy", greedy),
    Study("visibility only", partial(greedy, chosen_at=SEEN)),
    Study("farthest point", partial(blind, spread=True)),
    Study("random", partial(blind, spread=False)),
)


def table(results: Mapping[tuple[str, int], Result], studies: Sequence[Study]) -> str:
    """Return the views of each study until each share of what is reachable meets each requirement."""
    lines = [f"| requirement | share | {' | '.join(study.name for study in studies)} |"]
    lines.append("|---" * (len(studies) + 2) + "|")
    for angle in dict.fromkeys(angle for _, angle in results):
        for share in SHARES:
            cells = " | ".join(results[study.name, angle].cell(share) for study in studies)
            lines.append(f"| {ANGLES[angle]} | {100 * share:g} % | {cells} |")
    return "\n".join(lines)


def tail(results: Mapping[tuple[str, int], Result], studies: Sequence[Study]) -> str:
    """Return what the first 95 %, the last 5 % and the last 1 % cost each study, up to where it ends."""
    heads = [f"{study.name}: {what}" for study in studies for what in ("first 95 %", "last 5 %", "last 1 %")]
    lines = [f"| requirement | {' | '.join(heads)} |", "|---" * (len(heads) + 1) + "|"]
    for angle in dict.fromkeys(angle for _, angle in results):
        cells = []
        for study in studies:
            result = results[study.name, angle]
            first, most, last = (result.views(share) for share in SHARES)
            end = last if np.isfinite(last) else result.end[1]
            cells += [f"{first:g}", f"{end - first:g}", f"{end - most:g}"]
        lines.append(f"| {ANGLES[angle]} | {' | '.join(cells)} |")
    return "\n".join(lines)


def measure(
    problem: Problem, studies: Sequence[Study], angles: Sequence[int] = tuple(ANGLES)
) -> dict[tuple[str, int], Result]:
    """Return what each study reaches for each requirement."""
    return {(study.name, angle): study.run(problem, angle) for angle in angles for study in studies}


@suite("paper-study", smallest="--starts 1 --spacing 0.8 --sensor panorama --angle 90")
def paper_study(
    starts: int = 5, spacing: float = 0.15, sensor: list[str] | None = None, angle: list[int] | None = None
) -> Iterator[str]:
    """How many views a simple room with two occluders costs, and how many its last parts.

    --spacing of samples, metres; --sensor: generic60cone or panorama; --angle of incidence: 90, 75, 60, 45.
    """
    for name in sensor or SENSORS:
        problem = Problem.of(builtin_scene("two_occluders"), load_sensor(name), spacing, starts)
        results = measure(problem, STUDIES, tuple(angle or ANGLES))
        yield f"\n{SENSORS[name]}\n\n{table(results, STUDIES)}\n\n{tail(results, (ONLINE, OFFLINE))}"
