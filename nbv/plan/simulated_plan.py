# SPDX-License-Identifier: MIT
"""Plans by simulated scans: by the online planner, or of a known scene with completion standing in for views.

The online planner gets a scanner of the true scene, and is told when to stop. The other planner knows the
scene, and so what each candidate would see; what completion makes of the scans so far it learns as the
online planner does, by completing simulated scans. What completion will infer from further scans nobody can
say beforehand: there is no bound on how few views could do.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nbv.cover.overlap import OverlapOptions
from nbv.coverage.surface_classes import UNKNOWN
from nbv.online.planner import RENEWED, PlannerOptions, explore
from nbv.plan.offline_plan import overlap_graph, plan_stations, seen_by_candidates
from nbv.plan.plan import Plan
from nbv.plan.problem import PlanningProblem, PlanningRun
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage


def plan_online(
    problem: PlanningProblem,
    views: int | None,
    noise: str,
    options: PlannerOptions,
    rng: np.random.Generator | int | None,
) -> Plan:
    """Plan views, at most `views`, of a scene that the planner learns of by its scans alone.

    The true scene serves to scan, and to measure coverage. `rng` chooses the start (any candidate, or one of
    those at the place that was asked for; of a plan that is resumed none) and drives the noise.
    """
    rng = np.random.default_rng(rng)
    start, first = None, problem.start_poses()
    if len(first):
        start = problem.candidates.pose(int(first[rng.integers(len(first))]))
    elif not problem.scans:
        start = problem.candidates.pose(int(rng.integers(problem.candidates.n_poses)))
    run = PlanningRun.begin(problem)
    further = _further_starts(problem, start, rng)
    scans = list(problem.scans)

    def scan(pose: Pose) -> RangeImage:
        scans.append(run.scan(pose, noise, rng))
        return scans[-1]

    found = explore(
        scan,
        problem.scene.mesh.bounds(),
        start=start,
        candidates=problem.proposals,
        sensor=problem.sensor,
        requirement=problem.requirement,
        options=replace(
            options, max_views=min(views or options.max_views, options.max_views), zones=problem.zones
        ),
        given=problem.scans,
        from_outside=problem.from_outside,
        spot_of=None if problem.spots() is None or problem.site is None else problem.site.spots,
        further_starts=further,
        infer=run.complete if problem.infer else None,
        finished=run.why_finished,
        journal=problem.journal,
        n_threads=problem.n_threads,
        progress=problem.progress,
    )
    if problem.infer and run.shares[-1].views < len(run.views):
        run.complete(scans)
    return run.plan("nbv", found.stopped_because, stations=run.stations(in_order=True))


def _further_starts(problem: PlanningProblem, start: Pose | None, rng: np.random.Generator) -> list[Pose]:
    """Return a random candidate on each storey of each part of a building that one cannot walk to.

    The part of the start, and those that have scans already, are left out. A surveyor who was asked for these
    rooms knows where their stairs and doors are; the planner is told no more than this one place in each.
    """
    if problem.site is None:
        return []
    stood = [pose.translation for pose in [start] if pose] + [scan.origin for scan in problem.scans]
    parts = problem.site.parts(problem.candidates.positions)
    begun = {tuple(part) for part in problem.site.parts(np.array(stood).reshape(-1, 3)).tolist()}
    poses = []
    for part in np.unique(parts, axis=0).tolist():
        if tuple(part) not in begun and min(part) >= 0:
            there = np.flatnonzero((parts == part).all(axis=1))
            number = int(there[rng.integers(len(there))]) * problem.candidates.n_directions
            poses.append(problem.candidates.pose(number + int(rng.integers(problem.candidates.n_directions))))
    return poses


_STEEP = float(np.cos(np.radians(80.0)))  # flatter than this scans seldom tell a surface
_KNOWN = 0.05  # worth of meeting the requirement on surface that is known, beside seeing the unknown


def plan_with_completion(
    problem: PlanningProblem, views: int | None, noise: str, rng: np.random.Generator | int | None
) -> Plan:
    """Plan views until what they meet, and completion models or infers from them, reaches the target.

    There are no more than `views`, 200 when not given; `rng` drives the noise of the simulated scans.
    """
    rng = np.random.default_rng(rng)
    run, scans, chosen = PlanningRun.begin(problem), list(problem.scans), list[int]()
    steeply = replace(problem.requirement.visibility(problem.sensor), min_cosine=_STEEP)
    seen = seen_by_candidates(problem, "steeply", steeply) > 0
    met = seen_by_candidates(problem, "as-required", problem.requirement.limits(problem.sensor)) > 0
    n_most, n_known = views or PlannerOptions().max_views, len(scans)
    if scans:
        run.complete(scans)
    first, spots, d = problem.start_poses(), problem.spots(), problem.candidates.n_directions
    may = np.ones(problem.candidates.n_poses, np.bool_)
    while (reason := run.why_finished()) is None and len(chosen) < n_most:
        if problem.progress:
            problem.progress("views", len(chosen), n_most)
        gain = seen @ _unknown_m2(run) + _KNOWN * (met @ _unmet_m2(run))
        if len(first) and not chosen:
            chosen.append(int(first[np.argmax(gain[first])]))
        elif not gain[may].max(initial=0.0) > 0:
            reason = "no candidate sees what is left"
            break
        else:
            chosen.append(int(np.argmax(np.where(may, gain, -1.0))))
        if spots is not None:
            at = chosen[-1] // d
            may &= ~np.repeat((spots == spots[at]) & (np.arange(len(spots)) != at), d)
        scans.append(run.scan(problem.candidates.pose(chosen[-1]), noise, rng))
        if len(scans) >= RENEWED * n_known:
            run.complete(scans)
            n_known = len(scans)
    if chosen and run.shares[-1].views < len(chosen):
        run.complete(scans)
    graph = overlap_graph(problem, OverlapOptions())
    stations = plan_stations(problem, graph, chosen, begins_at_first=len(first) > 0)
    reason = reason or f"the limit of {n_most} views is reached"
    return run.plan("cover", reason, stations=stations)


def _unknown_m2(run: PlanningRun) -> FloatArray:
    """Area of each sample that is not known yet, 0 for others."""
    unknown = ~run.tally.met if run.classes is None else run.classes == UNKNOWN
    return np.asarray(run.problem.samples.areas * unknown)


def _unmet_m2(run: PlanningRun) -> FloatArray:
    """Area of each sample that is not met yet, 0 for others."""
    return np.asarray(run.problem.samples.areas * ~run.tally.met)
