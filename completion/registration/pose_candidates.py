# SPDX-License-Identifier: MIT
"""Candidates: poses of two scans that their planes, one shared plane, or their free forms propose.

Form candidates: poses under which facets of two free forms face alike and lie together.
Turns are spread evenly over all there are. Under each, two facets that then face alike vote for the shift
that brings them together, and the shifts with most votes are candidates: a Hough transform of poses, after
Stockman, "Object recognition and localization via pose clustering", CVGIP 1987.

Plane candidates: poses under which planes of two scans face alike and lie in each other.
After the two equations of a plane under a motion: R n_b = n_a, and n_a . t = d_a - d_b.

Turn candidates: poses that bring one plane of each scan together, turned about its normal and shifted.
Two scans that share one plane, a floor say, are told apart by a turn and two shifts. For each turn, facets of
both scans that then face alike at the same height vote for the shift that brings them together; shifts with
most votes are candidates.

Images: poses that are as good as another one because a place repeats itself.
Along a row of like doors a pose that is off by one door shares more with the beams than the truth does, where
the scans overlap little. What gives it away is a scan that fits itself once it is shifted: its beams approve
of that as well.
"""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
from scipy.spatial.transform import Rotation

from completion.registration.limits import (
    ALONG_PLANE,
    CELL_M,
    EVERY,
    FACING_FORM,
    FACING_TURN,
    FORM_CELL,
    LEAST_SINE,
    LEAST_VOLUME,
    N_FEW_VOTES,
    N_FORM_CANDIDATES,
    N_FORM_FACETS,
    N_HEIGHTS,
    N_PEAKS,
    N_ROTATIONS,
    N_SHARED,
    N_TURN_CANDIDATES,
    N_TURNS,
    N_VOTES,
    SAME_ANGLE,
    SAME_DIRECTION,
    SAME_OFFSET_M,
    STEP_M,
    TURN_STEP,
)
from completion.registration.station_view import Directions, StationView
from scenes.checks import FloatArray
from texture.engine.compiled import compiled


def plane_candidates(a: Directions, b: Directions, reach_m: float) -> FloatArray:
    """Return motions (n, 3, 4) of scan b into the frame of scan a that bring planes together.

    Rotations come from pairs of directions with the same angle between them, those that bring most area
    together first. Offsets come from the differences of planes' distances, the seven that most area votes for
    along each direction; where only two directions are shared, all places along the third within `reach_m`.
    """
    motions = [np.zeros((0, 3, 4))]
    for rotation in _rotations(a, b):
        places = places_of(a, b, rotation, reach_m)
        turned = np.repeat(rotation[None], len(places), axis=0)
        motions.append(np.concatenate([turned, places[:, :, None]], axis=2))
    return np.concatenate(motions)


def _rotations(a: Directions, b: Directions) -> list[FloatArray]:
    """Rotations (3, 3) under which directions agree, most area first."""
    pairs: list[tuple[float, FloatArray]] = []
    weight_a, weight_b = (np.array([float(area.sum()) for area in directions.areas]) for directions in (a, b))
    for i, j in combinations(range(len(a.normals)), 2):
        cross = np.cross(a.normals[i], a.normals[j])
        if np.linalg.norm(cross) < LEAST_SINE:
            continue
        angle = np.arctan2(np.linalg.norm(cross), a.normals[i] @ a.normals[j])
        for k, m in product(range(len(b.normals)), repeat=2):
            if k == m:
                continue
            cross_b = np.cross(b.normals[k], b.normals[m])
            size = np.linalg.norm(cross_b)
            if size < LEAST_SINE or abs(np.arctan2(size, b.normals[k] @ b.normals[m]) - angle) > SAME_ANGLE:
                continue
            rotation = _frame_of_two(a.normals[i], a.normals[j]) @ _frame_of_two(b.normals[k], b.normals[m]).T
            cosine = a.normals @ rotation @ b.normals.T
            together = np.minimum(weight_a[:, None], weight_b[None])[cosine > SAME_DIRECTION].sum()
            pairs.append((float(together), rotation))
    pairs.sort(key=lambda pair: -pair[0])
    kept: list[FloatArray] = []
    for _, rotation in pairs:
        if all(np.trace(rotation.T @ other) < 1 + 2 * SAME_DIRECTION for other in kept):
            kept.append(rotation)
        if len(kept) == N_ROTATIONS:
            break
    return kept


