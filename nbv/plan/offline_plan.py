# SPDX-License-Identifier: MIT
"""Offline planning: views of a known scene, chosen from the candidates' visibility of its samples.

Baseline plans are by planners too simple to rely on, to compare with: "greedy" takes what meets the
requirement on most new area, "visibility" what sees most new area at any angle; both know the scene.
"farthest" goes where it is farthest from all views before, and "random" anywhere; they know nothing. Rules
of thumb (`nbv.plan.rules`) know the rooms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from nbv.cover.instance import Cover, CoverInstance, LowerBound
from nbv.cover.overlap import OverlapGraph, OverlapOptions, components, connect
from nbv.cover.pipeline import CoverOptions, find_cover
from nbv.cover.swap_search import by_gain, choose_greedily
from nbv.online.limits import MOST_TRIES, REGISTRATION_COSINE
from nbv.online.planner import PlannerOptions
from nbv.plan.baselines import farthest_poses
from nbv.plan.budget_plan import choose_in_time, steps_of
from nbv.plan.plan import Plan
from nbv.plan.problem import PlanningProblem, PlanningRun
from nbv.plan.rules import RULES, rule_poses
from nbv.plan.tour import Overlap, Stations
from nbv.run.wording import count, duration
from nbv.visibility.requirement import SightLimits
from nbv.visibility.visibility import orient, visible_from_positions
from scenes.checks import BoolArray, InputError


def plan_offline(
    problem: PlanningProblem, views: int | None, options: CoverOptions, rng: np.random.Generator | int | None
) -> Plan:
    """Plan few views that meet the target, with a certified bound on how few could.

    Where scans are to overlap, views that could be registered with nothing are left out, and views are added
    until links join all; those do not count towards `views`, the most there may be. `rng` drives the search
    for a smaller plan. The first view is from the start where one is asked for, and counts as given: the
    bound holds for plans that begin with it.

    Raises
    ------
    InputError
        Scans that were taken before, or a start, where each point is to be seen by more than one view; a
        start where scans are to overlap.
    """
    first = problem.start_poses()
    if (problem.scans or len(first)) and problem.requirement.k > 1:
        given, cure = ("scans have", "resume") if problem.scans else ("the station at the start has", "plan")
        raise InputError(
            f"cover cannot count what {given} met towards k = {problem.requirement.k} views of each point; "
            f"{cure} with k = 1, or with method nbv"
        )
    if len(first) and problem.overlap is not None:
        raise InputError("a plan whose scans are to overlap chooses its first station; leave --start out")
    run = PlanningRun.begin(problem)
    begun = _begin(problem, run, first)
    instance = cover_instance(problem, run.tally.met)
    if problem.pace.budget_min is not None:
        return _plan_in_time(problem, run, instance, begun, rng)
    if problem.overlap is None:
        n_most = None if views is None else max(views - len(begun), 1)
        find = partial(find_cover, options=options, n_most=n_most, rng=rng, progress=problem.progress)
        cover, n_added = problem.journal.step("cover", partial(find, instance)), 0
        whole, n_tries = cover, 0
        while (left := _at_one_height(problem, instance, [*begun, *cover.chosen], n_tries)) is not None:
            n_tries += 1
            instance = left
            again = partial(find, instance, relaxed=whole)
            cover = problem.journal.step(f"cover-at-one-height-{n_tries}", again)
        if views is not None and views == len(begun):
            cover = replace(cover, chosen=(), is_complete=False)
        del instance, left  # large, as the graph will be
        graph = overlap_graph(problem, OverlapOptions())
    else:
        graph = overlap_graph(problem, problem.overlap)
        cover, n_added = _connected_cover(
            problem, instance, graph=graph, views=views, options=options, rng=rng
        )
    _add_all(problem, run, cover.chosen)
    stations = plan_stations(problem, graph, [*begun, *cover.chosen], begins_at_first=len(begun) > 0)
    reason = run.why_finished() or _why_not(problem, views, cover)
    if problem.overlap is not None:
        reason += f"; {n_added} of the views are there for overlap"
        n_groups = stations.n_groups or 1
        if n_groups > 1:
            reason += f", and yet {count(n_groups, 'group')} of scans that no candidate joins"
    if cover.was_cut_short:
        reason += f"; the time budget ended the search for fewer views after {cover.steps} swaps"
    bound = cover.bound
    if problem.scans:
        bound = LowerBound(bound.views, f"{bound.kind}, beyond the scans that were given")
    if begun:
        bound = LowerBound(bound.views + len(begun), f"{bound.kind}, with the first view as it is")
    return run.plan("cover", reason, bound, stations)


def _add_all(problem: PlanningProblem, run: PlanningRun, chosen: Iterable[int]) -> None:
    """Add the views of candidates, each with the angular steps that it needs."""
    poses = [problem.candidates.pose(number) for number in chosen]
    for pose, sensor in zip(poses, steps_of(problem, poses), strict=True):
        run.add(pose, sensor)


def _plan_in_time(
    problem: PlanningProblem,
    run: PlanningRun,
    instance: CoverInstance,
    begun: list[int],
    rng: np.random.Generator | int | None,
) -> Plan:
    """Return the plan that measures most within the time on site, and how much any could."""
    rng = np.random.default_rng(rng)
    (found, most), n_tries = choose_in_time(problem, instance, begun, rng.spawn(1)[0]), 0
    while (left := _at_one_height(problem, instance, list(found.chosen), n_tries)) is not None:
        n_tries += 1
        instance = left
        found, _ = choose_in_time(problem, instance, begun, rng.spawn(1)[0])
    chosen = [*begun, *by_gain(instance, [c for c in found.chosen if c not in begun])]
    _add_all(problem, run, chosen[len(begun) :])
    stations = plan_stations(
        problem, overlap_graph(problem, OverlapOptions()), chosen, begins_at_first=len(begun) > 0
    )
    before = float(problem.samples.areas[run.tally.met].sum()) - found.weight
    share = min(max(before, 0.0) + most, problem.samples.total_m2) / problem.samples.total_m2
    reason = run.why_finished() or f"the budget of {duration(60 * (problem.pace.budget_min or 0))} is spent"
    return run.plan("cover", reason, None, stations, most_in_time=share)


def _begin(problem: PlanningProblem, run: PlanningRun, first: NDArray[np.int64]) -> list[int]:
    """Add the view from the start (s,) that meets the requirement on most area; nothing without a start."""
    if not len(first):
        return []
    instance = cover_instance(problem, run.tally.met)
    gains = [float(instance.weights[instance.seen_by(int(pose))].sum()) for pose in first]
    number = int(first[int(np.argmax(gains))])
    run.add(problem.candidates.pose(number))
    return [number]


def _at_one_height(
    problem: PlanningProblem, instance: CoverInstance, chosen: list[int], n_tries: int
) -> CoverInstance | None:
    """Return the instance without second heights over a spot, None where the chosen poses have none.

    Over spots at which several are chosen only the one is left that sees most, that of the first pose before
    all; after `MOST_TRIES` over all spots. What is wanted stays as much, as far as the others can see it.
    """
    spots, d = problem.spots(), problem.candidates.n_directions
    if spots is None:
        return None
    positions = np.unique(np.array(chosen, np.int64) // d)
    several = np.bincount(spots[positions], minlength=int(spots.max()) + 1) > 1
    if not several.any():
        return None
    worth = ((instance.matrix != 0) @ instance.weights).reshape(-1, d).sum(axis=1)
    worth[positions] += worth.sum() + 1.0
    worth[np.array(chosen[:1], np.int64) // d] += 2 * worth.sum()  # where the first is the start it stays
    best = np.lexsort((-worth, spots))
    usable = ~several[spots] if n_tries < MOST_TRIES else np.zeros(len(spots), np.bool_)
    usable[best[np.append(True, np.diff(spots[best]) > 0)]] = True
    left = instance.only(np.repeat(usable, d))
    return replace(left, target=min(1.0, instance.wanted / max(left.coverable_weight, 1e-12)))


def _connected_cover(
    problem: PlanningProblem,
    instance: CoverInstance,
    graph: OverlapGraph,
    views: int | None,
    options: CoverOptions,
    rng: np.random.Generator | int | None,
) -> tuple[Cover, int]:
    """Return a cover whose scans overlap, and how many views were added for that.

    Views that no way joins to the others are left out, with what is linked to them, and the rest is planned
    anew.
    """
    rng = np.random.default_rng(rng)
    usable = graph.registrable
    for _ in range(MOST_TRIES):
        left = instance.only(usable)
        cover = find_cover(left, options, n_most=views, rng=rng, progress=problem.progress)
        joined = connect(left, graph, cover.chosen)
        if not joined.apart:
            break
        usable = usable & ~graph.linked_to_any(joined.apart).any(axis=0)
        usable[list(joined.apart)] = False
    bound = LowerBound(cover.bound.views, f"{cover.bound.kind}, over views that can be registered")
    ordered = by_gain(left, list(joined.chosen))
    return replace(cover, chosen=tuple(ordered), bound=bound), joined.n_added


def cover_instance(problem: PlanningProblem, met: BoolArray | None = None) -> CoverInstance:
    """Return which candidate pose meets the requirement on which sample.

    Samples that are `met` (n,) already have no weight, and the target is what is left of it.
    """
    limits, areas = problem.requirement.limits(problem.sensor), problem.samples.areas
    matrix = seen_by_candidates(problem, "as-required", limits)
    if met is None or not met.any():
        return CoverInstance(matrix, areas, problem.target, problem.requirement.k)
    whole = CoverInstance(matrix, np.where(met, 0.0, areas), 1.0, problem.requirement.k)
    left, done = whole.coverable_weight, float(areas[met].sum())
    if left == 0 or problem.target == 1:
        return whole
    return replace(whole, target=max(0.0, problem.target - (1 - problem.target) * done / left))


def overlap_graph(problem: PlanningProblem, options: OverlapOptions) -> OverlapGraph:
    """Return the overlaps of the candidates' scans, by all that is seen in range at 75 deg or less."""
    seen = problem.requirement.visibility(problem.sensor)
    limits = SightLimits(REGISTRATION_COSINE, seen.min_range_m, seen.max_range_m)
    return OverlapGraph.of(seen_by_candidates(problem, "for-overlap", limits), problem.samples, options)


