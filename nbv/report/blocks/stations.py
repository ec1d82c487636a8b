# SPDX-License-Identifier: MIT
"""Stations of a report: tables of where they stand and look, plots of what they measure one by one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh
from shapely import MultiPoint

from nbv.coverage.coverage import Coverage
from nbv.plan.baselines import Baseline
from nbv.plan.tour import Tour
from nbv.report.figures.floor_plan import FloorPlan
from nbv.report.figures.plots import coverage_curve
from nbv.report.pictures.picture import Picture
from nbv.scanning.sensor import Sensor
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.scan.projection import Projection
from scenes.world.scene import Scene

_RAYS = 25  # along each side of a field of view
_CUT_M = 1.0  # above the floor: where the floor plan cuts walls and furniture


def curve(
    met: Sequence[float],
    coverage: Coverage,
    target: float | None,
    bound: int | None,
    inferred: tuple[int, float, float] | None = None,
    start: float = 0.0,
    others: Sequence[Baseline] = (),
) -> Picture:
    """The coverage curve; `start` is the share that is measured before the first view."""
    beside = {other.name: np.median(other.met, axis=0) for other in others}
    plot = coverage_curve(
        met, coverage.reachable, target=target, bound=bound, inferred=inferred, start=start, others=beside
    )
    caption = "Share of all surface area that some view so far has measured within range and incidence."
    if inferred:
        caption += " Blue: what was inferred from a few scans, on top of what they measured at any incidence."
    if others:
        caption += " Thin: what simple planners reach on the same candidates, medians of their runs."
    return plot.picture("Coverage by number of views.", caption)


def stations(
    scene: Scene,
    poses: Sequence[Pose],
    sensor: Sensor,
    highlighted: Sequence[int] = (),
    given: Sequence[Pose] = (),
    tour: Tour | None = None,
    zones: Zones = EVERYWHERE,
    projections: Sequence[Projection] = (),
) -> Picture:
    """The floor plan; `projections` of the stations where they are not the sensor's."""
    bounds = scene.mesh.bounds()
    reach = field_length(bounds)
    plan = FloorPlan(
        outline=outline_of(scene),
        bounds=bounds,
        positions=places_of(poses),
        fields=fields_of(poses, projections or [sensor.projection] * len(poses), reach),
        highlighted=highlighted,
        given=places_of(given),
        ways=[] if tour is None else [leg.path for leg in tour.legs],
        zones=zones,
    )
    caption = f"Dots are stations, numbered by view, each with its field of view up to {reach:.2g} m."
    if highlighted:
        caption += " Blue: the stations whose scans were completed."
    if given:
        caption += " Squares with letters: where the scans that were given have been taken."
    if tour is not None:
        which = "the way from scan to scan" if tour.is_given else "a tour of the stations"
        caption += f" Lines: {which}, {tour.describe()}."
    caption += zones_caption(zones)
    height = min(_CUT_M, float(np.ptp(bounds[:, 2])) / 2)
    return plan.plot().picture("Plan.", f"{caption} Cut at {height:.2f} m height.")


def field_length(bounds: FloatArray) -> float:
    """Return how far fields of view are drawn within `bounds` (2, 3), metres: short enough to tell apart."""
    return 0.16 * float(np.ptp(bounds[:, :2], axis=0).max())


def fields_of(poses: Sequence[Pose], projections: Sequence[Projection], reach_m: float) -> list[FloatArray]:
    """Outlines (k, 2) of what sensors see up to a distance, from above: steep ones are short."""
    rays = {id(projection): _some_rays(projection) for projection in projections}
    return [
        _outline(pose.translation, pose.translation + reach_m * pose.rotate(rays[id(projection)]))
        for pose, projection in zip(poses, projections, strict=True)
    ]


def _some_rays(projection: Projection) -> FloatArray:
    """Rays (n, 3) all over a field of view, its corners among them."""
    rows, columns = (np.unique(np.linspace(0, n - 1, _RAYS).astype(np.int64)) for n in projection.shape)
    return projection.directions()[np.ix_(rows, columns)].reshape(-1, 3)


def _outline(origin: FloatArray, ends: FloatArray) -> FloatArray:
    """Convex outline (k, 2) of what lies between a place and others, from above."""
    hull = MultiPoint(np.vstack([origin, ends])[:, :2]).convex_hull
    return np.asarray(getattr(hull, "exterior", hull).coords, dtype=np.float64)


def zones_caption(zones: Zones) -> str:
    """What the floor plan's dashes and hatching mean."""
    dashes = "" if zones.region is None else " Dashes: only surface in this region counts."
    return dashes + (" Hatched: no station, and no way." if zones.keep_out else "")


def places_of(poses: Sequence[Pose]) -> FloatArray:
    """Return where sensors stand (n, 3), metres."""
    return np.array([pose.translation for pose in poses]).reshape(-1, 3)


def outline_of(scene: Scene) -> FloatArray:
    """Segments (k, 2, 2) in which a level plane near the floor cuts the scene, x and y in metres."""
    low, high = scene.mesh.bounds()
    return cut_of(scene.mesh, low[2] + min(_CUT_M, (high[2] - low[2]) / 2))


def cut_of(mesh: LabelledMesh, height_m: float) -> FloatArray:
    """Segments (k, 2, 2) in which the level plane at a height cuts a mesh, x and y in metres."""
    heights = mesh.vertices[:, 2][mesh.faces]
    near = (heights.min(axis=1) <= height_m + 1e-6) & (heights.max(axis=1) >= height_m + 1e-6)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces[near], process=False)
    cut = trimesh.intersections.mesh_plane(solid, (0.0, 0.0, 1.0), (0.0, 0.0, height_m + 1e-6))
    return np.asarray(cut, dtype=np.float64).reshape(-1, 2, 3)[:, :, :2]
