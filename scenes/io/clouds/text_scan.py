# SPDX-License-Identifier: MIT
"""Scans as text: the returns of a scan of ours, a line each, its pose and projection in the first."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import InputError
from scenes.io.checks.documents import parse_json
from scenes.io.formats.columns import COLOURS
from scenes.io.formats.format import NO_RAYS
from scenes.io.formats.header import checked_bytes, scan_header
from scenes.io.formats.returns import ScanReturns, cloud_of, scan_of
from scenes.run.atomic import atomic_path, to_plain
from scenes.scan.range_image import RangeImage

TEXT_TAG = "# unseen "  # begins the line that holds pose and projection of a scan of ours
_MOST_PIXELS = 2**31


def write_scan_text(scan: RangeImage, path: Path) -> None:
    """Write the returns of `scan`, a line each, in world coordinates to the nanometre.

    Columns are x y z, red green blue and intensity where known, row and column; commas part them in `.csv`
    files, blanks in others. The first line is a comment with pose and projection, the second names the
    columns: as a comment, but in `.csv` files.

    Raises InputError: a scan without returns.
    """
    cloud = cloud_of(scan)
    names, forms = ["x", "y", "z"], ["%.9f"] * 3
    columns: list[Any] = [cloud.points]
    if cloud.colour is not None:
        names, columns, forms = [*names, *COLOURS], [*columns, cloud.colour], [*forms, *["%d"] * 3]
    if cloud.intensity is not None:
        light = cloud.intensity[:, None].astype(np.float64)
        names, columns, forms = [*names, "intensity"], [*columns, light], [*forms, "%.9g"]
    pixels = np.column_stack([cloud.row, cloud.column])
    names, columns, forms = [*names, "row", "column"], [*columns, pixels], [*forms, "%d", "%d"]
    is_csv = path.suffix.lower() == ".csv"
    separator = "," if is_csv else " "
    with atomic_path(path) as temporary, temporary.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"{TEXT_TAG}{json.dumps(to_plain(scan_header(scan)), allow_nan=False)}\n")
        file.write(("" if is_csv else "# ") + separator.join(names) + "\n")
        np.savetxt(file, np.hstack(columns), fmt=forms, delimiter=separator)


def read_scan_text(path: Path) -> RangeImage:
    """Return the scan of a file that `write_scan_text` wrote.

    Raises InputError: any other file: it does not say where the scanner stood, nor which ray saw which point.
    """
    with path.open(encoding="utf-8", errors="replace") as file:
        first = file.readline()
        names = file.readline().lstrip("# ").replace(",", " ").split()
        if not first.startswith(TEXT_TAG) or not {"x", "y", "z", "row", "column"} <= set(names):
            raise InputError(NO_RAYS)
        separator = "," if path.suffix.lower() == ".csv" else None
        table = np.loadtxt(file, delimiter=separator, ndmin=2)
    if table.shape[1] != len(names):
        raise InputError(f"its lines hold {table.shape[1]} numbers, its header names {len(names)} columns")
    column: dict[str, Any] = {name: table[:, k] for k, name in enumerate(names)}
    cloud = ScanReturns(
        points=np.stack([column[axis] for axis in "xyz"], axis=-1),
        row=_whole(column["row"]),
        column=_whole(column["column"]),
        colour=checked_bytes([column[name] for name in COLOURS]).T if COLOURS[0] in column else None,
        intensity=column["intensity"].astype(np.float32) if "intensity" in column else None,
    )
    return scan_of(parse_json(first[len(TEXT_TAG) :], dict), len(table), [cloud])


def _whole(values: Any) -> Any:
    """Numbers of pixels as integers."""
    if not (np.abs(values) < _MOST_PIXELS).all() or (values != np.floor(values)).any():
        raise InputError("its rows and columns are not all integers: was the file edited?")
    return values.astype(np.int64)
