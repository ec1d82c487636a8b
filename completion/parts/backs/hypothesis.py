# SPDX-License-Identifier: MIT
"""One hypothesis of a part's symmetry: a mirror plane of the whole, or an axis of some of its surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from completion.parts.backs.weights import AXIS_WEIGHTS, MIRROR_WEIGHTS
from scenes.checks import FloatArray, Value

Provenance = Literal["symmetry", "turn"]


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis(Value):
    """A mirror plane, or an axis about which surfaces go all round.

    Attributes
    ----------
    kind : "mirror" or "axis"
    point, direction : (3,) float
        A place on the plane or axis, metres; unit normal or direction.
    covariance : (3, 3) float
        Of a mirror: two tilts, radians, and the offset along the normal, metres. Zero for an axis.
    evidence : dict of str to float
        What its probability is made of, shares: `matched` of the moved samples fall on measured surface of
        the same kind, `hidden` where no scan saw, `free` before measured surface, `beside` outside the
        outline; `edges` fall on edges and `lost` edges within measured surface.
    surfaces : tuple of int
        Labels: of an axis those that are coaxial, of a mirror none.
    probability : float
    """

    kind: Literal["mirror", "axis"]
    point: FloatArray
    direction: FloatArray
    covariance: FloatArray
    evidence: dict[str, float]
    surfaces: tuple[int, ...] = ()
    probability: float = 0.0

    @property
    def relation(self) -> str:
        """The relation of surfaces that it states."""
        return "symmetric" if self.kind == "mirror" else "coaxial"

    @property
    def isometry(self) -> FloatArray:
        """The reflection (3, 4) of a mirror."""
        return reflection(self.point, self.direction)

    def record(self) -> dict[str, Any]:
        """Return what files hold of it."""
        return {
            "kind": self.kind,
            "relation": self.relation,
            "point_m": self.point.tolist(),
            "direction": self.direction.tolist(),
            "surfaces": list(self.surfaces),
            "probability": self.probability,
            **self.evidence,
        }

    def spread(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Standard deviation (n,) of mirrored points (n, 3) along their mirrored normals, metres."""
        slope = np.einsum(
            "nij,ni->nj", mirror_change(self.point, self.direction, points),
            normals @ self.isometry[:, :3].T,
        )  # fmt: skip
        variance = np.einsum("ni,ij,nj->n", slope, self.covariance, slope)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def features(one: Hypothesis) -> FloatArray:
    """Return the terms (k,) of the logistic model of a hypothesis; the first is 1."""
    e = one.evidence
    refuted = e["free"] + e["beside"]
    if one.kind == "mirror":
        return np.array([
            1.0, np.log(e["matched"] + 0.03), np.log(refuted + 0.003), e["hidden"], e["edges"],
            np.log(e["lost"] + 0.01), e["across"], e["balance"],
        ])  # fmt: skip
    return np.array([
        1.0, np.log(e["matched"] + 0.03), np.log(refuted + 0.003), e["hidden"], e["arc"], e["rim"], e["open"],
        e["concave"], np.log(e["lost"] + 0.01), e["coaxial"],
    ])  # fmt: skip


def probability(one: Hypothesis) -> float:
    """Return how probable a hypothesis is: a logistic model fitted by `benchmarks run part-backs-fit`."""
    weights = np.array(MIRROR_WEIGHTS if one.kind == "mirror" else AXIS_WEIGHTS)
    return float(1 / (1 + np.exp(-np.clip(features(one) @ weights, -30, 30))))


def reflection(point: FloatArray, normal: FloatArray) -> FloatArray:
    """Return the isometry (3, 4) that mirrors at a plane."""
    turned = np.eye(3) - 2 * np.outer(normal, normal)
    return np.concatenate([turned, (2 * (point @ normal) * normal)[:, None]], axis=1)


def mirror_change(point: FloatArray, normal: FloatArray, points: FloatArray) -> FloatArray:
    """Change (n, 3, 3) of mirrored points (n, 3) with two tilts of a mirror about its point, and offset."""
    first, second = across(normal)
    away = points - point
    height = (away @ normal)[:, None]
    tilts = [-2 * (height * way + (away @ way)[:, None] * normal) for way in (first, second)]
    return np.stack([*tilts, np.broadcast_to(2 * normal, points.shape)], axis=2)


def across(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors (3,) at right angles to a unit vector and each other."""
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first = first / np.linalg.norm(first)
    return first, np.cross(normal, first)
