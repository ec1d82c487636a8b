# SPDX-License-Identifier: MIT
"""Tables and plots of a report on coverage: views, stations, surfaces, what is out of reach and why."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import trimesh
from shapely import MultiPoint

from nbv.coverage.coverage import Coverage
from nbv.coverage.unreachable import unreachable_patches
from nbv.plan.baselines import Baseline
from nbv.plan.plan import Plan
from nbv.plan.tour import Tour
from nbv.report.blocks.page import Block, Cell, Table, Text
from nbv.report.figures.floor_plan import FloorPlan
from nbv.report.figures.picture import Picture
from nbv.report.figures.plots import coverage_curve
from nbv.report.viewer.markers import Look, is_cone, projection_of, slope_of
from nbv.run.wording import letters, percent, percent_within, square_metres
from nbv.scanning.sensor import Sensor
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.run.mapping import trim
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

PLACE_COLUMNS = ("position x, y, z, m", "#heading, \u00b0", "#elevation, \u00b0")


def place_cells(pose: Pose, z_up: Pose | None = None) -> tuple[Cell, Cell, Cell]:
    """Position, heading from the x axis to the y axis, and elevation of where a sensor looks.

    `z_up` turns the world to that of drawings, in which headings and elevations are told.
    """
    dx, dy, dz = (pose if z_up is None else z_up @ pose).rotation[:, 2]
    heading, elevation = np.degrees(np.arctan2(dy, dx)), np.degrees(np.arcsin(np.clip(dz, -1, 1)))
    place = ", ".join(f"{c:.2f}" for c in pose.translation)
    return Cell(place), Cell(f"{heading:.0f}"), Cell(f"{elevation:.0f}")


def scans_table(scans: Sequence[RangeImage], *, lettered: bool = False, z_up: Pose | None = None) -> Table:
    """A row for each scan: number or letter as in plan and 3-D view, name, place, pixels that measured.

    `z_up` as of `place_cells`.
    """
    rows = []
    for number, scan in enumerate(scans, start=1):
        trim()
        hits = int(scan.valid.sum())
        share = hits / max(scan.valid.size, 1)
        farthest = f"{float(scan.ranges[scan.valid].max()):.2f}" if hits else ""
        rows.append(
            (
                Cell(letters(number - 1) if lettered else str(number)),
                Cell(scan.name),
                *place_cells(scan.world_from_sensor, z_up),
                Cell(f"{hits}"),
                Cell(f"{100 * share:.1f}", share=share, state="measured"),
                Cell(farthest),
            )
        )
    columns = ("Scan", "Name", *PLACE_COLUMNS, "#measured pixels", "#of all, %", "#farthest, m")
    return Table(columns, tuple(rows))


_MOST_PATCHES = 30  # in the report; coverage.json has all
REASON_TEXTS = {
    "hidden": "no candidate position has a free line of sight",
    "out_of_range": "what sees it is too near or too far",
    "grazing": "what sees it sees it at too flat an angle",
    "out_of_aperture": "no candidate direction points there",
    "too_sparse": "what sees it would measure too few points on a square metre",
    "too_uncertain": "what sees it would measure it with too large a standard deviation",
    "too_few_views": "fewer candidates than required can measure it",
}


def reasons(coverage: Coverage) -> tuple[Block, ...]:
    """A row for each reason for which surface is out of reach."""
    shares = {name: share for name, share in coverage.reasons().items() if share > 0}
    errors: dict[str, float] = dict(coverage.reason_errors())
    if not shares:
        return (Text("Every part of the surface can be measured as required by some candidate."),)
    rows = tuple(
        (
            Cell(name.replace("_", " ")),
            Cell(REASON_TEXTS.get(name, "")),
            Cell(
                percent_within(share, errors[name]),
                share=share / max(coverage.unreachable, 1e-12),
                state="unreachable",
            ),
            Cell(square_metres(share * coverage.total_m2)),
        )
        for name, share in shares.items()
    )
    columns = ("Reason", "What it means", "#% of the area", "#area, m\u00b2")
    return Table(columns, rows), _patches_table(coverage)


def _patches_table(coverage: Coverage) -> Table:
    """A row for each of the largest patches that are out of reach."""
    patches = unreachable_patches(coverage)
    rows = tuple(
        (
            Cell(patch.name),
            Cell(patch.reason.replace("_", " ")),
            Cell(", ".join(f"{c:.2f}" for c in patch.centre)),
            Cell(square_metres(patch.area_m2)),
        )
        for patch in patches[:_MOST_PATCHES]
    )
    title = (
        f"The largest of {len(patches)} patches out of reach"
        if len(patches) > 1
        else "The patch out of reach"
    )
    return Table(("Surface", "Reason", "centre x, y, z, m", "#area, m\u00b2"), rows, title, is_folded=True)


def surfaces_table(coverage: Coverage) -> Table:
    """A row for each surface."""
    table = coverage.by_surface()
    rows = tuple(
        (
            Cell(row.name),
            Cell(square_metres(row.area_m2)),
            Cell(percent_within(row.met, row.standard_error["met"]), share=row.met, state="measured"),
            Cell(
                percent(max(row.reachable - row.met, 0.0)),
                share=max(row.reachable - row.met, 0.0),
                state="unknown",
            ),
            Cell(
                percent_within(row.unreachable, row.standard_error["unreachable"]),
                share=row.unreachable,
                state="unreachable",
            ),
            Cell(f"{row.mean_cosine:.2f}"),
        )
        for row in table
    )
    columns = (
        "Surface",
        "#area, m\u00b2",
        "#measured, %",
        "#missed, %",
        "#out of reach, %",
        "#mean cosine of incidence, 0 to 1",
    )
    return Table(columns, rows)


def views_table(plan: Plan) -> Table:
    """A row for each view of a plan."""
    poses = [view.world_from_sensor for view in plan.views]
    gains = [view.gain_m2 or 0.0 for view in plan.views]
    return _stations_table("View", poses, gains, [view.met_fraction or 0.0 for view in plan.views])


def stations_table(
    poses: Sequence[Pose], met: Sequence[float], total_m2: float, what: str = "Station"
) -> Table:
    """A row for each station that was given; `met` is the share before the first and after each."""
    gains = [(after - before) * total_m2 for before, after in pairwise(met)]
    return _stations_table(what, poses, gains, met[1:])


def _stations_table(what: str, poses: Sequence[Pose], gains: Sequence[float], met: Sequence[float]) -> Table:
    rows = tuple(
        (
            Cell(str(number)),
            *place_cells(pose),
            Cell(square_metres(gain)),
            Cell(percent(share), share=share, state="measured"),
        )
        for number, (pose, gain, share) in enumerate(zip(poses, gains, met, strict=True), start=1)
    )
    columns = (what, *PLACE_COLUMNS, "#newly measured, m\u00b2", "#measured so far, %")
    return Table(columns, rows)


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
    looks: Sequence[Look] = (),
) -> Picture:
    """The floor plan; `looks` tell the stations' fields of view where they are not the sensor's."""
    bounds = scene.mesh.bounds()
    reach = field_length(bounds)
    plan = FloorPlan(
        outline=outline_of(scene),
        bounds=bounds,
        positions=places_of(poses),
        fields=fields_of(poses, looks or [sensor] * len(poses), reach),
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


def fields_of(poses: Sequence[Pose], looks: Sequence[Look], reach_m: float) -> list[FloatArray]:
    """Outlines (k, 2) of what sensors see up to a distance, from above: steep ones are short."""
    rays = {id(look): _some_rays(look) for look in looks}
    return [
        _outline(pose.translation, pose.translation + reach_m * pose.rotate(rays[id(look)]))
        for pose, look in zip(poses, looks, strict=True)
    ]


def _some_rays(look: Look) -> FloatArray:
    """Rays (n, 3) all over a field of view, its corners among them; of a cone in rings up to its own."""
    slope, projection = slope_of(look), projection_of(look)
    if slope is not None and is_cone(look):
        share, turn = np.meshgrid(np.linspace(0.0, 1.0, _RAYS), np.linspace(0.0, 2 * np.pi, 2 * _RAYS))
        across = [tangent * share * way(turn) for tangent, way in zip(slope, (np.cos, np.sin), strict=True)]
        rays = np.stack([*across, np.ones_like(turn)])
        return np.asarray((rays / np.linalg.norm(rays, axis=0)).reshape(3, -1).T)
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
    return cut_by_surface(mesh, height_m)[0]


def cut_by_surface(mesh: LabelledMesh, height_m: float) -> tuple[FloatArray, IntArray]:
    """Segments (k, 2, 2) of a level cut, as `cut_of`, and the surface (k,) that each belongs to."""
    heights = mesh.vertices[:, 2][mesh.faces]
    near = (heights.min(axis=1) <= height_m + 1e-6) & (heights.max(axis=1) >= height_m + 1e-6)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces[near], process=False)
    level = ((0.0, 0.0, 1.0), (0.0, 0.0, height_m + 1e-6))
    cut, face = trimesh.intersections.mesh_plane(solid, *level, return_faces=True)
    segments = np.asarray(cut, dtype=np.float64).reshape(-1, 2, 3)[:, :, :2]
    return segments, np.asarray(mesh.face_surface[near][np.asarray(face, np.int64)], np.int64)
