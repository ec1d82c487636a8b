# SPDX-License-Identifier: MIT
"""Shadow: where the second device of a triangulating camera was hidden, so that nothing could come back.

A camera that triangulates measures only what its projector lights, or its second camera sees. Beside each
near thing, on the side away from that device, lies a strip of pixels without return: between depths z and Z
it is f b (1/z - 1/Z) pixels wide, with the focal length f in pixels and the baseline b (Khoshelham & Elberink
2012, section 2). Files that were resampled to another camera's view have such strips on two sides, each of
its own width.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from completion.observe.limits import (
    AGREEING_SHARE,
    LEAST_JUMP,
    STRIP_SLACK,
    STRIP_SLACK_PX,
    SURE_SD,
    WINDOW_LINES,
)
from scenes.card import shown
from scenes.checks import FloatArray
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from texture.engine.compiled import compiled, inlined

BASELINES_M = np.geomspace(0.01, 0.15, 55)
"""Baselines that are told apart, metres: 5 % from one to the next."""

_LEAST_PX = 2 * STRIP_SLACK_PX  # widths below tell nothing: no strip at all would agree


@shown
class Shadow(NamedTuple):
    """Baselines of second devices to the right, left, below and above, as the image shows; 0 for none."""

    right_m: float = 0.0
    left_m: float = 0.0
    below_m: float = 0.0
    above_m: float = 0.0

    @property
    def is_known(self) -> bool:
        """Whether there is a second device."""
        return max(self) > 0


@shown
class Devices(NamedTuple):
    """A camera and the devices beside it, as compiled loops read them."""

    shadow: Shadow
    lens: tuple[float, float, float, float]  # fx, fy, cx, cy of a pinhole, pixels
    shape: tuple[int, int]  # rows and columns


NO_SHADOW = Shadow()


def shadow_of(projector_m: float) -> Shadow:
    """Return the shadow of a device on the camera's x axis, metres; to the right when positive."""
    return Shadow(right_m=max(projector_m, 0.0), left_m=max(-projector_m, 0.0))


def find_shadow(scan: RangeImage) -> Shadow:
    """Find where the second device of a camera stands, from the strips without return beside jumps of depth.

    In each of the four directions all jumps of the scan vote for the baseline that explains the widths of
    their strips, to 1.5 pixels or a quarter. Jumps count for which the strip would be 3 pixels wide or more,
    so that one without any votes against. A direction is believed where, with 99 % confidence, more than a
    third of the jumps agree (Wilson 1927): in directions across the baseline less than a quarter do. Nine
    neighbouring rows or columns count as one. Otherwise nothing is said of that direction. All devices of a
    camera stand in one line: of across and down, that is believed which is surer. Only pinhole cameras are
    taken to triangulate.
    """
    camera = scan.projection
    if not isinstance(camera, PinholeProjection) or scan.valid.all():
        return NO_SHADOW
    depth = scan.points_in_sensor()[..., 2]
    across, down = (_jumps(np.ascontiguousarray(lines)) for lines in (depth, depth.T))
    right, left = (_baseline(across * [1.0, sign], camera.fx) for sign in (1.0, -1.0))
    below, above = (_baseline(down * [1.0, sign], abs(camera.fy)) for sign in (1.0, -1.0))
    if max(right[1], left[1]) >= max(below[1], above[1]):
        return Shadow(right_m=right[0], left_m=left[0])
    return Shadow(below_m=below[0], above_m=above[0])


def _baseline(jumps: FloatArray, focal_px: float) -> tuple[float, float]:
    """The baseline that jumps agree on, metres, or 0, and the least share that does.

    Jumps (n, 2) are pixels without return and the rise of the inverse depth over them, 1 / m.
    """
    gap, parallax = jumps[jumps[:, 1] > 0].T
    parallax = parallax * focal_px
    baseline, best = 0.0, AGREEING_SHARE
    for baseline_m in BASELINES_M:
        telling = baseline_m * parallax >= _LEAST_PX
        if not telling.any():
            continue
        width = baseline_m * parallax[telling]
        agree = np.abs(gap[telling] - width) <= np.maximum(STRIP_SLACK_PX, STRIP_SLACK * width)
        bound = _least_share(float(agree.mean()), len(width) / WINDOW_LINES)
        if bound > best:
            baseline = float(gap[telling][agree].sum() / parallax[telling][agree].sum())
            best = bound
    return baseline, best


def _least_share(share: float, n: float) -> float:
    """Lower end of Wilson's interval of a share of n."""
    square = SURE_SD**2 / n
    spread = SURE_SD * np.sqrt(share * (1 - share) / n + square / (4 * n))
    return float((share + square / 2 - spread) / (1 + square))


@compiled
def _jumps(depth: FloatArray) -> FloatArray:
    """Pixels without return, and the rise of the inverse depth over them (n, 2), wherever a row jumps."""
    jumps = np.empty((depth.size, 2))
    n = 0
    for row in range(depth.shape[0]):
        last = -1
        for column in range(depth.shape[1]):
            if not np.isfinite(depth[row, column]):
                continue
            if last >= 0:
                rise = 1.0 / depth[row, column] - 1.0 / depth[row, last]
                if abs(rise) >= LEAST_JUMP:
                    jumps[n, 0], jumps[n, 1] = column - last - 1, rise
                    n += 1
            last = column
    return jumps[:n].copy()


@inlined
def is_shadowed(devices: Devices, ranges: FloatArray, pixel: int, depth: float, allowed: float) -> bool:
    """Tell whether a place that a pixel without return sees lies in the shadow of something measured.

    `ranges` (pixels,) are the scan's, metres. The place lies at a `depth`, and by more than `allowed` behind
    what hides it. Its strip ends at the first pixel that measured it or what lies behind: that one was lit.
    """
    baselines, lens, shape = devices
    row, column = pixel // shape[1], pixel % shape[1]
    for side in range(4):
        if not baselines[side] > 0.0:
            continue
        right, down = (1 - 2 * side, 0) if side < 2 else (0, 5 - 2 * side)
        parallax = baselines[side] * (abs(lens[0]) if side < 2 else abs(lens[1]))
        i, j, k = row + down, column + right, 1
        while 0 <= i < shape[0] and 0 <= j < shape[1]:
            measured = ranges[i * shape[1] + j]
            if np.isfinite(measured):
                x, y = (j - lens[2]) / lens[0], (i - lens[3]) / lens[1]
                near = measured / np.sqrt(1.0 + x * x + y * y)
                if near < depth - allowed:
                    width = parallax * (1.0 / near - 1.0 / depth)
                    if k - 1 <= width + max(STRIP_SLACK_PX, STRIP_SLACK * width):
                        return True
                break
            i, j, k = i + down, j + right, k + 1
    return False
