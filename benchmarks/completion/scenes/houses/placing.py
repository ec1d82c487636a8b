# SPDX-License-Identifier: MIT
"""Placing: what is taken of a room, and where else a piece of furniture can stand in it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from benchmarks.completion.scenes.houses.furniture.parts import Part, Piece, centred, motion, moved
from benchmarks.completion.scenes.houses.plan import Plan, Room, side_frame
from scenes.checks import FloatArray

STANDING_M = 0.33  # from what one stands beside
_BODY_M = 1.9  # below it, things are in one's way
_LEAST_M2 = 0.35  # of floor to stand on, in any room


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """Part of a room that is taken: its plan, and from where to where it reaches, metres."""

    plan: BaseGeometry
    low: float
    high: float


@dataclass(slots=True, eq=False)
class Layout:
    """A room while it is furnished."""

    plan: Plan
    room: Room
    number: int
    parts: list[Part] = field(default_factory=list)
    taken: list[Taken] = field(default_factory=list)
    _counts: dict[str, int] = field(default_factory=dict)

    def is_free(self, plan: BaseGeometry, low: float, high: float, but: Iterable[Taken] = ()) -> bool:
        """Tell whether a part of the room is inside it, below its ceiling, and not taken."""
        if not self.room.floor.contains(plan):
            return False
        if self.room.height(np.asarray(plan.exterior.coords)).min() < high - 1e-6:
            return False
        spared = {id(one) for one in but}
        return not any(
            one.low < high and low < one.high and one.plan.intersects(plan)
            for one in self.taken
            if id(one) not in spared
        )

    def standing_room(self) -> BaseGeometry:
        """Where a person can stand, metres away from walls and things."""
        blocked = [one.plan for one in self.taken if one.low < _BODY_M and one.high > 0.1]
        return (
            self.room.below(_BODY_M)
            .buffer(-STANDING_M)
            .difference(shapely.union_all(blocked).buffer(STANDING_M, quad_segs=3))
        )

    def put(
        self, name: str, piece: Piece, move: FloatArray, *, but: Iterable[Taken] = (), gap: float = 0.0
    ) -> Taken | None:
        """Put a piece there if its place is free and one can still stand in the room; tell what it takes."""
        (x0, y0, low), (x1, y1, high) = piece.bounds.tolist()
        ring = np.array([[x0 - gap, y0], [x1 + gap, y0], [x1 + gap, y1], [x0 - gap, y1]])
        plan = shapely.Polygon(ring @ move[:2, :2].T + move[:2, 3])
        low, high = low + float(move[2, 3]), high + float(move[2, 3])
        if not self.is_free(plan, low, high, but):
            return None
        took = Taken(plan, low, high)
        self.taken.append(took)
        if low < _BODY_M and self.standing_room().area < _LEAST_M2:
            self.taken.pop()
            return None
        self._counts[name] = self._counts.get(name, 0) + 1
        prefix = f"room {self.number} {name} {self._counts[name]}: "
        self.parts += moved(piece.parts, move, prefix)
        return took

    def put_at_wall(
        self, name: str, piece: Piece, rng: np.random.Generator, *, tries: int = 24, corner: bool = False
    ) -> tuple[Taken, FloatArray] | None:
        """Put a piece with its back to some wall, seldom exactly against it; tell what it takes and where."""
        low, high = piece.bounds
        lengths = np.array([side.end - side.start for side in self.room.sides])
        for _ in range(tries):
            side = self.room.sides[int(rng.choice(len(lengths), p=lengths / lengths.sum()))]
            free = side.end - side.start - (high[0] - low[0]) - 0.04
            if free < 0:
                continue
            share = float(rng.integers(2)) if corner or rng.random() < 0.35 else rng.random()
            s = side.start + 0.02 - side.sign * (low[0] if side.sign > 0 else high[0]) + share * free
            gap = 0.02 + (abs(rng.normal(0, 0.02)) if low[2] < 0.3 else -0.02 + 1e-4)
            move = side_frame(self.plan.walls[side.wall], side.sign, s) @ motion(
                (0, gap - low[1], max(0.0, -low[2]))
            )
            took = self.put(name, piece, move)
            if took is not None:
                return took, move
        return None

    def put_free(
        self, name: str, piece: Piece, rng: np.random.Generator, *, tries: int = 24
    ) -> tuple[Taken, FloatArray] | None:
        """Put a piece anywhere, turned along a wall or anyhow; tell what it takes and where."""
        own = centred(piece)
        low, high = np.array(self.room.floor.bounds).reshape(2, 2)
        for _ in range(tries):
            along = self.plan.walls[self.room.sides[int(rng.integers(len(self.room.sides)))].wall].along
            turn = float(np.arctan2(along[1], along[0])) + rng.integers(4) * np.pi / 2 + rng.normal(0, 0.08)
            move = motion((*rng.uniform(low, high), max(0.0, -float(own.bounds[0, 2]))), turn)
            took = self.put(name, own, move)
            if took is not None:
                x, y = piece.bounds.mean(axis=0)[:2]
                return took, move @ motion((-x, -y, 0))
        return None

    def put_on(
        self, piece: Piece, move: FloatArray, things: Iterable[Piece], rng: np.random.Generator, on: Taken
    ) -> None:
        """Put small things at random places of a piece's tops, where they do not touch each other."""
        own: list[Taken] = []
        for thing in things:
            top = piece.tops[int(rng.integers(len(piece.tops)))]
            (x0, y0, low), (x1, y1, high) = thing.bounds
            reach = float(np.hypot(x1 - x0, y1 - y0)) / 2 + 0.01
            area = np.array([[top[0], top[1]], [top[2], top[3]]]) + [[reach], [-reach]]
            if (area[1] <= area[0]).any():
                continue
            at = rng.uniform(*area)
            local = motion((*at, top[4] - low + 0.0005), rng.normal(0, 0.5)) @ motion(
                (-(x0 + x1) / 2, -(y0 + y1) / 2, 0)
            )
            centre = (move @ [*at, 0, 1])[:2]
            plan = shapely.Point(centre).buffer(reach, quad_segs=3)
            base = float(move[2, 3]) + top[4]
            if not self.is_free(plan, base + 0.002, base + high - low, [on]) or any(
                one.plan.intersects(plan) for one in own
            ):
                continue
            own.append(Taken(plan, base, base + high - low))
            self._counts["thing"] = self._counts.get("thing", 0) + 1
            self.parts += moved(
                thing.parts, move @ local, f"room {self.number} thing {self._counts['thing']}: "
            )
        self.taken += own
