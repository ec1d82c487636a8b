# SPDX-License-Identifier: MIT
"""Turn candidates: poses that bring one plane of each scan together, turned about its normal and shifted.

Two scans that share one plane, a floor say, are told apart by a turn and two shifts. For each turn, facets of
both scans that then face alike at the same height vote for the shift that brings them together; shifts with
most votes are candidates.
"""

from __future__ import annotations

import numpy as np

from completion.registration.candidates.plane_candidates import votes
from completion.registration.candidates.station_view import StationView
from scenes.checks import FloatArray
from texture.engine.compiled import compiled

_N_LARGEST = 4  # directions of each scan that may be shared
_N_HEIGHTS = 2  # offsets along a shared direction
_TURN = np.radians(5.0)
_CELL_M = 0.15  # of the shifts that are voted for
_SAME_M = 0.15  # difference in height of facets that meet
_ALIKE = 0.94  # cosine of what they face: 20 degrees
_UPRIGHT = 0.8  # cosine to the shared direction from which facets tell no shift
_N_PEAKS = 3  # shifts of a turn
_N_KEPT = 4000
_EVERY = 6  # facet of the sample that votes


def turn_candidates(a: StationView, b: StationView) -> FloatArray:
    """Return motions (n, 3, 4) of scan b into the frame of scan a, those with most votes first."""
    motions, counts = [np.zeros((0, 3, 4))], [np.zeros(0)]
    reach = a.radius_m + b.radius_m
    side = 2 * int(np.ceil(reach / _CELL_M)) + 1
    for i in range(min(_N_LARGEST, len(a.directions.normals))):
        for k in range(min(_N_LARGEST, len(b.directions.normals))):
            own, other = _frame(a.directions.normals[i]), _frame(b.directions.normals[k])
            places_a, facing_a = _upright(a, own)
            places_b, facing_b = _upright(b, other)
            for height in votes(a.directions, b.directions, i, k)[0][:_N_HEIGHTS].tolist():
                shifts, votes_of, turns = _vote(
                    places_a, facing_a, places_b, facing_b, height, _CELL_M, side, _N_PEAKS
                )
                c, s, zero = np.cos(turns), np.sin(turns), np.zeros_like(turns)
                turn = np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1]]).transpose(2, 0, 1)
                rotation = own @ turn @ other.T
                shift = np.concatenate([shifts, np.full((len(shifts), 1), height)], axis=1) @ own.T
                motions.append(np.concatenate([rotation, shift[:, :, None]], axis=2))
                counts.append(votes_of)
    order = np.argsort(-np.concatenate(counts), kind="stable")[:_N_KEPT]
    return np.ascontiguousarray(np.concatenate(motions)[order])


def _frame(normal: FloatArray) -> FloatArray:
    """A frame (3, 3) whose third column is the normal."""
    first = np.eye(3)[np.abs(normal).argmin()]
    first = first - (first @ normal) * normal
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first), normal], axis=1)


def _upright(view: StationView, frame: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places and normals (n, 3) in a frame of the facets that do not face along its third axis."""
    some = view.sample[::_EVERY]
    normals = view.facets.normal[some] @ frame
    chosen = np.abs(normals[:, 2]) < _UPRIGHT
    return np.ascontiguousarray((view.facets.centre[some] @ frame)[chosen]), np.ascontiguousarray(
        normals[chosen]
    )


@compiled
def _vote(
    places_a: FloatArray,
    facing_a: FloatArray,
    places_b: FloatArray,
    facing_b: FloatArray,
    height: float,
    cell: float,
    side: int,
    n_peaks: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The shifts (n, 2) with most votes of each turn, their votes (n,) and turns (n,), radians."""
    n_turns = int(np.round(2 * np.pi / _TURN))
    shifts, counts, turns = (
        np.zeros((n_turns * n_peaks, 2)),
        np.zeros(n_turns * n_peaks),
        np.zeros(n_turns * n_peaks),
    )
    grid, half = np.zeros((side, side), np.int32), side // 2
    for turn in range(n_turns):
        grid[:] = 0
        c, s = np.cos(turn * _TURN), np.sin(turn * _TURN)
        for k in range(len(places_b)):
            x, y = c * places_b[k, 0] - s * places_b[k, 1], s * places_b[k, 0] + c * places_b[k, 1]
            z = places_b[k, 2] + height
            u, v = c * facing_b[k, 0] - s * facing_b[k, 1], s * facing_b[k, 0] + c * facing_b[k, 1]
            for j in range(len(places_a)):
                if abs(places_a[j, 2] - z) > _SAME_M:
                    continue
                if facing_a[j, 0] * u + facing_a[j, 1] * v + facing_a[j, 2] * facing_b[k, 2] < _ALIKE:
                    continue
                row = int(np.floor((places_a[j, 0] - x) / cell + 0.5)) + half
                column = int(np.floor((places_a[j, 1] - y) / cell + 0.5)) + half
                if 0 <= row < side and 0 <= column < side:
                    grid[row, column] += 1
        for peak in range(n_peaks):
            best, at_row, at_column = 0, -1, -1
            for row in range(1, side - 1):
                for column in range(1, side - 1):
                    if grid[row, column] == 0:
                        continue
                    total = 2 * grid[row, column]
                    total += grid[row - 1, column] + grid[row + 1, column]
                    total += grid[row, column - 1] + grid[row, column + 1]
                    if total > best:
                        best, at_row, at_column = total, row, column
            number = turn * n_peaks + peak
            turns[number] = turn * _TURN
            if best == 0:
                continue
            counts[number] = best
            shifts[number, 0], shifts[number, 1] = (at_row - half) * cell, (at_column - half) * cell
            grid[max(at_row - 2, 0) : at_row + 3, max(at_column - 2, 0) : at_column + 3] = 0
    return shifts, counts, turns
