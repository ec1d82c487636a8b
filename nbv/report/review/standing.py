# SPDX-License-Identifier: MIT
"""Standing: where to scan from to see what is hidden of a surface."""

from __future__ import annotations

from typing import Any

import numpy as np

from completion.result.completion import Completion
from nbv.coverage.surface_classes import KnownSurfaces
from nbv.online.planner import PlannerOptions
from nbv.report.review.asking import hidden_box
from nbv.scanning.sensor import Sensor
from nbv.scans.next_stations import plan_next_stations
from nbv.scans.scan_map import ScanMap, with_known_noise
from nbv.visibility.zones import Box, Zones
from scenes.checks import FloatArray

_AROUND_M = 0.1  # by which the box around what is hidden is widened


def stand_for(
    completion: Completion, number: int, sensor: Sensor, *, n_threads: int | None = None
) -> dict[str, Any]:
    """Return the next station for what is hidden of a surface: place, direction, gain; or why there is none.

    The place is in coordinates of drawings, z up, as the planner needs them.

    Parameters
    ----------
    completion : Completion
        What is known.
    number : int
        The surface, from 1.
    sensor : Sensor
        What scans next.
    n_threads : int, optional
        Threads; the place does not depend on it.

    Raises
    ------
    InputError
        There is no such surface, or nothing of it is hidden.
    """
    scans = [with_known_noise(scan) for scan in completion.drawn_scans]
    zones = Zones(region=Box(*_drawn_box(completion, hidden_box(completion, number))))
    options = PlannerOptions(zones=zones)
    is_upright = np.array_equal(completion.up.drawing_from_world.matrix, np.eye(4))
    completed = KnownSurfaces(completion, 0.02) if is_upright else None  # it knows places of the world
    scan_map = ScanMap.of(scans, sensor, options=options, completed=completed, zones=zones)
    plan = plan_next_stations(scan_map, sensor, views=1, options=options, n_threads=n_threads)
    if not plan.views:
        return {"surface": number, "why_none": plan.stopped_because}
    view = plan.views[0]
    return {
        "surface": number,
        "place": view.world_from_sensor.translation.tolist(),
        "direction": view.world_from_sensor.rotation[:, 2].tolist(),
        "gain_m2": view.predicted_gain_m2,
        "why_none": "",
    }


def _drawn_box(completion: Completion, box: FloatArray) -> FloatArray:
    """The box (2, 3) around a box of the world, in coordinates of drawings, a little wider."""
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    drawn = completion.up.drawing_from_world.apply(corners)
    return np.stack([drawn.min(axis=0) - _AROUND_M, drawn.max(axis=0) + _AROUND_M])
