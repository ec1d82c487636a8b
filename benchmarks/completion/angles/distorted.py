# SPDX-License-Identifier: MIT
"""Distorted: scans of a depth camera that bends what it sees, more with the square of the distance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scenes.scan.range_image import RangeImage

UNIT_PER_M = 2.85e-3
"""Of disparity, an eighth of a pixel of a Kinect, as an error of the depth at 1 m (Khoshelham & Elberink)."""

_LEAST_M = 0.1  # to which a range is bent


def distorted(scan: RangeImage, seed: int, units: float = 2.0) -> RangeImage:
    """Return a pinhole scan with a bend of its own along the rays, root mean square `units` of disparity.

    Its noise is for who completes it to find out.

    The bend is a (rho^2 - 1/3) + b (rho^4 - 1/5) about a centre that is up to a fifth of the image off its
    middle, rho in half widths, a and b normal: lenses of camera and projector are round.
    """
    rng = np.random.default_rng([20267, seed])
    rows, columns = scan.shape
    row, column = np.mgrid[:rows, :columns]
    half = max(rows, columns) / 2
    centre = np.array([rows, columns]) / 2 + rng.uniform(-0.2, 0.2, 2) * max(rows, columns)
    rho = np.hypot(row - centre[0], column - centre[1]) / half
    bend = rng.normal() * (rho**2 - 1 / 3) + rng.normal() * (rho**4 - 1 / 5)
    bend *= units / np.sqrt(np.mean(np.square(bend)))
    ranges = scan.ranges.copy()
    held = ranges[scan.valid]
    ranges[scan.valid] = np.maximum(held + bend[scan.valid] * UNIT_PER_M * np.square(held), _LEAST_M)
    return replace(scan, ranges=ranges, truth=None, sigma_m=None)
