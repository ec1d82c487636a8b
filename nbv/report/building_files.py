# SPDX-License-Identifier: MIT
"""Building files: what a surveyor takes along, the list of stations and a floor plan of each storey."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from nbv.plan.plan import Plan
from nbv.plan.station_list import station_csv, stations_of
from nbv.report.blocks.rooms import storey_plans
from nbv.report.figures.storey_plan import sheets_pdf
from scenes.run.atomic import write_bytes, write_text
from scenes.world.scene import Scene

STATIONS_NAME, SHEETS_NAME = "stations.csv", "floor-plans.pdf"


def write_building_files(scene: Scene, plan: Plan, path: Callable[[str], Path]) -> None:
    """Write `stations.csv`, `floor-plan-N.svg` for each storey N, and `floor-plans.pdf` with all of them.

    `path` tells where a file of a name goes. Nothing is written of plans without rooms or without views.
    """
    if plan.site is None or not plan.views:
        return
    write_text(path(STATIONS_NAME), station_csv(stations_of(plan)))
    sheets = storey_plans(scene, plan)
    for sheet in sheets:
        write_bytes(path(f"floor-plan-{sheet.storey}.svg"), sheet.svg())
    write_bytes(path(SHEETS_NAME), sheets_pdf(sheets))
