# SPDX-License-Identifier: MIT
"""Competition: every pixel goes to the surface near by that it fits best, seams smooth and creases sharp."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.observe.observation import Observation
from completion.observe.packed_surfaces import gap_to
from completion.observe.rays import Noise, Rays, deviation_at, ray_at
from completion.observe.tiles import ImageTiles
from completion.segmentation.limits import ENCLOSED_SHARE, FARTHEST, MOST_MISFIT, SEAM_COST, WITHIN_SHARE
from completion.segmentation.regions import SegmentationOptions
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Surface
from texture.engine.compiled import compiled, inlined

_MOST_VISITS = 12


def compete(
    labels: NDArray[np.int32],
    models: FloatArray,
    observation: Observation,
    tiles: ImageTiles,
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
            members = labels[i, j]
            if np.isfinite(ranges[i, j]) and (
                (i > 0 and labels[i - 1, j] != members)
                or (j > 0 and labels[i, j - 1] != members)
                or (i < rows - 1 and labels[i + 1, j] != members)
                or (j < columns - 1 and labels[i, j + 1] != members)
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
    members = labels[i, j]
    near[0], tally[0], n_near, n_labelled = members, 0, 1, 0
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
    for index in range(members == 0, n_near):
        gap, cosine = gap_to(models, near[index] - 1, x, y, z, r, normal)
        square = gap * gap / (s * s * cosine * cosine + flat * flat + 1e-30)
        if not (cosine > 0.0 and square <= limit):
            continue
        cost = square + SEAM_COST * (n_labelled - tally[index])
        if members == 0 and misfit[ti, tj] <= MOST_MISFIT:
            wx, wy, wz = plane[ti, tj, 0], plane[ti, tj, 1], plane[ti, tj, 2]
            cosine = (wx * normal[0] + wy * normal[1] + wz * normal[2]) / np.sqrt(wx * wx + wy * wy + wz * wz)
            if np.arccos(min(1.0, max(-1.0, cosine))) > max_angle + 3.0 * normal_sd[ti, tj]:
                continue
        if cost < least:
            best, least = near[index], cost
    return best


def absorb(
    labels: NDArray[np.int32],
    models: FloatArray,
    surfaces: Sequence[Surface],
    observation: Observation,
    options: SegmentationOptions,
) -> NDArray[np.int32]:
    """Relabel islands that their surroundings explain as well as the sensor's systematic error allows.

    An island goes to the larger region that most of its outline touches where nearly all its pixels are
    within tolerance of that surface, where it does not tilt by more than a pixel's normal may, and where its
    mean distance is within `n_sigma` of what neighbouring ranges may stray by together. Noise alone would
    tell them apart; a sensor that bends walls does not let us. Labels (rows, columns) number regions from 1,
    largest first; `models` (m, 9) are their surfaces as compiled loops read them.
    """
    n = len(surfaces)
    contact, outline = contacts(labels, n)
    host = np.array([int(np.argmax(contact[i, :i])) if i else -1 for i in range(n)], np.int64)
    enclosed = np.array([i > 0 and contact[i, host[i]] >= ENCLOSED_SHARE * outline[i] for i in range(n)])
    sums = _distances(
        labels, models, np.where(enclosed, host, -1), observation.scan.ranges, observation.rays,
        observation.noise.numbers(), options.least_flatness_m, options.n_sigma,
    )  # fmt: skip
    goes_to = np.arange(n + 1)
    for i in np.flatnonzero(enclosed).tolist():
        count, within, mean, reach = sums[i, 0], sums[i, 1], sums[i, 2:5], sums[i, 5]
        if within < WITHIN_SHARE * count:
            continue
        middle = (observation.scan.origin + mean / count)[None]
        gap = abs(sums[i, 6] / count)
        stray = np.hypot(options.least_flatness_m, observation.noise.bias(np.array([reach / count]))[0])
        cosine = float(surfaces[i].normal(middle)[0] @ surfaces[host[i]].normal(middle)[0])
        if gap <= options.n_sigma * stray and cosine >= np.cos(np.radians(options.max_angle_deg)):
            goes_to[i + 1] = goes_to[host[i] + 1]
    return np.asarray(goes_to[labels], dtype=np.int32)


@compiled
def contacts(labels: NDArray[np.int32], n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of neighbouring pixels between n regions (n, n), and between each region and any other (n,)."""
    contact, outline = np.zeros((n, n), np.int64), np.zeros(n, np.int64)
    rows, columns = labels.shape
    for i in range(rows):
        for j in range(columns):
            members = labels[i, j]
            for k, m in ((i + 1, j), (i, j + 1)):
                if k < rows and m < columns:
                    other = labels[k, m]
                    if members == other:
                        continue
                    if members > 0:
                        outline[members - 1] += 1
                    if other > 0:
                        outline[other - 1] += 1
                    if members > 0 and other > 0:
                        contact[members - 1, other - 1] += 1
                        contact[other - 1, members - 1] += 1
    return contact, outline


