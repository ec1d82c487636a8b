# SPDX-License-Identifier: MIT
"""Symmetries of an upright thing: vertical mirrors, axes and turns, with what speaks for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from completion.backs.limits import CELL, N_COARSE, N_LIMB, N_POINTS
from completion.backs.views import Scale, Sight
from scenes.checks import FloatArray, IntArray, Value

Kind = Literal["mirror", "axis", "turn"]


@dataclass(frozen=True, slots=True, eq=False)
class Symmetry(Value):
    """One hypothesis: an isometry, or a group of them, that may map the thing into itself.

    Attributes
    ----------
    kind : "mirror", "axis" or "turn"
        A vertical mirror plane; an axis of revolution; turns by 360 / `n_fold` degrees about an axis.
    place : (2,) float
        Mirror: angle of its normal from x, radians, and n (x - middle). Else the axis in plan minus `middle`.
    middle : (3,) float
        Middle of the thing's box, metres, to which `place` refers.
    covariance : (2, 2) float
        Of `place`.
    evidence : dict of str to float
        `matched`, `contradicted`, `hidden`: shares m, f, h of the moved points; `limb`: share b of the limb
        that comes to lie on the limb; and the other numbers that the probability is made of.
    n_fold : int
        Of a turn; 0 for the others.
    probability : float
        That 85 % of the whole surface maps within 1.5 % of the thing's size.
    """

    kind: Kind
    place: FloatArray
    middle: FloatArray
    covariance: FloatArray
    evidence: dict[str, float]
    n_fold: int = 0
    probability: float = 0.0

    @property
    def normal(self) -> FloatArray:
        """Unit normal (3,) of a mirror."""
        return np.array([np.cos(self.place[0]), np.sin(self.place[0]), 0.0])

    @property
    def offset_m(self) -> float:
        """The mirror is n x = offset, metres."""
        return float(self.normal @ self.middle + self.place[1])

    @property
    def axis(self) -> FloatArray:
        """A place (3,) on the axis, metres; it is vertical."""
        return np.asarray(self.middle + np.array([*self.place, 0.0]))

    def isometries(self, n_turns: int) -> FloatArray:
        """The isometries (k, 3, 4) besides the identity; those of an axis are `n_turns` - 1 turns."""
        if self.kind == "mirror":
            return mirrors(self.place[None], self.middle)
        n = self.n_fold if self.kind == "turn" else n_turns
        return turns(self.place, self.middle, 2 * np.pi * np.arange(1, n) / n)

    def spread(self, points: FloatArray, normals: FloatArray, isometry: FloatArray) -> FloatArray:
        """Standard deviation (n,) of points (n, 3), moved by an isometry, along their moved normals.

        The covariance of the mirror or axis, carried to where the points come to lie.
        """
        facing = normals @ isometry[:, :3].T
        if self.kind == "mirror":
            by_place = mirror_change(self.place, points - self.middle)
        else:
            turned = np.eye(3) - isometry[:, :3]
            by_place = np.broadcast_to(turned[None, :, :2], (len(points), 3, 2))
        slope = np.einsum("ni,nij->nj", facing, by_place)
        variance = np.einsum("ni,ij,nj->n", slope, self.covariance, slope)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def mirrors(places: FloatArray, middle: FloatArray) -> FloatArray:
    """Return reflections (k, 3, 4) of mirrors (k, 2): angle of the normal, and n (x - middle)."""
    normal = np.stack([np.cos(places[:, 0]), np.sin(places[:, 0]), 0 * places[:, 0]], axis=1)
    out = np.empty((len(places), 3, 4))
    out[:, :, :3] = np.eye(3) - 2 * normal[:, :, None] * normal[:, None, :]
    out[:, :, 3] = 2 * (places[:, 1] + normal @ middle)[:, None] * normal
    return out


def turns(place: FloatArray, middle: FloatArray, angles: FloatArray) -> FloatArray:
    """Return turns (k, 3, 4) about the vertical axis through middle + place, by angles (k,), radians."""
    out = np.zeros((len(angles), 3, 4))
    out[:, 0, 0] = out[:, 1, 1] = np.cos(angles)
    out[:, 1, 0] = np.sin(angles)
    out[:, 0, 1] = -out[:, 1, 0]
    out[:, 2, 2] = 1.0
    axis = middle + np.array([*place, 0.0])
    out[:, :, 3] = axis - out[:, :, :3] @ axis
    return out


def mirror_change(place: FloatArray, points: FloatArray) -> FloatArray:
    """Change (n, 3, 2) of mirrored points (n, 3), about the middle, with angle and offset of the mirror."""
    cosine, sine = np.cos(place[0]), np.sin(place[0])
    normal, along = np.array([cosine, sine, 0.0]), np.array([-sine, cosine, 0.0])
    off, aside = points @ normal - place[1], points @ along
    turn = -2 * (aside[:, None] * normal + off[:, None] * along)
    return np.stack([turn, np.broadcast_to(2 * normal, points.shape)], axis=2)


def move(isometry: FloatArray, points: FloatArray) -> FloatArray:
    """Return points (n, 3) moved by an isometry (3, 4)."""
    return np.asarray(points @ isometry[:, :3].T + isometry[:, 3])


def product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the isometry (3, 4) that applies `second`, then `first`."""
    return np.concatenate([first[:, :3] @ second[:, :3], move(first, second[:, 3][None]).T], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Points of a thing that symmetries are tested with.

    Attributes
    ----------
    points, normals : (n, 3) float
        One a cell, metres; the first `n_coarse` in the coarse search.
    n_coarse : int
        How many those are.
    limbs, some_limbs : tuple of (k,) int
        For each view flat pixels of the limb: all that are used, and those of the coarse search.
    """

    points: FloatArray
    normals: FloatArray
    n_coarse: int
    limbs: tuple[IntArray, ...]
    some_limbs: tuple[IntArray, ...]


def draw_sample(sights: Sequence[Sight], scale: Scale, rng: np.random.Generator) -> Sample:
    """Draw points with normals, one a cell, and limb points of each view."""
    known = [sight.thing & (sight.normals != 0).any(axis=1) for sight in sights]
    points = np.concatenate([sight.points[one] for sight, one in zip(sights, known, strict=True)])
    normals = np.concatenate([sight.normals[one] for sight, one in zip(sights, known, strict=True)])
    order = rng.permutation(len(points))
    order = order[one_a_cell(points[order], CELL * scale.size)]
    order = rng.permutation(order)[:N_POINTS]
    limbs = [rng.permutation(np.flatnonzero(sight.limb & ~sight.cut)) for sight in sights]
    few = -(-N_LIMB // len(sights))
    return Sample(
        points[order], normals[order], min(N_COARSE, len(order)),
        tuple(one[: 4 * few] for one in limbs), tuple(one[:few] for one in limbs),
    )  # fmt: skip


def one_a_cell(points: FloatArray, cell: float) -> IntArray:
    """Return the numbers (m,) of the first point (n, 3) in each cell, ascending."""
    index = np.floor(points / cell).astype(np.int64)
    index -= index.min(axis=0, initial=0)
    extent = index.max(axis=0, initial=0) + 1
    key = (index[:, 0] * extent[1] + index[:, 1]) * extent[2] + index[:, 2]
    return np.sort(np.unique(key, return_index=True)[1])
