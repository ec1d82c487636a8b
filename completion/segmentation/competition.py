# SPDX-License-Identifier: MIT
"""Competition: every pixel goes to the surface near by that it fits best, seams kept smooth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from completion.observe.observation import Observation
from completion.observe.rays import Noise, Rays, deviation_at, ray_at
from completion.observe.refits.packed_surfaces import gap_to
from completion.observe.tiles import Tiles
from completion.segmentation.regions import SegmentationOptions
from scenes.checks import FloatArray
from texture.engine.compiled import compiled, inlined

_SEAM = 1.0  # cost of a neighbour on another surface, in units of a squared residual
_FLAT = 3.0  # misfit of tiles whose normal counts
_MOST_VISITS = 12


def compete(
    labels: NDArray[np.int32],
    models: FloatArray,
    observation: Observation,
    tiles: Tiles,
    options: SegmentationOptions,
) -> NDArray[np.int32]:
    """Relabel pixels by iterated conditional modes (Besag 1986) over the labels of their neighbours.

    A pixel may take its own label or one of its eight neighbours', where its residual in its own standard
    deviations is within `n_sigma` and the surface faces the sensor; it takes the one with the least squared
    residual plus a cost for each neighbour that is on another surface. Pixels on seams wait in a queue, so
    that labels spread evenly into pixels that no tile explained.

    Parameters
    ----------
    labels : (rows, columns) int32
        First labels, from 1; 0 for none.
    models : (m, 9) float
        Surface of each label, as `pack_plane` and `pack_cylinder` write them.
    observation, tiles
        The scan; no label spreads to unlabelled pixels of a flat tile whose normal is off by more than
        the option `max_angle_deg`.
    options : SegmentationOptions
        `n_sigma` is the largest residual in standard deviations.
    """
    result = labels.copy()
    _settle(
        result, models, observation.scan.ranges, observation.rays, observation.noise.numbers(),
        tiles.flatness_m, tiles.plane, tiles.misfit, tiles.normal_sd, tiles.side, options.n_sigma,
        np.radians(options.max_angle_deg), _MOST_VISITS,
    )  # fmt: skip
    return result


@compiled
def _settle(
    labels: NDArray[np.int32],
    models: FloatArray,
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    plane: FloatArray,
    misfit: FloatArray,
    normal_sd: FloatArray,
    side: int,
    n_sigma: float,
    max_angle: float,
    most_visits: int,
) -> None:
    """Drop labels that do not fit, then visit pixels on seams, first come first served, until all rest."""
    rows, columns = labels.shape
    normal = np.zeros(3)
    limit = n_sigma * n_sigma
    for i in range(rows):
        for j in range(columns):
            if labels[i, j] == 0:
                continue
            x, y, z = ray_at(rays, i, j)
            gap, cosine = gap_to(models, labels[i, j] - 1, x, y, z, ranges[i, j], normal)
            sigma = deviation_at(noise, ranges[i, j])
            variance = sigma * sigma * cosine * cosine + flat * flat + 1e-30
            if not (cosine > 0.0 and gap * gap <= limit * variance):
                labels[i, j] = 0
    near, tally = np.empty(9, np.int32), np.empty(9, np.int32)
    queue = np.empty(rows * columns, np.int32)
    waiting = np.zeros((rows, columns), np.bool_)
    visits = np.zeros((rows, columns), np.uint8)
    length = 0
    for i in range(rows):
        for j in range(columns):
            own = labels[i, j]
            if np.isfinite(ranges[i, j]) and (
                (i > 0 and labels[i - 1, j] != own)
                or (j > 0 and labels[i, j - 1] != own)
                or (i < rows - 1 and labels[i + 1, j] != own)
                or (j < columns - 1 and labels[i, j + 1] != own)
            ):
                queue[length] = i * columns + j
                waiting[i, j] = True
                length += 1
    head = 0
    while length > 0:
        i, j = queue[head] // columns, queue[head] % columns
        head = (head + 1) % queue.size
        length -= 1
        waiting[i, j] = False
        visits[i, j] += 1
        best = _best_label(
            labels, models, i, j, ranges[i, j], rays, deviation_at(noise, ranges[i, j]), flat, plane,
            misfit, normal_sd, side, max_angle, limit, near, tally, normal,
        )  # fmt: skip
        if best == labels[i, j]:
            continue
        labels[i, j] = best
        for k in range(max(i - 1, 0), min(i + 2, rows)):
            for m in range(max(j - 1, 0), min(j + 2, columns)):
                if not waiting[k, m] and visits[k, m] < most_visits and np.isfinite(ranges[k, m]):
                    waiting[k, m] = True
                    queue[(head + length) % queue.size] = k * columns + m
                    length += 1


@inlined
def _best_label(
    labels: NDArray[np.int32],
    models: FloatArray,
    i: int,
    j: int,
    r: float,
    rays: Rays,
    s: float,
    flat: float,
    plane: FloatArray,
    misfit: FloatArray,
    normal_sd: FloatArray,
    side: int,
    max_angle: float,
    limit: float,
    near: NDArray[np.int32],
    tally: NDArray[np.int32],
    normal: FloatArray,
) -> int:
    """The label among those of the pixel and its neighbours with the least cost; 0 where none fits."""
    rows, columns = labels.shape
    own = labels[i, j]
    near[0], tally[0], n_near, n_labelled = own, 0, 1, 0
    for k in range(max(i - 1, 0), min(i + 2, rows)):
        for m in range(max(j - 1, 0), min(j + 2, columns)):
            label = labels[k, m]
            if label == 0 or (k == i and m == j):
                continue
            n_labelled += 1
            index = 0
            while index < n_near and near[index] != label:
                index += 1
            if index == n_near:
                near[n_near], tally[n_near] = label, 0
                n_near += 1
            tally[index] += 1
    x, y, z = ray_at(rays, i, j)
    ti, tj = i // side, j // side
    best, least = 0, np.inf
    for index in range(own == 0, n_near):
        gap, cosine = gap_to(models, near[index] - 1, x, y, z, r, normal)
        square = gap * gap / (s * s * cosine * cosine + flat * flat + 1e-30)
        if not (cosine > 0.0 and square <= limit):
            continue
        cost = square + _SEAM * (n_labelled - tally[index])
        if own == 0 and misfit[ti, tj] <= _FLAT:
            wx, wy, wz = plane[ti, tj, 0], plane[ti, tj, 1], plane[ti, tj, 2]
            cosine = (wx * normal[0] + wy * normal[1] + wz * normal[2]) / np.sqrt(wx * wx + wy * wy + wz * wz)
            if np.arccos(min(1.0, max(-1.0, cosine))) > max_angle + 3.0 * normal_sd[ti, tj]:
                continue
        if cost < least:
            best, least = near[index], cost
    return best
