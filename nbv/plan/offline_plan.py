# SPDX-License-Identifier: MIT
"""Offline planning: views of a known scene, chosen from the candidates' visibility of its samples."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.sparse import csr_array

from nbv.cover.cover import Cover, LowerBound
from nbv.cover.greedy import by_gain
from nbv.cover.instance import CoverInstance
from nbv.cover.overlap import OverlapGraph, OverlapOptions, components, connect
from nbv.cover.pipeline import CoverOptions, find_cover
from nbv.plan.plan import Plan
from nbv.plan.problem import PlanningProblem, PlanningRun
from nbv.plan.tour import Overlap, Stations, plan_tour
from nbv.run.wording import count
from nbv.visibility.requirement import SightLimits
from nbv.visibility.visibility import orient, visible_from_positions
from scenes.checks import BoolArray, InputError

_MOST_TRIES = 5  # plans made anew without views that cannot be joined to the others
_REGISTRATION_COSINE = float(np.cos(np.radians(75.0)))  # flatter than this nothing helps registration


def plan_offline(
    problem: PlanningProblem, views: int | None, options: CoverOptions, rng: np.random.Generator | int | None
) -> Plan:
    """Plan few views that meet the target, with a certified bound on how few could.

    Where scans are to overlap, views that could be registered with nothing are left out, and views are added
    until links join all; those do not count towards `views`, the most there may be. `rng` drives the search
    for a smaller plan.

    Raises
    ------
    InputError
        Scans that were taken before where each point is to be seen by more than one view.
    """
    if problem.scans and problem.requirement.k > 1:
        raise InputError(
            f"cover cannot count what scans have met towards k = {problem.requirement.k} views of each point"
            "; resume with k = 1, or with method nbv"
        )
    run = PlanningRun.begin(problem)
    instance = cover_instance(problem, run.tally.met)
    if problem.overlap is None:
        find = partial(find_cover, instance, options, n_most=views, rng=rng, progress=problem.progress)
        cover, n_added = problem.journal.step("cover", find), 0
        del find, instance  # large, as the graph will be
        graph = overlap_graph(problem, OverlapOptions())
    else:
        graph = overlap_graph(problem, problem.overlap)
        cover, n_added = _connected_cover(
            problem, instance, graph=graph, views=views, options=options, rng=rng
        )
    for number in cover.chosen:
        run.add(problem.candidates.pose(number))
    stations = plan_stations(problem, graph, list(cover.chosen))
    reason = run.why_finished() or _why_not(problem, views, cover)
    if problem.overlap is not None:
        reason += f"; {n_added} of the views are there for overlap"
        if stations.n_groups > 1:
            reason += f", and yet {count(stations.n_groups, 'group')} of scans that no candidate joins"
    if cover.was_cut_short:
        reason += f"; the time budget ended the search for fewer views after {cover.steps} swaps"
    bound = cover.bound
    if problem.scans:
        bound = LowerBound(bound.views, f"{bound.kind}, beyond the scans that were given")
    return run.plan("cover", reason, bound, stations)


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
    for _ in range(_MOST_TRIES):
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
    limits = SightLimits(_REGISTRATION_COSINE, seen.min_range_m, seen.max_range_m)
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


def plan_stations(problem: PlanningProblem, graph: OverlapGraph, chosen: list[int]) -> Stations:
    """Return the tour of the chosen, and their overlaps."""
    links = [graph.links(candidate) for candidate in chosen]
    pairs = []
    for first, own in enumerate(links):
        for second in range(first + 1, len(chosen)):
            there = chosen[second]
            if own.linked[there]:
                pairs.append(Overlap(first, second, float(own.overlap[there]), float(own.stiffness[there])))
    linked = np.array([own.linked for own in links]).reshape(len(chosen), problem.candidates.n_poses)
    positions = [problem.candidates.pose(candidate).translation for candidate in chosen]
    places = np.array(positions).reshape(-1, 3)
    tour = plan_tour(
        problem.scene.mesh, places, on_foot=not problem.from_outside, keep_out=problem.zones.keep_out
    )
    return Stations(tour, tuple(pairs), len(set(components(linked, chosen))))


def _why_not(problem: PlanningProblem, views: int | None, cover: Cover) -> str:
    """Return why the target is not met."""
    if cover.is_complete and problem.overlap is not None:
        return "what is left is seen only by views that cannot be registered"
    if cover.is_complete:
        return "what is left is hidden from the second device of the sensor, unknown to the choice"
    return f"the limit of {count(views or 0, 'view')} is reached"