def _frame_of_two(first: FloatArray, second: FloatArray) -> FloatArray:
    """The frame (3, 3) of two directions, alike in both: its columns are their half, difference and cross."""
    half, across = first + second, first - second
    x, y = half / np.linalg.norm(half), across / np.linalg.norm(across)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def places_of(a: Directions, b: Directions, rotation: FloatArray, reach_m: float) -> FloatArray:
    """Return shifts (n, 3) under which planes of directions that agree lie in each other, metres."""
    cosine = a.normals @ rotation @ b.normals.T
    pairs = [(i, int(cosine[i].argmax())) for i in range(len(a.normals)) if cosine[i].max() > SAME_DIRECTION]
    sentence = [(a.normals[i], *votes(a, b, i, k)) for i, k in pairs]
    sentence.sort(key=lambda triple: -float(triple[2].sum()))
    places = [np.zeros((0, 3))]
    for three in combinations(sentence, 3):
        matrix = np.array([triple[0] for triple in three])
        if abs(np.linalg.det(matrix)) > LEAST_VOLUME:
            offsets = np.array(list(product(*(triple[1] for triple in three))))
            places.append(np.linalg.solve(matrix, offsets.T).T)
            break
    steps = np.arange(-reach_m, reach_m, STEP_M)
    for first, second in list(combinations(sentence, 2))[:3]:
        along = np.cross(first[0], second[0])
        if np.linalg.norm(along) < LEAST_SINE:
            continue
        offsets = np.array(list(product(first[1][:N_FEW_VOTES], second[1][:N_FEW_VOTES], steps)))
        matrix = np.array([first[0], second[0], along / np.linalg.norm(along)])
        places.append(np.linalg.solve(matrix, offsets.T).T)
    return np.concatenate(places)


def votes(a: Directions, b: Directions, i: int, k: int) -> tuple[FloatArray, FloatArray]:
    """The best offsets (m,) along direction i of a, metres, and the area that votes for each (m,)."""
    offsets = (a.heights[i][:, None] - b.heights[k][None]).ravel()
    weight = np.minimum(a.areas[i][:, None], b.areas[k][None]).ravel()
    kept: list[float] = []
    scores: list[float] = []
    left = np.argsort(-weight, kind="stable")
    while len(left) and len(kept) < N_VOTES:
        near = np.abs(offsets[left] - offsets[left[0]]) < SAME_OFFSET_M
        members = left[near]
        kept.append(float((offsets[members] * weight[members]).sum() / weight[members].sum()))
        scores.append(float(weight[members].sum()))
        left = left[~near]
    return np.array(kept), np.array(scores)


def turn_candidates(a: StationView, b: StationView) -> FloatArray:
    """Return motions (n, 3, 4) of scan b into the frame of scan a, those with most votes first."""
    motions, counts = [np.zeros((0, 3, 4))], [np.zeros(0)]
    reach = a.radius_m + b.radius_m
    side = 2 * int(np.ceil(reach / CELL_M)) + 1
    for i in range(min(N_SHARED, len(a.directions.normals))):
        for k in range(min(N_SHARED, len(b.directions.normals))):
            axes, other = _frame_along(a.directions.normals[i]), _frame_along(b.directions.normals[k])
            places_a, facing_a = _upright(a, axes)
            places_b, facing_b = _upright(b, other)
            for height in votes(a.directions, b.directions, i, k)[0][:N_HEIGHTS].tolist():
                shifts, votes_of, turns = _vote_of_turns(
                    places_a, facing_a, places_b, facing_b, height, CELL_M, side, N_PEAKS
                )
                c, s, zero = np.cos(turns), np.sin(turns), np.zeros_like(turns)
                turn = np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1]]).transpose(2, 0, 1)
                rotation = axes @ turn @ other.T
                shift = np.concatenate([shifts, np.full((len(shifts), 1), height)], axis=1) @ axes.T
                motions.append(np.concatenate([rotation, shift[:, :, None]], axis=2))
                counts.append(votes_of)
    order = np.argsort(-np.concatenate(counts), kind="stable")[:N_TURN_CANDIDATES]
    return np.ascontiguousarray(np.concatenate(motions)[order])


def _frame_along(normal: FloatArray) -> FloatArray:
    """A frame (3, 3) whose third column is the normal."""
    first = np.eye(3)[np.abs(normal).argmin()]
    first = first - (first @ normal) * normal
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first), normal], axis=1)


