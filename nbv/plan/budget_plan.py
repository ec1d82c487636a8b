# SPDX-License-Identifier: MIT
"""Plans within a time on site, and the angular steps of each station's scan.

The search walks in straight lines. How much longer the ways of its last choice really are, and how long its
scans need to be, is what the next one reckons with, until both hold; only times by the real tour count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from nbv.cover.dual import reduce_instance
from nbv.cover.instance import CoverInstance
from nbv.cover.within import SiteCosts, Within, choose_within, most_of
from nbv.plan.problem import PlanningProblem
from nbv.plan.site_time import COARSER, coarser, places_of, site_time
from nbv.scanning.sensor import Sensor, View
from nbv.visibility.visibility import visible_from_view
from scenes.checks import InputError
from scenes.pose import Pose

_TRIES = 6
_LONGER = 1.05  # by which ways are taken to be longer where the last choice took more time than there is
_SETTLED = 0.02  # share by which times may change from one choice to the next


def choose_in_time(
    problem: PlanningProblem, instance: CoverInstance, first: Sequence[int], rng: np.random.Generator
) -> tuple[Within, float]:
    """Choose the candidates that meet the requirement on most area within the budget of `problem.pace`.

    Return them, and the area in square metres that no choice within the budget exceeds. `first` are chosen
    already, and what they meet has no weight in `instance`.

    Raises
    ------
    InputError
        A sensor whose speed is not known, a budget that is too short for one station.
    """
    pace, sensor = problem.pace, problem.sensor
    scan_s, budget_s = pace.scan_s(sensor, sensor), 60 * (pace.budget_min or 0.0)
    if scan_s is None:
        raise InputError(
            f"a budget needs to know how long a scan takes, and the profile of {sensor.name} has no "
            "points_per_s: give --scan-time"
        )
    asked = replace(instance, target=min(instance.target, 1 - 1e-9))
    useful = np.union1d(reduce_instance(asked).candidates, np.array(first, np.int64))
    fewer = replace(instance, matrix=instance.matrix[useful])
    given = tuple(np.searchsorted(useful, np.array(first, np.int64)).tolist())
    positions = problem.candidates.positions[useful // problem.candidates.n_directions]
    place = places_of(positions)
    at = np.unique(place, return_index=True)[1]
    straight = np.linalg.norm(positions[at][:, None] - positions[at], axis=2) / pace.walk_m_s
    finest, best, bend = scan_s, None, 1.0
    may = [coarser(sensor, factor) for factor in (COARSER if _steps_matter(problem) else ())]
    least_s = min(pace.scan_s(one, sensor) or finest for one in (sensor, *may) if one is not None)
    for stream in rng.spawn(_TRIES):
        each = np.full(len(useful), scan_s)
        costs = SiteCosts(each, place, bend * straight, 60 * pace.set_up_min, least_s)
        found = choose_within(fewer, costs, budget_s, first=given, rng=stream)
        if not found.chosen:
            break
        poses = [problem.candidates.pose(int(useful[k])) for k in found.chosen]
        views = [View(pose, own) for pose, own in zip(poses, steps_of(problem, poses), strict=True)]
        tour = problem.tour(poses, first=0 if first else None)
        time = site_time(views, tour, sensor, pace)
        if time is None or time.scans_s is None:
            break
        if time.total_s <= budget_s and (best is None or found.weight > best.weight):
            best = replace(found, chosen=tuple(useful[list(found.chosen)].tolist()), spent_s=time.total_s)
        line = sum(
            float(np.linalg.norm(poses[a].translation - poses[b].translation))
            for a, b in pairwise(tour.order)
        )
        longer = max(time.walked_m / line, 1.0) if line else bend
        needed = float(np.mean(time.scans_s))
        if abs(longer - bend) <= _SETTLED * bend and abs(needed - scan_s) <= _SETTLED * scan_s and best:
            break
        bend = longer if time.total_s <= budget_s else max(longer, _LONGER * bend)
        scan_s = needed
    if best is None:
        raise InputError(f"no station fits into {pace.budget_min:g} min; give a larger --budget")
    each = np.full(len(useful), finest)
    shortest = SiteCosts(each, place, straight, 60 * pace.set_up_min, least_s)  # no real way is shorter
    n_most = shortest.most_stations(budget_s)
    return best, max(most_of(fewer, n_most, len(best.chosen), best.weight), best.weight)


def steps_of(problem: PlanningProblem, poses: Sequence[Pose]) -> list[Sensor]:
    """Return for each pose the sensor with the coarsest angular steps at which the poses meet as much.

    Steps matter where points are to lie densely, or are averaged; elsewhere they stay as they are. The
    station whose samples the others measure best gets coarser steps first.
    """
    required, sensor = problem.requirement, problem.sensor
    sensors: list[Sensor] = [sensor] * len(poses)
    if not _steps_matter(problem):
        return sensors
    seen, points = [], problem.samples.points
    n_met = np.zeros(len(points), np.int64)
    for pose in poses:
        index, cosine = visible_from_view(
            problem.caster, View(pose, sensor), problem.samples, required.visibility(sensor)
        )
        distance = np.linalg.norm(points[index] - pose.translation, axis=1)
        held = required.limits(sensor).hold(distance, cosine)
        seen.append((index[held], distance[held], cosine[held]))
        n_met[index[held]] += 1
    is_met = n_met >= required.k
    for factor in COARSER:
        tried = coarser(sensor, factor)
        if tried is None:
            continue
        limits = required.limits(tried)
        lost = [index[~limits.hold(distance, cosine)] for index, distance, cosine in seen]
        for k in sorted(range(len(poses)), key=lambda k: len(lost[k])):
            if sensors[k] is sensor and not (is_met[lost[k]] & (n_met[lost[k]] <= required.k)).any():
                sensors[k] = tried
                n_met[lost[k]] -= 1
                index, distance, cosine = seen[k]
                held = limits.hold(distance, cosine)
                seen[k] = (index[held], distance[held], cosine[held])
    return sensors


def _steps_matter(problem: PlanningProblem) -> bool:
    """Whether a requirement depends on how densely points lie."""
    required = problem.requirement
    averages = required.max_sd_m is not None and required.averaging_radius_m > 0
    return required.min_density_per_m2 is not None or averages
