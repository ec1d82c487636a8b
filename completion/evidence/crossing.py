# SPDX-License-Identifier: MIT
"""Crossing: which tiles of an image hold beams that may have gone through a chart."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from completion.evidence.form import Form, chart_of
from completion.evidence.reach import Reach, farthest_along
from completion.evidence.sight import Eye
from completion.observe.rays import Noise, deviation_at
from completion.observe.triple import Triple, dot, minus, plus
from scenes.checks import BoolArray
from texture.engine.compiled import compiled, inlined

_LEAST_COSINE = 1e-3  # of incidence that tolerances are reckoned with
_SLACK = 1e-6  # of lengths, which are kept in single precision


class Rectangle(NamedTuple):
    """Part of a chart, metres."""

    left: float
    right: float
    low: float
    high: float


@compiled
def crossing_tiles(
    eye: Eye, noise: Noise, form: Form, reach: Reach, part: Rectangle, least_sd: float
) -> BoolArray:
    """Tell which tiles (rows, columns) hold beams that may count as gone through part of a chart.

    `least_sd` is the smallest predicted deviation of the surface there, metres. A no is sure: no beam of the
    tile crosses the part and ends behind it by more than the tolerance.
    """
    if form.is_curved:
        return _across_cylinder(eye, form, reach, part, least_sd)
    return _across_plane(eye, noise, form, reach, part, least_sd)


@inlined
def _least_excess(eye: Eye, sigma: float, sd: float) -> float:
    """How far beams that count end behind a surface at least, along its normal, metres.

    A beam counts that ends behind by more than n sqrt(sigma^2 + (sd^2 + flatness^2) / cos^2) + registration /
    cos along the ray; times cos, that is at least what stands here if `sigma` holds the cosine already. Below
    the least cosine the tolerance no longer grows: there it is either too large for any beam to count, or
    nothing is left out.
    """
    across = sd * sd + eye.flatness_m * eye.flatness_m
    if (eye.n_sigma * np.sqrt(across) + eye.registration_m) / _LEAST_COSINE <= eye.max_m * (1 + _SLACK):
        return 0.0
    return float(eye.n_sigma * np.sqrt(sigma * sigma + across) + eye.registration_m)


@inlined
def _across_plane(
    eye: Eye, noise: Noise, form: Form, reach: Reach, part: Rectangle, least_sd: float
) -> BoolArray:
    """Tiles that get to the plane, and between the planes through the sensor and the rectangle's sides."""
    height, foot = dot(minus(eye.origin, form.point), form.axis), chart_of(form, eye.origin)
    far, nowhere = reach.far, (0.0, 0.0, 0.0)
    toward = plus(nowhere, -np.sign(height), form.axis)
    high = abs(height)
    right, left = plus(nowhere, high, form.first), plus(nowhere, -high, form.first)
    up, down = plus(nowhere, high, form.second), plus(nowhere, -high, form.second)
    sides = (
        plus(right, foot[0] - part.left, toward),
        plus(left, part.right - foot[0], toward),
        plus(up, foot[1] - part.low, toward),
        plus(down, part.high - foot[1], toward),
    )
    sigma = deviation_at(noise, high)  # of ranges that get there: it grows with the range
    found = np.zeros(far.shape, np.bool_)
    for i in range(far.shape[0]):
        for j in range(far.shape[1]):
            if far[i, j] < 0.0:
                continue
            found[i, j] = True
            if high == 0.0:
                continue
            excess = _least_excess(eye, sigma * min(high / max(far[i, j], high), 1.0), least_sd)
            slack = _SLACK * (high + far[i, j])
            if farthest_along(reach.boxes, i, j, toward) < high + excess - slack:
                found[i, j] = False
                continue
            for side in sides:
                if farthest_along(reach.boxes, i, j, side) < -_SLACK * far[i, j] * np.sqrt(dot(side, side)):
                    found[i, j] = False
                    break
    return found


@inlined
def _across_cylinder(eye: Eye, form: Form, reach: Reach, part: Rectangle, least_sd: float) -> BoolArray:
    """Tiles that no plane parts from the cylinder between two heights, with the sensor on the tiles' side.

    A beam lies between the sensor and its tile's box, so that such a plane parts it from the cylinder too.
    From within, beams cross the cylinder that end farther from the axis than its radius.
    """
    far, boxes = reach.far, reach.boxes
    bottom = plus(minus(form.point, eye.origin), part.low, form.axis)
    top = plus(bottom, part.high - part.low, form.axis)
    away = plus(bottom, -dot(bottom, form.axis), form.axis)  # from the sensor to the axis, the shortest way
    distance, excess = np.sqrt(dot(away, away)), _least_excess(eye, 0.0, least_sd)
    found = np.zeros(far.shape, np.bool_)
    for i in range(far.shape[0]):
        for j in range(far.shape[1]):
            if far[i, j] < 0.0:
                continue
            middle = boxes[i, j, 0, 0], boxes[i, j, 0, 1], boxes[i, j, 0, 2]
            slack = _SLACK * (distance + form.radius + far[i, j])
            if distance <= form.radius:
                found[i, j] = _farthest_from_axis(boxes, i, j, form, minus(middle, away)) > (
                    form.radius + excess - slack
                )
                continue
            aside = _cross(form.axis, middle)
            upward = _cross(middle, aside)
            found[i, j] = not (
                _parts(boxes, i, j, away, bottom, top, form.radius + slack)
                or _parts(boxes, i, j, aside, bottom, top, form.radius + slack)
                or _parts(boxes, i, j, upward, bottom, top, form.radius + slack)
            )
    return found


@inlined
def _parts(
    boxes: NDArray[np.float32],
    row: int,
    column: int,
    across: Triple,
    bottom: Triple,
    top: Triple,
    radius: float,
) -> bool:
    """Tell whether a plane at right angles to a direction parts a tile and the sensor from a cylinder."""
    length = np.sqrt(dot(across, across))
    if not length > 0.0:
        return False
    sign = 1.0 if dot(across, bottom) + dot(across, top) > 0.0 else -1.0
    toward = plus((0.0, 0.0, 0.0), sign / length, across)
    nearest = min(dot(toward, bottom), dot(toward, top)) - radius
    return nearest > 0.0 and nearest > farthest_along(boxes, row, column, toward)


@inlined
def _farthest_from_axis(
    boxes: NDArray[np.float32], row: int, column: int, form: Form, middle: Triple
) -> float:
    """How far a tile's box gets from an axis at most; its middle is given from a point of the axis."""
    outward = plus(middle, -dot(middle, form.axis), form.axis)
    length = np.sqrt(dot(outward, outward))
    if not length > 0.0:
        return np.inf
    outward = plus((0.0, 0.0, 0.0), 1.0 / length, outward)
    around = _cross(form.axis, outward)
    out, aside = length, 0.0
    for k in range(1, 4):
        arm = boxes[row, column, k, 0], boxes[row, column, k, 1], boxes[row, column, k, 2]
        out, aside = out + abs(dot(arm, outward)), aside + abs(dot(arm, around))
    return float(np.sqrt(out * out + aside * aside))


@inlined
def _cross(a: Triple, b: Triple) -> Triple:
    """Cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
