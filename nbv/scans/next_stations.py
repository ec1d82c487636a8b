# SPDX-License-Identifier: MIT
"""Next stations: where to put the scanner after scans that were really taken, in a place without a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from nbv.coverage.surface_classes import KnownSurfaces
from nbv.online.planner import PlannerOptions, PlannerState, next_view
from nbv.plan.plan import Plan, Resumption
from nbv.scanning.sensor import Sensor, View
from nbv.scans.scan_coverage import ScanCoverage
from nbv.scans.scan_map import ScanMap
from nbv.visibility.requirement import Requirement
from nbv.visibility.site_options import SiteOptions
from nbv.visibility.viewpoints import Candidates
from scenes.checks import InputError


def plan_next_stations(
    scan_map: ScanMap,
    sensor: Sensor,
    requirement: Requirement | None = None,
    *,
    views: int = 1,
    candidates: Candidates | None = None,
    options: PlannerOptions | None = None,
    completed: KnownSurfaces | None = None,
    n_threads: int | None = None,
) -> Plan:
    """Plan where to scan next from the scans so far.

    The first view is the online planner's next one. What it should see counts as settled, and the second is
    the next one then, and so on: later views are predictions, for nobody can say what the first will find.
    No view leaves space that is already known to be free.

    Parameters
    ----------
    scan_map : ScanMap
        What is known.
    sensor : Sensor
        What scans next.
    requirement : Requirement, optional
        What counts as seen well; of it the planner looks for the incidence.
    views : int
        How many stations to propose at most.
    candidates : Candidates, optional
        Where the sensor may go; the scan map's own when not given.
    options : PlannerOptions, optional
        Clearance, stopping, weights, zones.
    completed : CompletedSurfaces, optional
        Completion of the scans; what it knows counts less than what is unknown
        (`nbv.online.planner.explore`), also for the later views, whose scans nobody has to complete.
    n_threads : int, optional
        Threads; the plan does not depend on it.

    Returns
    -------
    Plan
        Without coverage, which nobody knows, and without target; its views say what gain is predicted.

    Raises
    ------
    InputError
        Fewer than one view, a sensor whose aperture is a plane.
    """
    if views < 1:
        raise InputError(f"views must be at least 1, got {views}")
    requirement = requirement or Requirement()
    options = options or PlannerOptions()
    options = replace(options, on_floor=options.on_floor and scan_map.rooms is not None)
    candidates = candidates or scan_map.candidates(sensor, SiteOptions(clearance_m=options.clearance_m))
    sensor, state = check_aperture(sensor), PlannerState.of(scan_map.voxels, completed)
    planned, reason = list[View](), f"the limit of {views} views is reached"
    here = scan_map.scans[-1].world_from_sensor
    while len(planned) < views:
        decision = next_view(
            state, candidates, here, sensor=sensor, requirement=requirement, options=options,
            n_threads=n_threads,
        )  # fmt: skip
        if decision.view is None:
            reason = decision.reason or reason
            break
        state = state.after_choice(decision.view, times=options.gain.max_attempts)
        planned.append(View(decision.view.pose, sensor, predicted_gain_m2=decision.view.gain_m2))
    return Plan(
        method="nbv",
        sensor=sensor,
        requirement=requirement,
        target=None,
        seed=None,
        n_candidates=candidates.n_poses,
        views=tuple(planned),
        coverage=None,
        lower_bound=None,
        stopped_because=reason,
        candidates=candidates,
        resumed_from=Resumption(tuple(scan.world_from_sensor for scan in scan_map.scans), None),
        zones=options.zones,
    )


def room_entries(coverage: ScanCoverage, plan: Plan, chosen: Sequence[int]) -> tuple[dict[str, Any], ...]:
    """Return what `plan.json` says of each room: areas, scans, next stations, whether it was asked for."""
    seen = coverage.scan_map.rooms
    if seen is None:
        return ()
    places = np.array([view.world_from_sensor.translation for view in plan.views]).reshape(-1, 3)
    of = seen.room_near(places)
    return tuple(
        {
            **room.to_json(),
            "is_asked_for": room.room.number in chosen,
            "stations": (np.flatnonzero(of == room.room.number) + 1).tolist(),
        }
        for room in coverage.rooms
        if room.room is not None
    )


def check_aperture(sensor: Sensor) -> Sensor:
    """Return the sensor; InputError for a profile scanner, in whose plane no place lies."""
    if sensor.kind == "line":
        raise InputError(
            f"{sensor.name} measures one line at a time, so that a single view has no gain; "
            "plan with a sensor that has an aperture, like generic60 or panorama"
        )
    return sensor
