# SPDX-License-Identifier: MIT
"""Report of coverage by scans without a model of the scene."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nbv.report.blocks.scan_coverage_blocks import (
    area_bar,
    area_headlines,
    boundary_blocks,
    state_blocks,
    stations_plan,
    surfaces_blocks,
)
from nbv.report.blocks.stations import scans_table
from nbv.report.page.page import Gallery, Page, Section
from nbv.run.wording import count, square_metres
from nbv.scanning.sensors.sensor import Sensor
from nbv.scans.scan_coverage import ScanCoverage
from nbv.scans.state_mesh import StateMesh


def scan_coverage_page(
    coverage: ScanCoverage,
    state: StateMesh,
    sensor: Sensor,
    title: str,
    options: Mapping[str, Any],
    seed: int,
    n_threads: int | None = None,
) -> Page:
    """Return the report of a coverage, with its mesh and the sensor that was reckoned with."""
    scans = coverage.scan_map.scans
    return Page(
        title=title,
        kicker="Coverage of scans",
        summary=summary(coverage),
        headlines=area_headlines(coverage),
        bar=area_bar(coverage),
        sections=(
            Section(
                "What was measured, and where the unknown begins", state_blocks(coverage, state, n_threads)
            ),
            Section(
                "Stations",
                (Gallery((stations_plan(coverage.scan_map, sensor),), 1), scans_table(scans, lettered=True)),
            ),
            Section("Where the unknown begins", boundary_blocks(coverage)),
            Section("Surfaces", surfaces_blocks(coverage)),
        ),
        options=options,
        seed=seed,
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
