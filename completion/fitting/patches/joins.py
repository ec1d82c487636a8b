# SPDX-License-Identifier: MIT
"""Joins: which surface a patch meets along each boundary, and the equations that hold it there.

A plane is met exactly by linear equations: the row on the boundary lies on it; tangent: the next row too;
orthogonal: each control of the next row lies along the normal from its neighbour on the boundary.

A cylinder is met at as many places as a row has controls, by equations linearised where the controls are.
Between these places it is met as closely as the row is smooth. So the angle about the axis, and how far the
next row reaches, are cubic along the boundary: that takes freedom from the parameters, not from the shape.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.linalg import qr

from completion.fitting.limits import EXACT_JOIN, NEARLY_JOIN, SQUARE
from completion.fitting.patches.spline import SIDES, Basis, SideName, SplinePatch, side_rows
from scenes.card import shown
from scenes.checks import BoolArray, FloatArray, InputError, IntArray, Value
from scenes.io.checks.documents import read_json
from scenes.io.checks.guard import guard_reading
from scenes.surfaces.catalogue import Cylinder, Plane


class JoinKind(StrEnum):
    """How a patch meets a surface along a boundary."""

    CONNECTED = "connected"  # the boundary lies on it
    TANGENT = "tangent"  # and both have one tangent plane there
    ORTHOGONAL = "orthogonal"  # and their tangent planes are at right angles there


@dataclass(frozen=True, slots=True, eq=False)
class Boundary(Value):
    """What a patch meets along one of its boundaries.

    Attributes
    ----------
    surface : Plane or Cylinder
        In the unit of the points.
    join : JoinKind
        How they are joined.
    deviations : mapping
        How well the surface is known, as `SurfaceFit.parameter_deviations` names it: "offset" and "normal" of
        a plane; "point", "direction" and "radius" of a cylinder. Needed where surfaces are free.

    Raises
    ------
    InputError
        Another surface, or an unknown join.
    """

    surface: Plane | Cylinder
    join: JoinKind
    deviations: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        surface: object = self.surface
        if not isinstance(surface, Plane | Cylinder):
            kind = getattr(self.surface, "kind", type(self.surface).__name__)
            raise InputError(f"a patch is joined to planes and cylinders, not to a {kind}")
        if self.join not in tuple(JoinKind):
            raise InputError(f"a join is one of {', '.join(JoinKind)}, got {self.join!r}")
        object.__setattr__(self, "join", JoinKind(self.join))


Boundaries = Mapping[SideName, Boundary]
"""By side; a side that is not named is free."""


def check_boundaries(boundaries: Boundaries) -> None:
    """Raise InputError for an unknown side, or two planes whose joins exclude each other at a corner."""
    strange = [name for name in boundaries if name not in SIDES]
    if strange:
        raise InputError(f"a patch has the boundaries {', '.join(SIDES)}, not {strange[0]!r}")
    for literal in ("u0", "u1"):
        for other in ("v0", "v1"):
            if literal in boundaries and other in boundaries:
                _check_corner(literal, other, boundaries[literal], boundaries[other])


def _check_corner(name: str, next_name: str, first: Boundary, second: Boundary) -> None:
    if not (isinstance(first.surface, Plane) and isinstance(second.surface, Plane)):
        return
    normal, next_normal = first.surface.normal_direction, second.surface.normal_direction
    across = float(np.linalg.norm(np.cross(normal, next_normal)))
    angle = float(np.arctan2(across, abs(normal @ next_normal)))
    joins = {first.join, second.join}
    if joins == {JoinKind.TANGENT}:
        is_good, needs = angle <= SQUARE, "in one plane"
    else:
        is_good = JoinKind.ORTHOGONAL not in joins or abs(angle - np.pi / 2) <= SQUARE
        needs = "square to the last digits (hold their directions: `unseen fit --axis`)"
    if not is_good:
        raise InputError(
            f"{name} ({first.join}) and {next_name} ({second.join}) exclude each other at their corner: "
            f"their planes meet at {np.degrees(angle):.6g} deg and have to be {needs}; "
            "or join one of them otherwise"
        )


_SMOOTH = 3  # degree along a boundary of what would let it meet a cylinder less closely


class JoinEquations(NamedTuple):
    """How far a join is from holding, and the derivatives by both rows of controls."""

    misfit: FloatArray  # (q,)
    by_outer: FloatArray  # (q, m, 3)
    by_inner: FloatArray  # (q, m, 3)


class _Term(NamedTuple):
    """A number a station, and its derivatives by the place there and by the step to the next row."""

    value: FloatArray  # (m,)
    by_at: FloatArray  # (m, 3)
    by_step: FloatArray  # (m, 3)


def join_equations(
    boundary: Boundary,
    outer: FloatArray,
    inner: FloatArray,
    along: Basis,
    flags: tuple[bool, bool] = (False, False),
) -> JoinEquations:
    """Return the equations of a join, of the row on the boundary (m, 3) and the next one (m, 3).

    `flags` says at which ends others say how the boundary begins: there a cylinder is asked one place less.
    """
    n, surface = along.n, boundary.surface
    if isinstance(surface, Plane):
        parts = [(np.eye(n), term) for term in _plane_terms(surface, boundary.join, outer, inner - outer)]
        return _gather_equations(parts, np.eye(n))
    seen = along.values(along.stations)
    asked = np.delete(np.eye(n), [k for k, is_told in zip((1, n - 2), flags, strict=True) if is_told], axis=0)
    rough = np.linalg.qr(np.polynomial.legendre.legvander(2 * along.stations - 1, _SMOOTH), "complete")[0]
    exact, smooth = _cylinder_terms(surface, boundary.join, seen @ outer, seen @ (inner - outer))
    parts = [(asked, term) for term in exact] + [(rough[:, _SMOOTH + 1 :].T, term) for term in smooth]
    return _gather_equations(parts, seen)


def _gather_equations(parts: list[tuple[FloatArray, _Term]], seen: FloatArray) -> JoinEquations:
    """Combinations of terms, as equations of controls that stations see by `seen` (m, m)."""
    misfit = [by @ term.value for by, term in parts]
    by_outer = [
        np.einsum("qk,kj,kc->qjc", by, seen, term.by_at - term.by_step, optimize=True) for by, term in parts
    ]
    by_inner = [np.einsum("qk,kj,kc->qjc", by, seen, term.by_step, optimize=True) for by, term in parts]
    return JoinEquations(*(np.concatenate(rows) for rows in (misfit, by_outer, by_inner)))


def _plane_terms(plane: Plane, join: JoinKind, at: FloatArray, step: FloatArray) -> list[_Term]:
    none, normal = np.zeros_like(at), plane.normal(at)
    pairs = [_Term(plane.distance(at), normal, none)]
    axes = {
        JoinKind.CONNECTED: (),
        JoinKind.TANGENT: (plane.normal_direction,),
        JoinKind.ORTHOGONAL: (plane.u_direction, plane.v_direction),
    }[join]
    return pairs + [_Term(step @ axis, none, np.broadcast_to(axis, at.shape)) for axis in axes]


def _cylinder_terms(
    tube: Cylinder, join: JoinKind, at: FloatArray, step: FloatArray
) -> tuple[list[_Term], list[_Term]]:
    """Terms that have to be zero, and terms that have to be smooth."""
    normal, axis = tube.normal(at), np.broadcast_to(tube.direction, at.shape)
    side = np.cross(axis, normal)
    reach = tube.radius + (-1.0 if tube.concave else 1.0) * tube.distance(at)
    turn = (-side if tube.concave else side) / reach[:, None]  # derivative of the angle about the axis
    middle = len(at) // 2
    angle = np.unwrap(np.arctan2(normal @ side[middle], normal @ normal[middle]))
    none = np.zeros_like(at)
    along_normal = _Term(_dot(step, normal), _dot(step, side)[:, None] * turn, normal)
    along_side = _Term(_dot(step, side), -_dot(step, normal)[:, None] * turn, side)
    along_axis = _Term(step @ tube.direction, none, axis)
    exact, smooth = [_Term(tube.distance(at), normal, none)], [_Term(angle, turn, none)]
    if join is JoinKind.TANGENT:
        return [*exact, along_normal], [*smooth, along_side]
    if join is JoinKind.ORTHOGONAL:
        return [*exact, along_side, along_axis], [*smooth, along_normal]
    return exact, smooth


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", first, second))


"""Independent is what is left of an equation by others: of linear ones, and of linearised ones."""


@shown
class ControlEquations(NamedTuple):
    """Equations rows @ x[columns] = value of the controls' coordinates x, and which of them are linear."""

    columns: IntArray  # (t,) of the coordinates (3 a control) that take part
    rows: FloatArray  # (q, t)
    misfit: FloatArray  # (q,) how far they are from holding
    value: FloatArray  # (q,)
    is_linear: BoolArray  # (q,)

    def independent(self) -> ControlEquations:
        """Return those that the others do not entail; linear ones go first."""
        kept, known = list[int](), np.zeros((self.rows.shape[1], 0))
        for linear, least in ((True, EXACT_JOIN), (False, NEARLY_JOIN)):
            rows = np.flatnonzero(self.is_linear == linear)
            if not len(rows):
                continue
            left = self.rows[rows].T - known @ (known.T @ self.rows[rows].T)
            frame, upper, order = qr(left, mode="economic", pivoting=True)
            size = np.abs(np.diag(upper))
            rank = int(np.count_nonzero(size > least * max(1.0, size.max(initial=0.0))))
            kept += rows[order[:rank]].tolist()
            known = np.column_stack([known, frame[:, :rank]])
        which = np.array(kept, dtype=np.int64)
        return ControlEquations(
            self.columns, self.rows[which], self.misfit[which], self.value[which], self.is_linear[which]
        )

    def impose(self, x: FloatArray) -> FloatArray:
        """Return coordinates (k,) moved as little as possible to where independent equations hold."""
        if not len(self.rows):
            return x
        frame, upper = np.linalg.qr(self.rows.T)
        moved = x.copy()
        for _ in range(2):  # the second takes away what rounding left
            misfit = self.value - self.rows @ moved[self.columns]
            moved[self.columns] += frame @ np.linalg.solve(upper.T, misfit)
        return moved


