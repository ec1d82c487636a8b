# SPDX-License-Identifier: MIT
"""Reports of scans without a model of the scene: what they cover, and where to stand next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nbv.online.occupancy import SEEN
from nbv.plan.plan import Plan
from nbv.report.blocks.coverage_tables import (
    PLACE_COLUMNS,
    field_length,
    fields_of,
    place_cells,
    places_of,
    scans_table,
    zones_caption,
)
from nbv.report.blocks.page import (
    Bar,
    BarShare,
    Block,
    Cell,
    Gallery,
    Headline,
    Page,
    PageSection,
    State,
    Table,
    Text,
)
from nbv.report.blocks.room_tables import record_blocks, rooms_blocks, seen_storey_plans
from nbv.report.figures.completion_shots import is_single_camera, part_of, solid_bounds
from nbv.report.figures.drawing import MeshDrawing, mark_hatched, mark_modelled, paint_states
from nbv.report.figures.floor_plan import FloorPlan
from nbv.report.figures.picture import (
    INFERRED,
    MEASURED,
    MODELLED,
    UNKNOWN,
    Picture,
    aside_cameras,
    overview_cameras,
    picture_of,
)
from nbv.report.viewer.markers import look_of_scan
from nbv.report.viewer.scan_views import state_view
from nbv.run.wording import count, square_metres
from nbv.scanning.sensor import Sensor
from nbv.scans.scan_coverage import ScanCoverage
from nbv.scans.scan_map import ScanMap
from nbv.scans.scan_record import ScanRecord
from nbv.scans.state_mesh import FRONTIER, SEEN_WORSE, SHADOW, STATES, StateMesh
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.colour import surface_colour

_WIDTH = 760
_THICK_M = 0.15  # half the height over which seen voxels are drawn
_COLOURS = (MEASURED, MODELLED, INFERRED, UNKNOWN)


def area_headlines(coverage: ScanCoverage) -> tuple[Headline, ...]:
    """Measured, inferred and unknown areas."""
    area, unseen, model = coverage.measured, coverage.unseen, coverage.completion
    inferred = () if model is None else (
        Headline(square_metres(model.hypothesised_m2), "m\u00b2", "inferred surface", "inferred"),
    )  # fmt: skip
    states: tuple[State, ...] = ("measured", "unknown", "unreachable")
    return (
        Headline(square_metres(area.met_m2), "m\u00b2", "surface measured as required", states[0]),
        Headline(square_metres(area.worse_m2), "m\u00b2", "surface measured worse", "modelled"),
        *inferred,
        Headline(
            square_metres(unseen.occluded_m2), "m\u00b2", "edge of shadows (boundary, not surface)", states[1]
        ),
        Headline(
            square_metres(unseen.frontier_m2), "m\u00b2", "edge of all fields of view (boundary)", states[2]
        ),
    )


def area_bar(coverage: ScanCoverage) -> Bar:
    """Surface alone: measured as required, worse, inferred."""
    model = coverage.completion
    parts: list[tuple[str, State, float]] = [
        ("measured as required", "measured", coverage.measured.met_m2),
        ("measured worse", "modelled", coverage.measured.worse_m2),
        ("inferred", "inferred", 0.0 if model is None else model.hypothesised_m2),
    ]
    total = max(sum(area for _, _, area in parts), 1e-12)
    shares = tuple(
        BarShare(label, state, area / total, f"{square_metres(area)} m\u00b2")
        for label, state, area in parts
        if area > 0
    )
    return Bar("Areas of surface", shares)


def state_blocks(
    coverage: ScanCoverage,
    state: StateMesh,
    n_threads: int | None,
    poses: Sequence[Pose] = (),
    sensor: Sensor | None = None,
    zones: Zones = EVERYWHERE,
) -> tuple[Block, ...]:
    """What was measured, inferred and hidden, in three dimensions, with the next stations of `sensor`."""
    if not len(state.mesh.faces):
        return (Text("There is no surface to show."),)
    view = state_view(
        coverage, state, state_pictures(coverage, state, n_threads), poses=poses, sensor=sensor, zones=zones
    )
    legend = (
        f"Hatched: {STATES[SHADOW]}, behind which nobody knows: faces of voxels between known empty space "
        f"and the unknown, not surface. The {STATES[FRONTIER]}, beyond which no scan has looked, is left "
        f"out at first{', and so are faces that look away' if view.is_room else ''}."
    )
    return view, Text(legend, is_note=True)


def state_pictures(coverage: ScanCoverage, state: StateMesh, n_threads: int | None) -> tuple[Picture, ...]:
    """What was measured, inferred and hidden, from two sides."""
    scans = list(coverage.scan_map.scans)
    drawn = state.mesh.face_surface != FRONTIER  # it would hide what was measured
    mesh = part_of(state.mesh, drawn)
    canvas = MeshDrawing(mesh, state.front[drawn], n_threads)
    if is_single_camera(scans):
        cameras = aside_cameras(scans[0])[:2]
    else:
        around = overview_cameras(solid_bounds(mesh))
        cameras = [around[0], around[len(around) // 2]]
    pictures = []
    for side, camera in zip(("one side", "the other side"), cameras, strict=True):
        layer = canvas.look(camera, camera.shape(_WIDTH))
        hit, shade = layer.hit, canvas.shade(layer)
        vertex_of = np.full(hit.shape, -1, np.int64)
        vertex_of[hit] = mesh.face_surface[layer.face[hit]]
        image = paint_states(vertex_of, shade, dict(enumerate(_COLOURS)))
        image = mark_hatched(mark_modelled(image, vertex_of == SEEN_WORSE, shade), vertex_of == SHADOW)
        pictures.append(picture_of(image, f"Measured, inferred, hidden: from {side}."))
    return tuple(pictures)


def stations_plans(scan_map: ScanMap, sensor: Sensor, plan: Plan | None = None) -> tuple[Picture, ...]:
    """The floor plan of each storey: where the scans were taken, and where the next ones are to be.

    One of everything around an object, and where no floor was seen.
    """
    if scan_map.rooms is not None:
        places = places_of([scan.world_from_sensor for scan in scan_map.scans])
        return tuple(sheet.picture() for sheet in seen_storey_plans(scan_map.rooms, places, plan))
    poses = [] if plan is None else [view.world_from_sensor for view in plan.views]
    zones = EVERYWHERE if plan is None else plan.zones
    outline, height = _outline(scan_map)
    reach = field_length(scan_map.bounds)
    looks = [look_of_scan(scan, sensor) for scan in scan_map.scans]
    plot = FloorPlan(
        outline=outline,
        bounds=scan_map.bounds,
        positions=places_of(poses),
        fields=fields_of(poses, [sensor] * len(poses), reach),
        given=places_of([scan.world_from_sensor for scan in scan_map.scans]),
        given_fields=fields_of([scan.world_from_sensor for scan in scan_map.scans], looks, reach),
        zones=zones,
    ).plot()
    caption = "Squares with letters: where the scans have been taken."
    if poses:
        caption += " Dots: the next stations, in order."
    caption += f" Around each its field of view up to {reach:.2g} m."
    caption += zones_caption(zones) + f" Outlines: voxels that hold measured surface, {height}."
    return (plot.picture("Plan.", caption),)


def _outline(scan_map: ScanMap) -> tuple[FloatArray, str]:
    """Segments (k, 2, 2) around the seen voxels of a horizontal slice, and where it lies."""
    grid = scan_map.voxels.grid
    low, high = scan_map.bounds[:, 2]
    level = (low + high) / 2
    z = grid.origin[2] + (np.arange(grid.shape[2]) + 0.5) * grid.voxel_m
    layers = np.abs(z - level) <= max(_THICK_M, grid.voxel_m / 2)
    seen = (scan_map.voxels.labels == SEEN).reshape(grid.shape)[:, :, layers].any(axis=2)
    return _edges(seen) * grid.voxel_m + grid.origin[:2], f"{level:.2f} \u00b1 {_THICK_M:.2f} m high"


def _edges(filled: np.ndarray) -> FloatArray:
    """Edges (k, 2, 2) between filled cells of a raster and others, in cells."""
    padded = np.pad(filled, 1)
    i, j = np.nonzero(padded[1:, 1:-1] != padded[:-1, 1:-1])
    across = np.stack([np.stack([i, j], -1), np.stack([i, j + 1], -1)], axis=1)
    i, j = np.nonzero(padded[1:-1, 1:] != padded[1:-1, :-1])
    along = np.stack([np.stack([i, j], -1), np.stack([i + 1, j], -1)], axis=1)
    return np.concatenate([across, along]).astype(np.float64)


def surfaces_blocks(coverage: ScanCoverage) -> tuple[Block, ...]:
    """A row for each recognised surface."""
    rows = tuple(
        (
            Cell(str(surface.id), swatch=surface_colour(surface.id)),
            Cell(surface.kind),
            Cell(square_metres(surface.observed_m2)),
            Cell(f"{100 * surface.met:.1f}", share=surface.met, state="measured"),
            Cell(square_metres(surface.hypothesised_m2)),
        )
        for surface in coverage.surfaces
    )
    if not rows:
        return (Text("None was recognised."),)
    columns = ("Surface", "Kind", "#measured, m\u00b2", "#of it as required, %", "#inferred, m\u00b2")
    return (Table(columns, rows),)


def boundary_blocks(coverage: ScanCoverage) -> tuple[Block, ...]:
    """A row for each kind of boundary."""
    unseen = coverage.unseen
    kinds = (
        ("edge of a shadow", "behind it something measured hides what there is", unseen.occluded_m2),
        (
            "of shadows, explained",
            "a recognised surface passes there, measured or inferred",
            unseen.explained_m2,
        ),
        ("frontier", "no scan has looked beyond", unseen.frontier_m2),
    )
    rows = tuple((Cell(name), Cell(meaning), Cell(square_metres(area))) for name, meaning, area in kinds)
    note = (
        "Areas of the boundary between space known to be empty and space of which nothing is known, within "
        f"the volume that was measured, by voxels of {100 * coverage.scan_map.voxels.grid.voxel_m:.1f} cm. "
        "They are not areas of surface, and cannot be added to those: behind a square metre of shadow's edge "
        "there may be ten square metres of surface, or none."
    )
    return Table(("Boundary", "What it means", "#area, m\u00b2"), rows), Text(note, is_note=True)


_NO_FLOOR = (
    "No floor was seen below the scanners, so stations are wherever space is known to be free; "
    "if another direction is up than was taken, say so (--up)."
)


def next_stations_page(
    plan: Plan,
    coverage: ScanCoverage,
    record: Sequence[ScanRecord],
    title: str,
    *,
    infers: bool = False,
    n_threads: int | None = None,
) -> Page:
    """Return the report of a plan that continues scans in a place without a model.

    `infers` tells whether the stations were chosen by what completion leaves open.
    """
    scan_map = coverage.scan_map
    poses = [view.world_from_sensor for view in plan.views]
    stations = Headline(str(len(poses)), "", "next stations" if len(poses) != 1 else "next station")
    lost = scan_map.mode == "room" and scan_map.rooms is None
    plans, brought = stations_plans(scan_map, plan.sensor, plan), record_blocks(record)
    missing = rooms_blocks(coverage, plan)
    return Page(
        title=title,
        kicker="Next stations",
        summary=f"{_where(plan)} {summary(coverage)}",
        headlines=(stations, *area_headlines(coverage)),
        bar=area_bar(coverage),
        sections=(
            PageSection(
                "Where to stand next",
                (Gallery(plans, min(len(plans), 2)), *stations_table(plan, infers=infers)),
            ),
            *((PageSection("What is missing, room by room", missing),) if missing else ()),
            *((PageSection("What each scan brought", brought),) if brought else ()),
            PageSection(
                "What was measured, and where the unknown begins",
                state_blocks(
                    coverage,
                    StateMesh.of(coverage),
                    n_threads=n_threads,
                    poses=poses,
                    sensor=plan.sensor,
                    zones=plan.zones,
                ),
            ),
            PageSection("Where the unknown begins", boundary_blocks(coverage)),
            PageSection("Scans so far", (scans_table(scan_map.scans, lettered=True),)),
            *((PageSection("Surfaces", surfaces_blocks(coverage)),) if coverage.completion else ()),
        ),
        warnings=(_NO_FLOOR,) if lost else (),
    )


def _where(plan: Plan) -> str:
    """Where the first station is."""
    if not plan.views:
        return f"No further station: {plan.stopped_because}."
    x, y, z = plan.views[0].world_from_sensor.translation
    return f"The next station with {plan.sensor.name} is at ({x:.2f}, {y:.2f}, {z:.2f}) m."


def stations_table(plan: Plan, *, infers: bool = False) -> tuple[Block, ...]:
    """A row for each station, and why there are no more."""
    rows = tuple(
        (
            Cell(str(number)),
            *place_cells(view.world_from_sensor),
            Cell(square_metres(view.predicted_gain_m2 or 0.0)),
        )
        for number, view in enumerate(plan.views, start=1)
    )
    columns = ("Station", *PLACE_COLUMNS, "#predicted gain, m\u00b2")
    gain = (
        "area that is likely to be news beyond the unknown's boundary, inferred surface by its doubt alone, "
        "and of surface measured worse than required, which counts little where a fitted surface is exact,"
        if infers
        else "area of the unknown's boundary and of surface that was measured worse than required,"
    )
    note = (
        f"Chosen among {count(plan.n_candidates, 'pose')}, of which those count that stand in known free "
        f"space. Gain: {gain} "
        "as far as the voxels say that the station sees it. It is a prediction; from the second station on "
        "it supposes that the ones before have seen what was predicted. The list ends because: "
        f"{plan.stopped_because}."
    )
    return (Table(columns, rows),) * bool(rows) + (Text(note, is_note=True),)


def scan_coverage_page(
    coverage: ScanCoverage,
    state: StateMesh,
    sensor: Sensor,
    title: str,
    n_threads: int | None = None,
) -> Page:
    """Return the report of a coverage, with its mesh and the sensor that was reckoned with."""
    scans, rooms = coverage.scan_map.scans, rooms_blocks(coverage)
    plans = stations_plans(coverage.scan_map, sensor)
    return Page(
        title=title,
        kicker="Coverage of scans",
        summary=summary(coverage),
        headlines=area_headlines(coverage),
        bar=area_bar(coverage),
        sections=(
            PageSection(
                "What was measured, and where the unknown begins",
                state_blocks(coverage, state, n_threads, sensor=sensor),
            ),
            PageSection(
                "Stations",
                (Gallery(plans, min(len(plans), 2)), scans_table(scans, lettered=True)),
            ),
            *((PageSection("Room by room", rooms),) if rooms else ()),
            PageSection("Where the unknown begins", boundary_blocks(coverage)),
            PageSection("Surfaces", surfaces_blocks(coverage)),
        ),
    )


def summary(coverage: ScanCoverage) -> str:
    """What was measured, and how well, in a sentence or two."""
    area, model = coverage.measured, coverage.completion
    scans = count(len(coverage.scan_map.scans), "scan")
    share = f"{100 * area.met_m2 / area.total_m2:.1f} %" if area.total_m2 > 0 else "nothing"
    text = (
        f"{scans[0].upper()}{scans[1:]} measured {square_metres(area.total_m2)} m\u00b2 of surface, {share} "
        f"of it at {coverage.requirement.describe()}."
    )
    if model is not None:
        text += f" {square_metres(model.hypothesised_m2)} m\u00b2 more were inferred behind occluders."
    return text + " How much there is in all nobody knows: no model of the scene was given."