def seen_by_candidates(problem: PlanningProblem, name: str, limits: SightLimits) -> csr_array:
    """Return which pose sees which sample within `limits`, by ones: each position cast once.

    The journal knows them by `name`.
    """
    candidates, samples = problem.candidates, problem.samples

    def cast() -> csr_array:
        if problem.remote is not None:
            return problem.remote.from_positions(
                problem.scene.mesh, candidates.positions, samples, limits, problem.progress
            )
        return visible_from_positions(
            problem.caster,
            candidates.positions,
            samples,
            limits,
            n_threads=problem.n_threads,
            progress=problem.progress,
        )

    seen = problem.journal.step(f"seen-{name}", cast)
    seen.data = np.ones(seen.nnz, np.int8)
    return orient(seen, candidates.positions, candidates.rotations(), samples.points, problem.sensor)


def plan_stations(
    problem: PlanningProblem, graph: OverlapGraph, chosen: list[int], *, begins_at_first: bool = False
) -> Stations:
    """Return the tour of the chosen, perhaps from the first of them on, and their overlaps."""
    links = [graph.links(candidate) for candidate in chosen]
    pairs = []
    for first, link in enumerate(links):
        for second in range(first + 1, len(chosen)):
            there = chosen[second]
            if link.linked[there]:
                pairs.append(Overlap(first, second, float(link.overlap[there]), float(link.stiffness[there])))
    linked = np.array([link.linked for link in links]).reshape(len(chosen), problem.candidates.n_poses)
    poses = [problem.candidates.pose(candidate) for candidate in chosen]
    tour = problem.tour(poses, first=0 if begins_at_first else None)
    return Stations(tour, tuple(pairs), len(set(components(linked, chosen))))


def _why_not(problem: PlanningProblem, views: int | None, cover: Cover) -> str:
    """Return why the target is not met."""
    if cover.is_complete and problem.overlap is not None:
        return "what is left is seen only by views that cannot be registered"
    if cover.is_complete and problem.spots() is not None:
        return (
            "what is left is hidden, or seen only from second heights over one spot; a smaller --spacing or "
            "--several-heights shows more"
        )
    if cover.is_complete:
        return "what is left is hidden from the second device of the sensor, unknown to the choice"
    return f"the limit of {count(views or 0, 'view')} is reached"


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
