# SPDX-License-Identifier: MIT
"""Form candidates: poses under which facets of two free forms face alike and lie together.

Turns are spread evenly over all there are. Under each, two facets that then face alike vote for the shift
that brings them together, and the shifts with most votes are candidates: a Hough transform of poses, after
Stockman, "Object recognition and localization via pose clustering", CVGIP 1987.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from completion.registration.candidates.station_view import StationView
from scenes.checks import FloatArray
from texture.engine.compiled import compiled

_N_TURNS = 2000  # about 20 degrees apart
_N_FACETS = 160  # of each scan that vote
_CELL = 0.35  # of the smaller scan's spread, the side of a cell of shifts
_ALIKE = 0.92  # cosine of what facets face: 23 degrees
_N_PEAKS = 3  # shifts of a turn
_N_KEPT = 3000


def form_candidates(a: StationView, b: StationView) -> FloatArray:
    """Return motions (n, 3, 4) of scan b into the frame of scan a, those with most votes first."""
    places_a, facing_a = _some(a)
    places_b, facing_b = _some(b)
    if not len(places_a) or not len(places_b):
        return np.zeros((0, 3, 4))
    middle_a, middle_b = places_a.mean(axis=0), places_b.mean(axis=0)
    places_a, places_b = places_a - middle_a, places_b - middle_b
    spread = min(float(np.sqrt(np.square(one).sum(axis=1).mean())) for one in (places_a, places_b))
    cell = max(_CELL * spread, 1e-6)
    reach = sum(float(np.linalg.norm(one, axis=1).max()) for one in (places_a, places_b))
    side = 2 * int(np.ceil(reach / cell)) + 1
    turns = even_turns(_N_TURNS)
    shifts, counts = _vote(
        places_a, facing_a, places_b, facing_b, turns=turns, cell=cell, side=side, n_peaks=_N_PEAKS
    )
    turns = np.repeat(turns, _N_PEAKS, axis=0)
    shifts += middle_a - turns @ middle_b
    motions = np.concatenate([turns, shifts[:, :, None]], axis=2)
    order = np.argsort(-counts, kind="stable")[:_N_KEPT]
    return np.ascontiguousarray(motions[order])


def even_turns(n: int) -> FloatArray:
    """Return n rotations (n, 3, 3) evenly over all: super-Fibonacci spirals (Alexa, CVPR 2022)."""
    k = np.arange(n) + 0.5
    t = k / n
    near, far = np.sqrt(t), np.sqrt(1 - t)
    alpha, beta = 2 * np.pi * k / np.sqrt(2.0), 2 * np.pi * k / 1.533751168755204288118041
    quaternions = [near * np.sin(alpha), near * np.cos(alpha), far * np.sin(beta), far * np.cos(beta)]
    return np.asarray(Rotation.from_quat(np.stack(quaternions, axis=1)).as_matrix())


def _some(view: StationView) -> tuple[FloatArray, FloatArray]:
    """Places and normals (n, 3) of some facets of a scan, evenly over its sample."""
    some = view.sample[:: max(1, len(view.sample) // _N_FACETS)]
    return view.facets.centre[some], np.ascontiguousarray(view.facets.normal[some])


@compiled
def _vote(
    places_a: FloatArray,
    facing_a: FloatArray,
    places_b: FloatArray,
    facing_b: FloatArray,
    turns: FloatArray,
    cell: float,
    side: int,
    n_peaks: int,
) -> tuple[FloatArray, FloatArray]:
    """The shifts (n, 3) with most votes of each turn, and their votes (n,)."""
    n, half = len(turns), side // 2
    shifts, counts = np.zeros((n * n_peaks, 3)), np.zeros(n * n_peaks)
    grid = np.zeros((side, side, side), np.int32)
    for number in range(n):
        r = turns[number]
        grid[:] = 0
        for k in range(len(places_b)):
            x = r[0, 0] * places_b[k, 0] + r[0, 1] * places_b[k, 1] + r[0, 2] * places_b[k, 2]
            y = r[1, 0] * places_b[k, 0] + r[1, 1] * places_b[k, 1] + r[1, 2] * places_b[k, 2]
            z = r[2, 0] * places_b[k, 0] + r[2, 1] * places_b[k, 1] + r[2, 2] * places_b[k, 2]
            u = r[0, 0] * facing_b[k, 0] + r[0, 1] * facing_b[k, 1] + r[0, 2] * facing_b[k, 2]
            v = r[1, 0] * facing_b[k, 0] + r[1, 1] * facing_b[k, 1] + r[1, 2] * facing_b[k, 2]
            w = r[2, 0] * facing_b[k, 0] + r[2, 1] * facing_b[k, 1] + r[2, 2] * facing_b[k, 2]
            for j in range(len(places_a)):
                if facing_a[j, 0] * u + facing_a[j, 1] * v + facing_a[j, 2] * w < _ALIKE:
                    continue
                i0 = int(np.floor((places_a[j, 0] - x) / cell + 0.5)) + half
                i1 = int(np.floor((places_a[j, 1] - y) / cell + 0.5)) + half
                i2 = int(np.floor((places_a[j, 2] - z) / cell + 0.5)) + half
                grid[i0, i1, i2] += 1
        for peak in range(n_peaks):
            best = int(grid.argmax())
            i0, i1, i2 = best // (side * side), best // side % side, best % side
            row = number * n_peaks + peak
            counts[row] = grid[i0, i1, i2]
            shifts[row, 0], shifts[row, 1], shifts[row, 2] = i0 - half, i1 - half, i2 - half
            grid[max(i0 - 1, 0) : i0 + 2, max(i1 - 1, 0) : i1 + 2, max(i2 - 1, 0) : i2 + 2] = 0
    return cell * shifts, counts
