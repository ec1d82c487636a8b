# SPDX-License-Identifier: MIT
"""Tables of scans: where each was taken and how much it measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nbv.report.page.page import Cell, Table
from nbv.run.wording import letters
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
