# SPDX-License-Identifier: MIT
"""Baseline plans: views by planners too simple to rely on, planned as the others are, to compare with.

"greedy" takes what meets the requirement on most new area, "visibility" what sees most new area at any
angle; both know the scene. "farthest" goes where it is farthest from all views before, and "random"
anywhere; they know nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import chain

import numpy as np

from nbv.cover.greedy import choose_greedily
from nbv.cover.instance import CoverInstance
from nbv.online.planner import PlannerOptions
from nbv.plan.baselines import farthest_poses
from nbv.plan.offline_plan import cover_instance, seen_by_candidates
from nbv.plan.plan import Plan
from nbv.plan.problem import PlanningProblem, PlanningRun


def plan_simply(
    problem: PlanningProblem, method: str, views: int | None, rng: np.random.Generator | int | None
) -> Plan:
    """Plan views by one of `BASELINES` until the target is met, or there are `views`, 200 when not given.

    `rng` chooses the poses of "random", and where "farthest" starts. What would stand at a second height over
    one spot is left out, unless it may; where a start is asked for, the first view is from there.
    """
    n_most = views or PlannerOptions().max_views
    run = PlanningRun.begin(problem)
    first, spots = problem.start_poses()[:1].tolist(), problem.spots()
    numbers = chain(first, BASELINES[method](problem, run, n_most, np.random.default_rng(rng)))
    taken: dict[int, int] = {}
    for number in numbers:
        if run.why_finished() or len(run.views) == n_most:
            break
        at = number // problem.candidates.n_directions
        if spots is None or taken.setdefault(int(spots[at]), at) == at:
            run.add(problem.candidates.pose(number))
    reason = run.why_finished()
    if reason is None:
        spent = len(run.views) == n_most
        reason = f"the limit of {n_most} views is reached" if spent else "no candidate sees anything new"
    return run.plan(method, reason)


def _greedy(
    problem: PlanningProblem, run: PlanningRun, n_most: int, _rng: np.random.Generator
) -> Iterable[int]:
    return choose_greedily(cover_instance(problem, run.tally.met), n_most=n_most)


def _visibility(
    problem: PlanningProblem, run: PlanningRun, n_most: int, _rng: np.random.Generator
) -> Iterable[int]:
    seen = seen_by_candidates(problem, "at-all", problem.requirement.visibility(problem.sensor))
    new = np.where(run.tally.n_views > 0, 0.0, problem.samples.areas)
    return choose_greedily(CoverInstance(seen, new, 1.0, problem.requirement.k), n_most=n_most)


def _farthest(
    problem: PlanningProblem, _run: PlanningRun, n_most: int, rng: np.random.Generator
) -> Iterable[int]:
    n_poses = problem.candidates.n_poses
    return farthest_poses(problem.candidates, int(rng.integers(n_poses)), min(n_most, n_poses))


def _random(
    problem: PlanningProblem, _run: PlanningRun, n_most: int, rng: np.random.Generator
) -> Iterable[int]:
    poses: list[int] = rng.integers(problem.candidates.n_poses, size=n_most).tolist()
    return poses


BASELINES: Mapping[str, Callable[[PlanningProblem, PlanningRun, int, np.random.Generator], Iterable[int]]] = {
    "greedy": _greedy,
    "visibility": _visibility,
    "farthest": _farthest,
    "random": _random,
}
