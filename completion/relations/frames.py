# SPDX-License-Identifier: MIT
"""Frames: directions that surfaces share, and those of them that stand at right angles to one another.

Three that are mutually perpendicular are a Manhattan frame (Coughlan and Yuille 1999); one with three or more
across it, at any angles to each other, is an Atlanta frame (Schindler and Dellaert 2004).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.relations.engine.placement import place
from completion.relations.graph import RelationGraph
from scenes.checks import FloatArray

_ALIKE = ("parallel", "coplanar", "coaxial", "regular")
_SQUARE = ("perpendicular", "axis_in_plane")
_LEAST_ACROSS = 3  # directions across the first of an Atlanta frame


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """A direction that surfaces share: unit vector (3,), deviation in radians; the surfaces from 0."""

    vector: FloatArray
    sd: float
    surfaces: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class DirectionFrame:
    """Directions at right angles: three of "manhattan"; of "atlanta" the first stands so to all others.

    Surfaces of one direction have one unknown direction between them, as the relations that hold say.
    """

    kind: Literal["manhattan", "atlanta"]
    directions: tuple[Direction, ...]


def direction_frames(graph: RelationGraph) -> tuple[DirectionFrame, ...]:
    """Return the frames of a graph, by the relations that hold; those of most surfaces first."""
    classes = shared_directions(graph)
    of = {number: k for k, own in enumerate(classes) for number in own}
    square = {
        frozenset((of[relation.surfaces[0]], of[relation.surfaces[1]]))
        for relation in graph.relations
        if relation.kind in _SQUARE and relation.holds
    }
    told = [_direction(own, graph.fits) for own in classes]
    found = [
        DirectionFrame(kind, tuple(told[k] for k in some)) for kind, some in _frames(len(classes), square)
    ]
    return tuple(sorted(found, key=lambda frame: -sum(len(one.surfaces) for one in frame.directions)))


def shared_directions(graph: RelationGraph) -> list[list[int]]:
    """Group the surfaces that have a direction by those which the relations that hold make one."""
    placed = [place(fit.surface, np.zeros(len(fit.covariance))) for fit in graph.fits]
    group = {number: {number} for number, one in enumerate(placed) if one.direction.any()}
    for relation in graph.relations:
        if relation.kind in _ALIKE and relation.holds:
            joined = set().union(*(group[number] for number in relation.surfaces))
            group |= dict.fromkeys(joined, joined)
    return [sorted(own) for number, own in group.items() if min(own) == number]


def frame_records(
    graph: RelationGraph, names: Sequence[Any], turn: FloatArray | None = None
) -> list[dict[str, Any]]:
    """Return the frames as files hold them, by the names (n,) of the surfaces, turned by `turn` (3, 3)."""
    world = np.eye(3) if turn is None else turn
    return [
        {
            "type": frame.kind,
            "directions": [
                {
                    "direction": (world @ one.vector).tolist(),
                    "standard_deviation_deg": float(np.degrees(one.sd)),
                    "surfaces": [names[number] for number in one.surfaces],
                }
                for one in frame.directions
            ],
        }
        for frame in direction_frames(graph)
    ]


def _frames(
    n: int, square: set[frozenset[int]]
) -> Iterator[tuple[Literal["manhattan", "atlanta"], tuple[int, ...]]]:
    """Frames of n directions of which these pairs are at right angles."""
    for three in combinations(range(n), 3):
        if all(frozenset(pair) in square for pair in combinations(three, 2)):
            yield "manhattan", three
    for one in range(n):
        across = [other for other in range(n) if other != one and frozenset((one, other)) in square]
        if len(across) >= _LEAST_ACROSS:
            yield "atlanta", (one, *across)


def _direction(surfaces: Sequence[int], fits: Sequence[SurfaceFit]) -> Direction:
    """What the best known of surfaces says of the direction that they share."""
    known = []
    for number in surfaces:
        at = place(fits[number].surface, np.zeros(len(fits[number].covariance)))
        by = at.across @ at.by_direction
        variance = np.linalg.eigvalsh(by @ fits[number].covariance @ by.T)[-1]
        known.append((float(np.sqrt(max(variance, 0.0))), at.direction))
    sd, vector = min(known, key=lambda one: one[0])
    return Direction(vector, sd, tuple(surfaces))
