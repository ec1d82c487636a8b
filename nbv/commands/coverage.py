# SPDX-License-Identifier: MIT
"""`unseen coverage`: which surface given stations measured as required, what is missing, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import completion.extension.extent
from nbv.commands.process.run import Run, Shared, running
from nbv.coverage.coverage import STATES, Coverage
from nbv.coverage.measurement import measure_coverage, measure_scan_coverage
from nbv.coverage.unreachable import coverage_record
from nbv.coverage.visibility_history import VisibilityHistory
from nbv.plan.plan import read_plan
from nbv.report.coverage_report import coverage_page
from nbv.report.pictures.surface_values import fine_coverage
from nbv.run.csv_table import csv_text
from nbv.run.wording import count, percent_within
from nbv.scanning.sensor import Sensor
from nbv.scanning.sensor_profile import load_sensor
from nbv.scanning.view import View
from nbv.visibility.reachability import REASONS
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.standing.candidates import Standing, find_standing, samples_that_count
from nbv.visibility.standing.site_options import SiteOptions
from nbv.visibility.visibility import facing
from scenes.io.format import Units
from scenes.io.ply import write_mesh_ply
from scenes.io.scan_request import ScanRequest, read_request
from scenes.io.scene_files import open_scene
from scenes.io.trajectory import read_poses
from scenes.mesh.orientation import Axis
from scenes.run.atomic import write_json, write_text
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Mode, Scene


@dataclass(frozen=True, slots=True, kw_only=True)
class CoverageRequest:
    """Which stations to judge, and by what: angles in degrees, lengths in metres."""

    plan: str | None = None
    scans: ScanRequest = field(default_factory=lambda: ScanRequest(()))
    register: bool = False
    sensor: str = "generic60"
    max_incidence_deg: float = 60.0
    max_range_m: float | None = None
    mode: Mode | None = None
    site: SiteOptions = field(default_factory=SiteOptions)
    without: tuple[str, ...] = ()
    inference: completion.extension.extent.Mode = "standard"
    up: Axis = "z"
    units: Units = "m"

    def options(self) -> dict[str, Any]:
        """Return the options for manifest and report; files by name."""
        return {
            "plan": None if self.plan is None else Path(self.plan).name,
            **self.scans.options(),
            "register": self.register,
            "sensor": Path(self.sensor).name,
            "max_incidence_deg": self.max_incidence_deg,
            "max_range_m": self.max_range_m,
            "mode": self.mode,
            "site": asdict(self.site),
            "without": list(self.without),
            "up": self.up,
            "units": self.units,
        }


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """Coverage, the stations, and what they see one after the other."""

    coverage: Coverage
    stations: Sequence[View] | Sequence[RangeImage]
    seen: VisibilityHistory
    sensor: Sensor
    instruments: list[str]


def run_coverage(shared: Shared, scene: str, request: CoverageRequest) -> None:
    """Measure the coverage of `scene` by a plan's views or by scans, and write it."""
    with running("coverage", shared, default="out/coverage", is_folder=True) as run:
        run.watch.enter("load")
        files = [request.plan] if request.plan else request.scans.inputs
        run.read([scene, request.sensor, *files])
        world = open_scene(scene, up=request.up, units=request.units, mode=request.mode)
        world = world.without(request.without)
        run.warn(world.warnings)
        measured = _measure(run, world, request)
        coverage = measured.coverage
        run.watch.enter("report")
        write_json(run.path("coverage.json"), coverage_record(coverage))
        write_text(run.path("coverage.csv"), csv_of(coverage))
        _write_ply(run.path("coverage.ply"), world, coverage)
        options = {**request.options(), "mode": request.mode or world.mode, "sensor": measured.sensor.name}
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
        reached = percent_within(coverage.met_of_reachable, coverage.met_of_reachable_error)
        line = (
            f"{count(len(measured.stations), 'station measures', 'stations measure')} "
            f"{met} % of the area, {reached} % of what can be reached"
        )
        run.finish(resolved, summary, [line])


def _measure(run: Run, world: Scene, request: CoverageRequest) -> _Measured:
    """Measure by views or by scans."""
    threads = run.shared.threads
    requirement = Requirement(max_incidence_deg=request.max_incidence_deg, max_range_m=request.max_range_m)
    if request.plan is not None:
        views = _views(request.plan, request.sensor)
        sensor = views[0].sensor if views else load_sensor(request.sensor)
        run.will_call(facing, 10)
        caster = world.ray_caster(threads)
        standing, samples, apart = _standing(run, world, sensor, request)
        coverage = measure_coverage(
            world, views, requirement, samples=samples, candidates=standing.candidates, sensor=sensor,
            caster=caster, n_threads=threads, progress=run.progress,
        )  # fmt: skip
        coverage = replace(coverage, apart_m2=apart)
        return _Measured(coverage, views, _history(coverage), sensor, [])
    given = read_request(request.scans)
    run.warn(given.doubts)
    sensor = load_sensor(request.sensor)
    run.will_call(facing, 10)
    caster = world.ray_caster(threads)
    standing, samples, apart = _standing(run, world, sensor, request)
    coverage = measure_scan_coverage(
        world, given.scans, requirement, samples=samples, candidates=standing.candidates, sensor=sensor,
        caster=caster, n_threads=threads, progress=run.progress,
    )  # fmt: skip
    coverage = replace(coverage, apart_m2=apart)
    return _Measured(coverage, given.scans, _history(coverage), sensor, list(given.instruments))


def _standing(
    run: Run, world: Scene, sensor: Sensor, request: CoverageRequest
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


def _write_ply(path: Path, world: Scene, coverage: Coverage) -> None:
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
