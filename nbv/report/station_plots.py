# SPDX-License-Identifier: MIT
"""Plots of a report on stations: where they stand, and what they measure one after the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh

from nbv.coverage import Coverage
from nbv.floor_plan import FloorPlan
from nbv.plots import Plot, coverage_curve
from nbv.report.picture import Picture
from nbv.scanning.sensor import Sensor
from nbv.tour import Tour
from nbv.wording import count
from nbv.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scene import Scene

_CUT_M = 1.0  # above the floor: where the floor plan cuts walls and furniture


def curve(
    met: Sequence[float],
    coverage: Coverage,
    target: float | None,
    bound: int | None,
    inferred: tuple[int, float, float] | None = None,
    start: float = 0.0,
) -> Picture:
    """The coverage curve; `start` is the share that is measured before the first view."""
    plot = coverage_curve(met, coverage.reachable, target, bound, inferred, start)
    caption = "Share of all surface area that some view so far has measured within range and incidence."
    if inferred:
        caption += " Blue: what was inferred from a few scans, on top of what they measured at any incidence."
    return _picture(plot, "Coverage by number of views.", caption)


def stations(
    scene: Scene,
    poses: Sequence[Pose],
    sensor: Sensor,
    highlighted: Sequence[int] = (),
    given: Sequence[Pose] = (),
    tour: Tour | None = None,
    zones: Zones = EVERYWHERE,
) -> Picture:
    """The floor plan."""
    bounds = scene.mesh.bounds()
    directions = np.array([pose.rotation[:, 2] for pose in poses]).reshape(-1, 3)
    plan = FloorPlan(
        outline=outline_of(scene),
        bounds=bounds,
        positions=places_of(poses),
        directions=None if sensor.kind == "spherical" else directions,
        highlighted=highlighted,
        given=places_of(given),
        ways=[] if tour is None else [leg.path for leg in tour.legs],
        zones=zones,
    )
    caption = "Dots are stations, numbered by view; arrows point where they look."
    if highlighted:
        caption += " Blue: the stations whose scans were completed."
    if given:
        caption += " Squares with letters: where the scans that were given have been taken."
    if tour is not None:
        n_lost = sum(not len(leg.path) for leg in tour.legs)
        caption += f" Lines: a tour of the stations, {tour.length_m:.1f} m long"
        caption += f"; {count(n_lost, 'leg')} of it no way leads along." if n_lost else "."
    caption += zones_caption(zones)
    height = min(_CUT_M, float(np.ptp(bounds[:, 2])) / 2)
    return _picture(plan.plot(), "Plan.", f"{caption} Cut at {height:.2f} m height.")


def zones_caption(zones: Zones) -> str:
    """What the floor plan's dashes and hatching mean."""
    dashes = "" if zones.region is None else " Dashes: only surface in this region counts."
    return dashes + (" Hatched: no station, and no way." if zones.keep_out else "")


def places_of(poses: Sequence[Pose]) -> FloatArray:
    """Return where sensors stand (n, 3), metres."""
    return np.array([pose.translation for pose in poses]).reshape(-1, 3)


def outline_of(scene: Scene) -> FloatArray:
    """Segments (k, 2, 2) in which a horizontal plane cuts the scene, x and y in metres."""
    low, high = scene.mesh.bounds()
    height = low[2] + min(_CUT_M, (high[2] - low[2]) / 2)
    mesh = trimesh.Trimesh(scene.mesh.vertices, scene.mesh.faces, process=False)
    cut = trimesh.intersections.mesh_plane(mesh, (0.0, 0.0, 1.0), (0.0, 0.0, height + 1e-6))
    return np.asarray(cut, dtype=np.float64).reshape(-1, 2, 3)[:, :, :2]


def _picture(plot: Plot, title: str, caption: str) -> Picture:
    return Picture(title, caption, plot.light, plot.width, plot.height, plot.dark)
