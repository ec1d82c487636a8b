# SPDX-License-Identifier: MIT
"""The graph of relations: what became of each, how free the surfaces still are, and its records in files.

Frames: directions that surfaces share, and those of them that stand at right angles to one another.
Three that are mutually perpendicular are a Manhattan frame (Coughlan and Yuille 1999); one with three or more
across it, at any angles to each other, is an Atlanta frame (Schindler and Dellaert 2004).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Literal, NamedTuple

import numpy as np

from completion.fitting.result import SurfaceFit, surface_parameters
from completion.relations.constraint import constrain, mirror_of, spacing_of
from completion.relations.equations import ANGLE, RelationFrame, move_surface, place
from completion.relations.estimate import JointEstimate
from completion.relations.limits import FEWEST_ACROSS, MOST_FRAME_SD, MOST_RADIUS_SD
from completion.relations.options import RelationOptions
from completion.relations.relation import Relation, RelationStatus
from scenes.checks import FloatArray, Value
from scenes.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class RelationGraph(Value):
    """Surfaces and their relations.

    Attributes
    ----------
    fits : tuple of SurfaceFit
        The surfaces where the relations hold, with their covariances given these.
    relations : tuple of Relation
        All that were stated or proposed, in the order in which they were examined.
    changes : tuple of (k,) float
        How far the parameters of each surface were moved, in the chart of its fit before (`place`).
    moved_sd : tuple of float
        How far each surface was moved, the greatest part of it, in the standard deviations of its fit.
    unknowns, rank : int
        Parameters of all surfaces, and how many of them the relations take away.
    options : RelationOptions
        How exactly things were taken to be built, and what was looked for.
    covariance : (unknowns, unknowns) float
        Of the parameters of all surfaces, one after the other, given the relations; in the charts of the
        fits before.
    """

    fits: tuple[SurfaceFit, ...]
    relations: tuple[Relation, ...]
    changes: tuple[FloatArray, ...]
    moved_sd: tuple[float, ...]
    unknowns: int
    rank: int
    options: RelationOptions
    covariance: FloatArray

    @classmethod
    def of(
        cls, estimate: JointEstimate, relations: Sequence[Relation], options: RelationOptions
    ) -> RelationGraph:
        """Return what the estimate came to."""
        fits, changes, moves = [], [], []
        for number, fit in enumerate(estimate.fits):
            change = estimate.change(number)
            fits.append(
                replace(
                    fit, surface=move_surface(fit.surface, change), covariance=estimate.covariance_of(number)
                )
            )
            changes.append(change)
            moves.append(estimate.moved_sd(number))
        return cls(
            fits=tuple(fits),
            relations=tuple(relations),
            changes=tuple(changes),
            moved_sd=tuple(moves),
            unknowns=estimate.n_unknowns,
            rank=estimate.rank,
            options=options,
            covariance=estimate.covariance,
        )

    @property
    def free(self) -> int:
        """Degrees of freedom that are left."""
        return self.unknowns - self.rank

    @property
    def accepted(self) -> tuple[Relation, ...]:
        """The relations that are imposed."""
        return tuple(relation for relation in self.relations if relation.status is RelationStatus.ACCEPTED)

    def count_with(self, status: RelationStatus) -> int:
        """How many relations came to a status."""
        return sum(relation.status is status for relation in self.relations)

    def __repr__(self) -> str:
        counts = ", ".join(f"{self.count_with(status)} {status.value}" for status in RelationStatus)
        return f"RelationGraph({len(self.fits)} surfaces, {counts}, {self.free} of {self.unknowns} free)"


def is_settled(fit: SurfaceFit) -> bool:
    """Whether a surface is known so well that its equations are linear within what is doubtful of it."""
    deviations = fit.parameter_deviations()
    if max(deviations.get("direction", 0.0), deviations.get("normal", 0.0)) >= MOST_FRAME_SD:
        return False
    radii = [name for name in ("radius", "tube_radius") if name in deviations]
    return all(deviations[name] < MOST_RADIUS_SD * float(getattr(fit.surface, name)) for name in radii)


FORMAT = "unseen-relations/1"
_IN_DEGREES = ("angle", "half_angle")


class Misfit(NamedTuple):
    """How far surfaces are from a relation: degrees of its angles and metres of its lengths; NaN for none."""

    angle_deg: float
    length_m: float


def misfit_of(relation: Relation, fits: Sequence[SurfaceFit], up: np.ndarray | None = None) -> Misfit:
    """Return how far fits are from a relation of theirs; `up` (3,) is against gravity where that is known."""
    at = {number: place(fits[number].surface, np.zeros(len(fits[number].covariance)))
          for number in relation.surfaces}  # fmt: skip
    constraint = constrain(relation, at, RelationFrame(at, up))
    size = np.abs(constraint.value)
    turned = [value for value, row in zip(size, constraint.rows, strict=True) if row == ANGLE]
    apart = [value for value, row in zip(size, constraint.rows, strict=True) if row != ANGLE]
    return Misfit(
        float(np.degrees(np.hypot.reduce(turned))) if turned else float("nan"),
        float(np.hypot.reduce(apart)) if apart else float("nan"),
    )


def relation_records(
    graph: RelationGraph,
    before: Sequence[SurfaceFit],
    names: Sequence[Any],
    *,
    up: np.ndarray | None = None,
    world: Pose | None = None,
) -> list[dict[str, Any]]:
    """Return the relations of a graph as files hold them, by the names (n,) of its surfaces.

    `before` are the fits (n,) without relations. Values are metres, degrees of angles; `conflicts` are places
    in this list, from 1; `before` and `after` say how far the surfaces were from it, and are. A row says its
    spacing, and pairs their mirror, in the frame that `world` leads to.
    """
    return [
        {
            "type": relation.kind,
            "surfaces": [names[number] for number in relation.surfaces],
            "value": None if relation.value is None else _value(relation),
            "status": relation.status.value,
            "p": _finite(relation.p),
            "log_evidence": _finite(relation.log_evidence),
            "given": relation.is_given,
            "reason": relation.reason,
            "conflicts": [place + 1 for place in relation.conflicts],
            "before": _misfit_record(misfit_of(relation, before, up)),
            "after": _misfit_record(misfit_of(relation, graph.fits, up)),
            **_pattern_record(relation, graph, world),
        }
        for relation in graph.relations
    ]


def freedom_record(graph: RelationGraph) -> dict[str, int]:
    """Return how free the surfaces are, as files hold it."""
    return {"unknowns": graph.unknowns, "rank": graph.rank, "free": graph.free}


def surface_record(fit: SurfaceFit, label: int) -> dict[str, Any]:
    """Return a surface as `relations.json` holds it, metres, degrees."""
    held = {name: value for name, value in surface_parameters(fit.surface).items() if name in _PARAMETERS}
    return {
        "label": label,
        "kind": fit.surface.kind,
        **held,
        "standard_deviation": {name: _finite(sd) for name, sd in fit.parameter_deviations().items()},
    }


def _pattern_record(relation: Relation, graph: RelationGraph, world: Pose | None) -> dict[str, Any]:
    """The spacing of a row that holds, or the mirror of pairs that do."""
    if relation.kind not in ("regular", "symmetric") or not relation.holds:
        return {}
    at = {number: place(graph.fits[number].surface, np.zeros(len(graph.fits[number].covariance)))
          for number in relation.surfaces}  # fmt: skip
    if relation.kind == "regular":
        return {"spacing_m": spacing_of(relation.surfaces, at)}
    mirror = mirror_of(relation.surfaces, at)
    point, normal = mirror.point[None], mirror.normal[None]
    if world is not None:
        point, normal = world.apply(point), world.rotate(normal)
    return {"mirror": {"point": point[0].tolist(), "normal": normal[0].tolist()}}


_PARAMETERS = ("point", "centre", "normal", "direction", "radius", "tube_radius", "half_angle_deg")


def _value(relation: Relation) -> float:
    value = float(relation.value or 0.0)
    return float(np.degrees(value)) if relation.kind in _IN_DEGREES else value


def _misfit_record(misfit: Misfit) -> dict[str, float | None]:
    return {"angle_deg": _finite(misfit.angle_deg), "length_m": _finite(misfit.length_m)}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


_ALIKE = ("parallel", "coplanar", "coaxial", "regular")
_SQUARE = ("perpendicular", "axis_in_plane")


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
    of = {number: k for k, kind in enumerate(classes) for number in kind}
    square = {
        frozenset((of[relation.surfaces[0]], of[relation.surfaces[1]]))
        for relation in graph.relations
        if relation.kind in _SQUARE and relation.holds
    }
    directions = [_direction(kind, graph.fits) for kind in classes]
    frames = [
        DirectionFrame(kind, tuple(directions[k] for k in numbers))
        for kind, numbers in _frames(len(classes), square)
    ]
    return tuple(
        sorted(frames, key=lambda frame: -sum(len(direction.surfaces) for direction in frame.directions))
    )


def shared_directions(graph: RelationGraph) -> list[list[int]]:
    """Group the surfaces that have a direction by those which the relations that hold make one."""
    placed = [place(fit.surface, np.zeros(len(fit.covariance))) for fit in graph.fits]
    group = {number: {number} for number, placement in enumerate(placed) if placement.direction.any()}
    for relation in graph.relations:
        if relation.kind in _ALIKE and relation.holds:
            joined = set().union(*(group[number] for number in relation.surfaces))
            group |= dict.fromkeys(joined, joined)
    return [sorted(numbers) for number, numbers in group.items() if min(numbers) == number]


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
                    "direction": (world @ direction.vector).tolist(),
                    "standard_deviation_deg": float(np.degrees(direction.sd)),
                    "surfaces": [names[number] for number in direction.surfaces],
                }
                for direction in frame.directions
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
    for number in range(n):
        across = [other for other in range(n) if other != number and frozenset((number, other)) in square]
        if len(across) >= FEWEST_ACROSS:
            yield "atlanta", (number, *across)


def _direction(surfaces: Sequence[int], fits: Sequence[SurfaceFit]) -> Direction:
    """What the best known of surfaces says of the direction that they share."""
    known = []
    for number in surfaces:
        at = place(fits[number].surface, np.zeros(len(fits[number].covariance)))
        by = at.across @ at.by_direction
        variance = np.linalg.eigvalsh(by @ fits[number].covariance @ by.T)[-1]
        known.append((float(np.sqrt(max(variance, 0.0))), at.direction))
    sd, vector = min(known, key=lambda pair: pair[0])
    return Direction(vector, sd, tuple(surfaces))
