# SPDX-License-Identifier: MIT
"""`unseen coverage --scans SCAN...` without a scene: measured, seen worse, inferred and occluded area."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from completion.options import CompletionOptions
from completion.pipeline import complete
from nbv.commands.coverage import CoverageRequest
from nbv.commands.process.run import Shared, running
from nbv.report.scan_coverage_report import scan_coverage_page
from nbv.run.csv_table import csv_text
from nbv.run.wording import count, square_metres
from nbv.scanning.sensors.sensor_profile import load_sensor
from nbv.scans.scan_coverage import ScanCoverage, cover_by_scans
from nbv.scans.scan_map import ScanMap
from nbv.scans.state_mesh import STATES, StateMesh
from nbv.visibility.requirement import Requirement
from scenes.files.scan_request import read_request
from scenes.formats.meshes.ply import write_mesh_ply
from scenes.run.atomic import write_json, write_text

_COLOURS = np.array(
    [[158, 163, 163], [244, 211, 158], [46, 122, 204], [230, 159, 26], [219, 219, 214]], np.uint8
)


def run_scan_coverage(shared: Shared, request: CoverageRequest) -> None:
    """Report what the scans of `request` have measured, and what completion makes of it."""
    with running("coverage", shared, default="out/coverage", is_folder=True) as run:
        run.watch.enter("load")
        run.read([request.sensor, *request.scans.inputs])
        requirement = Requirement(
            max_incidence_deg=request.max_incidence_deg, max_range_m=request.max_range_m
        )
        sensor = load_sensor(request.sensor)
        given = read_request(request.scans, request.up)
        run.watch.enter("voxels")
        scan_map = ScanMap.of(given.scans, sensor, mode=request.mode or "room")
        options = CompletionOptions(mode=request.inference, texture=False)
        model = complete(
            scan_map.scans, options, rng=shared.seed, n_threads=shared.threads, progress=run.progress
        )
        coverage = cover_by_scans(scan_map, requirement, completion=model)
        run.watch.enter("report")
        write_json(run.path("coverage.json"), coverage.to_json())
        write_text(run.path("coverage.csv"), csv_of(coverage))
        state = StateMesh.of(coverage)
        _write_ply(run.path("coverage.ply"), state)
        asked = {**request.options(), "mode": scan_map.mode, "instruments": given.instruments}
        page = scan_coverage_page(
            coverage,
            state,
            sensor=sensor,
            title=request.scans.title,
            options=asked,
            seed=shared.seed,
            n_threads=shared.threads,
        )
        run.report(page)
        run.finish(asked, coverage.to_json(), lines_of(coverage))


def csv_of(coverage: ScanCoverage) -> str:
    """Return a row for each recognised surface: id, kind, measured area, share as required, inferred area."""
    return csv_text(
        ["id", "kind", "observed_m2", "met", "hypothesised_m2"],
        ((one.id, one.kind, one.observed_m2, one.met, one.hypothesised_m2) for one in coverage.surfaces),
    )


def lines_of(coverage: ScanCoverage) -> list[str]:
    """Return the headline numbers for people."""
    area, unseen, model = coverage.measured, coverage.unseen, coverage.completion
    scans = count(len(coverage.scan_map.scans), "scan")
    inferred = 0.0 if model is None else model.hypothesised_m2
    return [
        f"{scans} measured {square_metres(area.total_m2)} m2 of surface: "
        f"{square_metres(area.met_m2)} m2 as required, {square_metres(area.worse_m2)} m2 worse",
        f"inferred: {square_metres(inferred)} m2 of surface",
        f"not explained: shadows begin on {square_metres(unseen.occluded_m2)} m2, fields of view end on "
        f"{square_metres(unseen.frontier_m2)} m2 (areas of boundary, not of surface)",
    ]


def _write_ply(path: Path, state: StateMesh) -> None:
    """Write surface and boundary with the state of every vertex."""
    colours = _COLOURS[state.state]
    properties: dict[str, Any] = {
        **{name: colours[:, k] for k, name in enumerate(("red", "green", "blue"))},
        "state": state.state,
        "cosine": state.cosine,
    }
    legend = [f"state {value} {name}" for value, name in enumerate(STATES)]
    write_mesh_ply(path, state.mesh.vertices, state.mesh.faces, properties, legend)
