# SPDX-License-Identifier: MIT
"""Facets: the flat tiles of a scan, by which its pose is compared with those of others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from completion.observe.observation import Observation
from completion.observe.tiles import LEAST_TILE, MOST_TILE, cut_tiles, tile_side
from completion.observe.tolerance import FLATNESS_M
from scenes.checks import BoolArray, FloatArray

_MOST_TILES = 20_000  # of a scan, about: larger images are cut into larger tiles
_ROUGHEST = 2.0  # weighted square residual by freedom of a tile that counts as flat
_MOST_BENT = 0.15  # of a tile's side, by which curved ones may stray
_FULL = 0.9  # of a facet's pixels that brought something back
_MOST_FACETS = 1500  # of a scan that are compared with other scans


class Facets(NamedTuple):
    """A scan in tiles of `side` pixels, working frame; the flat ones are facets."""

    side: int
    is_flat: BoolArray  # (rows, columns) of tiles
    plane: FloatArray  # (rows, columns, 3) w of each: w . x = 1, x from the sensor; NaN for none
    near: FloatArray  # (rows, columns) nearest range in each tile and those around it, metres; inf for none
    noise: FloatArray  # (rows, columns) expected error of a single range there, metres
    sd: FloatArray  # (rows, columns) expected error of a facet along its normal, metres
    centre: FloatArray  # (n, 3) of some facets, evenly over the image
    normal: FloatArray  # (n, 3) away from the sensor
    deviation: FloatArray  # (n,) expected error of each along its normal, metres
    area: FloatArray  # (n,) each stands for, square metres


def facets_of(seen: Observation, *, curved: bool = False) -> Facets:
    """Return the facets of a scan.

    The error of a facet is that of the mean of its ranges, the error that neighbouring ranges have in common,
    and the flatness of real surfaces, together. With `curved`, tiles that bend are facets too, and what they
    stray from their planes is part of their error.
    """
    ranges, noise = seen.scan.ranges, seen.noise
    least = int(np.ceil(np.sqrt(ranges.size / _MOST_TILES)))
    side = max(tile_side(ranges, noise.numbers(), seen.scan.projection.pixel_angle), least, LEAST_TILE)
    tiles = cut_tiles(ranges, seen.rays, noise.numbers(), FLATNESS_M, min(side, MOST_TILE))
    distance = np.linalg.norm(tiles.centre, axis=-1)
    size = np.linalg.norm(tiles.plane, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = tiles.plane / size[..., None]
        cosine = 1.0 / (size * np.linalg.norm(tiles.centre, axis=-1))
        white = np.square(noise.sigma(distance)) / np.maximum(tiles.count, 1.0)
    along = (white + np.square(noise.bias(distance))) * np.square(np.minimum(cosine, 1.0))
    pixel = distance * seen.scan.projection.pixel_angle * tiles.side
    bent, straight = np.zeros_like(along), tiles.misfit <= _ROUGHEST
    if curved:
        with np.errstate(invalid="ignore"):
            bent = np.square(noise.sigma(distance)) * np.maximum(tiles.misfit - _ROUGHEST, 0.0)
            straight = bent < np.square(_MOST_BENT * pixel)
    sd = np.sqrt(along + bent + FLATNESS_M**2)
    full = tiles.count >= _FULL * tiles.side**2
    flat = full & straight & np.isfinite(size) & (cosine > 0.1)
    chosen = np.flatnonzero(flat)
    step = max(1, len(chosen) // _MOST_FACETS)
    some = chosen[step // 2 :: step]
    with np.errstate(invalid="ignore", divide="ignore"):
        area = np.square(pixel) / cosine * step
    return Facets(
        side=tiles.side,
        is_flat=flat,
        plane=np.ascontiguousarray(tiles.plane),
        near=_nearest(ranges, tiles.side, tiles.shape),
        noise=noise.deviation(distance.ravel()).reshape(distance.shape),
        sd=sd,
        centre=seen.scan.origin + tiles.centre.reshape(-1, 3)[some],
        normal=normal.reshape(-1, 3)[some],
        deviation=sd.ravel()[some],
        area=area.ravel()[some],
    )


def _nearest(ranges: FloatArray, side: int, shape: tuple[int, int]) -> FloatArray:
    """Nearest range in each tile (rows, columns) and those around it, inf where there is none."""
    padded = np.full((shape[0] * side, shape[1] * side), np.inf)
    padded[: ranges.shape[0], : ranges.shape[1]] = np.where(np.isfinite(ranges), ranges, np.inf)
    near = padded.reshape(shape[0], side, shape[1], side).min(axis=(1, 3))
    return np.asarray(ndimage.minimum_filter(near, 3, mode="nearest"))