def equations_of(patch: SplinePatch, boundaries: Boundaries) -> ControlEquations:
    """Return all equations of a patch's joins, linearised where it is."""
    n, m, _ = patch.controls.shape
    controls = patch.controls.reshape(-1, 3)
    pairs = list[tuple[IntArray, FloatArray, FloatArray, bool]]()
    for side, boundary in boundaries.items():
        outer, inner = side_rows(side, n, m)
        along = patch.bases[1 if side[0] == "u" else 0]
        equations = join_equations(
            boundary, controls[outer], controls[inner], along, _fixed_ends(side, boundaries)
        )
        columns = 3 * np.concatenate([outer, inner])[:, None] + np.arange(3)
        rows = np.concatenate([equations.by_outer, equations.by_inner], axis=1).reshape(
            len(equations.misfit), -1
        )
        pairs.append((columns.ravel(), rows, equations.misfit, isinstance(boundary.surface, Plane)))
    columns = np.unique(np.concatenate([np.zeros(0, np.int64), *(row[0] for row in pairs)]))
    whole = np.zeros((sum(len(row[1]) for row in pairs), len(columns)))
    start = 0
    for taking_part, rows, _, _ in pairs:
        whole[start : start + len(rows), np.searchsorted(columns, taking_part)] = rows
        start += len(rows)
    misfit = np.concatenate([np.zeros(0), *(row[2] for row in pairs)])
    is_linear = np.concatenate([np.zeros(0, bool), *(np.full(len(row[2]), row[3]) for row in pairs)])
    value = whole @ controls.ravel()[columns] - misfit
    return ControlEquations(columns, whole, misfit, value, is_linear)


