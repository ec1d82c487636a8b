# SPDX-License-Identifier: MIT
"""Segmentation: a range image as regions on planes and cylinders, from tiles down to the pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.observe.observation import Beams, Observation
from completion.observe.pixel_set import PixelSet
from completion.observe.refits.packed_surfaces import pack
from completion.observe.refits.refitting import improve, refit
from completion.observe.tiles import LEAST_TILE, Tiles, cut_tiles, solve_plane, spread_over_pixels, tile_side
from completion.segmentation.absorbing import absorb, sharpen_creases
from completion.segmentation.competition import compete
from completion.segmentation.curvature import bending_cylinder, grow_cylinder
from completion.segmentation.growing import CHI2_3, Cluster, grow_plane, quadratic, tile_cut
from completion.segmentation.regions import Region, SegmentationOptions, split_parts
from completion.segmentation.relief import join_relief
from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled

_THINNING = 3  # of the pixels that surfaces are first refitted to
_LEAST_TILES = 3  # in a row or corner: fewer show neither plane nor cylinder
_BULGE = 0.1  # pixel footprints that a tile on a cylinder of a few pixels' radius strays from its plane
_MAX_MISFIT = 3.0  # of a tile that an edge may not cross
_SEED_CUT = 0.25  # excess of the plane through 3 x 3 tiles below which they are one surface


def segment(observation: Observation, options: SegmentationOptions) -> list[Region]:
    """Cut a scan into regions on planes and cylinders.

    Planes grow over tiles, from the middle of the largest area that is flat; where a patch bends by more
    than its noise, a cylinder grows from it instead. Then pixels compete: each goes to the surface near by
    that it fits best. What is left over is cut into finer tiles, for small faces. Connected parts are
    refitted, errors along the rays; warps go back to the surface around them, and edges that the sensor has
    rounded to the planes that meet there; and pixels compete once more. Pieces that an uneven plane broke
    into are joined.
    """
    labels, models, tiles = _grow(observation, options)
    labels, surfaces = split_parts(labels, models, observation, options)
    placed = improve(surfaces, [Beams.of(observation, labels).thinned(_THINNING)], options.least_flatness_m)
    surfaces = [new or old for new, old in zip(placed, surfaces, strict=True)]
    models = np.array([pack(surface, observation.scan.origin) for surface in surfaces]).reshape(-1, 9)
    labels = absorb(labels, models, surfaces, observation, options)
    labels = sharpen_creases(labels, models, observation)
    labels = compete(labels, models, observation, tiles, options)
    labels, surfaces = split_parts(labels, models, observation, options)
    fits = refit(surfaces, [observation], [labels], options.least_flatness_m)
    each = PixelSet.by_label(labels, len(fits))
    regions = [Region(fit, pixels) for fit, pixels in zip(fits, each, strict=True) if fit is not None]
    return join_relief(regions, observation, options)


def _grow(
    observation: Observation, options: SegmentationOptions
) -> tuple[NDArray[np.int32], FloatArray, Tiles]:
    """Labels of the pixels, from 1, and the packed surfaces, by coarse tiles and then by finer ones."""
    scan, spacing = observation.scan, observation.scan.projection.pixel_angle
    side = tile_side(scan.ranges, observation.noise.numbers(), spacing)
    noise = observation.noise.numbers(bulge=_BULGE * spacing)
    labels, models = np.zeros(scan.shape, np.int32), np.zeros((0, 9))
    tiles = cut_tiles(scan.ranges, observation.rays, noise, options.least_flatness_m, side)
    fine = tiles
    for thorough in (False, True):
        if thorough:
            left = np.where(labels == 0, scan.ranges, np.inf)
            half = max(LEAST_TILE, side // 2)
            fine = cut_tiles(left, observation.rays, noise, options.least_flatness_m, half)
        clusters = find_clusters(fine, observation, options, thorough=thorough)
        labels = _numbered(labels, clusters, fine, len(models))
        models = np.concatenate([models, *(cluster.model[None] for cluster in clusters)])
        labels = compete(labels, models, observation, tiles, options)
    return labels, models, tiles


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
    free, clusters = seeds.flat.copy(), list[Cluster]()
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
            if np.count_nonzero(cluster.tiles) < _LEAST_TILES:
                untried &= ~cluster.tiles
                continue
            start = bending_cylinder(cluster, free, tiles, observation, angle)
            grown = (
                None
                if start is None
                else grow_cylinder(
                    start, cluster, free=free, tiles=tiles, observation=observation, options=options
                )
            )
            cluster = grown or cluster
            untried &= ~cluster.tiles
            if cluster.n_pixels >= options.min_pixels:
                clusters.append(cluster)
                free &= ~cluster.tiles
    return clusters


@dataclass(frozen=True, slots=True, eq=False)
class Seeds:
    """Where growing may begin and go."""

    flat: BoolArray  # (rows, columns) tiles that no edge crosses
    coherent: BoolArray  # (rows, columns) those that lie on one plane with the tiles around


def find_seeds(tiles: Tiles) -> Seeds:
    """Tell which tiles lie inside one surface, alone and with their neighbours."""
    flat: BoolArray = tiles.misfit <= _MAX_MISFIT * (1 + 3 * np.sqrt(2 / np.maximum(tiles.count - 3, 1)))
    return Seeds(flat, _coherent(flat, tiles.count, tiles.matrix, tiles.vector, tiles.plane, tiles.misfit))


def next_seed(candidates: BoolArray) -> tuple[int, int] | None:
    """Return row and column of the tile in the middle of the largest area of candidates (rows, columns).

    None when nothing is left.
    """
    if not candidates.any():
        return None
    depth = cv2.distanceTransform(np.pad(candidates, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(depth)), depth.shape)
    return int(row), int(column)


@compiled
def _coherent(
    flat: BoolArray,
    count: FloatArray,
    matrix: FloatArray,
    vector: FloatArray,
    plane: FloatArray,
    misfit: FloatArray,
) -> BoolArray:
    """Which flat tiles agree with the plane of their flat neighbours."""
    rows, columns = flat.shape
    result = np.zeros((rows, columns), np.bool_)
    a, b, w = np.zeros(6), np.zeros(3), np.zeros(3)
    for i in range(rows):
        for j in range(columns):
            if not flat[i, j]:
                continue
            a[:], b[:] = 0.0, 0.0
            n, n_pixels = 0, 0.0
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for m in range(max(j - 1, 0), min(j + 2, columns)):
                    if flat[k, m]:
                        for t in range(6):
                            a[t] += matrix[k, m, t]
                        for t in range(3):
                            b[t] += vector[k, m, t]
                        n += 1
                        n_pixels += count[k, m]
            if n < 5 or not solve_plane(a, b, w):
                continue
            excess, worst = 0.0, 1.0
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for m in range(max(j - 1, 0), min(j + 2, columns)):
                    if flat[k, m]:
                        own = plane[k, m]
                        excess += quadratic(matrix[k, m], w[0] - own[0], w[1] - own[1], w[2] - own[2])
                        worst = max(worst, misfit[k, m])
            result[i, j] = excess <= (_SEED_CUT * n_pixels + CHI2_3 * n) * worst
    return result
