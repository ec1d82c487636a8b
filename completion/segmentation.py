# SPDX-License-Identifier: MIT
"""Segmentation: a range image as regions on planes and cylinders, from tiles down to the pixel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray
from skimage.measure import label as connected_parts

from completion.absorbing import absorb
from completion.competition import compete
from completion.curvature import bending_cylinder, grow_cylinder
from completion.growing import Cluster, find_seeds, grow_plane, next_seed, pack, tile_cut
from completion.observation import Observation
from completion.refitting import Beams, improve, refit
from completion.regions import Region, SegmentationOptions
from completion.tiles import LEAST_TILE, Tiles, cut_tiles, spread_over_pixels, tile_side
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces import Cylinder, Plane, Surface


_BULGE = 0.1  # pixel footprints that a tile on a cylinder of a few pixels' radius strays from its plane


def segment(observation: Observation, options: SegmentationOptions) -> list[Region]:
    """Cut a scan into regions on planes and cylinders.

    Planes grow over tiles, from the middle of the largest area that is flat; where a patch bends by more
    than its noise, a cylinder grows from it instead. Then pixels compete: each goes to the surface near by that
    it fits best. What is left over is cut into finer tiles for small faces. Connected parts are refitted on
    all their pixels, errors along the rays, and compete once more.
    """
    side = tile_side(observation.scan.ranges, observation.sigma, observation.scan.projection.pixel_angle)
    labels, models = np.zeros(observation.scan.shape, np.int32), np.zeros((0, 11))
    tiles = _tiles(observation, observation.valid, options, side)
    for size, thorough in ((side, False), (max(LEAST_TILE, side // 2), True)):
        left = observation.valid & (labels == 0)
        cut = tiles if not thorough else _tiles(observation, left, options, size)
        clusters = find_clusters(cut, observation, options, thorough=thorough)
        labels = _numbered(labels, clusters, cut, len(models))
        models = np.concatenate([models, *(cluster.model[None] for cluster in clusters)])
        labels = compete(labels, models, observation, tiles, options)
    labels, surfaces = split_parts(labels, models, observation, options)
    placed = improve(surfaces, [Beams.of(observation, labels)], options.flatness_m)
    surfaces = [new or old for new, old in zip(placed, surfaces, strict=True)]
    models = np.array([pack(surface, observation.scan.origin) for surface in surfaces]).reshape(-1, 11)
    labels = absorb(labels, models, surfaces, observation, options)
    labels = compete(labels, models, observation, tiles, options)
    labels, surfaces = split_parts(labels, models, observation, options)
    fits = refit(surfaces, [observation], [labels], options.flatness_m)
    return [Region(fit, labels == number) for number, fit in enumerate(fits, start=1) if fit is not None]


def _tiles(observation: Observation, usable: BoolArray, options: SegmentationOptions, side: int) -> Tiles:
    """Tiles of the usable pixels."""
    ranges = np.where(usable, observation.scan.ranges, np.inf)
    spacing = observation.scan.projection.pixel_angle
    sigma = np.hypot(observation.sigma, _BULGE * spacing * observation.scan.ranges)
    return cut_tiles(ranges, observation.rays, sigma, options.flatness_m, side, spacing)


def _numbered(
    labels: NDArray[np.int32], clusters: Sequence[Cluster], tiles: Tiles, n_before: int
) -> NDArray[np.int32]:
    """The labels with the clusters' pixels numbered on from `n_before`, where there was none."""
    numbers = np.zeros(tiles.shape, np.int32)
    for number, cluster in enumerate(clusters, start=n_before + 1):
        numbers[cluster.tiles] = number
    return np.where(labels == 0, spread_over_pixels(tiles, numbers, labels.shape), labels)


def find_clusters(
    tiles: Tiles, observation: Observation, options: SegmentationOptions, *, thorough: bool
) -> list[Cluster]:
    """Grow planes and cylinders over the tiles until no seed is left.

    Seeds lie among tiles that form one plane with those around; when `thorough`, single tiles are seeds too.
    """
    seeds = find_seeds(tiles)
    free, clusters = seeds.flat.copy(), []
    cut, angle = tile_cut(options), np.radians(options.max_angle_deg)
    for candidates in (seeds.coherent, seeds.flat) if thorough else (seeds.coherent,):
        untried = candidates.copy()
        while len(clusters) < options.max_regions:
            seed = next_seed(untried & free)
            if seed is None:
                break
            cluster = grow_plane(seed, free, tiles, cut, angle)
            untried[seed] = False
            if cluster is None:
                continue
            start = bending_cylinder(cluster, free, tiles, observation, angle)
            grown = (
                None if start is None else grow_cylinder(start, cluster, free, tiles, observation, options)
            )
            cluster = grown or cluster
            untried &= ~cluster.tiles
            if cluster.n_pixels >= options.min_pixels:
                clusters.append(cluster)
                free &= ~cluster.tiles
    return clusters


def split_parts(
    labels: NDArray[np.int32], models: FloatArray, observation: Observation, options: SegmentationOptions
) -> tuple[NDArray[np.int32], list[Surface]]:
    """Number the connected parts that are large enough and nowhere only a seam; the surface of each."""
    parts = connected_parts(labels, connectivity=1, background=0).astype(np.int32)
    count, core, model, centre = _part_sums(parts, labels, observation.points, int(parts.max()) + 1)
    kept = (count >= options.min_pixels) & (core > 0)
    kept[0] = False
    order = np.flatnonzero(kept)
    order = order[np.argsort(-count[order], kind="stable")][: options.max_regions]
    number = np.zeros(len(count), np.int32)
    number[order] = np.arange(1, len(order) + 1)
    surfaces = [
        unpack(models[model[part] - 1], centre[part] / count[part], observation.scan.origin) for part in order
    ]
    return number[parts], surfaces


def unpack(model: FloatArray, centre: FloatArray, origin: FloatArray) -> Surface:
    """The surface that a packed model stands for, its own point next to `centre`, facing the sensor."""
    if model[0] == 0.0:
        size = float(np.linalg.norm(model[1:4]))
        normal = -model[1:4] / size
        height = float((centre - origin) @ normal) + 1.0 / size
        return Plane(centre - height * normal, normal)
    point, direction = model[1:4] + origin, model[4:7]
    point = point + float((centre - point) @ direction) * direction
    return Cylinder(point, direction, float(model[7]), None, bool(model[8] < 0))


@njit(cache=True, nogil=True, error_model="numpy")
def _part_sums(parts, labels, points, n):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    count, core = np.zeros(n, np.int64), np.zeros(n, np.int64)
    model, centre = np.zeros(n, np.int64), np.zeros((n, 3))
    rows, columns = parts.shape
    for i in range(rows):
        for j in range(columns):
            part = parts[i, j]
            if part == 0:
                continue
            count[part] += 1
            model[part] = labels[i, j]
            centre[part] += points[i, j]
            if core[part] == 0 and 0 < i < rows - 1 and 0 < j < columns - 1:
                whole = True
                for k in range(i - 1, i + 2):
                    if parts[k, j - 1] != part or parts[k, j] != part or parts[k, j + 1] != part:
                        whole = False
                        break
                core[part] += whole
    return count, core, model, centre
