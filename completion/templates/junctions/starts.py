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
_SPLITS = (0.25, 0.5, 0.75)  # of an arc, where a joint may be
_BENDS = ((1.4, 0.7), (0.7, 1.4))  # of the curvature of one arc, on both sides of a joint


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


def split_starts(single: Model, points: FloatArray, near: BoolArray, is_free: BoolArray) -> list[Model]:
    """Return starts for two tangent arcs from one arc that points (n, 3) fit best, some of them near.

    The joint lies at a quarter, half and three quarters of the arc; one side bends more and the other less.
    """
    k = float(single.shape[0])
    local = single.local(points[near] if near.any() else points)
    angles = np.arctan2(k * local[:, 1], 1 + k * local[:, 0]) if k else local[:, 1]
    starts = []
    for angle in np.quantile(angles, _SPLITS):
        turn, shift = np.eye(3), np.array([0.0, angle, 0.0])
        if k:
            cosine, sine = np.cos(angle), np.sin(angle)
            turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
            shift = np.array([(cosine - 1) / k, sine / k, 0.0])
        origin = single.origin + shift @ single.turn
        for first, second in _BENDS:
            shape = np.array([first * k, second * k])
            starts.append(Model(single.profile, turn @ single.turn, origin, shape, is_free))
    return starts
