# SPDX-License-Identifier: MIT
"""Text: points as lines of numbers, whatever the separators, and the returns of a scan of ours."""

from __future__ import annotations

import io
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import FloatArray, InputError, freeze_arrays
from scenes.io.documents import decode_text, parse_json
from scenes.io.format import (
    NO_RAYS,
    Format,
    RawPoints,
    ScanReturns,
    cloud_of,
    one_cloud,
    one_scan,
    scan_of,
    time_column,
    times_among,
    write_single,
)
from scenes.io.header import checked_bytes, scan_header
from scenes.limits import FEWEST_POINTS
from scenes.run.atomic import atomic_path, to_plain
from scenes.scan.range_image import RangeImage

_COMMENT = re.compile(r"[ \t]*(?:#|//|%|!)[^\n]*")
TEXT_TAG = "# unseen "  # begins the line that holds pose and projection of a scan of ours
_EMPTY_FIELD = re.compile(r"(?m)(?:^|(?<=\t)) *(?=\t)")  # of tab-separated text
_NAME = re.compile(r"[a-z]+")
_LETTER = re.compile(r"[^\W\d_]")
_QUOTED = re.compile(r'"([^"\n]*)"')
_AXES = {  # names of columns, the plainest first
    "x": ("x", "easting", "east", "e", "rechtswert"),  # German surveyors: right, high, height
    "y": ("y", "northing", "north", "n", "hochwert"),
    "z": ("z", "elevation", "elev", "height", "el", "h", "up", "u", "höhe"),
}
_LABEL = "label"
_COUNTED = 10  # points from which a first column that counts them is their number
_TRACK = "track"  # of points3D.txt of COLMAP: any number of fields
_SHOWN = 200  # characters of names in a warning
_MAX_HEADER = 200  # lines; a file without a point in that many is no point file
_CURE = "correct the line, or mark it as a comment with #"


@dataclass(frozen=True, slots=True, eq=False)
class PointTable:
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
    times : (n,) float, optional
        Of the column that is named so, seconds.
    """

    points: FloatArray
    normals: FloatArray | None
    warnings: tuple[str, ...]
    label: FloatArray | None = None
    times: FloatArray | None = None

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where in the lines the points stand."""

    first: int  # index of the first line with a point
    columns: tuple[int, ...]  # of x, y, z and perhaps nx, ny, nz, then of `more`
    count: int | None = None  # points that the file announces
    warnings: tuple[str, ...] = ()
    normals_are_named: bool = False
    more: tuple[str, ...] = ()  # names of the columns beside: the label, times
    may_count: bool = False  # no column is named, and there are more than three


def read_point_table(path: Path) -> PointTable:
    """Return the points of a text file.

    Fields are separated by blanks, tabs, commas or semicolons; decimal commas are known where something
    else separates the fields. Lines may end in any way; `#`, `//`, `%` and `!` begin comments. Lines of names
    may stand before the points and say which columns are x, y, z (nx, ny, nz, label, time), or easting,
    northing and elevation (P, N, E, Z, D); without them the first three columns are taken, and three more are
    normals where all have length one. A first line with one integer announces how many points follow (.pts,
    and the reference sets of NIST).

    Raises InputError: no text, no points, a line that is no point (with its number), another count than
    announced, or a first column without a name that counts the points.
    """
    lines = _clean(_decode(path)).split("\n")
    layout = _layout(lines)
    table = _parse(lines, layout)
    if layout.count is not None and layout.count != len(table):
        raise InputError(
            f"its first line announces {layout.count} points, {len(table)} follow: is it truncated, or are "
            "there several clouds in it? correct or remove that line"
        )
    if layout.may_count and len(table) >= _COUNTED and (np.diff(table[:, 0]) == 1).all():
        raise InputError(
            f"its first column counts from {table[0, 0]:.0f} to {table[-1, 0]:.0f}, so it numbers the "
            "points; name the columns in the first line (P,N,E,Z,D or point,x,y,z)"
        )
    first = table.shape[1] - len(layout.more)
    beside = {name: table[:, first + k].copy() for k, name in enumerate(layout.more)}
    points, more = table[:, :3], table[:, 3:first]
    normals = more.copy() if layout.normals_are_named or (more.shape[1] == 3 and _are_unit(more)) else None
    return PointTable(points, normals, layout.warnings, beside.get(_LABEL), times_among(beside))


