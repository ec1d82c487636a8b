# SPDX-License-Identifier: MIT
"""Tables of a report on coverage: views, surfaces, and what is out of reach and why."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from nbv.coverage.coverage import Coverage
from nbv.coverage.unreachable import unreachable_patches
from nbv.plan.plan import Plan
from nbv.report.blocks.page import Block, Cell, Table, Text
from nbv.run.wording import count, letters, percent, percent_within, square_metres
from scenes.pose import Pose
from scenes.run.mapping import trim
from scenes.scan.range_image import RangeImage

PLACE_COLUMNS = ("position x, y, z, m", "#heading, \u00b0", "#elevation, \u00b0")
_MANY = 20


def place_cells(pose: Pose) -> tuple[Cell, Cell, Cell]:
    """Position, heading from the x axis to the y axis, and elevation of where a sensor looks."""
    dx, dy, dz = pose.rotation[:, 2]
    heading, elevation = np.degrees(np.arctan2(dy, dx)), np.degrees(np.arcsin(np.clip(dz, -1, 1)))
    place = ", ".join(f"{c:.2f}" for c in pose.translation)
    return Cell(place), Cell(f"{heading:.0f}"), Cell(f"{elevation:.0f}")


def scans_table(scans: Sequence[RangeImage], *, lettered: bool = False) -> Table:
    """A row for each scan: number or letter as in plan and 3-D view, name, place, pixels that measured."""
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
                *place_cells(scan.world_from_sensor),
                Cell(f"{hits}"),
                Cell(f"{100 * share:.1f}", share=share, state="measured"),
                Cell(farthest),
            )
        )
    columns = ("Scan", "Name", *PLACE_COLUMNS, "#measured pixels", "#of all, %", "#farthest, m")
    many = len(rows) > _MANY
    return Table(columns, tuple(rows), "Every scan" if many else "", is_folded=many)


_MOST_PATCHES = 30  # in the report; coverage.json has all
_MANY_ROWS, _MANY_VIEWS = 40, 12  # of longer tables a line stands in
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
        "#mean best cosine",
    )
    many = len(rows) > _MANY_ROWS
    return Table(columns, rows, count(len(rows), "surface") if many else "", is_folded=many)


def views_table(plan: Plan) -> Table:
    """A row for each view of a plan."""
    poses = [view.world_from_sensor for view in plan.views]
    gains = [view.gain_m2 or 0.0 for view in plan.views]
    return _stations_table("View", poses, gains, [view.met_fraction or 0.0 for view in plan.views])


def stations_table(poses: Sequence[Pose], met: Sequence[float], total_m2: float) -> Table:
    """A row for each station that was given; `met` is the share before the first and after each."""
    gains = [(after - before) * total_m2 for before, after in pairwise(met)]
    return _stations_table("Station", poses, gains, met[1:])


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
    many = len(rows) > _MANY_VIEWS
    return Table(columns, rows, f"Every {what.lower()}" if many else "", is_folded=many)
