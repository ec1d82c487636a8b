# SPDX-License-Identifier: MIT
"""Comparison: what a model says of areas, thicknesses, openings and volumes, and what is true."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy import ndimage
from scipy.spatial import cKDTree

from benchmarks.completion.quantities.elements import LEAVES, STEP_M, Side, TrueBuilding
from completion.exchange.building.bodies import Body
from completion.exchange.building.faces import PlaneFace
from completion.exchange.building.parts import BuildingParts
from scenes.checks import FloatArray

_NEAR_M = 0.02  # between a true side and a face that is its model
_SEEN_M = 0.06  # between a place and the nearest measured point, where it counts as seen
_WALL_HIGH_M = 2.0
_PLAN_M, _PLAN_ABOVE_M = 0.02, 2.35  # step of the plan of rooms, and its height above the floor: above doors
_HOLE_M, _AROUND_M, _THROUGH_M = 0.01, 0.1, 0.45
_LEAST_HOLE_M2, _LEAST_ROOM_M2 = 0.3, 1.0
_SAMPLES = 400


@dataclass(frozen=True, slots=True)
class Pair:
    """A quantity: what it is of, what is true, what the model says (0 for nothing), and how much was seen."""

    kind: str
    true: float
    said: float
    seen: float = 1.0

    @property
    def error(self) -> float:
        """Relative."""
        return abs(self.said - self.true) / self.true

    @property
    def is_right(self) -> bool:
        """Whether it is within 5 %."""
        return self.error <= 0.05


def areas(sides: Sequence[Side], parts: BuildingParts, measured: FloatArray) -> Iterator[Pair]:
    """Areas of true sides; the model's are those of its faces in the same plane within their rectangle."""
    tree = cKDTree(measured)
    for side in sides:
        shown = side.places[side.is_shown]
        near, _ = tree.query(shown, distance_upper_bound=_SEEN_M)
        covered = np.zeros(len(side.places), dtype=np.bool_)
        for face in parts.faces:
            covered |= _is_on(face, side)
        said = float(covered.sum()) * STEP_M**2
        yield Pair(side.kind, side.area_m2, said, float(np.isfinite(near).mean()))


def _is_on(face: PlaneFace, side: Side) -> np.ndarray:
    """Which places of a side a face covers."""
    if face.frame.normal @ side.normal < np.cos(np.radians(2.0)):
        return np.zeros(len(side.places), dtype=np.bool_)
    near = np.abs(face.frame.height(side.places)) < _NEAR_M
    found = np.zeros(len(side.places), dtype=np.bool_)
    if near.any():
        found[near] = shapely.contains_xy(face.area, face.frame.flat(side.places[near]))
    return found


def thicknesses(truth: TrueBuilding, bodies: Sequence[Body], rng: np.random.Generator) -> Iterator[Pair]:
    """Thicknesses of bodies; true is how far the first elements from both sides are apart (median)."""
    for body in bodies:
        low, high = np.reshape(body.area.bounds, (2, 2))
        uv = rng.uniform(low, high, (20 * _SAMPLES, 2))
        uv = uv[shapely.contains_xy(body.area, uv)][:_SAMPLES]
        off = 0.03
        fronts, backs = (body.frame.place(uv, w) for w in (off, -body.thickness_m - off))
        ways = np.tile(body.frame.normal, (len(uv), 1))
        there, back = truth.shell.first_hit(fronts, -ways), truth.shell.first_hit(backs, ways)
        known = there.hit & back.hit
        true = body.thickness_m + 2 * off - there.ranges[known] - back.ranges[known]
        yield Pair(body.kind, float(np.median(true)) if known.any() else np.inf, body.thickness_m)


def walls(
    truth: TrueBuilding, sides: Sequence[Side], parts: BuildingParts, measured: FloatArray
) -> Iterator[Pair]:
    """True walls of which both sides were seen, with the thickness that is said of most of them."""
    tree = cKDTree(measured)
    for number in sorted({side.element for side in sides if side.kind == "wall"}):
        own = [side for side in sides if side.element == number]
        box = truth.box(number)
        if len(own) < 2 or box[1, 2] - box[0, 2] < _WALL_HIGH_M:
            continue
        seen = [
            np.isfinite(tree.query(one.places[one.is_shown], distance_upper_bound=_SEEN_M)[0]) for one in own
        ]
        said, best = 0.0, 0
        for body in parts.bodies:
            inside = sum(int(_is_in(body, side).sum()) for side in own)
            if inside > best:
                said, best = body.thickness_m, inside
        if min(one.mean() for one in seen) >= 0.1:
            share = float(min(one.mean() for one in seen))
            yield Pair("wall", float(np.ptp(box, axis=0)[:2].min()), said, share)