@compiled
def _distances(
    labels: NDArray[np.int32],
    models: FloatArray,
    host: NDArray[np.int64],
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    n_sigma: float,
) -> FloatArray:
    """For each region with a host: pixels, those within tolerance, sums of points, ranges and distances."""
    sums = np.zeros((len(host), 7))
    normal = np.zeros(3)
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            label = labels[i, j] - 1
            if label < 0 or host[label] < 0:
                continue
            x, y, z = ray_at(rays, i, j)
            r = ranges[i, j]
            s = deviation_at(noise, r)
            gap, cosine = gap_to(models, host[label], x, y, z, r, normal)
            variance = s * s * cosine * cosine + flat * flat
            sums[label, 0] += 1.0
            sums[label, 1] += cosine > 0.0 and gap * gap <= n_sigma * n_sigma * variance
            sums[label, 2] += r * x
            sums[label, 3] += r * y
            sums[label, 4] += r * z
            sums[label, 5] += r
            sums[label, 6] += gap
    return sums


def sharpen_creases(
    labels: NDArray[np.int32], models: FloatArray, observation: Observation
) -> NDArray[np.int32]:
    """Relabel cylinders that are no more than an edge as a camera that averages over windows sees it.

    Such a camera rounds every edge. The ranges to two planes next to a cylinder, the farther of them on a
    convex edge and the nearer in a corner, are averaged over its window; where they explain the cylinder's
    ranges as well as noise that is alike within a window allows, its pixels go to the nearer plane each.
    Sensors that measure every ray by itself round nothing: their cylinders stay. Labels and models as in
    `absorb`: (rows, columns) and (m, 9).
    """
    if observation.scan.projection.kind != "pinhole" or observation.noise.quadratic_per_m == 0:
        return labels
    result = labels.copy()
    contact, _ = contacts(labels, len(models))
    for i in np.flatnonzero(models[:, 0] == 1.0).tolist():
        beside = np.flatnonzero((contact[i] > 0) & (models[:, 0] == 0.0))
        if len(beside) > 1:
            _sharpen_creases(i + 1, beside, result, models, observation)
    return result


def _sharpen_creases(
    label: int, beside: NDArray[np.int64], labels: NDArray[np.int32], models: FloatArray, seen: Observation
) -> None:
    """Give one cylinder's pixels to two of the planes beside it where their crease explains them."""
    pixel = np.argwhere(labels == label)
    ranges = seen.scan.ranges[tuple(pixel.T)]
    width = seen.noise.window_pixels(float(np.median(ranges)))
    if width == 1:
        return
    low, high = np.maximum(pixel.min(axis=0) - width, 0), pixel.max(axis=0) + width + 1
    frame = (slice(low[0], high[0]), slice(low[1], high[1]))
    is_member: BoolArray = labels[frame] == label
    flat = np.arange(labels.size, dtype=np.int64).reshape(labels.shape)[frame]
    rays = seen.rays_at(flat.ravel()).reshape(*flat.shape, 3)
    reach = {int(j): _reach(models[j], rays, FARTHEST * float(ranges.max())) for j in beside}
    measured, sigma = seen.scan.ranges[frame][is_member], seen.sigma_at(flat[is_member])
    allowed = 1 + 3 * np.sqrt(2 * width**2 / len(pixel))  # a window's ranges count as one
    pairs = [
        (float(np.mean(np.square((measured - crease[is_member]) / sigma))), pair)
        for pair, crease in _creases(reach, width)
    ]
    square, (first, second) = min(pairs)
    if square <= allowed:
        nearer = np.abs(measured - reach[first][is_member]) <= np.abs(measured - reach[second][is_member])
        labels[frame][is_member] = np.where(nearer, first, second) + 1


def _reach(model: FloatArray, rays: FloatArray, farthest: float) -> FloatArray:
    """Ranges (rows, columns) along the rays to a packed plane."""
    along = rays @ model[1:4]
    return np.asarray(model[7] / np.maximum(along, model[7] / farthest), dtype=np.float64)


def _creases(reach: dict[int, FloatArray], width: int) -> Iterator[tuple[tuple[int, int], FloatArray]]:
    """Averaged ranges to each pair of planes, as an edge and as a corner."""
    for first, second in combinations(reach, 2):
        for sharp in (np.maximum(reach[first], reach[second]), np.minimum(reach[first], reach[second])):
            yield (first, second), np.asarray(cv2.blur(sharp, (width, width)), dtype=np.float64)
