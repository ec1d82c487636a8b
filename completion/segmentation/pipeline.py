# SPDX-License-Identifier: MIT
"""Segmentation: a range image as regions on planes and cylinders, from tiles down to the pixel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from completion.observe.observation import LabelledBeams, Observation, PixelSet
from completion.observe.packed_surfaces import pack
from completion.observe.refitting import improve, refit
from completion.observe.tiles import LEAST_TILE, ImageTiles, cut_tiles, spread_over_pixels, tile_side
from completion.segmentation.competition import absorb, compete, sharpen_creases
from completion.segmentation.curvature import bending_cylinder, grow_cylinder
from completion.segmentation.growing import (
    Cluster,
    depths_within,
    find_seeds,
    grow_plane,
    next_seed,
    tile_cut,
)
from completion.segmentation.limits import FEWEST_TILES, MOST_BULGE
from completion.segmentation.regions import Region, SegmentationOptions, split_parts
from completion.segmentation.relief import join_relief
from scenes.checks import FloatArray

_THINNING = 3  # of the pixels that surfaces are first refitted to


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
    placed = improve(
        surfaces, [LabelledBeams.of(observation, labels).subsample(_THINNING)], options.least_flatness_m
    )
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
) -> tuple[NDArray[np.int32], FloatArray, ImageTiles]:
    """Labels of the pixels, from 1, and the packed surfaces, by coarse tiles and then by finer ones."""
    scan, spacing = observation.scan, observation.scan.projection.pixel_angle
    side = tile_side(scan.ranges, observation.noise.numbers(), spacing)
    noise = observation.noise.numbers(bulge=MOST_BULGE * spacing)
    labels, models = np.zeros(scan.shape, np.int32), np.zeros((0, 9))
    tiles = cut_tiles(scan.ranges, observation.rays, noise, options.least_flatness_m, side)
    fine = tiles
    for thorough in (False, True):
        if thorough:
            left = np.where(labels == 0, scan.ranges, np.inf)
            half = max(LEAST_TILE, side // 2)
            fine = cut_tiles(left, observation.rays, noise, options.least_flatness_m, half)
        clusters = find_clusters(fine, observation, options, thorough=thorough)
        labels = _number_clusters(labels, clusters, fine, len(models))
        models = np.concatenate([models, *(cluster.model[None] for cluster in clusters)])
        labels = compete(labels, models, observation, tiles, options)
    return labels, models, tiles


def _number_clusters(
    labels: NDArray[np.int32], clusters: Sequence[Cluster], tiles: ImageTiles, n_before: int
) -> NDArray[np.int32]:
    """The labels with the clusters' pixels numbered on from `n_before`, where there was none."""
    numbers = np.zeros(tiles.shape, np.int32)
    for number, cluster in enumerate(clusters, start=n_before + 1):
        numbers[cluster.tiles] = number
    return np.where(labels == 0, spread_over_pixels(tiles, numbers, labels.shape), labels)


def find_clusters(
    tiles: ImageTiles, observation: Observation, options: SegmentationOptions, *, thorough: bool
) -> list[Cluster]:
    """Grow planes and cylinders over the tiles until no seed is left.

    Seeds lie among tiles that form one plane with those around; when `thorough`, single tiles are seeds too.
    """
    seeds = find_seeds(tiles)
    free, clusters = seeds.flat.copy(), list[Cluster]()
    cut, angle = tile_cut(options), np.radians(options.max_angle_deg)
    for candidates in (seeds.coherent, seeds.flat) if thorough else (seeds.coherent,):
        untried, depths = candidates.copy(), depths_within(candidates)
        while len(clusters) < options.max_regions:
            seed = next_seed(untried & free, depths)
            if seed is None:
                break
            cluster = grow_plane(seed, free, tiles, cut, angle)
            untried[seed] = False
            if cluster is None:
                continue
            if np.count_nonzero(cluster.tiles) < FEWEST_TILES:
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
