# SPDX-License-Identifier: MIT
"""Stated features: those of a features.json that are found."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from completion.templates.engine.options import OPENINGS
from completion.templates.engine.template import Seen, Side, Status, TemplateFit
from completion.templates.openings.walls.recess import SIDES
from scenes.checks import FloatArray, InputError, check_coordinates, check_direction, check_places
from scenes.io.documents import read_json

PATTERNS = ("hole-row", "hole-grid", "bolt-circle")
JOINTS = ("junction", "elbow")

_LEAST_M = 1e-3  # between corners
_N_RADII = 2  # of an elbow
_CURE = "give a features.json that `unseen feature` wrote"


def read_features(path: str | os.PathLike[str]) -> list[TemplateFit]:
    """Return the openings, patterns of holes and joints that a features.json calls found; world coordinates.

    Raises InputError: no such file, another kind of JSON, an opening without corners or sides, a pattern
    without centres and radius, a joint without its ends.
    """
    source = os.fspath(path)
    held = read_json(Path(source), dict).get("features")
    if not isinstance(held, list):
        raise InputError(f'{source}: holds no list "features"; {_CURE}')
    return [
        _READERS[entry["kind"]](f"{source}: feature {number}", entry)
        for number, entry in enumerate(held, start=1)
        if isinstance(entry, Mapping) and entry.get("kind") in _READERS and entry.get("status") == "found"
    ]


def _read_opening(source: str, entry: Mapping[str, Any]) -> TemplateFit:
    sides, corners = entry.get("sides"), entry.get("corners")
    if not isinstance(sides, Mapping) or not all(isinstance(sides.get(name), Mapping) for name in SIDES):
        raise InputError(f"{source}: has no sides {', '.join(SIDES)}; {_CURE}")
    places = _places(source, "corners", corners)
    if places.shape != (4, 3):
        raise InputError(f"{source}: corners must be four points, got {len(places)}; {_CURE}")
    if (np.linalg.norm(places - np.roll(places, 1, axis=0), axis=1) < _LEAST_M).any():
        raise InputError(f"{source}: two corners lie at one place; {_CURE}")
    told = entry.get("standard_deviation")
    sd = told.get("depth") if isinstance(told, Mapping) else None
    geometry = {
        "corners": places,
        "depth_m": _number(source, "depth_m", entry.get("depth_m")),
        "depth_sd_m": np.inf if sd is None else _number(source, "standard_deviation", sd),
    }
    return _fit(source, entry, {name: sides[name] for name in SIDES}, geometry)


def _read_pattern(source: str, entry: Mapping[str, Any]) -> TemplateFit:
    sides, centres = entry.get("sides"), _places(source, "centres", entry.get("centres"))
    radius = _number(source, "radius", entry.get("radius"))
    if not len(centres) or radius <= 0:
        raise InputError(f"{source}: needs centres and a radius above 0; {_CURE}")
    if not isinstance(sides, Mapping) or len(sides) != len(centres):
        raise InputError(f"{source}: needs a side for each of its {len(centres)} holes; {_CURE}")
    axis = _axis(source, entry)
    return _fit(source, entry, sides, {"centres": centres, "radius": radius, "axis": axis})


def _read_joint(source: str, entry: Mapping[str, Any]) -> TemplateFit:
    ends, axis = entry.get("joint"), _axis(source, entry)
    geometry = {"joint": _places(source, "joint", ends), "axis": axis}
    joint = geometry["joint"]
    if joint.shape != (2, 3) or np.linalg.norm(joint[1] - joint[0]) < _LEAST_M:
        raise InputError(f"{source}: joint must be two places; {_CURE}")
    if entry["kind"] == "elbow":
        radii = entry.get("radii")
        if not isinstance(radii, list) or len(radii) != _N_RADII:
            raise InputError(f"{source}: radii must be that of the bend and that of the tube; {_CURE}")
        geometry["radii"] = np.array([_number(source, "radii", one) for one in radii])
        geometry["centres"] = _places(source, "centres", entry.get("centres"))
        away = np.linalg.norm(np.cross(axis, joint - geometry["centres"][:1]), axis=1)
        if len(geometry["centres"]) != 1 or (away < _LEAST_M).any():
            raise InputError(f"{source}: centres must be the middle of the bend, off its joint; {_CURE}")
    return _fit(source, entry, {}, geometry)


_READERS: dict[str, Callable[[str, Mapping[str, Any]], TemplateFit]] = {
    **dict.fromkeys(OPENINGS, _read_opening),
    **dict.fromkeys(PATTERNS, _read_pattern),
    **dict.fromkeys(JOINTS, _read_joint),
}


def _fit(
    source: str, entry: Mapping[str, Any], sides: Mapping[str, Any], geometry: Mapping[str, object]
) -> TemplateFit:
    """A feature that is found, by its sides and its geometry."""
    return TemplateFit(
        kind=str(entry["kind"]),
        status=Status.FOUND,
        names=(),
        x=np.zeros(0),
        covariance=np.zeros((0, 0)),
        sides=tuple(_side(f"{source}: {name}", name, told) for name, told in sides.items()),
        evidence=_number(source, "evidence", entry.get("evidence")),
        faces=(),
        assignment=np.zeros(0, np.int64),
        geometry=geometry,
    )


def _side(source: str, name: str, told: object) -> Side:
    held = told if isinstance(told, Mapping) else {}
    seen, sd = held.get("seen"), held.get("sd_m")
    if not isinstance(seen, bool) or not (sd is None or (isinstance(sd, int | float) and 0 <= sd < np.inf)):
        raise InputError(f"{source}: needs seen (true or false) and sd_m (metres, or null); {_CURE}")
    confirmed, tiles = (int(_number(source, what, held.get(what))) for what in ("confirmed", "tiles"))
    tiles = max(tiles, 2)
    confirmed = min(max(confirmed, 2), tiles) if seen else 0
    against = tiles if held.get("state") == Seen.CONTRADICTED else 0
    return Side(name, confirmed, against, tiles, np.inf if sd is None else float(sd))


def _places(source: str, name: str, value: object) -> FloatArray:
    """Points (n, 3) of the world."""
    try:
        return check_places(name, check_coordinates(value))
    except InputError as error:
        raise InputError(f"{source}: {name}: {error}; {_CURE}") from error


def _axis(source: str, entry: Mapping[str, Any]) -> FloatArray:
    """The axis of a pattern or a joint, (3,)."""
    try:
        return check_direction("axis", check_coordinates(entry.get("axis")))
    except InputError as error:
        raise InputError(f"{source}: {error}; {_CURE}") from error


def _number(source: str, name: str, value: object) -> float:
    """A finite number, 0 for null."""
    if value is None:
        return 0.0
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise InputError(f"{source}: {name} must be a number or null, got {value!r}; {_CURE}")
    return float(value)
