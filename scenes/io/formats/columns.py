# SPDX-License-Identifier: MIT
"""Columns of points: what their names mean in any format, and the unit that a name or a comment states."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from scenes.checks import FloatArray
from scenes.io.formats.crs import LengthUnit

AXES, NORMALS, COLOURS = ("x", "y", "z"), ("nx", "ny", "nz"), ("red", "green", "blue")
_GROUPS = {  # for each axis or channel its names, the plainest first; all of a group, or none
    AXES: (
        ("x", "easting", "east", "e", "rechtswert"),  # German surveyors: right, high, height
        ("y", "northing", "north", "n", "hochwert"),
        ("z", "elevation", "elev", "height", "el", "h", "up", "u", "höhe"),
    ),
    NORMALS: (("nx", "normal_x"), ("ny", "normal_y"), ("nz", "normal_z")),
    COLOURS: (("red", "r", "diffuse_red"), ("green", "g", "diffuse_green"), ("blue", "b", "diffuse_blue")),
}
_SINGLE = {
    "intensity": ("intensity", "scalar_intensity", "intensities", "i", "reflectance"),
    "label": ("label",),
}
_SECONDS = {  # of a unit of the columns that may hold times, by name; the first that is there counts
    **dict.fromkeys(("gps_time", "gpstime", "timestamp", "time", "t", "secs", "seconds"), 1.0),
    **dict.fromkeys(("msecs", "timestamp_ms", "time_ms"), 1e-3),
    **dict.fromkeys(("usecs", "timestamp_us", "time_us"), 1e-6),
    **dict.fromkeys(("nsecs", "timestamp_ns", "time_ns"), 1e-9),
}
_LATEST_S = 1e11  # the year 5138, counted from 1970: larger numbers are of a smaller unit
_ACROSS = {"azimuth", "azimut", "az", "hz", "theta", "bearing"}  # angles of an instrument
_UPWARDS = {"elevation", "elev", "zenith", "v", "vz", "phi", "inclination"}
_AWAY = {"range", "distance", "dist", "sd", "slope_distance", "r", "rho"}
_DEGREES = {"lon", "lat", "longitude", "latitude"}
_METRES = {
    "mm": 0.001, "millimeters": 0.001, "millimetres": 0.001, "millimeter": 0.001, "millimetre": 0.001,
    "cm": 0.01, "centimeters": 0.01, "centimetres": 0.01, "centimeter": 0.01, "centimetre": 0.01,
    "m": 1.0, "meters": 1.0, "metres": 1.0, "meter": 1.0, "metre": 1.0,
    "in": 0.0254, "inches": 0.0254, "inch": 0.0254, "ft": 0.3048, "feet": 0.3048, "foot": 0.3048,
    "us-ft": 1200 / 3937, "usft": 1200 / 3937, "ftus": 1200 / 3937, "us survey feet": 1200 / 3937,
    "us survey foot": 1200 / 3937,
}  # fmt: skip
_BRACKETS = re.compile(r"[\[(]([^\[\](\)]*)[\])]")
_STATED = re.compile(r"\bunits?\s*(?:=|:|are|in)\s*([a-z]+(?: survey f(?:ee|oo)t|-ft)?)\b", re.IGNORECASE)


def columns_of(names: Sequence[str]) -> dict[str, int]:
    """Return the columns by what they are: x y z, nx ny nz, red green blue, intensity, label.

    Upper and lower case do not differ; a group of which one name is missing is not there.

    Examples
    --------
    >>> columns_of(["P", "Northing", "Easting", "Elevation", "diffuse_red"])
    {'x': 2, 'y': 1, 'z': 3}
    """
    place = {name.lower(): k for k, name in reversed(list(enumerate(names)))}
    found: dict[str, int] = {}
    for group, aliases in _GROUPS.items():
        columns = [next((place[name] for name in known if name in place), -1) for known in aliases]
        if min(columns) >= 0:
            found |= dict(zip(group, columns, strict=True))
    for role, known in _SINGLE.items():
        column = next((place[name] for name in known if name in place), None)
        if column is not None and column not in found.values():
            found[role] = column
    return found


def are_degrees(names: Sequence[str]) -> bool:
    """Tell whether columns are named longitude and latitude."""
    return len(_DEGREES & {name.lower() for name in names}) > 1


def are_polar(names: Sequence[str]) -> bool:
    """Tell whether columns are named as angles and distances of an instrument.

    Examples
    --------
    >>> are_polar(["Pt", "Hz", "V", "SD"]), are_polar(["u", "v"])
    (True, False)
    """
    held = {name.lower() for name in names}
    return bool(held & _ACROSS) and bool(held & (_UPWARDS | _AWAY))


def unit_of_names(line: str) -> LengthUnit | None:
    """Return the unit that stands in brackets after the names of a line, None without, or where they differ.

    Examples
    --------
    >>> unit_of_names("X [mm], Y [mm], Z [mm], t (s)").metres[0]
    0.001
    """
    named = [held.strip().lower() for held in _BRACKETS.findall(line)]
    lengths = {_METRES[name]: name for name in named if name in _METRES}
    if len(lengths) != 1:
        return None
    ((metres, name),) = lengths.items()
    return LengthUnit(name, (metres,) * 3)


def unit_of_comment(text: str) -> LengthUnit | None:
    """Return the unit that comments state, as in "File units = inches", None where they do not.

    Examples
    --------
    >>> unit_of_comment("# File units = inches").metres[0], unit_of_comment("# 12 units")
    (0.0254, None)
    """
    for word in _STATED.findall(text):
        metres = _METRES.get(word.lower())
        if metres is not None:
            return LengthUnit(word, (metres,) * 3)
    return None


def time_column(names: Iterable[str]) -> str | None:
    """Return which of the names of columns is that of times, None where none is.

    Examples
    --------
    >>> time_column(["x", "y", "z", "scalar_GpsTime"])
    'scalar_GpsTime'
    """
    plain = {name.lower().removeprefix("scalar_"): name for name in names}  # CloudCompare's prefix
    return next((plain[known] for known in _SECONDS if known in plain), None)


def times_among(columns: Mapping[str, FloatArray]) -> FloatArray | None:
    """Return the times (n,) among columns by name, seconds; None without such a column.

    Numbers that are too large for seconds are of the next smaller unit in which they are not.

    Examples
    --------
    >>> times_among({"nsecs": np.array([1.5e18])}), times_among({"t": np.array([1.5e15])})
    (array([1.5e+09]), array([1.5e+09]))
    """
    name = time_column(columns)
    if name is None:
        return None
    return in_seconds(columns[name] * _SECONDS[name.lower().removeprefix("scalar_")])


def in_seconds(times: FloatArray) -> FloatArray:
    """Return times (n,) whose numbers, where too large for seconds, are of the unit in which they are not.

    Examples
    --------
    >>> in_seconds(np.array([1305031102.2])), in_seconds(np.array([1305031102200.0]))
    (array([1.3050311e+09]), array([1.3050311e+09]))
    """
    while np.abs(times[np.isfinite(times)]).max(initial=0.0) > _LATEST_S:
        times = times / 1000
    return times
