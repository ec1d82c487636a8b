# SPDX-License-Identifier: MIT
"""Convention of poses: whether camera images agree better with OpenGL's axes or with the poses inverted."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from scenes.checks import FloatArray
from scenes.limits import BETTER, ENOUGH_POINTS, GOOD
from scenes.run.mapping import trim
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage

_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # y up and z backwards, to y down and z forward
_CURES = {
    "OpenGL's (y up, z backwards)": "multiply each by diag(1, -1, -1, 1) from the right",
    "sensor from world": "invert each",
}
_PAIRS = 8  # of consecutive images that are compared
_POINTS = 4000  # of each


def convention_doubt(scans: Sequence[RangeImage]) -> str:
    """Return a warning when depths agree far better under another convention of the poses, "" otherwise.

    Points of an image are looked up in the next one; the measure is the median of their disagreement with
    the depth that is seen there, as a fraction of it. Images that hardly overlap, or a camera that only
    turned about the direction in which it looks, tell nothing.
    """
    seen = [scan for scan in scans if isinstance(scan.projection, PinholeProjection) and _has_returns(scan)]
    pairs = list(pairwise(seen))
    pairs = [pairs[k] for k in np.unique(np.linspace(0, len(pairs) - 1, min(_PAIRS, len(pairs))).astype(int))]
    given = _disagreement(pairs, "")
    for name, cure in _CURES.items():
        other = _disagreement(pairs, name)
        if other < GOOD and other * BETTER < given:
            as_given = "not at all" if np.isinf(given) else f"to {given:.1%}"
            return (
                f"the poses seem to be {name}: so depths agree to {other:.1%} in the median, as given "
                f"{as_given}; if so, {cure}"
            )
    return ""


def _has_returns(scan: RangeImage) -> bool:
    trim()
    return bool(scan.valid.any())


def _disagreement(pairs: Sequence[tuple[RangeImage, RangeImage]], convention: str) -> float:
    """Median relative disagreement over all pairs, infinite where they hardly overlap."""
    differences = [_compare(first, second, convention) for first, second in pairs]
    off = np.concatenate([np.zeros(0), *differences])
    return float(np.median(off)) if len(off) >= ENOUGH_POINTS else np.inf


def _compare(first: RangeImage, second: RangeImage, convention: str) -> FloatArray:
    points = first.points_in_sensor()[first.valid]
    points = points[:: max(1, len(points) // _POINTS)]
    values, two = (_matrix(scan, convention) for scan in (first, second))
    motion = np.linalg.solve(two, values)
    moved = points @ motion[:3, :3].T + motion[:3, 3]
    pixels = second.projection.pixels(moved)
    inside = np.isfinite(pixels).all(axis=1)
    row, column = np.rint(pixels[inside]).astype(np.int64).T
    measured = second.ranges[row, column]
    known = np.isfinite(measured)
    expected = np.linalg.norm(moved[inside][known], axis=1)
    off: FloatArray = np.abs(expected - measured[known]) / measured[known]
    return off


def _matrix(scan: RangeImage, convention: str) -> FloatArray:
    matrix = scan.world_from_sensor.matrix
    if convention.startswith("OpenGL"):
        return np.asarray(matrix @ _OPENGL, dtype=np.float64)
    return scan.world_from_sensor.inverse().matrix if convention else matrix
