# SPDX-License-Identifier: MIT
"""Baseline plans: views by planners too simple to rely on, planned as the others are, to compare with.

"greedy" takes what meets the requirement on most new area, "visibility" what sees most new area at any
angle; both know the scene. "farthest" goes where it is farthest from all views before, and "random"
anywhere; they know nothing. Rules of thumb (`nbv.plan.rules`) know the rooms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from itertools import chain, islice

import numpy as np

from nbv.cover.greedy import choose_greedily
from nbv.cover.instance import CoverInstance
from nbv.online.planner import PlannerOptions
from nbv.plan.baselines import farthest_poses
from nbv.plan.offline_plan import cover_instance, seen_by_candidates
from nbv.plan.plan import Plan
from nbv.plan.problem import PlanningProblem, PlanningRun
from nbv.plan.rules import RULES, rule_poses
from scenes.checks import InputError


def plan_simply(
    problem: PlanningProblem, method: str, views: int | None, rng: np.random.Generator | int | None
) -> Plan:
    """Plan views by one of `BASELINES` until the target is met, or there are `views`, 200 when not given.

    `rng` chooses the poses of "random", and where "farthest" starts. Where a start is asked for, the first
    view is from there. Several heights over one spot are as good as several spots.
    """
    n_most = views or PlannerOptions().max_views
    run = PlanningRun.begin(problem)
    first = problem.start_poses()[:1].tolist()
    numbers = chain(first, BASELINES[method](problem, run, n_most, np.random.default_rng(rng)))
    for number in islice(numbers, n_most):
        if run.why_finished():
            break
        run.add(problem.candidates.pose(number))
    reason = run.why_finished()
    if reason is None:
        spent = len(run.views) == n_most
        ended = "all stations of the rule are taken" if method in RULES else "no candidate sees anything new"
        reason = f"the limit of {n_most} views is reached" if spent else ended
    return run.plan(method, reason, stations=run.stations())


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


def _rule(
    name: str, problem: PlanningProblem, _run: PlanningRun, _n_most: int, _rng: np.random.Generator
) -> Iterable[int]:
    if problem.site is None or problem.sensor.kind != "spherical":
        raise InputError(
            f"{name} puts instruments that turn by themselves into rooms: give a scene of rooms, "
            f"no candidates of your own, and a sensor like panorama, not {problem.sensor.name}"
        )
    return rule_poses(name, problem.site, problem.candidates)


BASELINES: Mapping[str, Callable[[PlanningProblem, PlanningRun, int, np.random.Generator], Iterable[int]]] = {
    "greedy": _greedy,
    "visibility": _visibility,
    "farthest": _farthest,
    "random": _random,
    **{name: partial(_rule, name) for name in RULES},
}