def _decode(path: Path) -> str:
    """Return the text with plain line ends."""
    data = path.read_bytes()
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = data.decode("utf-16", errors="replace")
    else:
        text = decode_text(data)
    if "\0" in text[:100_000]:
        raise InputError("is binary, not text; is its suffix right?")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _clean(text: str) -> str:
    """Return the text without quotes, decimal commas and separators other than blanks; empty fields NaN.

    Blanks and separators within quotes, and blanks within a field that has a separator, become _ in words.
    """
    text = _QUOTED.sub(lambda held: _as_word(held[1], r"[\s,;]+"), text).replace('"', "")
    has_decimal_commas = _has_decimal_commas(text.replace("\t", " "))
    text = _with_whole_words(_with_empty_fields(text), "\t").replace("\t", " ")
    if has_decimal_commas:
        text = text.replace(",", ".")
    for separator in ",;":
        if separator not in text:
            continue
        text = _with_whole_words(text, separator)
        text = re.sub(rf"(?m)^ *(?={separator})", " nan ", text)
        text = re.sub(rf"{separator}(?= *{separator})", f"{separator} nan ", text)
        text = text.replace(separator, " ")
    return text


def _as_word(field: str, gaps: str = r"\s+") -> str:
    """A field whose gaps are _, unless it is all numbers."""
    return re.sub(gaps, "_", field.strip()) if _LETTER.search(field) else field


def _with_whole_words(text: str, separator: str) -> str:
    """Return text whose fields between separators hold no blanks where they hold letters."""
    if separator not in text:
        return text
    return "\n".join(
        separator.join(map(_as_word, line.split(separator)))
        if separator in line and _LETTER.search(line) and not _COMMENT.match(line)
        else line
        for line in text.split("\n")
    )


def _with_empty_fields(text: str) -> str:
    """Return tab-separated text with NaN for its empty fields.

    Where lines differ in their tabs but not in their fields, tabs align columns and no field is empty.
    """
    if not _EMPTY_FIELD.search(text):
        return text
    lines = [line.rstrip() for line in text.split("\n")]
    rows = [line for line in lines if "\t" in line and _COMMENT.sub("", line).strip()]
    is_aligned = len({row.count("\t") for row in rows}) > 1 and len({len(row.split()) for row in rows}) == 1
    if is_aligned or not rows:
        return text
    if all(row.lstrip(" ").startswith("\t") for row in rows):  # indented
        lines = [line.lstrip() for line in lines]
    return "\n".join(_EMPTY_FIELD.sub(" nan ", line) for line in lines)


def _has_decimal_commas(text: str) -> bool:
    """Tell whether the first points are written like 1,5;2,5;3 or 1,5 2,5 3,5."""
    number = r"[-+]?\d+(?:,\d+)?(?:[eE][-+]?\d+)?"
    for line in _COMMENT.sub("", text[:20_000]).split("\n"):
        fields = [field.strip() for field in (line.split(";") if ";" in line else line.split())]
        fields = [field for field in fields if field]
        if len(fields) >= 3 and any("," in field for field in fields[:3]):
            return all(re.fullmatch(number, field) for field in fields[:3])
    return False


def _layout(lines: list[str]) -> _Layout:
    """Find the first point, the names before it, and the announced count."""
    names: list[str] = []
    count: int | None = None
    for index, line in enumerate(lines[:_MAX_HEADER]):
        if line.startswith(TEXT_TAG):
            continue
        fields = _fields(line)
        if not fields:
            names = _column_names(line, names)
        elif not _is_number(fields[0]):
            columns = _columns(names, len(fields)) if names else ()
            if columns and all(_is_number(fields[k]) for k in columns[:3] if k < len(fields)):
                return _data_layout(index, fields, names, count)  # a text column stands first
            names = _column_names(line, names)
        elif len(fields) == 1 and count is None and re.fullmatch(r"\+?\d+", fields[0]):
            count = int(fields[0])
        else:
            return _data_layout(index, fields, names, count)
    if count is not None and len(lines) < _MAX_HEADER:
        raise InputError(f"announces {count} points, and none follows")
    raise InputError(f"no point in its first {min(len(lines), _MAX_HEADER)} lines: three numbers a line are "
                     "expected")  # fmt: skip


def _data_layout(index: int, fields: list[str], names: list[str], count: int | None) -> _Layout:
    columns = named = _columns(names, len(fields))
    warnings: tuple[str, ...] = ()
    if not named:
        columns = tuple(range(6)) if len(fields) == 6 else (0, 1, 2)
        if len(names) == len(fields):
            warnings = (f"no columns x, y, z among {', '.join(names)[:_SHOWN]}: the first three were taken",)
            columns = (0, 1, 2)
    elif len(fields) < len(names) and max(columns) >= len(fields):
        raise InputError(
            f"line {index + 1} has {len(fields)} columns, its header names {len(names)}; {_CURE}"
        )
    may_count = not named and len(fields) > 3
    if not names and len(columns) == 6 and not all(_is_number(field) for field in fields):
        columns = (0, 1, 2)
    beside = [name for name in (_LABEL, time_column(names)) if named and name in names]
    places = [names.index(name) for name in beside]
    more = {
        name: k for name, k in zip(beside, places, strict=True) if k < len(fields) and _is_number(fields[k])
    }
    return _Layout(
        index,
        (*columns, *more.values()),
        count,
        warnings,
        normals_are_named=bool(named) and len(named) == 6,
        more=tuple(more),  # words are no labels
        may_count=may_count,
    )


