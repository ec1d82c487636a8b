# SPDX-License-Identifier: MIT
"""`unseen coverage`: which surface given stations measured as required, what is missing, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.options import CompletionOptions
from completion.pipeline import complete
from nbv.commands.options.planning import CoverageOptions
from nbv.commands.options.shared import Shared
from nbv.commands.process import Run, start_run
from nbv.coverage.coverage import STATES, Coverage, VisibilityHistory
from nbv.coverage.measurement import check_scans, measure_coverage, measure_scan_coverage
from nbv.coverage.surface_classes import KnownSurfaces
from nbv.coverage.unreachable import coverage_record
from nbv.plan.plan import read_plan
from nbv.report.coverage_report import coverage_page, noun_of
from nbv.report.figures.surface_values import fine_coverage
from nbv.report.scans_report import scan_coverage_page
from nbv.run.wording import count, percent_within, square_metres
from nbv.scanning.sensor import Sensor, View
from nbv.scanning.sensor_profile import load_sensor
from nbv.scans.registering import placed_of, register_request
from nbv.scans.scan_coverage import ScanCoverage, cover_by_scans
from nbv.scans.scan_map import ScanMap, with_known_noise
from nbv.scans.state_mesh import STATES as SCAN_STATES
from nbv.scans.state_mesh import StateMesh
from nbv.scans.upright import UprightScans
from nbv.visibility.candidates import Standing, find_standing, samples_that_count
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.visibility import REASONS, select_facing
from scenes.inclination import Up
from scenes.io.meshes.ply_writer import write_mesh_ply
from scenes.io.poses.trajectory import read_poses
from scenes.io.scan_request import read_request
from scenes.io.scene_files import open_scene
from scenes.run.atomic import write_json, write_text
from scenes.run.csv_table import csv_text
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene


def options_record(asked: CoverageOptions) -> dict[str, Any]:
    """Return the options for manifest and report; files by name."""
    return {
        "plan": None if asked.plan is None else Path(asked.plan).name,
        **asked.request().options(),
        "register": asked.register,
        "sensor": Path(asked.sensor).name,
        **asdict(asked.requirement),
        "mode": asked.mode,
        "site": asdict(asked.site),
        "without": list(asked.without),
        **({} if asked.scene is None else {"up": asked.up}),
        "units": asked.units,
        **({"inference": asked.inference} if asked.scene is None else {}),
    }


@dataclass(frozen=True, slots=True, eq=False)
class _MeasuredCoverage:
    """Coverage, the stations, and what they see one after the other."""

    coverage: Coverage
    stations: Sequence[View] | Sequence[RangeImage]
    seen: VisibilityHistory
    sensor: Sensor
    instruments: list[str]


def run_coverage(shared: Shared, asked: CoverageOptions) -> None:
    """Measure the coverage of a scene, or without one what scans have measured, and write it."""
    if asked.scene is None:
        _run_scan_coverage(shared, asked)
    else:
        _run_scene_coverage(shared, asked.scene, asked)


def _run_scene_coverage(shared: Shared, scene: str, request: CoverageOptions) -> None:
    """Measure the coverage of `scene` by a plan's views or by scans, and write it."""
    with start_run("coverage", shared, default="out/coverage", is_folder=True) as run:
        run.watch.enter("load")
        files = [request.plan] if request.plan else request.request().inputs
        run.read([scene, request.sensor, *files])
        world = open_scene(scene, up=request.scene_up, units=request.units, mode=request.mode)
        world = world.without(request.without)
        run.warn(world.warnings)
        measured = _measure(run, world, request)
        coverage = measured.coverage
        run.watch.enter("report")
        write_json(run.path("coverage.json"), coverage_record(coverage))
        write_text(run.path("coverage.csv"), csv_of(coverage))
        _write_scene_ply(run.path("coverage.ply"), world, coverage)
        options = {
            **options_record(request),
            "mode": request.mode or world.mode,
            "sensor": measured.sensor.name,
        }
        if measured.instruments:
            options["instruments"] = measured.instruments
        given, sensor = measured.stations, measured.sensor
        run.report(
            coverage_page(world, coverage, given, measured.seen, sensor, n_threads=shared.threads), options
        )
        resolved = {**options, "resolved_sensor": measured.sensor.to_json()}
        summary = {
            "stations": len(measured.stations),
            "coverage": coverage.summary().to_json(),
            "met_of_reachable": coverage.met_of_reachable,
            "met_of_reachable_standard_error": coverage.met_of_reachable_error,
            "unreachable_because": coverage.reasons(),
            "warnings": world.warnings,
        }
        met = percent_within(coverage.met, coverage.standard_errors()["met"])
        noun = noun_of(measured.stations)
        reached = percent_within(coverage.met_of_reachable, coverage.met_of_reachable_error)
        line = (
            f"{count(len(measured.stations), f'{noun} measures', f'{noun}s measure')} "
            f"{met} % of the area, {reached} % of what can be reached"
        )
        run.finish(resolved, summary, [line])


