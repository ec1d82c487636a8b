# SPDX-License-Identifier: MIT
"""Curvature: whether a patch that looks flat bends by more than its noise, and the cylinder it starts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from completion.fitting.chart import axis_frame
from completion.observe.observation import LabelledBeams, Observation
from completion.observe.packed_surfaces import pack
from completion.observe.rays import Noise, Rays, Triple, deviation_at, ray_at
from completion.observe.refitting import improve
from completion.observe.tiles import ImageTiles
from completion.segmentation.growing import Cluster, deviations, flood, tile_cut, with_smooth_ring
from completion.segmentation.limits import CURVED_SD, LEAST_SAGITTA, RING_GROWTH
from completion.segmentation.regions import SegmentationOptions, observed_arc
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder
from texture.engine.compiled import compiled, inlined

_N_BEND = 3_000  # pixels that the curvature is read from
_N_FIT = 1_500
_N_ROUNDS = 8
_CHI2_2 = 27.6  # quantile for the two parameters a cylinder has more than a plane, 1 in a million


def bending_cylinder(
    cluster: Cluster, free: BoolArray, tiles: ImageTiles, observation: Observation, max_angle: float
) -> Cylinder | None:
    """Return the cylinder that osculates a patch, None where its curvature is not significant.

    Narrow patches take the tiles around along that go on smoothly. Heights above the plane are fitted by a
    quadratic form; the standard deviation of its greatest curvature comes from the residuals, inflated where
    the tiles' means exceed independent ones. `cluster` is the patch, grown as a plane; `free`, shape
    (rows, columns), tells which tiles may be added (`with_smooth_ring`).
    """
    members = with_smooth_ring(cluster.tiles, free, tiles, max_angle)
    if np.count_nonzero(members) < RING_GROWTH * np.count_nonzero(cluster.tiles):
        members = cluster.tiles
    normal = -cluster.model[1:4]
    where = np.argwhere(members)
    centres = tiles.centre[where[:, 0], where[:, 1]]
    centre = centres.mean(axis=0)
    centre = centre - (centre @ normal + cluster.model[7]) * normal
    frame = axis_frame(normal)
    reach = float(np.sqrt(np.mean(np.square((centres - centre) @ frame[:2].T)))) + 1e-12
    step = max(1, int(np.sqrt(len(where) * tiles.side**2 / _N_BEND)))
    arguments = (where, tiles.side, step, tiles.ranges, observation.rays, observation.noise.numbers(),
                 tiles.flatness_m, centre, frame / reach)  # fmt: skip
    matrix, vector = _quadratic_sums(*arguments)
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return None
    solution = inverse @ vector
    bend = np.array([[solution[3], solution[4]], [solution[4], solution[5]]])
    values, vectors = np.linalg.eigh(bend)
    steepest = int(np.argmax(np.abs(values)))
    x, y = vectors[:, steepest]
    gradient = np.array([0, 0, 0, x * x, 2 * x * y, y * y])
    variance = max(float(gradient @ inverse @ gradient), 0.0)
    curvature = float(values[steepest])  # lengths are in units of the reach
    if not curvature**2 > CURVED_SD**2 * variance * _residual_variance(*arguments, solution):
        return None
    axis = vectors[:, 1 - steepest] @ frame[:2]
    radius = reach / curvature
    point = observation.scan.origin + centre + normal * (radius + solution[0] * reach)
    return Cylinder(point, axis, abs(radius), None, bool(curvature > 0))


def grow_cylinder(
    start: Cylinder,
    cluster: Cluster,
    free: BoolArray,
    tiles: ImageTiles,
    observation: Observation,
    options: SegmentationOptions,
) -> Cluster | None:
    """Grow a cylinder from a patch and refit it in turn; None where it fits no better than the plane.

    It begins with `start` (`bending_cylinder`) and may take the `free` tiles (rows, columns).
    """
    cut, max_angle = tile_cut(options), np.radians(options.max_angle_deg)
    where = np.argwhere(cluster.tiles)
    seed = where[np.argmin(np.square(where - where.mean(axis=0)).sum(axis=1))]
    middle = (int(seed[0]), int(seed[1]))
    origin, cylinder, size = observation.scan.origin, start, 0
    members = cluster.tiles | flood(pack(start, origin), middle, free, tiles, cut, max_angle=max_angle)[0]
    for _ in range(_N_ROUNDS):
        (better,) = improve([cylinder], [_sample(members, tiles, observation)], tiles.flatness_m, n_rounds=2)
        if not isinstance(better, Cylinder):
            return None
        cylinder = better
        members, *_, now = flood(pack(cylinder, origin), middle, free, tiles, cut, max_angle=max_angle)
        if now == 0:
            return None
        if abs(now - size) <= 0.01 * now:
            break
        size = now
    model = pack(cylinder, origin)
    results = Cluster(members, model, int(tiles.count[members].sum()))
    is_round = _is_round(cylinder, members, tiles, observation, options)
    return results if is_round and _explains_better(results, cluster, tiles) else None


def _is_round(
    cylinder: Cylinder,
    members: BoolArray,
    tiles: ImageTiles,
    observation: Observation,
    options: SegmentationOptions,
) -> bool:
    """Whether the arc is long enough, and rises above its chord by more than a flat wall may stray."""
    arc = observed_arc(cylinder, observation.scan.origin + tiles.centre[members])
    sagitta = cylinder.radius * (1 - np.cos(min(arc / 2, np.pi)))
    reach = np.linalg.norm(tiles.centre[members], axis=1)
    stray = np.hypot(tiles.flatness_m, observation.noise.bias(reach).mean())
    return bool(arc >= np.radians(options.min_arc_deg) and sagitta > LEAST_SAGITTA * stray)


def _explains_better(cluster: Cluster, plane: Cluster, tiles: ImageTiles) -> bool:
    """Whether the cylinder takes up the plane's tiles and deviates from them by significantly less.

    Where it takes up as many tiles again, those that the plane could not explain count too.
    """
    both = plane.tiles & cluster.tiles
    if np.count_nonzero(both) < 0.8 * np.count_nonzero(plane.tiles):
        return False
    if cluster.n_pixels >= 2 * plane.n_pixels:
        both = cluster.tiles
    where = np.argwhere(both)
    flat, round_ = (
        deviations(cluster.model, where, tiles.matrix, tiles.plane, tiles.centre)
        for cluster in (plane, cluster)
    )
    noise = max(float(np.mean(round_)) / 3.0, 1.0)
    return float(flat.sum() - round_.sum()) > _CHI2_2 * noise


def _sample(members: BoolArray, tiles: ImageTiles, observation: Observation) -> LabelledBeams:
    """Beams of the tiles, thinned evenly."""
    where = np.argwhere(members)
    step = max(1, int(np.sqrt(len(where) * tiles.side**2 / _N_FIT)))
    pixel = _pixels(where, tiles.side, step, tiles.ranges)
    return LabelledBeams.at(observation, pixel)


@compiled
def _pixels(where: NDArray[np.int64], side: int, step: int, ranges: FloatArray) -> NDArray[np.int32]:
    """Flat numbers of every step-th measured pixel of the tiles along rows and columns."""
    result = np.empty(len(where) * side * side, np.int32)
    n = 0
    for index in range(len(where)):
        for i in range(where[index, 0] * side, min((where[index, 0] + 1) * side, ranges.shape[0])):
            for j in range(where[index, 1] * side, min((where[index, 1] + 1) * side, ranges.shape[1])):
                if i % step == 0 and j % step == 0 and np.isfinite(ranges[i, j]):
                    result[n] = i * ranges.shape[1] + j
                    n += 1
    return result[:n]


@inlined
def _term(
    ray: Triple,
    r: float,
    s: float,
    flat: float,
    centre: FloatArray,
    frame: FloatArray,
    row: FloatArray,
) -> tuple[float, float]:
    """Write the basis of a pixel; return its height and weight."""
    x, y, z = r * ray[0] - centre[0], r * ray[1] - centre[1], r * ray[2] - centre[2]
    u = frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z
    v = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z
    height = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z
    cosine = frame[2, 0] * ray[0] + frame[2, 1] * ray[1] + frame[2, 2] * ray[2]
    unit2 = frame[2, 0] ** 2 + frame[2, 1] ** 2 + frame[2, 2] ** 2
    row[0], row[1], row[2], row[3], row[4], row[5] = 1.0, u, v, 0.5 * u * u, u * v, 0.5 * v * v
    return height, 1.0 / (s * s * cosine * cosine + flat * flat * unit2 + 1e-30)


@compiled
def _quadratic_sums(
    where: NDArray[np.int64],
    side: int,
    step: int,
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    centre: FloatArray,
    frame: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Normal equations of a height that is quadratic over the tiles' pixels."""
    matrix, vector, row = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    for index in range(len(where)):
        for i in range(where[index, 0] * side, min((where[index, 0] + 1) * side, ranges.shape[0]), step):
            for j in range(where[index, 1] * side, min((where[index, 1] + 1) * side, ranges.shape[1]), step):
                if not np.isfinite(ranges[i, j]):
                    continue
                r = ranges[i, j]
                ray, sigma = ray_at(rays, i, j), deviation_at(noise, r)
                height, weight = _term(ray, r, sigma, flat, centre, frame, row)
                for a in range(6):
                    vector[a] += weight * row[a] * height
                    for b in range(a + 1):
                        matrix[a, b] += weight * row[a] * row[b]
    for a in range(6):
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    return matrix, vector


@compiled
def _residual_variance(
    where: NDArray[np.int64],
    side: int,
    step: int,
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    centre: FloatArray,
    frame: FloatArray,
    solution: FloatArray,
) -> float:
    """Mean square of the weighted residuals, or of the tiles' means in their own deviations if greater."""
    row = np.zeros(6)
    total, n, square, n_pixels = 0.0, 0, 0.0, 0
    for index in range(len(where)):
        summed, weights = 0.0, 0.0
        for i in range(where[index, 0] * side, min((where[index, 0] + 1) * side, ranges.shape[0]), step):
            for j in range(where[index, 1] * side, min((where[index, 1] + 1) * side, ranges.shape[1]), step):
                if not np.isfinite(ranges[i, j]):
                    continue
                r = ranges[i, j]
                ray, sigma = ray_at(rays, i, j), deviation_at(noise, r)
                height, weight = _term(ray, r, sigma, flat, centre, frame, row)
                residual = height
                for a in range(6):
                    residual -= row[a] * solution[a]
                summed += weight * residual
                weights += weight
                square += weight * residual * residual
                n_pixels += 1
        if weights > 0.0:
            total += summed * summed / weights
            n += 1
    return max(square / max(n_pixels - 6, 1), total / max(n, 1))