def _upright(view: StationView, frame: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places and normals (n, 3) in a frame of the facets that do not face along its third axis."""
    sample = view.sample[::EVERY]
    normals = view.facets.normal[sample] @ frame
    chosen = np.abs(normals[:, 2]) < ALONG_PLANE
    return np.ascontiguousarray((view.facets.centre[sample] @ frame)[chosen]), np.ascontiguousarray(
        normals[chosen]
    )


@compiled
def _vote_of_turns(
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
    n_turns = int(np.round(2 * np.pi / TURN_STEP))
    shifts, counts, turns = (
        np.zeros((n_turns * n_peaks, 2)),
        np.zeros(n_turns * n_peaks),
        np.zeros(n_turns * n_peaks),
    )
    grid, half = np.zeros((side, side), np.int32), side // 2
    for turn in range(n_turns):
        grid[:] = 0
        c, s = np.cos(turn * TURN_STEP), np.sin(turn * TURN_STEP)
        for k in range(len(places_b)):
            x, y = c * places_b[k, 0] - s * places_b[k, 1], s * places_b[k, 0] + c * places_b[k, 1]
            z = places_b[k, 2] + height
            u, v = c * facing_b[k, 0] - s * facing_b[k, 1], s * facing_b[k, 0] + c * facing_b[k, 1]
            for j in range(len(places_a)):
                if abs(places_a[j, 2] - z) > CELL_M:
                    continue
                if facing_a[j, 0] * u + facing_a[j, 1] * v + facing_a[j, 2] * facing_b[k, 2] < FACING_TURN:
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
            turns[number] = turn * TURN_STEP
            if best == 0:
                continue
            counts[number] = best
            shifts[number, 0], shifts[number, 1] = (at_row - half) * cell, (at_column - half) * cell
            grid[max(at_row - 2, 0) : at_row + 3, max(at_column - 2, 0) : at_column + 3] = 0
    return shifts, counts, turns


def form_candidates(a: StationView, b: StationView) -> FloatArray:
    """Return motions (n, 3, 4) of scan b into the frame of scan a, those with most votes first."""
    places_a, facing_a = _facets_that_vote(a)
    places_b, facing_b = _facets_that_vote(b)
    if not len(places_a) or not len(places_b):
        return np.zeros((0, 3, 4))
    middle_a, middle_b = places_a.mean(axis=0), places_b.mean(axis=0)
    places_a, places_b = places_a - middle_a, places_b - middle_b
    spread = min(
        float(np.sqrt(np.square(place_offsets).sum(axis=1).mean())) for place_offsets in (places_a, places_b)
    )
    cell = max(FORM_CELL * spread, 1e-6)
    reach = sum(float(np.linalg.norm(place_offsets, axis=1).max()) for place_offsets in (places_a, places_b))
    side = 2 * int(np.ceil(reach / cell)) + 1
    turns = even_turns(N_TURNS)
    shifts, counts = _vote_of_forms(
        places_a, facing_a, places_b, facing_b, turns=turns, cell=cell, side=side, n_peaks=N_PEAKS
    )
    turns = np.repeat(turns, N_PEAKS, axis=0)
    shifts += middle_a - turns @ middle_b
    motions = np.concatenate([turns, shifts[:, :, None]], axis=2)
    order = np.argsort(-counts, kind="stable")[:N_FORM_CANDIDATES]
    return np.ascontiguousarray(motions[order])


def even_turns(n: int) -> FloatArray:
    """Return n rotations (n, 3, 3) evenly over all: super-Fibonacci spirals (Alexa, CVPR 2022)."""
    k = np.arange(n) + 0.5
    t = k / n
    near, far = np.sqrt(t), np.sqrt(1 - t)
    alpha, beta = 2 * np.pi * k / np.sqrt(2.0), 2 * np.pi * k / 1.533751168755204288118041
    quaternions = [near * np.sin(alpha), near * np.cos(alpha), far * np.sin(beta), far * np.cos(beta)]
    return np.asarray(Rotation.from_quat(np.stack(quaternions, axis=1)).as_matrix())


def _facets_that_vote(view: StationView) -> tuple[FloatArray, FloatArray]:
    """Places and normals (n, 3) of some facets of a scan, evenly over its sample."""
    sample = view.sample[:: max(1, len(view.sample) // N_FORM_FACETS)]
    return view.facets.centre[sample], np.ascontiguousarray(view.facets.normal[sample])


@compiled
def _vote_of_forms(
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
                if facing_a[j, 0] * u + facing_a[j, 1] * v + facing_a[j, 2] * w < FACING_FORM:
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
