# SPDX-License-Identifier: MIT
"""Text: points as lines of numbers, whatever the separators."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.checks import ArrayValue, ColourArray, FloatArray, InputError
from scenes.io.clouds.text_fields import COMMENT, read_fields
from scenes.io.clouds.text_scan import TEXT_TAG, read_scan_text, write_scan_text
from scenes.io.formats.columns import (
    AXES,
    COLOURS,
    NORMALS,
    are_degrees,
    are_polar,
    columns_of,
    time_column,
    times_among,
    unit_of_comment,
    unit_of_names,
)
from scenes.io.formats.crs import LengthUnit, degrees_error
from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import (
    Format,
    RawPoints,
    one_cloud,
    one_scan,
    write_single,
)
from scenes.limits import FEWEST_POINTS
from scenes.scan.colour import known_colours

_NAME = re.compile(r"[a-z]+")
_SAMPLE, _MOST_COLUMNS = 1000, 16  # lines, and columns of them, that tell what columns without names hold
_COUNTED = 10  # points from which a first column that counts them is their number
_TRACK = "track"  # of points3D.txt of COLMAP: any number of fields
_SHOWN = 200  # characters of names in a warning
_MAX_HEADER = 200  # lines; a file without a point in that many is no point file
_CURE = "correct the line, or mark it as a comment with #"


@dataclass(frozen=True, slots=True, eq=False)
class PointTable(ArrayValue):
    """What a text file of points holds.

    Attributes
    ----------
    points : (n, 3) float
        In the file's unit and order, NaN where a field was empty or said so.
    normals : (n, 3) float, optional
        As in the file.
    warnings : tuple of str
        What was assumed.
    label : (n,) float, optional
        The column that is named so, NaN where a field was empty.
    colour : (n, 3) uint8, optional
        sRGB.
    unit : LengthUnit, optional
        What the names of the columns, or a comment before them, state.
    times : (n,) float, optional
        Of the column that is named so, seconds.
    """

    points: FloatArray
    normals: FloatArray | None
    warnings: tuple[str, ...]
    label: FloatArray | None = None
    colour: ColourArray | None = None
    unit: LengthUnit | None = None
    times: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where in the lines the points stand."""

    first: int  # index of the first line with a point
    columns: dict[str, int]  # of x, y, z and whatever else is known
    count: int | None = None  # points that the file announces
    warnings: tuple[str, ...] = ()
    unit: LengthUnit | None = None
    may_count: bool = False  # no column is named, and there are more than three


def read_point_table(path: Path) -> PointTable:
    """Return the points of a text file.

    Fields are separated by blanks, tabs, commas or semicolons; decimal commas are known where something
    else separates the fields. Lines may end in any way; `#`, `//`, `%` and `!` begin comments. Lines of names
    may stand before the points and say which columns are x, y, z (nx, ny, nz, red, green, blue, label, time),
    or easting, northing and elevation (P, N, E, Z, D), and their unit in brackets. Without them the first
    three columns are taken, three further ones of length one are normals, whole numbers up to 255 colours. A
    first line with one integer announces how many points follow (.pts, and the reference sets of NIST).

    Raises InputError: no text, no points, a line that is no point (with its number), another count than
    announced, longitude and latitude, or a first column without a name that counts the points.
    """
    lines = read_fields(path)
    layout = _layout(lines)
    table = _parse(lines, layout)
    if layout.count is not None and layout.count != len(table):
        raise InputError(
            f"its first line announces {layout.count} points, {len(table)} follow: is it truncated, or are "
            "there several clouds in it? correct or remove that line"
        )
    column = dict(zip(layout.columns, table.T, strict=True))
    points = np.stack([column[axis] for axis in AXES], axis=-1)
    if layout.may_count and len(table) >= _COUNTED and (np.diff(points[:, 0]) == 1).all():
        raise InputError(
            f"its first column counts from {points[0, 0]:.0f} to {points[-1, 0]:.0f}, so it numbers the "
            "points; name the columns in the first line (P,N,E,Z,D or point,x,y,z)"
        )
    normals = np.stack([column[axis] for axis in NORMALS], axis=-1) if "nx" in column else None
    colour, colourless = None, tuple[str, ...]()
    if "red" in column:
        colour, colourless = known_colours(np.stack([column[name] for name in COLOURS], axis=-1), points)
    return PointTable(
        points,
        normals,
        (*layout.warnings, *colourless),
        label=column.get("label"),
        colour=colour,
        unit=layout.unit,
        times=times_among(column),
    )


