# SPDX-License-Identifier: MIT
"""Agreement: what the beams of two scans say of a pose of one to the other.

A facet of one scan, moved, is looked up in the other's image. It agrees where it lies in a facet of its
direction. It is violated where beams of the other scan went on through it, or where they end in something
that faces otherwise at the same place. It is hidden where they end before it; then, and outside the image, it
says nothing.
"""

from __future__ import annotations

import numpy as np

from completion.evidence.registration.facets import Facets
from completion.evidence.sight import Sight, pixel_of
from completion.observe.triple import dot, minus
from scenes.checks import FloatArray, IntArray
from texture.engine.compiled import compiled

_ALIKE = 0.8  # cosine of the normals of two facets of one surface: 37 degrees
_LEAST_M = 1e-12


@compiled
def count_agreement(
    own: Facets, sample: IntArray, motions: FloatArray, sight: Sight, other: Facets, within_m: float
) -> IntArray:
    """Return for each motion (n, 3, 4) of one scan's facets what the other says (n, 3).

    Counted are facets of the `sample` (k,) that agree, that are violated, and that its image holds.
    `within_m` is added to the expected error of both: how far poses may still be off, metres.
    """
    eye, found = sight.eye, np.zeros((len(motions), 3), np.int64)
    columns = eye.shape[1]
    for number in range(len(motions)):
        m = motions[number]
        for k in sample:
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
            distance = np.sqrt(dot(ray, ray))
            found[number, 2] += 1
            if other.is_flat[row, column]:
                w = other.plane[row, column, 0], other.plane[row, column, 1], other.plane[row, column, 2]
                size = np.sqrt(dot(w, w))
                behind = (dot(w, ray) - 1.0) / size
                sd = np.sqrt(own.deviation[k] ** 2 + other.sd[row, column] ** 2)
                allowed = eye.n_sigma * sd + within_m
                if abs(behind) <= allowed:
                    # at the same place: alike, or something else
                    found[number, 0 if dot(w, facing) > _ALIKE * size else 1] += 1
                elif behind < 0:
                    found[number, 1] += 1
                continue
            cosine = abs(dot(ray, facing)) / max(distance, _LEAST_M)
            farther = other.near[row, column] - distance
            if np.isfinite(farther) and farther * cosine > eye.n_sigma * own.deviation[k] + within_m:
                found[number, 1] += 1
    return found
