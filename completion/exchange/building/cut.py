# SPDX-License-Identifier: MIT
"""Cut: where a plane cuts the facets of a model, as polylines that are measured or inferred."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from completion.exchange.building.building_model import REST, BuildingModel
from scenes.checks import FloatArray

_CUT_ABOVE_M = 1.1  # the lowest floor: windows are cut there, and tables are not
_STRAIGHT_M, _STRAIGHT_REST_M = 1e-5, 2e-3  # by which a corner may be off its neighbours' line and go

Crossing = tuple[int, int]  # the two vertices of an edge that is cut


@dataclass(frozen=True, slots=True, eq=False)
class CutLine:
    """A polyline (n, 3) of one surface, from 1 or 0 for none, and of one state; world, metres."""

    points: FloatArray
    surface: int
    kind: str
    is_measured: bool

    @property
    def length_m(self) -> float:
        """Its length."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A level cut: its height, the sentence that says where it is, and its lines."""

    height_m: float
    told: str
    lines: tuple[CutLine, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """An upright cut.

    Attributes
    ----------
    name : str
        A, B.
    point : (3,) float
        In it, world coordinates.
    along : (3,) float
        The level direction in it that leads to the right on paper.
    lines : tuple of CutLine
        World coordinates.
    """

    name: str
    point: FloatArray
    along: FloatArray
    lines: tuple[CutLine, ...]


def cut(model: BuildingModel, point: FloatArray, normal: FloatArray) -> tuple[CutLine, ...]:
    """Cut the facets of a model by the plane through `point` (3,) with `normal` (3,).

    Facets of a surface and a state that share an edge give one polyline. What lies in the plane is not cut.
    Polylines come by surface, measured ones first.
    """
    side = (model.vertices - point) @ normal
    is_above = side >= 0
    above = is_above[model.faces].sum(axis=1)
    pairs: dict[tuple[int, bool], list[tuple[Crossing, Crossing]]] = defaultdict(list)
    for k in np.flatnonzero((above == 1) | (above == 2)).tolist():
        a, b, c = model.faces[k].tolist()
        cuts = [(min(e), max(e)) for e in ((a, b), (b, c), (c, a)) if is_above[e[0]] != is_above[e[1]]]
        pairs[int(model.surface[k]), bool(model.provenance[k] == 0)].append((cuts[0], cuts[1]))
    found = []
    for number, is_measured in sorted(pairs, key=lambda key: (key[0], not key[1])):
        kind = model.kinds[number]
        for chain in _chains(pairs[number, is_measured]):
            ends = np.array(chain)
            near, far = (model.vertices[ends[:, j]] for j in (0, 1))
            share = side[ends[:, 0]] / (side[ends[:, 0]] - side[ends[:, 1]])
            points = _straight(
                near + share[:, None] * (far - near), _STRAIGHT_REST_M if kind == REST else _STRAIGHT_M
            )
            if len(points) > 1:
                found.append(CutLine(points, number, kind, is_measured))
    return tuple(found)


def plan_of(model: BuildingModel) -> Plan:
    """Return the plan: the cut 1.1 m above the lowest floor, or halfway up where no floor is known."""
    if not len(model.faces):
        return Plan(0.0, "Nothing was found that could be drawn.", ())
    low, high = model.drawn[:, 2].min(), model.drawn[:, 2].max()
    height, told = float(low + high) / 2, ""
    if model.floor_m is not None:
        height = model.floor_m + _CUT_ABOVE_M
        told = f"Plan, cut {_CUT_ABOVE_M} m above the lowest floor, at z = {height:.2f} m."
    elif model.walls:
        told = f"No floor was found: plan, cut halfway up what was scanned, at z = {height:.2f} m."
    else:
        told = (
            "Neither floor nor walls were found, so that what is up is only what the poses say: plan, "
            f"cut halfway up, at z = {height:.2f} m."
        )
    return Plan(height, told, cut(model, np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 1.0])))


def sections_of(model: BuildingModel) -> tuple[Section, ...]:
    """Return upright cuts through the middle of what surfaces cover: A along most walls, B across them."""
    own = model.faces[model.surface > 0]
    if not len(own):
        return ()
    places = model.vertices[np.unique(own)]
    along = _main_direction(model)
    across = np.array([-along[1], along[0], 0.0])
    middle = np.array([0.0, 0.0, places[:, 2].min()])
    for direction in (along, across):
        reach = places @ direction
        middle += (reach.min() + reach.max()) / 2 * direction
    return tuple(
        Section(name, middle, right, cut(model, middle, np.cross(right, [0.0, 0.0, 1.0])))
        for name, right in (("A", along), ("B", across))
    )


def _main_direction(model: BuildingModel) -> FloatArray:
    """Level unit vector (3,) along most wall area, within 45 degrees of +x; +x where there is no wall."""
    corners = model.vertices[model.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    total = 0j
    for wall in model.walls:
        angle = float(np.arctan2(wall.normal[1], wall.normal[0]))
        total += area[model.surface == wall.number].sum() * np.exp(4j * angle)  # a quarter turn is none
    turn = float(np.angle(total)) / 4 if abs(total) > 0 else 0.0
    return np.array([np.cos(turn), np.sin(turn), 0.0])


def _chains(pairs: Iterable[tuple[Crossing, Crossing]]) -> Iterator[list[Crossing]]:
    """Segments joined to chains by the crossings that they share; closed ones end where they began."""
    beside: dict[Crossing, list[Crossing]] = defaultdict(list)
    for one, other in pairs:
        beside[one].append(other)
        beside[other].append(one)
    ends = sorted(key for key, others in beside.items() if len(others) != 2)
    for start in (*ends, *sorted(beside)):
        while beside[start]:
            chain = [start]
            while beside[chain[-1]]:
                following = beside[chain[-1]].pop(0)
                beside[following].remove(chain[-1])
                chain.append(following)
            yield chain


def _straight(points: FloatArray, slack_m: float) -> FloatArray:
    """Points (n, 3) but those on the line between the last one kept and the next; none if it is short."""
    kept = [points[0]]
    for here, following in pairwise(points[1:]):
        whole, part = following - kept[-1], here - kept[-1]
        length = float(np.linalg.norm(whole))
        if length == 0 or float(np.linalg.norm(np.cross(whole, part))) > slack_m * length:
            kept.append(here)
    kept.append(points[-1])
    moves = np.linalg.norm(np.diff(np.array(kept), axis=0), axis=1)
    if moves.sum() <= slack_m:
        return np.zeros((0, 3))
    return np.asarray(np.array(kept)[np.append(True, moves > 0)])
