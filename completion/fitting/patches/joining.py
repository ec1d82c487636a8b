# SPDX-License-Identifier: MIT
"""Joins as equations of two rows of controls: that on a boundary, and the next one.

A plane is met exactly by linear equations: the row on the boundary lies on it; tangent: the next row too;
orthogonal: each control of the next row lies along the normal from its neighbour on the boundary.

A cylinder is met at as many places as a row has controls, by equations linearised where the controls are.
Between these places it is met as closely as the row is smooth. So the angle about the axis, and how far the
next row reaches, are cubic along the boundary: that takes freedom from the parameters, not from the shape.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from completion.fitting.patches.basis import Basis
from completion.fitting.patches.boundary import Boundary, Join
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane

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
    told: tuple[bool, bool] = (False, False),
) -> JoinEquations:
    """Return the equations of a join, of the row on the boundary (m, 3) and the next one (m, 3).

    `told` says at which ends others say how the boundary begins: there a cylinder is asked one place less.
    """
    n, surface = along.n, boundary.surface
    if isinstance(surface, Plane):
        parts = [(np.eye(n), one) for one in _plane_terms(surface, boundary.join, outer, inner - outer)]
        return _gathered(parts, np.eye(n))
    seen = along.values(along.stations)
    asked = np.delete(np.eye(n), [k for k, is_told in zip((1, n - 2), told, strict=True) if is_told], axis=0)
    rough = np.linalg.qr(np.polynomial.legendre.legvander(2 * along.stations - 1, _SMOOTH), "complete")[0]
    exact, smooth = _cylinder_terms(surface, boundary.join, seen @ outer, seen @ (inner - outer))
    parts = [(asked, one) for one in exact] + [(rough[:, _SMOOTH + 1 :].T, one) for one in smooth]
    return _gathered(parts, seen)


def _gathered(parts: list[tuple[FloatArray, _Term]], seen: FloatArray) -> JoinEquations:
    """Combinations of terms, as equations of controls that stations see by `seen` (m, m)."""
    misfit = [by @ one.value for by, one in parts]
    by_outer = [
        np.einsum("qk,kj,kc->qjc", by, seen, one.by_at - one.by_step, optimize=True) for by, one in parts
    ]
    by_inner = [np.einsum("qk,kj,kc->qjc", by, seen, one.by_step, optimize=True) for by, one in parts]
    return JoinEquations(*(np.concatenate(some) for some in (misfit, by_outer, by_inner)))


def _plane_terms(plane: Plane, join: Join, at: FloatArray, step: FloatArray) -> list[_Term]:
    none, normal = np.zeros_like(at), plane.normal(at)
    found = [_Term(plane.distance(at), normal, none)]
    axes = {
        Join.CONNECTED: (),
        Join.TANGENT: (plane.normal_direction,),
        Join.ORTHOGONAL: (plane.u_direction, plane.v_direction),
    }[join]
    return found + [_Term(step @ axis, none, np.broadcast_to(axis, at.shape)) for axis in axes]


def _cylinder_terms(
    tube: Cylinder, join: Join, at: FloatArray, step: FloatArray
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
    if join is Join.TANGENT:
        return [*exact, along_normal], [*smooth, along_side]
    if join is Join.ORTHOGONAL:
        return [*exact, along_side, along_axis], [*smooth, along_normal]
    return exact, smooth


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", one, other))
