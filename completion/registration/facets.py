# SPDX-License-Identifier: MIT
"""Facets: the flat tiles of a scan, where those of two scans meet, and what beams say of a pose.

A facet of one scan, moved, is looked up in the other's image. It agrees where it lies in a facet of its
direction, in the tile that it falls into or one of those around. It is violated where beams of the other scan
went on through all of these, or where all are of something that faces otherwise at the same place. Else it is
hidden; then, and outside the image, it says nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from completion.evidence.sight import ScanSight, along_ray, pixel_of
from completion.observe.observation import Observation
from completion.observe.rays import Triple, dot, minus
from completion.observe.tiles import LEAST_TILE, MOST_TILE, cut_tiles, tile_side
from completion.observe.tolerance import FLATNESS_M
from completion.registration.limits import (
    FINE_M,
    GATE_M,
    LEAST_DISTANCE_M,
    LEAST_FILL,
    MOST_BENT,
    MOST_FACETS,
    MOST_TILES,
    OTHER_SURFACE,
    ROUGHEST,
    SAME_SURFACE,
)
from scenes.card import shown
from scenes.checks import BoolArray, FloatArray, IntArray
from texture.engine.compiled import compiled, inlined


@shown
class ScanFacets(NamedTuple):
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


def facets_of(seen: Observation, *, curved: bool = False) -> ScanFacets:
    """Return the facets of a scan.

    The error of a facet is that of the mean of its ranges, the error that neighbouring ranges have in common,
    and the flatness of real surfaces, together. With `curved`, tiles that bend are facets too, and what they
    stray from their planes is part of their error.
    """
    ranges, noise = seen.scan.ranges, seen.noise
    least = int(np.ceil(np.sqrt(ranges.size / MOST_TILES)))
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
    bent, straight = np.zeros_like(along), tiles.misfit <= ROUGHEST
    if curved:
        with np.errstate(invalid="ignore"):
            bent = np.square(noise.sigma(distance)) * np.maximum(tiles.misfit - ROUGHEST, 0.0)
            straight = bent < np.square(MOST_BENT * pixel)
    sd = np.sqrt(along + bent + FLATNESS_M**2)
    full = tiles.count >= LEAST_FILL * tiles.side**2
    flat = full & straight & np.isfinite(size) & (cosine > 0.1)
    chosen = np.flatnonzero(flat)
    step = max(1, len(chosen) // MOST_FACETS)
    sample = chosen[step // 2 :: step]
    with np.errstate(invalid="ignore", divide="ignore"):
        area = np.square(pixel) / cosine * step
    return ScanFacets(
        side=tiles.side,
        is_flat=flat,
        plane=np.ascontiguousarray(tiles.plane),
        near=_nearest(ranges, tiles.side, tiles.shape),
        noise=noise.deviation(distance.ravel()).reshape(distance.shape),
        sd=sd,
        centre=seen.scan.origin + tiles.centre.reshape(-1, 3)[sample],
        normal=normal.reshape(-1, 3)[sample],
        deviation=sd.ravel()[sample],
        area=area.ravel()[sample],
    )


def _nearest(ranges: FloatArray, side: int, shape: tuple[int, int]) -> FloatArray:
    """Nearest range in each tile (rows, columns) and those around it, inf where there is none."""
    padded = np.full((shape[0] * side, shape[1] * side), np.inf)
    padded[: ranges.shape[0], : ranges.shape[1]] = np.where(np.isfinite(ranges), ranges, np.inf)
    near = padded.reshape(shape[0], side, shape[1], side).min(axis=(1, 3))
    return np.asarray(ndimage.minimum_filter(near, 3, mode="nearest"))


class Meetings(NamedTuple):
    """What n facets of one scan met in another one, working frame."""

    met: BoolArray  # (n,) a facet of their direction
    offset: FloatArray  # (n,) metres by which they lie behind it, along its normal
    deviation: FloatArray  # (n,) expected error of that, metres
    normal: FloatArray  # (n, 3) of what they met, in the frame of the other scan as its pose is given
    depth: (
        FloatArray  # (n,) metres along the normal by which beams went on behind them; 0 where none surely did
    )


@compiled
def meet(facets: ScanFacets, motion: FloatArray, sight: ScanSight, other: ScanFacets, step: int) -> Meetings:
    """Hold every step-th facet of one scan, moved by `motion` (3, 4), against another scan.

    A facet meets another one of its direction that it lies in front of or behind by at most `GATE_M`. Beams
    went through it where they ended behind it by more than noise allows: by the facet that it met, or by the
    nearest range in the tile and all around, so that edges do not count.
    """
    n, eye = (len(facets.centre) + step - 1) // step, sight.eye
    met, offset, deviation = np.zeros(n, np.bool_), np.zeros(n), np.zeros(n)
    normal, depth, columns = np.zeros((n, 3)), np.zeros(n), eye.shape[1]
    for k in range(n):
        members = facets.deviation[k * step]
        place = _moved_vector(motion, facets.centre, k * step, 1.0)
        facing = _moved_vector(motion, facets.normal, k * step, 0.0)
        pixel = pixel_of(eye, sight.angles, place)
        if pixel < 0:
            continue
        row, column = pixel // columns // other.side, pixel % columns // other.side
        ray = minus(place, eye.origin)
        distance = np.sqrt(dot(ray, ray))
        if other.is_flat[row, column]:
            w = other.plane[row, column, 0], other.plane[row, column, 1], other.plane[row, column, 2]
            size = np.sqrt(dot(w, w))
            behind = (dot(w, ray) - 1.0) / size
            if dot(w, facing) > SAME_SURFACE * size and abs(behind) <= GATE_M:
                met[k], offset[k] = True, behind
                deviation[k] = np.sqrt(members * members + other.sd[row, column] ** 2)
                normal[k, 0], normal[k, 1], normal[k, 2] = w[0] / size, w[1] / size, w[2] / size
                if -behind > eye.n_sigma * deviation[k]:
                    depth[k] = -behind
                continue
        cosine = abs(dot(ray, facing)) / max(distance, LEAST_DISTANCE_M)
        farther = other.near[row, column] - distance
        allowed = along_ray(eye, other.noise[row, column], members, cosine)
        if np.isfinite(farther) and farther > allowed and allowed <= eye.max_m:
            depth[k] = farther * cosine
    return Meetings(met, offset, deviation, normal, depth)


@inlined
def _moved_vector(motion: FloatArray, vectors: FloatArray, k: int, shift: float) -> Triple:
    """The k-th place moved, or with `shift` 0 the k-th direction turned."""
    x, y, z = vectors[k, 0], vectors[k, 1], vectors[k, 2]
    return (
        motion[0, 0] * x + motion[0, 1] * y + motion[0, 2] * z + shift * motion[0, 3],
        motion[1, 0] * x + motion[1, 1] * y + motion[1, 2] * z + shift * motion[1, 3],
        motion[2, 0] * x + motion[2, 1] * y + motion[2, 2] * z + shift * motion[2, 3],
    )


AGREES, VIOLATED, HIDDEN, OUTSIDE = 0, 1, -1, -2
"""What a scan says of a facet: it agrees, is violated or hidden, or no pixel holds its place."""


@compiled
def count_agreement(
    facets: ScanFacets,
    sample: IntArray,
    motions: FloatArray,
    sight: ScanSight,
    other: ScanFacets,
    within_m: float,
) -> IntArray:
    """Return for each motion (n, 3, 4) of one scan's facets what the other says (n, 3).

    Counted are facets of the `sample` (k,) that agree, that are violated, and that its image holds.
    `within_m` is added to the expected error of both: how far poses may still be off, metres.
    """
    counts = np.zeros((len(motions), 3), np.int64)
    for number in range(len(motions)):
        for facet in ask_facets(facets, sample, motions[number], sight, other, within_m):
            if facet != OUTSIDE:
                counts[number, 2] += 1
            if facet >= 0:
                counts[number, facet] += 1
    return counts


@compiled
def ask_facets(
    members: ScanFacets,
    sample: IntArray,
    motion: FloatArray,
    sight: ScanSight,
    other: ScanFacets,
    within_m: float,
) -> IntArray:
    """Return for a motion (3, 4) what the other scan says of each facet of the `sample` (k,)."""
    eye, m, facets = sight.eye, motion, np.full(len(sample), OUTSIDE)
    columns = eye.shape[1]
    for number in range(len(sample)):
        k = sample[number]
        x, y, z = members.centre[k, 0], members.centre[k, 1], members.centre[k, 2]
        place = (
            m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3],
            m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3],
            m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3],
        )
        pixel = pixel_of(eye, sight.angles, place)
        if pixel < 0:
            continue
        x, y, z = members.normal[k, 0], members.normal[k, 1], members.normal[k, 2]
        facing = (
            m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
            m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
            m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
        )
        row, column = pixel // columns // other.side, pixel % columns // other.side
        ray = minus(place, eye.origin)
        facets[number] = _answer(other, row, column, ray, facing, members.deviation[k], eye.n_sigma, within_m)
    return facets


@inlined
def _answer(
    other: ScanFacets,
    row: int,
    column: int,
    ray: Triple,
    facing: Triple,
    deviation: float,
    n_sigma: float,
    within_m: float,
) -> int:
    """What a tile and those around it say of a facet."""
    rows, columns = other.is_flat.shape
    faced, asked = 0, 0
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        for c in range(max(column - 1, 0), min(column + 2, columns)):
            asked += 1
            if not other.is_flat[r, c]:
                continue
            w = other.plane[r, c, 0], other.plane[r, c, 1], other.plane[r, c, 2]
            size = np.sqrt(dot(w, w))
            behind = (dot(w, ray) - 1.0) / size
            noise = n_sigma * np.sqrt(deviation**2 + other.sd[r, c] ** 2)
            cosine = dot(w, facing) / size
            if cosine > SAME_SURFACE and abs(behind) <= noise + within_m:
                return AGREES
            if cosine < OTHER_SURFACE and abs(behind) <= noise + min(within_m, FINE_M):
                faced += 1
    if faced == asked:
        return VIOLATED
    distance = np.sqrt(dot(ray, ray))
    cosine = abs(dot(ray, facing)) / max(distance, LEAST_DISTANCE_M)
    farther = other.near[row, column] - distance
    if np.isfinite(farther) and farther * cosine > n_sigma * deviation + within_m:
        return VIOLATED
    return HIDDEN
