# SPDX-License-Identifier: MIT
"""Contacts: balls that touch faces, of no radius where these meet; places along an edge in even steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from completion.parts.dimensions.joint_surfaces import JointSurfaces
from completion.relations.equations import Placement, surface_at
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Surface

_N_STEPS, _STILL_M = 12, 1e-12  # of Newton's method: how many at most, metres from which it has ended
_FLAT = 1e-6  # squared sine between faces that do not meet


class Contact(NamedTuple):
    """Centres (n, 3) of balls that touch m faces, which way (n, m, 3) these are, and how centres move (n, 3).

    As the radius grows, metres a metre.
    """

    centre: FloatArray
    way: FloatArray
    by_radius: FloatArray

    def seen(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far points (n, 3) are from their centres, and which way."""
        step = points - self.centre
        far = np.linalg.norm(step, axis=1)
        return far, step / np.maximum(far, 1e-300)[:, None]

    def has(self, points: FloatArray) -> BoolArray:
        """Which points (n, 3) their ball has between its contacts, as seen from its centre."""
        square = self.way @ self.way.transpose(0, 2, 1)
        parts = np.linalg.solve(square, self.way @ self.seen(points)[1][:, :, None])[..., 0]
        return np.asarray((parts > 0).all(axis=1))


def contact(surfaces: Sequence[Surface], signs: FloatArray, radius: float, start: FloatArray) -> Contact:
    """Where a ball touches m faces on the sides `signs` (m,), from near places (n, 3), across the edge.

    Of no radius: where the faces meet. NaN where they do not.
    """
    centre = start.copy()
    for _ in range(_N_STEPS):
        normal = np.stack([surface.normal(centre) for surface in surfaces], axis=1)
        off = np.stack([surface.distance(centre) for surface in surfaces], axis=1)
        square = normal @ normal.transpose(0, 2, 1)
        is_flat = np.linalg.det(square) < _FLAT
        normal[is_flat], square[is_flat] = np.nan, np.nan
        lack = np.stack([signs * radius - off, np.broadcast_to(signs, off.shape)], axis=2)
        step, by_radius = (normal.transpose(0, 2, 1) @ np.linalg.solve(square, lack)).transpose(2, 0, 1)
        centre = centre + step
        if not np.abs(step[np.isfinite(step)]).max(initial=0.0) > _STILL_M:
            break
    return Contact(centre, -signs[:, None] * normal, by_radius)


def meeting(
    known: JointSurfaces, places: Sequence[int], like: Sequence[Surface], start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where faces by their places meet, from near points (n, 3) on, and the covariance (n, 3, 3) of that."""
    found = known.estimate(
        places, lambda at: contact(surfaces_at(at, like), np.ones(len(like)), 0.0, start).centre.ravel()
    )
    n = len(start)
    return found.value.reshape(n, 3), found.covariance.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n)]


def surfaces_at(at: Sequence[Placement], like: Sequence[Surface]) -> list[Surface]:
    """Surfaces at placements, of the kinds of others."""
    return [surface_at(one, two) for one, two in zip(at, like, strict=True)]


def spread(points: FloatArray, along: FloatArray, n: int) -> FloatArray:
    """Out of many points those (n, 3) at even steps of their places (m,) along an edge."""
    order = np.argsort(along, kind="stable")
    wanted = np.linspace(along[order[0]], along[order[-1]], n)
    return np.asarray(points[order[np.minimum(np.searchsorted(along[order], wanted), len(order) - 1)]])


def turns(at: Placement, points: FloatArray) -> FloatArray:
    """Angles (m,) of points about an axis, from where the widest gap between them ends."""
    step = points - at.point
    angle = np.arctan2(step @ at.across[1], step @ at.across[0])
    inorder = np.sort(angle)
    gap = np.diff(inorder, append=inorder[0] + 2 * np.pi)
    first = inorder[(int(np.argmax(gap)) + 1) % len(inorder)]
    return np.asarray((angle - first) % (2 * np.pi))
