# SPDX-License-Identifier: MIT
"""Records: relations as files hold them, and what surfaces were to each other before and after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from completion.fitting.result import SurfaceFit, surface_parameters
from completion.relations.engine.constraint import constrain, spacing_of
from completion.relations.engine.equation import ANGLE, Frame
from completion.relations.engine.placement import place
from completion.relations.engine.relation import Relation
from completion.relations.engine.symmetry import mirror_of
from completion.relations.graph import RelationGraph
from scenes.pose import Pose

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
    found = constrain(relation, at, Frame(at, up))
    size = np.abs(found.value)
    turned = [value for value, row in zip(size, found.rows, strict=True) if row == ANGLE]
    apart = [value for value, row in zip(size, found.rows, strict=True) if row != ANGLE]
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
            "type": one.kind,
            "surfaces": [names[number] for number in one.surfaces],
            "value": None if one.value is None else _value(one),
            "status": one.status.value,
            "p": _finite(one.p),
            "log_evidence": _finite(one.log_evidence),
            "given": one.is_given,
            "reason": one.reason,
            "conflicts": [place + 1 for place in one.conflicts],
            "before": _misfit_record(misfit_of(one, before, up)),
            "after": _misfit_record(misfit_of(one, graph.fits, up)),
            **_pattern_record(one, graph, world),
        }
        for one in graph.relations
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
