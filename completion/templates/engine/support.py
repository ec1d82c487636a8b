# SPDX-License-Identifier: MIT
"""Support: tiles of each face of a template that points confirm, or that beams went through."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import cKDTree

from completion.templates.engine.measured import Measured
from completion.templates.engine.template import Side
from scenes.checks import BoolArray, FloatArray, IntArray

Nearest = Callable[[FloatArray], tuple[FloatArray, IntArray]]
"""From points (n, 3) to distance and number (n,) of the nearest face, from 1."""

_TILE = 6.0  # typical distances between points
_LEAST_POINTS = 4  # on a tile that counts
_N_BEAMS, _N_STEPS, _N_SAMPLE = 2_000, 80, 2_000


def face_sides(
    names: Sequence[str],
    measured: Measured,
    faces: IntArray,
    deviations: FloatArray,
    *,
    nearest: Nearest,
    tolerance: float,
) -> tuple[Side, ...]:
    """Return the support of each face.

    Tiles are cubes of six typical distances between the points of a face. One is confirmed by four of them,
    and contradicted by beams that went through the face there and on, unless it is confirmed.

    Parameters
    ----------
    names : sequence of str
        Of the faces.
    measured : Measured
        What was measured.
    faces : (n,) int
        Face of each point, from 1; 0 for none.
    deviations : (f,) float
        Of the place of each face across itself.
    nearest : callable
        Distances to the template, for beams.
    tolerance : float
        Within which a point agrees with a face.
    """
    through, through_faces = _passages(measured, measured.points[faces > 0], nearest, tolerance)
    sides = []
    for number, name in enumerate(names, start=1):
        points = measured.points[faces == number]
        side = max(_TILE * max(measured.spacing, _spacing(points)), 4 * tolerance, 1e-12)
        confirmed = _tiles(points, side, _LEAST_POINTS)
        crossed = _tiles(through[through_faces == number], side, 1) - confirmed
        n = len(confirmed) + len(crossed)
        deviation = float(deviations[number - 1])
        sides.append(Side(name, len(confirmed), len(crossed), n, deviation=deviation))
    return tuple(sides)


def _spacing(points: FloatArray) -> float:
    """Typical distance between the points (n, 3) of a face: where beams graze it they lie farther apart."""
    if len(points) < _LEAST_POINTS:
        return 0.0
    some = points[:: max(1, len(points) // _N_SAMPLE)]
    away, _ = cKDTree(points).query(some, k=_LEAST_POINTS)
    return float(np.median(away[:, -1]) / np.sqrt(_LEAST_POINTS - 1))


def _tiles(points: FloatArray, side: float, least: int) -> set[tuple[int, ...]]:
    """Numbers of the cubes with so many of the points (n, 3) at least."""
    cells, count = np.unique(np.floor(points / side).astype(np.int64), axis=0, return_counts=True)
    return {tuple(cell) for cell in cells[count >= least].tolist()}


def _passages(
    measured: Measured, explained: FloatArray, nearest: Nearest, tolerance: float
) -> tuple[FloatArray, IntArray]:
    """Where beams (m, 3) went through a face and on, and its number (m,); by steps of the distance.

    Of beams that pass the ball round the points (n, 3) that the template explains.
    """
    beams = measured.beams
    if beams is None or len(beams.ranges) == 0 or len(explained) == 0:
        return np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    middle = (explained.min(axis=0) + explained.max(axis=0)) / 2
    reach = float(np.linalg.norm(explained - middle, axis=1).max())
    away = middle - beams.origins
    along = np.einsum("ij,ij->i", away, beams.directions)
    passes = np.einsum("ij,ij->i", away, away) - np.square(along) <= reach**2
    near = np.isfinite(beams.ranges) & passes & (along > -reach) & (beams.ranges > along - reach)
    chosen = np.flatnonzero(near)[:: max(1, int(near.sum()) // _N_BEAMS)]
    origins, directions = beams.origins[chosen], beams.directions[chosen]
    end = beams.ranges[chosen] - 4 * tolerance - measured.spacing
    gone, hit = np.zeros(len(chosen)), np.zeros(len(chosen), dtype=np.int64)
    for _ in range(_N_STEPS):
        going: BoolArray = (hit == 0) & (gone < end)
        if not going.any():
            break
        places = origins[going] + gone[going, None] * directions[going]
        distance, face = nearest(places)
        size = np.abs(distance)
        # one that passes within the tolerance beside a face has not gone through it
        hit[going] = np.where(size < 0.05 * tolerance, face, 0)
        gone[going] += size
    met = (hit > 0) & (gone < end)
    return origins[met] + gone[met, None] * directions[met], hit[met]