def _layout(lines: list[str]) -> _Layout:
    """Find the first point, the names before it, the unit they state, and the announced count."""
    names: list[str] = []
    count: int | None = None
    unit: LengthUnit | None = None
    for index, line in enumerate(lines[:_MAX_HEADER]):
        if line.startswith(TEXT_TAG):
            continue
        fields = _fields(line)
        if not fields or not _is_number(fields[0]):
            columns = columns_of(names) if fields and _fits(names, len(fields)) else {}
            if columns and all(_is_number(fields[columns[k]]) for k in AXES if columns[k] < len(fields)):
                return _data_layout(index, lines, names, count, unit)  # a text column stands first
            names = _column_names(line, names)
            unit = unit_of_names(line) or unit_of_comment(line.replace("_", " ")) or unit
        elif len(fields) == 1 and count is None and re.fullmatch(r"\+?\d+", fields[0]):
            count = int(fields[0])
        else:
            return _data_layout(index, lines, names, count, unit)
    if count is not None and len(lines) < _MAX_HEADER:
        raise InputError(f"announces {count} points, and none follows")
    named = next((fields for line in lines[:_MAX_HEADER] if _is_named(fields := _fields(line))), None)
    cure = "three numbers a line are expected"
    if named is not None:
        cure = f"they begin with words, as {named[0]!r}; name the columns in the first line (point,x,y,z)"
    raise InputError(f"no point in its first {min(len(lines), _MAX_HEADER)} lines: {cure}")


def _is_named(fields: list[str]) -> bool:
    """Whether a word stands before the numbers of a point."""
    return len(fields) > 3 and not _is_number(fields[0]) and all(map(_is_number, fields[1:4]))


def _total(count: int | None, lines: list[str], at: int) -> int | None:
    """The points of all clouds of which the first, of `count` points, begins at line `at`.

    Cyclone writes several into one .pts, each behind the number of its points, which becomes blank here.
    """
    total, held = count, [k for k in range(at, len(lines)) if lines[k].strip()]
    place = count
    while total and place is not None and place < len(held):
        fields = _fields(lines[held[place]])
        if len(fields) != 1 or not re.fullmatch(r"\d+", fields[0]):
            break
        lines[held[place]] = ""
        total, place = total + int(fields[0]), place + 1 + int(fields[0])
    return total


def _data_layout(
    index: int, lines: list[str], names: list[str], count: int | None, unit: LengthUnit | None
) -> _Layout:
    fields, count = _fields(lines[index]), _total(count, lines, index)
    if are_degrees(names):
        raise degrees_error(f"columns {', '.join(names)[:_SHOWN]}")
    named = columns_of(names) if _fits(names, len(fields)) else {}
    warnings: tuple[str, ...] = ()
    if "x" not in named and are_polar(names):
        raise InputError(
            f"columns {', '.join(names)[:_SHOWN]} are angles and distances of an instrument; export x, y, z"
        )
    if "x" not in named:
        columns = dict(zip(AXES, range(3), strict=True))
        if len(names) == len(fields):
            warnings = (f"no columns x, y, z among {', '.join(names)[:_SHOWN]}: the first three were taken",)
        else:
            more, warnings = _nameless(lines[index:], is_counted=count is not None)
            columns |= more
        return _Layout(index, columns, count, warnings, unit, may_count=len(fields) > 3)
    if max(named[axis] for axis in AXES) >= len(fields):
        raise InputError(
            f"line {index + 1} has {len(fields)} columns, its header names {len(names)}; {_CURE}"
        )
    time = time_column(names)
    all_named = named if time is None else named | {time: names.index(time)}
    known = {name: k for name, k in all_named.items() if k < len(fields) and _is_number(fields[k])}
    kept = {name: known[name] for name in (*AXES, *_whole_groups(known), "label", time) if name in known}
    return _Layout(index, kept if kept.keys() >= set(AXES) else named, count, warnings, unit)


def _whole_groups(known: dict[str, int]) -> tuple[str, ...]:
    """The names of the groups of which no column is missing."""
    return tuple(name for group in (NORMALS, COLOURS) if set(group) <= known.keys() for name in group)


def _nameless(lines: list[str], *, is_counted: bool) -> tuple[dict[str, int], tuple[str, ...]]:
    """What columns after the third hold, by the first lines: normals of length one, colours up to 255.

    Where they are counted (.pts) an intensity stands before the colours, which are the last that can be some.
    """
    rows = [fields for line in lines[:_SAMPLE] if (fields := _fields(line))]
    n_columns = min(_MOST_COLUMNS, *map(len, rows))
    if n_columns < 6 or not all(_is_number(field) for row in rows for field in row[3:n_columns]):
        return {}, ()
    table = np.array([[float(field) for field in row[3:n_columns]] for row in rows])
    starts = range(table.shape[1] - 2)
    normal = next((k for k in starts if _are_unit(table[:, k : k + 3])), None)
    found = {} if normal is None else dict(zip(NORMALS, range(3 + normal, 6 + normal), strict=True))
    is_byte = ((table >= 0) & (table <= 255) & (table == np.floor(table))).all(axis=0) & (table > 1).any()
    colours = [k for k in starts if is_byte[k : k + 3].all() and (normal is None or abs(k - normal) > 2)]
    if len(colours) == 1 or (colours and is_counted):
        return found | dict(zip(COLOURS, range(3 + colours[-1], 6 + colours[-1]), strict=True)), ()
    doubt = (
        "columns of whole numbers without names may be colours and were left out: name them in a first line"
    )
    return found, (doubt,) if colours else ()