def _is_in(body: Body, side: Side) -> np.ndarray:
    """Which places that a side shows lie on either face of a body."""
    places = side.places[side.is_shown]
    depth = -body.frame.height(places)
    near = (np.abs(depth) < _NEAR_M) | (np.abs(depth - body.thickness_m) < _NEAR_M)
    return np.asarray(near & shapely.contains_xy(body.area, body.frame.flat(places)))


def openings(truth: TrueBuilding, parts: BuildingParts) -> Iterator[Pair]:
    """Holes that doors and windows leave in walls; the model's area is the median of those that are there."""
    for number, name in enumerate(truth.classes):
        if not name.startswith(LEAVES) or not (truth.element == number).any():
            continue
        box = truth.box(number)
        axis = int(np.argmin(np.ptp(box, axis=0)))
        if axis == 2:
            continue  # a skylight
        area = _hole(truth, box, axis)
        if area < _LEAST_HOLE_M2:
            continue
        other, middle = 1 - axis, box.mean(axis=0)
        said = []
        for one in parts.model.openings:
            off = np.abs(one.points.mean(axis=0) - middle)
            flat = np.ptp(one.points[:, axis]) < 0.05
            if flat and off[axis] < _THROUGH_M and off[other] < 0.3 and off[2] < 0.3:
                uv = one.points[:, [other, 2]]
                said.append(float(shapely.Polygon(uv).area))
        yield Pair(name, area, float(np.median(said)) if said else 0.0)


def _hole(truth: TrueBuilding, box: FloatArray, axis: int) -> float:
    """Area that beams get through along an axis, around a box."""
    other, middle = 1 - axis, box.mean(axis=0)
    steps = [np.arange(box[0, k] - _AROUND_M, box[1, k] + _AROUND_M, _HOLE_M) for k in (other, 2)]
    places = np.empty((len(steps[0]) * len(steps[1]), 3))
    places[:, [other, 2]] = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
    places[:, axis] = middle[axis]
    free = np.ones(len(places), dtype=np.bool_)
    for sign in (-1.0, 1.0):
        hits = truth.shell.first_hit(places, np.tile(sign * np.eye(3)[axis], (len(places), 1)))
        free &= ~hits.hit | (hits.ranges > _THROUGH_M)
    up = truth.shell.first_hit(places, np.tile([0.0, 0.0, 1.0], (len(places), 1)))
    free &= ~(
        up.hit
        & (up.ranges < 0.15)
        & np.char.startswith(np.array(truth.classes)[truth.shell_element[up.face]], "IfcSlab")
    )
    return float(free.sum()) * _HOLE_M**2


def rooms(truth: TrueBuilding, parts: BuildingParts) -> Iterator[Pair]:
    """Volumes of true rooms: what is connected in the plan above the doors, by rays up and down."""
    low, high = truth.vertices.min(axis=0), truth.vertices.max(axis=0)
    steps = [np.arange(low[k], high[k], _PLAN_M) for k in (0, 1)]
    for k, storey in enumerate(parts.storeys):
        places = np.empty((len(steps[0]), len(steps[1]), 3))
        places[:, :, :2] = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1)
        places[:, :, 2] = storey.elevation_m + _PLAN_ABOVE_M
        label, n = ndimage.label(_free(truth, places))
        flat = places.reshape(-1, 3)
        up, down = (
            truth.shell.first_hit(flat, np.tile([0.0, 0.0, sign], (len(flat), 1))) for sign in (1.0, -1.0)
        )
        height = np.where(up.hit & down.hit, up.ranges + down.ranges, 0.0)
        roofed = np.char.startswith(np.array(truth.classes)[truth.shell_element[up.face]], "IfcCovering")
        number = np.where(up.hit & down.hit & roofed, label.ravel(), 0)
        for one in range(1, n + 1):
            own = number == one
            if own.sum() * _PLAN_M**2 < _LEAST_ROOM_M2:
                continue
            volume = float(height[own].sum()) * _PLAN_M**2
            yield Pair("room", volume, _said_of(parts, k, flat[own]))


def _free(truth: TrueBuilding, places: FloatArray) -> np.ndarray:
    """Which cells of a plan are not within a wall and have none through them."""
    free = np.ones(places.shape[:2], dtype=np.bool_)
    flat = places.reshape(-1, 3)
    for axis in (0, 1):
        for sign in (-1.0, 1.0):
            hits = truth.closed.first_hit(flat, np.tile(sign * np.eye(3)[axis], (len(flat), 1)))
            free &= ~(hits.hit & (hits.ranges < _PLAN_M / 2)).reshape(free.shape)
    return free


def _said_of(parts: BuildingParts, storey: int, places: FloatArray) -> float:
    """Volume of the model's room that most of some places lie in; 0 of none, and where there is no volume."""
    best, said = 0, 0.0
    for room in parts.rooms:
        if room.storey == storey and room.volume_m3 is not None:
            inside = int(shapely.contains_xy(room.outline, places[:, :2]).sum())
            if inside > max(best, len(places) // 2):
                best, said = inside, room.volume_m3
    return said
