# SPDX-License-Identifier: MIT
"""Clusters: the planes and cylinders that grow over the tiles of an image, until no seed is left."""

from __future__ import annotations

import numpy as np

from completion.observe.observation import Observation
from completion.observe.tiles import Tiles
from completion.segmentation.curvature import bending_cylinder, grow_cylinder
from completion.segmentation.growing import Cluster, grow_plane, tile_cut
from completion.segmentation.regions import SegmentationOptions
from completion.segmentation.seeds import find_seeds, next_seed

_LEAST_TILES = 3  # in a row or corner: fewer show neither plane nor cylinder


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
