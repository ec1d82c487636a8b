# SPDX-License-Identifier: MIT
"""Online planning in simulation: the planner gets a scanner of the true scene, and is told when to stop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nbv.online.planner import PlannerOptions, explore
from nbv.plan.plan import Plan
from nbv.plan.problem import PlanningProblem, PlanningRun
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage


def plan_online(
    problem: PlanningProblem,
    views: int | None,
    noise: str,
    options: PlannerOptions,
    rng: np.random.Generator | int | None,
) -> Plan:
    """Plan views of a scene that the planner learns of by its scans alone.

    Parameters
    ----------
    problem : PlanningProblem
        What to plan; its true scene serves to scan, and to measure coverage.
    views : int, optional
        Plan no more than so many.
    noise : str
        Noise model of the scans.
    options : PlannerOptions
        The planner's.
    rng : Generator, int or None
        Chooses the start (any candidate; of a plan that is resumed none) and drives the noise.
    """
    seed = int(rng) if isinstance(rng, int | np.integer) else None
    rng = np.random.default_rng(rng)
    start = None if problem.scans else problem.candidates.pose(int(rng.integers(problem.candidates.n_poses)))
    run = PlanningRun.begin(problem)
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
        infer=run.complete if problem.infer else None,
        finished=run.why_finished,
        journal=problem.journal,
        n_threads=problem.n_threads,
        progress=problem.progress,
    )
    if problem.infer and run.shares[-1].views < len(run.views):
        run.complete(scans)
    return run.plan("nbv", seed, None, found.stopped_because)