def _columns(names: list[str], n_fields: int) -> tuple[int, ...]:
    """Return the columns of x, y, z, and of nx, ny, nz where named; nothing where x, y, z are not."""
    known = _axis_names(names)
    if not known or (len(names) < n_fields and _TRACK not in names):
        return ()
    columns = [names.index(name) for name in known]
    for normal in (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z")):
        if set(normal) <= set(names):
            return tuple(columns + [names.index(axis) for axis in normal])
    return tuple(columns)


def _column_names(line: str, before: list[str]) -> list[str]:
    """Return the names of a header line, or those before where it names nothing or only those are of axes."""
    names = _names(line)
    return before if not names or (_axis_names(before) and not _axis_names(names)) else names


def _axis_names(names: list[str]) -> list[str]:
    """Return which of the names are those of x, y and z; nothing where one of them is missing."""
    known = [next((name for name in _AXES[axis] if name in names), "") for axis in "xyz"]
    return known if all(known) else []


def _names(line: str) -> list[str]:
    """Return the column names of a header line, lower case and without units: "X [mm]" is x."""
    plain = re.sub(r"[\[(][^\[\](\)]*[\])]", " ", line.lower())
    words = [word for word in re.split(r"[\s#/%!]+", plain) if word]
    words = [re.sub(r"_+(?:m|mm|cm|in)?$", "", word).lstrip("_") or word for word in words]
    return words if any(_NAME.search(word) for word in words) else []


def _fields(line: str) -> list[str]:
    return _COMMENT.sub("", line).split()


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return "_" not in field


def _parse(lines: list[str], layout: _Layout) -> FloatArray:
    """Return the columns of the layout as numbers, or say which line is wrong."""
    body = "\n".join(lines[layout.first :])
    try:
        table = np.loadtxt(io.StringIO(body), comments=["#", "//", "%", "!"], usecols=layout.columns, ndmin=2)
    except ValueError as error:
        if (
            not layout.normals_are_named
            and layout.columns == tuple(range(6))
            and _fewer_columns(lines, layout)
        ):
            return _parse(lines, _Layout(layout.first, (0, 1, 2), layout.count, layout.warnings))
        raise InputError(_wrong_line(lines, layout) or str(error)) from error
    return np.asarray(table, dtype=np.float64)


def _fewer_columns(lines: list[str], layout: _Layout) -> bool:
    """Tell whether all lines have x, y, z, though not all have three more numbers."""
    return not _wrong_line(lines, _Layout(layout.first, (0, 1, 2)))


def _wrong_line(lines: list[str], layout: _Layout) -> str:
    """Say which line is no point, and why; nothing where all are."""
    needed = max(layout.columns) + 1
    for number, line in enumerate(lines[layout.first :], start=layout.first + 1):
        fields = _fields(line)
        if fields and len(fields) < needed:
            shown = f"{line.strip()[:60]!r}; {_CURE}"
            return f"line {number} has {len(fields)} columns, {needed} are needed: {shown}"
        for column in layout.columns if fields else ():
            if not _is_number(fields[column]):
                return f"line {number}: {fields[column][:40]!r} is no number; {_CURE}"
    return ""


def _are_unit(vectors: FloatArray) -> bool:
    """Tell whether all vectors have length one, as far as text of a few digits shows."""
    return bool(len(vectors) and np.isclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-3).all())


_COLOURS = ("red", "green", "blue")
_MOST_PIXELS, _MOST_DECIMALS = 2**31, 6


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
        names, columns, forms = [*names, *_COLOURS], [*columns, cloud.colour], [*forms, *["%d"] * 3]
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
        colour=checked_bytes([column[name] for name in _COLOURS]).T if _COLOURS[0] in column else None,
        intensity=column["intensity"].astype(np.float32) if "intensity" in column else None,
    )
    return scan_of(parse_json(first[len(TEXT_TAG) :], dict), len(table), [cloud])


def _whole(values: Any) -> Any:
    """Numbers of pixels as integers."""
    if not (np.abs(values) < _MOST_PIXELS).all() or (values != np.floor(values)).any():
        raise InputError("its rows and columns are not all integers: was the file edited?")
    return values.astype(np.int64)


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
        warnings=table.warnings,
        label=table.label,
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
    ),
    Format(suffixes=(".pts", ".ds"), points=one_cloud(_raw_points), is_text=True),
)