def _fits(names: list[str], n_fields: int) -> bool:
    """Whether a line of names stands for as many fields."""
    return bool(names) and (len(names) >= n_fields or _TRACK in names)


def _column_names(line: str, before: list[str]) -> list[str]:
    """Return the names of a header line, or those before where it names nothing or only those are of axes."""
    names = _names(line)
    return before if not names or ("x" in columns_of(before) and "x" not in columns_of(names)) else names


def _names(line: str) -> list[str]:
    """Return the column names of a header line, lower case and without units: "X [mm]" is x."""
    plain = re.sub(r"[\[(][^\[\](\)]*[\])]", " ", line.lower())
    words = [word for word in re.split(r"[\s#/%!]+", plain) if word]
    words = [re.sub(r"_+(?:m|mm|cm|in)?$", "", word).lstrip("_") or word for word in words]
    return words if any(_NAME.search(word) for word in words) else []


def _fields(line: str) -> list[str]:
    return COMMENT.sub("", line).split()


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return "_" not in field


def _parse(lines: list[str], layout: _Layout) -> FloatArray:
    """Return the columns of the layout as numbers, or say which line is wrong."""
    body, columns = "\n".join(lines[layout.first :]), list(layout.columns.values())
    try:
        table = np.loadtxt(io.StringIO(body), comments=["#", "//", "%", "!"], usecols=columns, ndmin=2)
    except ValueError as error:
        raise InputError(_wrong_line(lines, layout) or str(error)) from error
    return np.asarray(table, dtype=np.float64)


def _wrong_line(lines: list[str], layout: _Layout) -> str:
    """Say which line is no point, and why; nothing where all are."""
    needed = max(layout.columns.values()) + 1
    for number, line in enumerate(lines[layout.first :], start=layout.first + 1):
        fields = _fields(line)
        if fields and len(fields) < needed:
            shown = f"{line.strip()[:60]!r}; {_CURE}"
            return f"line {number} has {len(fields)} columns, {needed} are needed: {shown}"
        for column in layout.columns.values() if fields else ():
            if not _is_number(fields[column]):
                return f"line {number}: {fields[column][:40]!r} is no number; {_CURE}"
    return ""


def _are_unit(vectors: FloatArray) -> bool:
    """Tell whether all vectors have length one, as far as text of a few digits shows."""
    return bool(len(vectors) and np.isclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-3).all())


_MOST_DECIMALS = 6


def decimal_step(points: FloatArray) -> float:
    """Return the step of coordinates (n, 3) written with up to 6 decimals, 0 of more, or of few points.

    Examples
    --------
    >>> decimal_step(np.arange(300.0).reshape(100, 3) / 4)
    0.01
    """
    known = points[np.isfinite(points).all(axis=1)]
    if len(known) < FEWEST_POINTS:
        return 0.0
    for n_decimals in range(_MOST_DECIMALS + 1):
        counts = known * 10.0**n_decimals
        if (np.abs(counts - np.rint(counts)) <= 1e-6 + 4 * np.spacing(np.abs(counts))).all():
            return float(10.0**-n_decimals)
    return 0.0


def _raw_points(path: Path) -> RawPoints:
    table = read_point_table(path)
    step = decimal_step(table.points)
    return RawPoints(
        table.points,
        table.normals,
        colour=table.colour,
        warnings=table.warnings,
        label=table.label,
        unit=table.unit,
        step=step,
        times=table.times,
    )


FORMAT = (
    Format(
        suffixes=(".xyz", ".txt", ".csv", ".asc"),
        points=one_cloud(_raw_points),
        scans=one_scan(read_scan_text),
        write=write_single(write_scan_text),
        is_text=True,
        facts=FormatFacts(
            title="`.xyz` `.txt` `.csv` `.asc`",
            read=(
                "points, scans of ours; separators, decimal commas, comments and names of columns (also "
                "P,N,E,Z,D) are detected, and times"
            ),
            lost="columns without a known name",
            written="scans: 2e-9 m",
            poses="in files of ours; `--origin`, `--trajectory`",
            units=(
                "in brackets after the names, or a comment such as `units: ft`; longitude and latitude are "
                "refused; few decimals are steps that all points share"
            ),
            colours="named columns, or three whole numbers up to 255; bytes, 16 bits, 0 to 1",
        ),
    ),
    Format(
        suffixes=(".pts", ".ds"),
        points=one_cloud(_raw_points),
        is_text=True,
        facts=FormatFacts(
            title="`.pts`",
            read="points; the first line gives their number",
            lost="intensity",
            poses="`--origin`",
            colours="the last three columns of whole numbers",
        ),
    ),
)
