# SPDX-License-Identifier: MIT
"""Shafts: upright cylinders among points, by where the normals of their walls meet."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from completion.templates.solids.upright import UprightSample
from scenes.checks import FloatArray

_N_RADII = 28
_LEAST_RADIUS, _MOST_RADIUS = 4.0, 0.25  # of the spacing, and of the size of the scene
_CELL = 0.2  # of the radius: how near centres must be to each other
_PEAKS = 4  # cells of most centres, of each radius
_N_BINS, _LEAST_BINS = 24, 6  # of directions round the axis: a quarter turn must be seen
_LEAST_POINTS = 20
_AROUND, _ON, _NOISES = (
    0.15,
    0.03,
    4.0,
)  # of the radius: what lies about a circle, what on it; or of the noise
_LEAST_SHARE = 0.6  # of what lies about it
_MOST = 4  # shafts


class Shaft(NamedTuple):
    """An upright cylinder, and how many of the points that were looked at lie on it."""

    x: float
    y: float
    radius: float
    n: int = 0


def find_shafts(
    sample: UprightSample, spacing: float, noise: float, *, radius: float | None = None
) -> list[Shaft]:
    """Return upright cylinders, the one of most points first.

    A point of a cylinder has its axis a radius away along its normal, to one side or the other. For each of
    some radii the axes of all points are counted in cells (Hough 1962): those of a wall are spread along it,
    those of a cylinder lie in one. A circle is then fitted to what lies about it; it counts if most of that
    lies on it, and is seen from a quarter turn.

    Parameters
    ----------
    sample : UprightSample
        Points of an upright frame, with their normals.
    spacing, noise : float
        Between neighbouring points of all; of a point.
    radius : float, optional
        If it is known.
    """
    points, normals = sample.steep
    if len(points) < _LEAST_POINTS:
        return []
    flat, way = points[:, :2], normals[:, :2] / np.linalg.norm(normals[:, :2], axis=1, keepdims=True)
    size = float(np.ptp(flat, axis=0).max())
    low, high = _LEAST_RADIUS * spacing, _MOST_RADIUS * size
    radii = np.array([radius]) if radius is not None else np.geomspace(low, max(high, low), _N_RADII)
    fitted = [
        _fitted(flat, rough, noise, fixed=radius is not None)
        for one in radii
        for rough in _peaks(flat, way, one)
    ]
    found: list[Shaft] = []
    for shaft in sorted((one for one in fitted if one.n), key=lambda one: -one.n):
        if all(np.hypot(shaft.x - one.x, shaft.y - one.y) > max(shaft.radius, one.radius) for one in found):
            found.append(shaft)
    return found[:_MOST]


def _peaks(flat: FloatArray, way: FloatArray, radius: float) -> Iterator[Shaft]:
    """Where most points (n, 2) have an axis of a radius in one cell, along their normals (n, 2)."""
    centres = np.concatenate([flat - radius * way, flat + radius * way])
    low = centres.min(axis=0)
    for shift in (0.0, 0.5):
        column, row = np.floor((centres - low) / (_CELL * radius) + shift).astype(np.int64).T
        _, member, count = np.unique(column * (row.max() + 1) + row, return_inverse=True, return_counts=True)
        for number in np.argsort(-count, kind="stable")[:_PEAKS]:
            if count[number] >= _LEAST_POINTS:
                middle = centres[member == number].mean(axis=0)
                yield Shaft(float(middle[0]), float(middle[1]), radius)


def _fitted(flat: FloatArray, rough: Shaft, noise: float, *, fixed: bool) -> Shaft:
    """The circle through the points (n, 2) about a rough one by least squares; of no points if it is none."""
    shaft = rough
    for width in (_AROUND, _AROUND, _ON, _ON):
        away = flat - [shaft.x, shaft.y]
        out = np.hypot(*away.T)
        near = np.abs(out - shaft.radius) < max(width * shaft.radius, _NOISES * noise)
        if near.sum() < _LEAST_POINTS:
            return rough
        unit = away[near] / out[near, None]
        slopes = np.column_stack([unit, np.ones(len(unit))])[:, : 2 if fixed else 3]
        step = np.linalg.lstsq(slopes, out[near] - shaft.radius, rcond=None)[0]
        x, y, radius = np.array(shaft[:3]) + np.append(step, 0.0)[:3]
        if not 0.5 * rough.radius < radius < 2 * rough.radius:
            return rough
        shaft = Shaft(float(x), float(y), float(radius))
    away = flat - [shaft.x, shaft.y]
    off = np.abs(np.hypot(*away.T) - shaft.radius)
    on = off < max(_ON * shaft.radius, _NOISES * noise)
    about = off < max(_AROUND * shaft.radius, _NOISES * noise)
    turn = np.floor((np.arctan2(away[on, 1], away[on, 0]) / (2 * np.pi) + 0.5) * _N_BINS)
    is_round = len(np.unique(turn)) >= _LEAST_BINS and on.sum() >= _LEAST_SHARE * about.sum()
    return shaft._replace(n=int(on.sum()) if is_round and on.sum() >= _LEAST_POINTS else 0)
