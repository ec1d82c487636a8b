# SPDX-License-Identifier: MIT
"""Stated openings: those of a features.json that are found, placed in the walls of other surfaces."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.templates.engine.features import moved_geometry
from completion.templates.engine.options import OPENINGS
from completion.templates.engine.template import Side, Status, TemplateFit
from completion.templates.openings.walls.recess import SIDES
from scenes.checks import FloatArray, InputError, check_points
from scenes.formats.documents import read_json
from scenes.pose import Pose
from scenes.surfaces.catalogue import Plane

_LEAST_M = 1e-3  # between corners
_MOST_POINTS = 5000  # of a wall, that say where it was measured
_NEAR_M = 0.10  # between the corners of an opening and its wall
_CURE = "give a features.json that `unseen feature` wrote"


def read_openings(path: str | os.PathLike[str]) -> list[TemplateFit]:
    """Return the doorways, windows and niches that a features.json calls found; world coordinates.

    Raises InputError: no such file, another kind of JSON, an opening without corners or sides.
    """
    source = os.fspath(path)
    held = read_json(Path(source), dict).get("features")
    if not isinstance(held, list):
        raise InputError(f'{source}: holds no list "features"; {_CURE}')
    return [
        _read(f"{source}: feature {number}", entry)
        for number, entry in enumerate(held, start=1)
        if isinstance(entry, Mapping) and entry.get("kind") in OPENINGS and entry.get("status") == "found"
    ]


def _read(source: str, entry: Mapping[str, Any]) -> TemplateFit:
    sides, corners = entry.get("sides"), entry.get("corners")
    if not isinstance(sides, Mapping) or not all(isinstance(sides.get(name), Mapping) for name in SIDES):
        raise InputError(f"{source}: has no sides {', '.join(SIDES)}; {_CURE}")
    places = check_points(f"{source}: corners", corners)
    if places.shape != (4, 3):
        raise InputError(f"{source}: corners must be four points, got {len(places)}; {_CURE}")
    if (np.linalg.norm(places - np.roll(places, 1, axis=0), axis=1) < _LEAST_M).any():
        raise InputError(f"{source}: two corners lie at one place; {_CURE}")
    return TemplateFit(
        kind=str(entry["kind"]),
        status=Status.FOUND,
        names=(),
        x=np.zeros(0),
        covariance=np.zeros((0, 0)),
        sides=tuple(_side(f"{source}: {name}", name, sides[name]) for name in SIDES),
        evidence=_number(source, "evidence", entry.get("evidence")),
        faces=(),
        assignment=np.zeros(0, np.int64),
        geometry={"corners": places, "depth_m": _number(source, "depth_m", entry.get("depth_m"))},
    )


def _side(source: str, name: str, told: Mapping[str, Any]) -> Side:
    seen, sd = told.get("seen"), told.get("sd_m")
    if not isinstance(seen, bool) or not (sd is None or (isinstance(sd, int | float) and sd >= 0)):
        raise InputError(f"{source}: needs seen (true or false) and sd_m (metres, or null); {_CURE}")
    tiles = max(int(_number(source, "tiles", told.get("tiles"))), 2)
    return Side(name, tiles if seen else 0, 0, tiles, np.inf if sd is None else float(sd))


def _number(source: str, name: str, value: object) -> float:
    """A number, 0 for null."""
    if value is not None and (not isinstance(value, int | float) or isinstance(value, bool)):
        raise InputError(f"{source}: {name} must be a number or null, got {value!r}; {_CURE}")
    return float(value or 0.0)


def place_openings(
    stated: Sequence[TemplateFit],
    surfaces: Sequence[MergedSurface],
    observations: Sequence[Observation],
    reference_from_world: Pose,
) -> list[TemplateFit]:
    """Return the openings in the frame of some surfaces, each with the number of the wall that it lies in.

    Raises InputError: an opening that lies in none of them: within 10 cm of its plane, and no farther from
    what was measured of it than it is large.
    """
    pose, out = reference_from_world, []
    for number, fit in enumerate(stated, start=1):
        geometry = moved_geometry(fit, pose.rotation, pose.translation)
        corners = np.asarray(geometry["corners"])
        away = [_away(one, corners, observations) for one in surfaces]
        nearest = int(np.argmin(away)) if away else 0
        if not away or away[nearest] > _NEAR_M:
            least = f"{100 * away[nearest]:.0f} cm away" if away and np.isfinite(away[nearest]) else "none"
            raise InputError(
                f"opening {number} of the features lies in no wall of these scans: nearest {least}"
            )
        slack = {side.name: (0.0, 0.0 if side.is_seen else np.inf) for side in fit.sides}
        out.append(replace(fit, geometry={**geometry, "surface": nearest + 1, "slack": slack}))
    return out


def _away(surface: MergedSurface, corners: FloatArray, observations: Sequence[Observation]) -> float:
    """How far corners (4, 3) are from a plane, metres; inf where it was measured nowhere near them."""
    plane = surface.fit.surface
    if not isinstance(plane, Plane):
        return np.inf
    off = float(np.abs(plane.distance(corners)).max())
    if off > _NEAR_M:
        return off
    middle, size = corners.mean(axis=0), float(np.linalg.norm(np.ptp(corners, axis=0)))
    nearest = np.linalg.norm(surface.points(observations, _MOST_POINTS) - middle, axis=1).min()
    return off if nearest <= size else np.inf