def _measure(run: Run, world: Scene, request: CoverageOptions) -> _MeasuredCoverage:
    """Measure by views or by scans."""
    threads = run.shared.threads
    requirement = Requirement.of(request.requirement)
    if request.plan is not None:
        views = _views(request.plan, request.sensor)
        sensor = views[0].sensor if views else load_sensor(request.sensor)
        run.will_call(select_facing, 10)
        caster = world.ray_caster(threads)
        standing, samples, apart = _resolve_candidates(run, world, sensor, request)
        coverage = measure_coverage(
            world, views, requirement, samples=samples, candidates=standing.candidates, sensor=sensor,
            caster=caster, n_threads=threads, progress=run.progress,
        )  # fmt: skip
        coverage = replace(coverage, apart_m2=apart)
        return _MeasuredCoverage(coverage, views, _history(coverage), sensor, [])
    given = read_request(request.request()).with_z_up(world.file_up)
    run.warn(given.doubts)
    sensor = load_sensor(request.sensor)
    run.will_call(select_facing, 10)
    caster = world.ray_caster(threads)
    run.warn(check_scans(world.mesh, caster, given.scans))
    standing, samples, apart = _resolve_candidates(run, world, sensor, request)
    coverage = measure_scan_coverage(
        world, given.scans, requirement, samples=samples, candidates=standing.candidates, sensor=sensor,
        caster=caster, n_threads=threads, progress=run.progress,
    )  # fmt: skip
    coverage = replace(coverage, apart_m2=apart)
    return _MeasuredCoverage(coverage, given.scans, _history(coverage), sensor, list(given.instruments))


def _resolve_candidates(
    run: Run, world: Scene, sensor: Sensor, request: CoverageOptions
) -> tuple[Standing, SurfaceSamples, Mapping[str, float]]:
    """What "reachable" refers to, and what surface counts; says what was assumed of rooms."""
    standing = find_standing(world, sensor, request.site, mode=request.mode)
    if standing.site is not None:
        run.warn(standing.site.warnings)
    samples, apart = samples_that_count(world, standing, world.ray_caster(run.shared.threads))
    return standing, samples, apart


def _history(coverage: Coverage) -> VisibilityHistory:
    """Return what each station saw, which a coverage that was just measured holds."""
    if coverage.history is None:
        raise TypeError("this coverage does not tell which station saw what")
    return coverage.history


def _views(file: str, sensor: str) -> Sequence[View]:
    """Views of a plan; or of a file of poses, from which a sensor looks."""
    if Path(file).suffix.lower() == ".json":
        return read_plan(file).views
    looks = load_sensor(sensor)
    return [View(pose, looks) for pose in read_poses(Path(file))]


def csv_of(coverage: Coverage) -> str:
    """Return a row for each surface: id, name, area in square metres, fractions of it, mean best cosine."""
    columns = ["id", "name", "area_m2", "met", "reachable", "unreachable", "mean_best_cosine",
        "met_standard_error", "reachable_standard_error"]  # fmt: skip
    return csv_text(
        columns,
        (
            (
                row.surface,
                row.name,
                row.area_m2,
                row.met,
                row.reachable,
                row.unreachable,
                row.mean_cosine,
                row.standard_error["met"],
                row.standard_error["reachable"],
            )
            for row in coverage.by_surface()
        ),
    )


def _write_scene_ply(path: Path, world: Scene, coverage: Coverage) -> None:
    """Write the scene's faces, cut as finely as coverage was measured, with quality, views and state."""
    fine = fine_coverage(world.mesh, coverage)
    n = len(fine.corners)
    colours = np.array([[244, 211, 158], [230, 159, 26], [158, 163, 163]], np.uint8)[fine.state]
    properties: dict[str, NDArray[Any]] = {
        **{name: np.repeat(colours[:, k], 3) for k, name in enumerate(("red", "green", "blue"))},
        "best_cosine": np.repeat(fine.best_cosine.astype(np.float32), 3),
        "views": np.repeat(fine.n_views, 3),
        "state": np.repeat(fine.state, 3).astype(np.uint8),
        "reason": np.repeat(fine.reason, 3),
        "face": np.repeat(fine.face, 3),
        "surface": np.repeat(fine.surface, 3),
    }
    legend = [f"state {value} {name}" for value, name in enumerate(STATES)]
    legend += [f"reason {value} {name}" for value, name in enumerate(REASONS)]
    triangles = np.arange(3 * n, dtype=np.int32).reshape(-1, 3)
    write_mesh_ply(path, fine.corners.reshape(-1, 3), triangles, properties, legend)


