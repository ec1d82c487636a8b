# SPDX-License-Identifier: MIT
"""Agreement: what the beams of two scans say of a pose of one to the other.

A facet of one scan, moved, is looked up in the other's image. It agrees where it lies in a facet of its
direction, in the tile that it falls into or one of those around. It is violated where beams of the other scan
went on through all of these, or where all are of something that faces otherwise at the same place. Else it is
hidden; then, and outside the image, it says nothing.
"""

from __future__ import annotations

import numpy as np

from completion.evidence.registration.facets import Facets
from completion.evidence.sight import Sight, pixel_of
from completion.observe.triple import Triple, dot, minus
from scenes.checks import FloatArray, IntArray
from texture.engine.compiled import compiled

AGREES, VIOLATED, HIDDEN, OUTSIDE = 0, 1, -1, -2
"""What a scan says of a facet: it agrees, is violated or hidden, or no pixel holds its place."""

_ALIKE = 0.8  # cosine of the normals of two facets of one surface: 37 degrees
_OTHER = 0.5  # of two that are not of one surface: 60 degrees
_LEAST_M = 1e-12
_SAME_M = 0.01  # within which two that face otherwise are at the same place


@compiled
def count_agreement(
    own: Facets, sample: IntArray, motions: FloatArray, sight: Sight, other: Facets, within_m: float
) -> IntArray:
    """Return for each motion (n, 3, 4) of one scan's facets what the other says (n, 3).

    Counted are facets of the `sample` (k,) that agree, that are violated, and that its image holds.
    `within_m` is added to the expected error of both: how far poses may still be off, metres.
    """
    found = np.zeros((len(motions), 3), np.int64)
    for number in range(len(motions)):
        for told in ask_facets(own, sample, motions[number], sight, other, within_m):
            if told != OUTSIDE:
                found[number, 2] += 1
            if told >= 0:
                found[number, told] += 1
    return found


@compiled
def ask_facets(
    own: Facets, sample: IntArray, motion: FloatArray, sight: Sight, other: Facets, within_m: float
) -> IntArray:
    """Return for a motion (3, 4) what the other scan says of each facet of the `sample` (k,)."""
    eye, m, found = sight.eye, motion, np.full(len(sample), OUTSIDE)
    columns = eye.shape[1]
    for number in range(len(sample)):
        k = sample[number]
        x, y, z = own.centre[k, 0], own.centre[k, 1], own.centre[k, 2]
        place = (
            m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3],
            m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3],
            m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3],
        )
        pixel = pixel_of(eye, sight.angles, place)
        if pixel < 0:
            continue
        x, y, z = own.normal[k, 0], own.normal[k, 1], own.normal[k, 2]
        facing = (
            m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
            m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
            m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
        )
        row, column = pixel // columns // other.side, pixel % columns // other.side
        ray = minus(place, eye.origin)
        found[number] = _told(other, row, column, ray, facing, own.deviation[k], eye.n_sigma, within_m)
    return found


@compiled
def _told(
    other: Facets,
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
            if cosine > _ALIKE and abs(behind) <= noise + within_m:
                return AGREES
            if cosine < _OTHER and abs(behind) <= noise + min(within_m, _SAME_M):
                faced += 1
    if faced == asked:
        return VIOLATED
    distance = np.sqrt(dot(ray, ray))
    cosine = abs(dot(ray, facing)) / max(distance, _LEAST_M)
    farther = other.near[row, column] - distance
    if np.isfinite(farther) and farther * cosine > n_sigma * deviation + within_m:
        return VIOLATED
    return HIDDEN
