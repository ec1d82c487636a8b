# SPDX-License-Identifier: MIT
"""Meetings: where the facets of one scan come to lie among those of another one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from completion.evidence.registration.facets import Facets
from completion.evidence.sight import Sight, along_ray, pixel_of
from completion.observe.triple import Triple, dot, minus
from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled, inlined

GATE_M = 0.3
"""How far apart two facets of one surface may lie, metres; poses that are farther off are not told."""

_ALIKE = 0.8  # cosine of the normals of two facets of one surface: 37 degrees
_LEAST_M = 1e-12


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
def meet(facets: Facets, motion: FloatArray, sight: Sight, other: Facets, step: int) -> Meetings:
    """Hold every step-th facet of one scan, moved by `motion` (3, 4), against another scan.

    A facet meets another one of its direction that it lies in front of or behind by at most `GATE_M`. Beams
    went through it where they ended behind it by more than noise allows: by the facet that it met, or by the
    nearest range in the tile and all around, so that edges do not count.
    """
    n, eye = (len(facets.centre) + step - 1) // step, sight.eye
    met, offset, deviation = np.zeros(n, np.bool_), np.zeros(n), np.zeros(n)
    normal, depth, columns = np.zeros((n, 3)), np.zeros(n), eye.shape[1]
    for k in range(n):
        own = facets.deviation[k * step]
        place = _moved(motion, facets.centre, k * step, 1.0)
        facing = _moved(motion, facets.normal, k * step, 0.0)
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
            if dot(w, facing) > _ALIKE * size and abs(behind) <= GATE_M:
                met[k], offset[k] = True, behind
                deviation[k] = np.sqrt(own * own + other.sd[row, column] ** 2)
                normal[k, 0], normal[k, 1], normal[k, 2] = w[0] / size, w[1] / size, w[2] / size
                if -behind > eye.n_sigma * deviation[k]:
                    depth[k] = -behind
                continue
        cosine = abs(dot(ray, facing)) / max(distance, _LEAST_M)
        farther = other.near[row, column] - distance
        allowed = along_ray(eye, other.noise[row, column], own, cosine)
        if np.isfinite(farther) and farther > allowed and allowed <= eye.max_m:
            depth[k] = farther * cosine
    return Meetings(met, offset, deviation, normal, depth)


@inlined
def _moved(motion: FloatArray, vectors: FloatArray, k: int, shift: float) -> Triple:
    """The k-th place moved, or with `shift` 0 the k-th direction turned."""
    x, y, z = vectors[k, 0], vectors[k, 1], vectors[k, 2]
    return (
        motion[0, 0] * x + motion[0, 1] * y + motion[0, 2] * z + shift * motion[0, 3],
        motion[1, 0] * x + motion[1, 1] * y + motion[1, 2] * z + shift * motion[1, 3],
        motion[2, 0] * x + motion[2, 1] * y + motion[2, 2] * z + shift * motion[2, 3],
    )