_STATE_COLOURS = np.array(
    [[158, 163, 163], [209, 214, 214], [46, 122, 204], [230, 159, 26], [244, 211, 158]], np.uint8
)


def _run_scan_coverage(shared: Shared, request: CoverageOptions) -> None:
    """Report what scans have measured, and what completion makes of it."""
    with start_run("coverage", shared, default="out/coverage", is_folder=True) as run:
        run.watch.enter("load")
        run.read([request.sensor, *request.request().inputs])
        requirement, scan_request = Requirement.of(request.requirement), request.request()
        sensor = load_sensor(request.sensor)
        options = CompletionOptions(mode=request.inference, texture=False, up=Up.along("z"))
        placement = []
        if request.register:
            placed = register_request(scan_request, n_threads=shared.threads, progress=run.progress)
            given, options = placed.given, replace(options, pose_deviations_m=placed.deviations_m)
            placement = [placed.summary]
        else:
            given = read_request(scan_request)
        upright = UprightScans.of(given.scans, Up.along(scan_request.up), n_threads=shared.threads)
        doubts = upright.doubts("coverage.json")
        run.warn([*given.doubts, *doubts])
        run.watch.enter("voxels")
        scans = [with_known_noise(scan) for scan in upright.scans]
        model = complete(scans, options, rng=shared.seed, n_threads=shared.threads, progress=run.progress)
        completed = KnownSurfaces(model, options.max_sd_m)
        scan_map = ScanMap.of(
            scans, sensor, mode=request.mode or "room", requirement=requirement, completed=completed
        )
        coverage = cover_by_scans(scan_map, requirement, completion=model)
        run.watch.enter("report")
        write_json(run.path("coverage.json"), {**coverage.to_json(), **upright.to_json()})
        write_text(run.path("coverage.csv"), scan_csv(coverage))
        state = StateMesh.of(coverage)
        _write_state_ply(run.path("coverage.ply"), state)
        asked = {**options_record(request), "mode": scan_map.mode, "instruments": given.instruments}
        page = scan_coverage_page(coverage, state, sensor, scan_request.title, shared.threads)
        run.report(replace(page, warnings=(*doubts, *page.warnings)), asked)
        summary = {**coverage.to_json(), "warnings": [*given.doubts, *doubts], **placed_of(placement)}
        run.finish(asked, summary, placement + scan_lines(coverage))


def scan_csv(coverage: ScanCoverage) -> str:
    """Return a row for each recognised surface: id, kind, measured area, share as required, inferred area."""
    return csv_text(
        ["id", "kind", "observed_m2", "met", "hypothesised_m2"],
        (
            (surface.id, surface.kind, surface.observed_m2, surface.met, surface.hypothesised_m2)
            for surface in coverage.surfaces
        ),
    )


def scan_lines(coverage: ScanCoverage) -> list[str]:
    """Return the headline numbers for people."""
    area, unseen, model = coverage.measured, coverage.unseen, coverage.completion
    scans = count(len(coverage.scan_map.scans), "scan")
    inferred = 0.0 if model is None else model.hypothesised_m2
    return [
        f"{scans} measured {square_metres(area.total_m2)} m2 of surface: "
        f"{square_metres(area.met_m2)} m2 as required, {square_metres(area.worse_m2)} m2 worse",
        f"inferred: {square_metres(inferred)} m2 of surface",
        unseen.describe(),
        *(room.describe() for room in coverage.rooms),
    ]


def _write_state_ply(path: Path, state: StateMesh) -> None:
    """Write surface and boundary with the state of every vertex."""
    colours = _STATE_COLOURS[state.state]
    properties: dict[str, Any] = {
        **{name: colours[:, k] for k, name in enumerate(("red", "green", "blue"))},
        "state": state.state,
        "cosine": state.cosine,
    }
    legend = [f"state {value} {name}" for value, name in enumerate(SCAN_STATES)]
    write_mesh_ply(path, state.mesh.vertices, state.mesh.faces, properties, legend)
