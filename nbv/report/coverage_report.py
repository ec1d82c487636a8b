# SPDX-License-Identifier: MIT
"""Report of coverage and of plans: what stations measure as required, what they miss, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nbv.baselines import Baseline
from nbv.coverage import MET, REACHABLE, UNREACHABLE, Coverage
from nbv.plan import Plan
from nbv.report.baseline_blocks import baselines_section
from nbv.report.findings import Findings, measured_sentence, met_before
from nbv.report.inference_blocks import with_inference
from nbv.report.page import (
    Bar,
    Block,
    Cell,
    Gallery,
    Headline,
    Legend,
    Page,
    Section,
    Share,
    State,
    Table,
    Text,
    percent,
    square_metres,
)
from nbv.report.picture import MEASURED, UNKNOWN
from nbv.report.state_pictures import state_pictures
from nbv.report.station_plots import curve, stations
from nbv.scanning.sensor import Sensor
from nbv.unreachable import unreachable_patches
from nbv.wording import count
from nbv.zones import EVERYWHERE, Zones
from scenes.pose import Pose
from scenes.scene import Scene

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


def plan_page(
    scene: Scene,
    plan: Plan,
    coverage: Coverage,
    options: Mapping[str, Any],
    seed: int,
    n_threads: int | None,
    baselines: Sequence[Baseline] = (),
) -> Page:
    """Return the report of a plan, with what simple planners reach beside it."""
    found = (with_inference if plan.shares else by_views)(scene, plan, coverage, n_threads)
    ended = f"The plan ends because: {plan.stopped_because}."
    if plan.lower_bound:
        ended += f" {plan.lower_bound.describe().capitalize()}."
    before = plan.resumed_from.poses if plan.resumed_from else ()
    tour = plan.stations.tour if plan.stations else None
    poses = [view.world_from_sensor for view in plan.views]
    where = stations(scene, poses, plan.sensor, given=before, tour=tour, zones=plan.zones)
    return Page(
        title=scene.name,
        kicker="View plan",
        summary=found.summary,
        headlines=(Headline(str(len(plan.views)), "", "views"), *found.headlines),
        bar=found.bar,
        sections=(
            *found.meanings,
            Section(
                "Views",
                (Gallery((found.curve, where), 2), Text(ended, is_note=True), views_table(plan)),
            ),
            *baselines_section(plan, baselines),
            found.overview,
            Section("What cannot be reached, and why", reasons(coverage)),
            Section("Surface by surface", (found.surfaces,)),
        ),
        options=options,
        seed=seed,
        warnings=scene.warnings,
    )


def by_views(scene: Scene, plan: Plan, coverage: Coverage, n_threads: int | None) -> Findings:
    """Return what views alone achieve."""
    met = [view.met_fraction or 0.0 for view in plan.views]
    bound = plan.lower_bound.views if plan.lower_bound else None
    return Findings(
        summary=f"{measured_sentence(plan, coverage)} {_rest(coverage)}",
        headlines=coverage_headlines(coverage),
        bar=coverage_bar(coverage),
        meanings=(),
        curve=curve(met, coverage, plan.target, bound, start=met_before(plan)),
        overview=Section("Where the surface is measured", overview(scene, coverage, n_threads, plan.zones)),
        surfaces=surfaces_table(coverage),
    )


def coverage_page(
    scene: Scene,
    coverage: Coverage,
    poses: Sequence[Pose],
    met: Sequence[float],
    sensor: Sensor,
    options: Mapping[str, Any],
    seed: int,
    n_threads: int | None,
) -> Page:
    """Return the report of stations that are given; `met` is the measured share after each of them."""
    requirement = coverage.requirement
    summary = (
        f"{count(len(poses), 'station measures', 'stations measure')} {percent(coverage.met)} % of "
        f"{square_metres(coverage.total_m2)} m\u00b2 at {requirement.describe()}. {_rest(coverage)}"
    )
    pictures = (curve(met, coverage, None, None), stations(scene, poses, sensor)) if poses else ()
    return Page(
        title=scene.name,
        kicker="Coverage report",
        summary=summary,
        headlines=(Headline(str(len(poses)), "", "stations"), *coverage_headlines(coverage)),
        bar=coverage_bar(coverage),
        sections=(
            Section("Where the surface is measured", overview(scene, coverage, n_threads)),
            Section("Stations", (Gallery(pictures, 2) if pictures else Text("None."),)),
            Section("What cannot be reached, and why", reasons(coverage)),
            Section("Surface by surface", (surfaces_table(coverage),)),
        ),
        options=options,
        seed=seed,
        warnings=scene.warnings,
    )


def _rest(coverage: Coverage) -> str:
    missed = coverage.reachable - coverage.met
    return (
        f"Of the rest, {percent(missed)} % could be measured by further views, and "
        f"{percent(coverage.unreachable)} % by none."
    )


def coverage_headlines(coverage: Coverage) -> tuple[Headline, ...]:
    """Measured, missed and unreachable shares."""
    return (
        Headline(percent(coverage.met), "%", "of the area measured as required", "measured"),
        Headline(percent(coverage.met_of_reachable), "%", "of what can be reached", "measured"),
        Headline(percent(coverage.reachable - coverage.met), "%", "reachable, not yet measured", "unknown"),
        Headline(percent(coverage.unreachable), "%", "out of reach of any candidate", "unreachable"),
    )


def coverage_bar(coverage: Coverage) -> Bar:
    """The whole area by state."""
    missed = coverage.reachable - coverage.met
    parts: tuple[tuple[str, State, float], ...] = (
        ("measured as required", "measured", coverage.met),
        ("reachable, not measured", "unknown", missed),
        ("out of reach", "unreachable", coverage.unreachable),
    )
    total = coverage.total_m2
    return Bar(
        "",
        tuple(
            Share(label, state, share, f"{square_metres(share * total)} m\u00b2")
            for label, state, share in parts
        ),
    )


def overview(
    scene: Scene, coverage: Coverage, n_threads: int | None = None, zones: Zones = EVERYWHERE
) -> tuple[Block, ...]:
    """The scene from two opposite sides, by state; what is outside the region in one pale grey."""
    pale = tuple(0.38 * part + 0.62 for part in UNKNOWN)
    colours = {MET: MEASURED, REACHABLE: UNKNOWN, UNREACHABLE: pale}
    pictures = state_pictures(
        scene,
        coverage.samples,
        coverage.state,
        colours,
        REACHABLE,
        "Measured, missed, out of reach",
        n_threads,
        zones,
    )
    note = "The scene from outside; surfaces that face away from the eye are left out."
    return (
        Legend(("measured", "unknown", "unreachable")),
        Gallery(pictures, 2),
        Text(f"{note} Unknown here means reachable, but not measured as required.", is_note=True),
    )


def reasons(coverage: Coverage) -> tuple[Block, ...]:
    """A row for each reason for which surface is out of reach."""
    shares = {name: share for name, share in coverage.reasons().items() if share > 0}
    if not shares:
        return (Text("Every part of the surface can be measured as required by some candidate."),)
    rows = tuple(
        (
            Cell(name.replace("_", " ")),
            Cell(REASON_TEXTS.get(name, "")),
            Cell(percent(share, 2), share=share / max(coverage.unreachable, 1e-12), state="unreachable"),
            Cell(square_metres(share * coverage.total_m2)),
        )
        for name, share in shares.items()
    )
    return Table(("Reason", "What it means", "#% of the area", "#area, m\u00b2"), rows), _patches_table(
        coverage
    )


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
    """A row for each surface, the worst covered first when there are many."""
    table = coverage.by_surface()
    rows = tuple(
        (
            Cell(row.name),
            Cell(square_metres(row.area_m2)),
            Cell(percent(row.met), share=row.met, state="measured"),
            Cell(
                percent(max(row.reachable - row.met, 0.0)),
                share=max(row.reachable - row.met, 0.0),
                state="unknown",
            ),
            Cell(percent(row.unreachable), share=row.unreachable, state="unreachable"),
        )
        for row in table
    )
    columns = ("Surface", "#area, m\u00b2", "#measured, %", "#missed, %", "#out of reach, %")
    many = len(rows) > 40
    return Table(columns, rows, f"{len(rows)} surfaces" if many else "", is_folded=many)


def views_table(plan: Plan) -> Table:
    """A row for each view."""
    rows = []
    for number, view in enumerate(plan.views, start=1):
        x, y, z = view.world_from_sensor.translation
        dx, dy, dz = view.world_from_sensor.rotation[:, 2]
        yaw, pitch = np.degrees(np.arctan2(dy, dx)), np.degrees(np.arcsin(np.clip(dz, -1, 1)))
        met = view.met_fraction or 0.0
        rows.append(
            (
                Cell(str(number)),
                Cell(f"{x:.2f}, {y:.2f}, {z:.2f}"),
                Cell(f"{yaw:.0f}"),
                Cell(f"{pitch:.0f}"),
                Cell(square_metres(view.gain_m2 or 0.0)),
                Cell(percent(met), share=met, state="measured"),
            )
        )
    columns = (
        "View",
        "position x, y, z, m",
        "#heading, \u00b0",
        "#elevation, \u00b0",
        "#gain, m\u00b2",
        "#measured, %",
    )
    return Table(columns, tuple(rows), "Every view", is_folded=True)
