# SPDX-License-Identifier: MIT
"""Starts: models to begin with, and points brought to unit RMS for them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from completion.templates.engine.measured import Measured
from completion.templates.junctions.model import Model, Profile
from scenes.checks import BoolArray, FloatArray

N_DIRECTIONS = 12
_SPLITS = (0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85)  # of an arc, where a joint may be
_NEAR, _N_REWEIGHTED = 4.0, 6  # sigmas from one arc within which points tell where two are; rounds


class Unit(NamedTuple):
    """What was measured, about its median and at unit RMS."""

    measured: Measured
    centre: FloatArray  # (3,) in the old unit
    factor: float  # new units in an old one

    @property
    def points(self) -> FloatArray:
        """Return the points (n, 3)."""
        return self.measured.points

    def outside(self, points: FloatArray) -> FloatArray:
        """Return points (..., 3) in the old unit."""
        return np.asarray(points / self.factor + self.centre)


def at_unit(measured: Measured) -> Unit:
    """Return what was measured at unit RMS."""
    centre = np.median(measured.points, axis=0)
    square = ((measured.points - centre) ** 2).sum(axis=1)
    factor = 1 / max(float(np.sqrt(square.mean())), 1e-300)
    beams = measured.beams and replace(measured.beams, origins=measured.beams.origins - centre)
    moved = replace(measured, points=measured.points - centre, beams=beams)
    return Unit(moved.scaled(factor), centre, factor)


def flat_starts(
    points: FloatArray,
    profile: Profile,
    shapes: FloatArray,
    is_free: BoolArray,
    ties: FloatArray | None = None,
    n_directions: int = N_DIRECTIONS,
) -> list[Model]:
    """Return starts in the principal frame of points (n, 3), with each of the shapes (m, s).

    x lies along the direction of least variance, z in so many directions across it.
    """
    centre = points.mean(axis=0)
    _, axes = np.linalg.eigh((points - centre).T @ (points - centre))
    normal, first, second = axes.T
    starts = []
    for angle in np.arange(n_directions) * np.pi / n_directions:
        along = np.cos(angle) * first + np.sin(angle) * second
        turn = np.stack([normal, np.cross(along, normal), along])
        starts += [Model(profile, turn, centre, shape, is_free, ties=ties) for shape in shapes]
    return starts


def split_starts(single: Model, points: FloatArray, sigma: float, is_free: BoolArray) -> list[Model]:
    """Return starts for two tangent arcs from one arc that points (n, 3) fit best, with noise of sigma.

    For each of some joints along the arc, what both sides bend more or less than it is linear in the
    distances from it: c + b s + a1 s^2 / 2 where s > 0, and a2 where s < 0, with s the length of arc from the
    joint; solved with weights that fall with the distance left over (Cauchy's). The model most likely by
    these is a better start than one of guessed bends: outliers hide which of several valleys is the deepest.
    """
    k, local, far = float(single.shape[0]), single.local(points), single.distance(points)
    near = np.abs(far) < _NEAR * sigma
    angles = np.arctan2(k * local[:, 1], 1 + k * local[:, 0]) if k else local[:, 1]
    starts = []
    for angle in np.quantile(angles[near] if near.any() else angles, _SPLITS):
        s = (angles - angle) / k if k else angles - angle
        shift_out, lean, *bends = _bent(s, far, near, sigma)
        cosine, sine = (np.cos(angle), np.sin(angle)) if k else (1.0, 0.0)
        arc = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        place = np.array([(cosine - 1) / k, sine / k, 0.0]) if k else np.array([0.0, angle, 0.0])
        leaning = np.array([[1.0, -lean, 0.0], [lean, 1.0, 0.0], [0.0, 0.0, np.hypot(1.0, lean)]])
        turn = leaning / np.hypot(1.0, lean) @ arc
        origin = single.origin + (place + shift_out * arc[0]) @ single.turn
        shape = k - np.array(bends)
        starts.append(Model(single.profile, turn @ single.turn, origin, shape, is_free))
    return starts


def _bent(s: FloatArray, far: FloatArray, near: BoolArray, sigma: float) -> FloatArray:
    """Coefficients (4,) of distances (n,) by lengths of arc s (n,): 1, s, s^2 / 2 on each side."""
    square = s**2 / 2
    columns = np.column_stack([np.ones(len(s)), s, np.where(s > 0, square, 0), np.where(s > 0, 0, square)])
    weight = near.astype(np.float64)
    for _ in range(_N_REWEIGHTED):
        root = np.sqrt(weight)
        found = np.linalg.lstsq(root[:, None] * columns, root * far, rcond=None)[0]
        weight = 1 / (1 + ((far - columns @ found) / sigma) ** 2) ** 2
    return np.asarray(found)
