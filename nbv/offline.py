# SPDX-License-Identifier: MIT
"""Offline planning: views of a known scene, chosen from the candidates' visibility of its samples."""

from __future__ import annotations

import numpy as np

from nbv.cover.instance import CoverInstance
from nbv.cover.pipeline import CoverOptions, find_cover
from nbv.plan import Plan
from nbv.task import Study, Task
from nbv.visibility import orient, visible_from_positions


def plan_offline(
    task: Task, views: int | None, options: CoverOptions, rng: np.random.Generator | int | None
) -> Plan:
    """Plan few views that meet the task, with a certified bound on how few could.

    Parameters
    ----------
    task : Task
        The task.
    views : int, optional
        Plan no more than so many.
    options : CoverOptions
        Budgets.
    rng : Generator, int or None
        Drives the search for a smaller plan.
    """
    seed = int(rng) if isinstance(rng, int | np.integer) else None
    instance = cover_instance(task)
    cover = find_cover(instance, options, n_most=views, rng=rng, progress=task.progress)
    study = Study.begin(task)
    for number in cover.chosen:
        study.add(task.candidates.pose(number))
    reason = study.why_finished() or f"the limit of {views} views is reached"
    if cover.was_cut_short:
        reason += f"; the time budget ended the search for fewer views after {cover.steps} swaps"
    return study.plan("cover", seed, cover.bound, reason)


def cover_instance(task: Task) -> CoverInstance:
    """Return which candidate pose meets the requirement on which sample."""
    candidates, samples = task.candidates, task.samples
    seen = visible_from_positions(
        task.caster,
        candidates.positions,
        samples,
        task.requirement.limits(task.sensor),
        n_threads=task.n_threads,
        progress=task.progress,
    )
    matrix = orient(seen, candidates.positions, candidates.rotations(), samples.points, task.sensor)
    return CoverInstance(matrix, samples.areas, task.target, task.requirement.k)
