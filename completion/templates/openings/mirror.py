# SPDX-License-Identifier: MIT
"""Mirror: whether what lies behind an opening is the image of what stands before the wall."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.observe.observation import Observation
from completion.templates.openings.walls.wall_beams import WallBeams, WallFrame
from scenes.checks import FloatArray

_FEW = 50  # images that a beam answered for, below which nothing is said
_TOLERANCE = 0.02, 3.0  # metres, and deviations of the range


def image_share(frame: WallFrame, beams: WallBeams, observations: Sequence[Observation]) -> float:
    """Return the share of points behind a wall whose mirror images were measured before it; NaN of too few.

    Each point is reflected in the wall. A beam through its image that ends there agrees; one that goes on
    refutes it, since a mirror would show what stands there; one that ends before says nothing.
    """
    agrees = refutes = 0
    for number in np.unique(beams.scan):
        seen = observations[int(number)]
        of_scan = beams.chosen((beams.scan == number) & np.isfinite(beams.ranges))
        points = seen.points_at(of_scan.pixel)
        into = frame.axes[1]
        images = points - 2 * ((points - frame.origin) @ into)[:, None] * into
        for other in observations:
            said = _said(images, other)
            agrees, refutes = agrees + said[0], refutes + said[1]
    return agrees / (agrees + refutes) if agrees + refutes >= _FEW else np.nan


def _said(images: FloatArray, seen: Observation) -> tuple[int, int]:
    """How many images (n, 3) a scan's beams end at, and how many they go on behind."""
    place = seen.scan.pixels(images)
    rows, columns = seen.scan.shape
    with np.errstate(invalid="ignore"):
        row, column = np.rint(place).T
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    flat = (row[inside] * columns + column[inside]).astype(np.int64)
    away = np.linalg.norm(images[inside] - seen.scan.origin, axis=1)
    measured = seen.scan.ranges.ravel()[flat]
    slack = _TOLERANCE[0] * np.maximum(away, 1.0) + _TOLERANCE[1] * seen.noise.deviation(away)
    back = np.isfinite(measured)
    agrees = back & (np.abs(measured - away) <= slack)
    return int(agrees.sum()), int((back & (measured > away + slack)).sum())