def _fixed_ends(side: SideName, boundaries: Boundaries) -> tuple[bool, bool]:
    """Whether, at each end of a boundary, a plane next to it says how the boundary begins there."""
    join = boundaries[side].join
    ends = list[bool]()
    for end in ("0", "1"):
        other = boundaries.get(cast(SideName, ("v" if side[0] == "u" else "u") + end))
        if other is None or not isinstance(other.surface, Plane):
            ends.append(False)
            continue
        ends.append(other.join is JoinKind.ORTHOGONAL or join is JoinKind.TANGENT is other.join)
    return ends[0], ends[1]


_KNOWN = (*SIDES, "free", "controls", "note")
_EXAMPLE = (
    '"u0": {"surface": {"shape": "plane", "parameters": {"point": [0, 0, 0], "normal": [0, 0, 1]}}, '
    '"join": "tangent"}'
)
_FIELDS = {"plane": ("point", "normal"), "cylinder": ("point", "direction", "radius")}


@dataclass(frozen=True, slots=True, eq=False)
class PatchRequest(Value):
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
    with guard_reading(file, "a file of boundaries (JSON)"):
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
    if not (isinstance(held, list) and len(held) == 2 and all(type(entry) is int for entry in held)):
        raise InputError(f'"controls" are two whole numbers, along u and along v, got {held!r}')
    return held[0], held[1]


def _boundary(held: object, source: str, folder: Path, files: list[Path]) -> Boundary:
    if not isinstance(held, dict) or set(held) - {"surface", "join", "note"} or "surface" not in held:
        raise InputError(f'{source}: needs a "surface" and a "join" alone, as in {_EXAMPLE}')
    join = held.get("join")
    if join not in tuple(JoinKind):
        raise InputError(f'{source}: "join" is one of {", ".join(JoinKind)}, got {join!r}')
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
    return Boundary(*_surface(surface, source, JoinKind(join)))


def _surface(
    held: object, source: str, join: JoinKind
) -> tuple[Plane | Cylinder, JoinKind, Mapping[str, float]]:
    if not isinstance(held, dict):
        raise InputError(
            f'{source}: "surface" must be the output of `unseen fit`, or the name of a file that holds it'
        )
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
    if not is_good or not all(type(entry) in (int, float) and np.isfinite(entry) for entry in many):
        what = "a number" if name == "radius" else "three numbers"
        raise InputError(f'{source}: "{name}" is {what} (metres), got {held!r}')
    return held


def _deviations(held: object, source: str) -> Mapping[str, float]:
    if held is None:
        return {}
    if not isinstance(held, dict) or not all(type(entry) in (int, float) for entry in held.values()):
        raise InputError(f'{source}: "standard_deviation" holds numbers by name, got {held!r}')
    return {str(name): float(deviation) for name, deviation in held.items()}
