# SPDX-License-Identifier: MIT
"""Online planning in simulation: the planner gets a scanner of the true scene, and is told when to stop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nbv.online.planner import PlannerOptions, explore
from nbv.plan.plan import Plan
from nbv.plan.problem import Attempt, Task
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage


def plan_online(
    task: Task,
    views: int | None,
    noise: str,
    options: PlannerOptions,
    rng: np.random.Generator | int | None,
) -> Plan:
    """Plan views of a scene that the planner learns of by its scans alone.

    Parameters
    ----------
    task : Task
        The task; its true scene serves to scan, and to measure coverage.
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
    start = None if task.scans else task.candidates.pose(int(rng.integers(task.candidates.n_poses)))
    attempt = Attempt.begin(task)
    scans = list(task.scans)

    def scan(pose: Pose) -> RangeImage:
        scans.append(attempt.scan(pose, noise, rng))
        return scans[-1]

    found = explore(
        scan,
        task.scene.mesh.bounds(),
        start=start,
        candidates=task.proposals,
        sensor=task.sensor,
        requirement=task.requirement,
        options=replace(
            options, max_views=min(views or options.max_views, options.max_views), zones=task.zones
        ),
        given=task.scans,
        from_outside=task.from_outside,
        infer=attempt.complete if task.infer else None,
        finished=attempt.why_finished,
        journal=task.journal,
        n_threads=task.n_threads,
        progress=task.progress,
    )
    if task.infer and attempt.shares[-1].views < len(attempt.views):
        attempt.complete(scans)
    return attempt.plan("nbv", seed, None, found.stopped_because)
