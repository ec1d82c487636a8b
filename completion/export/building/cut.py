# SPDX-License-Identifier: MIT
"""Cut: where a plane cuts the facets of a model, as polylines that are measured or inferred."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from completion.export.building.model import REST, BuildingModel, OpeningOutline
from scenes.checks import FloatArray
from scenes.inclination import LEVEL_COSINE

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
class LevelCut:
    """A level cut: its height, the sentence that says where it is, and its lines."""

    height_m: float
    caption: str
    lines: tuple[CutLine, ...]


@dataclass(frozen=True, slots=True, eq=False)
class UprightCut:
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
    lines = []
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
                lines.append(CutLine(points, number, kind, is_measured))
    return tuple(lines)


def plan_of(model: BuildingModel) -> LevelCut:
    """Return the plan: the cut 1.1 m above the lowest floor, or at the lowest scanner's height without one.

    Where there are no walls either, or all is above the scanner or below, it is the cut halfway up.
    """
    if not len(model.faces):
        return LevelCut(0.0, "Nothing was found that could be drawn.", ())
    low, high = model.drawn[:, 2].min(), model.drawn[:, 2].max()
    height, place, sentence = float(low + high) / 2, "halfway up what was scanned", ""
    if model.floor_m is not None:
        height = model.floor_m + _CUT_ABOVE_M
        sentence = f"Plan, cut {_CUT_ABOVE_M} m above the lowest floor, at z = {height:.2f} m."
    elif model.walls:
        if model.eye_m is not None and low < model.eye_m < high:
            height, place = model.eye_m, "at the height of the scanner"
        sentence = f"No floor was found: plan, cut {place}, at z = {height:.2f} m."
    else:
        sentence = (
            "Neither floor nor walls were found, so that what is up is only what the poses say: plan, "
            f"cut halfway up, at z = {height:.2f} m."
        )
    return LevelCut(height, sentence, cut(model, np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 1.0])))


def sections_of(model: BuildingModel) -> tuple[UprightCut, ...]:
    """Return upright cuts through the middle of what surfaces cover: A along most walls, B across them."""
    members = model.faces[model.surface > 0]
    if not len(members):
        return ()
    places = model.vertices[np.unique(members)]
    along = _main_direction(model)
    across = np.array([-along[1], along[0], 0.0])
    middle = np.array([0.0, 0.0, places[:, 2].min()])
    for direction in (along, across):
        reach = places @ direction
        middle += (reach.min() + reach.max()) / 2 * direction
    return tuple(
        UprightCut(name, middle, right, cut(model, middle, np.cross(right, [0.0, 0.0, 1.0])))
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
    for first, second in pairs:
        beside[first].append(second)
        beside[second].append(first)
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


_RAGGED_M, _LEAST_M = 0.02, 0.3  # to which outlines are simplified; length of those that are drawn


def seen_below(model: BuildingModel, height_m: float, without: Collection[int] = ()) -> list[FloatArray]:
    """Return outlines (n, 2) of level surfaces seen from above and below a height, such as table tops.

    Surfaces `without` are left out: things have outlines of their own.
    Holes in them are left out: what stands on a floor hides it, and so does the scanner's own stand.
    """
    corners = model.vertices[model.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    is_level = (normal[:, 2] > LEVEL_COSINE * length) & ~np.isin(model.surface, [0, *without])
    is_member = is_level & (corners[:, :, 2].max(axis=1) < height_m)
    faces = model.faces[is_member]
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    numbered = np.column_stack([np.repeat(model.surface[is_member], 3), edges])
    cells, count = np.unique(numbered, axis=0, return_counts=True)
    outlines = []
    for number in np.unique(cells[:, 0]).tolist():
        places = model.vertices[cells[(cells[:, 0] == number) & (count == 1), 1:], :2]
        merged = shapely.line_merge(
            shapely.multilinestrings([shapely.linestrings(place) for place in places])
        )
        lines = shapely.simplify(shapely.get_parts(merged), _RAGGED_M)
        areas = [shapely.Polygon(line) if line.is_ring else line for line in lines]
        outlines += [
            shapely.get_coordinates(line)
            for k, line in enumerate(lines)
            if line.length > _LEAST_M
            and not any(other.contains(line) for other in (*areas[:k], *areas[k + 1 :]))
        ]
    return outlines


def opening_at(opening: OpeningOutline, height_m: float) -> FloatArray | None:
    """Return both ends (2, 2) of an opening at a height; None where it is not there."""
    points, following = opening.points, np.roll(opening.points, -1, axis=0)
    rise = following[:, 2] - points[:, 2]
    crosses = (points[:, 2] >= height_m) != (following[:, 2] >= height_m)
    if crosses.sum() < 2:
        return None
    share = (height_m - points[crosses, 2]) / rise[crosses]
    places = points[crosses, :2] + share[:, None] * (following - points)[crosses, :2]
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    return np.asarray(places[list(np.unravel_index(int(np.argmax(apart)), apart.shape))])
