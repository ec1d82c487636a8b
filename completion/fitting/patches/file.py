# SPDX-License-Identifier: MIT
"""Boundary files: what a patch is joined to, as JSON; surfaces as `unseen fit` writes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from completion.fitting.patches.boundary import Boundary, Join, check_boundaries
from completion.fitting.patches.patch import SIDES, SideName
from scenes.checks import InputError
from scenes.io.documents import read_json
from scenes.io.guard import reading
from scenes.surfaces.catalogue import Cylinder, Plane

_KNOWN = (*SIDES, "free", "controls", "note")
_EXAMPLE = (
    '"u0": {"surface": {"shape": "plane", "parameters": {"point": [0, 0, 0], "normal": [0, 0, 1]}}, '
    '"join": "tangent"}'
)
_FIELDS = {"plane": ("point", "normal"), "cylinder": ("point", "direction", "radius")}


@dataclass(frozen=True, slots=True, eq=False)
class PatchRequest:
    """What a file of boundaries asks for: see `fit_patch`; `files` are those that it names."""

    boundaries: Mapping[SideName, Boundary]
    free: bool
    controls: tuple[int, int] | None
    files: tuple[Path, ...]


def read_boundaries(path: str | PathLike[str]) -> PatchRequest:
    """Return what a JSON file says of a patch; lengths in metres, as `unseen fit` writes them.

    The file is an object with some of the boundaries u0, u1, v0, v1; the others are free::

        {"u0": {"surface": "wall.fit.json", "join": "tangent"},
         "u1": {"surface": {"shape": "plane", "parameters": {"point": [0, 0, 0], "normal": [0, 0, 1]}},
                "join": "connected"},
         "v0": {"surface": {"shape": "cylinder", "point": [0, 0, 0], "direction": [0, 0, 1], "radius": 0.05},
                "join": "orthogonal"},
         "free": false, "controls": [10, 10]}

    A surface is what `unseen fit` wrote, pasted in, or the name of such a file (beside this one); a join is
    "connected", "tangent" or "orthogonal". Free surfaces need their "standard_deviation".

    Parameters
    ----------
    path : str or path
        The file.

    Raises
    ------
    InputError
        Not such a file; the message names the file, the boundary, and the cure.
    """
    file, files = Path(path), list[Path]()
    with reading(file, "a file of boundaries (JSON)"):
        held = read_json(file, dict)
        strange = [name for name in held if name not in _KNOWN]
        if strange:
            raise InputError(f"knows {', '.join(_KNOWN)}, not {strange[0]!r}")
        named = [side for side in SIDES if side in held]
        if not named:
            raise InputError(f"names no boundary; write {{{_EXAMPLE}}}")
        boundaries = {side: _boundary(held[side], f"{file}: {side}", file.parent, files) for side in named}
        free, controls = held.get("free", False), held.get("controls")
        if not isinstance(free, bool):
            raise InputError(f'"free" is true or false, got {free!r}')
        check_boundaries(boundaries)
        return PatchRequest(boundaries, free, _controls(controls), tuple(files))


def _controls(held: object) -> tuple[int, int] | None:
    if held is None:
        return None
    if not (isinstance(held, list) and len(held) == 2 and all(type(one) is int for one in held)):
        raise InputError(f'"controls" are two whole numbers, along u and along v, got {held!r}')
    return held[0], held[1]


def _boundary(held: object, source: str, folder: Path, files: list[Path]) -> Boundary:
    if not isinstance(held, dict) or set(held) - {"surface", "join", "note"} or "surface" not in held:
        raise InputError(f'{source}: needs a "surface" and a "join" alone, as in {_EXAMPLE}')
    join = held.get("join")
    if join not in tuple(Join):
        raise InputError(f'{source}: "join" is one of {", ".join(Join)}, got {join!r}')
    surface = held["surface"]
    if isinstance(surface, str):
        named = folder / surface
        if not named.resolve().is_relative_to(folder.resolve()):
            raise InputError(
                f"{source}: its surface {surface} leads out of the folder; put the file beside this one"
            )
        files.append(named)
        try:
            surface = read_json(named, dict)
        except InputError as error:
            raise InputError(f"{source}: its surface {surface}: {error}") from error
    return Boundary(*_surface(surface, source, Join(join)))


def _surface(held: object, source: str, join: Join) -> tuple[Plane | Cylinder, Join, Mapping[str, float]]:
    if not isinstance(held, dict):
        raise InputError(f'{source}: "surface" is what `unseen fit` wrote, or the name of such a file')
    shape = held.get("shape")
    if shape not in _FIELDS:
        raise InputError(f'{source}: its surface needs a "shape" of {" or ".join(_FIELDS)}, got {shape!r}')
    fields = held.get("parameters", held)
    if not isinstance(fields, dict):
        raise InputError(f'{source}: "parameters" are an object, got {fields!r}')
    missing = [name for name in _FIELDS[shape] if name not in fields]
    if missing:
        raise InputError(
            f"{source}: its {shape} needs {', '.join(_FIELDS[shape])}; {missing[0]!r} is missing"
        )
    values = {name: _numbers(fields[name], name, source) for name in _FIELDS[shape]}
    try:
        made: Plane | Cylinder
        if shape == "plane":
            made = Plane(values["point"], values["normal"])
        else:
            made = Cylinder(values["point"], values["direction"], values["radius"])
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    return made, join, _deviations(held.get("standard_deviation"), source)


def _numbers(held: object, name: str, source: str) -> Any:
    """A vector of three numbers, or of a radius one."""
    many: list[Any] = [held] if name == "radius" else held if isinstance(held, list) else []
    is_good = len(many) == (1 if name == "radius" else 3)
    if not is_good or not all(type(one) in (int, float) and np.isfinite(one) for one in many):
        what = "a number" if name == "radius" else "three numbers"
        raise InputError(f'{source}: "{name}" is {what} (metres), got {held!r}')
    return held


def _deviations(held: object, source: str) -> Mapping[str, float]:
    if held is None:
        return {}
    if not isinstance(held, dict) or not all(type(one) in (int, float) for one in held.values()):
        raise InputError(f'{source}: "standard_deviation" holds numbers by name, got {held!r}')
    return {str(name): float(one) for name, one in held.items()}
