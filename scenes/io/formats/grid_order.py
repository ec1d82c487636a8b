# SPDX-License-Identifier: MIT
"""Grid order: rows and columns that a file exchanges, or whose numbers it exchanges, put in order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray
from scenes.scan.pixels import row_blocks
from scenes.scan.projection import Projection

Order = Callable[[NDArray[Any]], NDArray[Any]]
_OWN_PX = 1.0  # from their own pixels half of the points are at most where they are in order
_FEWEST_LINES = 8  # rows or columns whose step is none by chance
_MOST_JUDGED = 100_000  # points that tell whether a projection sees them in their pixels


def own_pixel_distance(points: FloatArray, projection: Projection) -> float:
    """Return how far points (rows, columns, 3) lie from their own pixels in the median, inf without any."""
    step = -(-points.shape[0] * points.shape[1] // _MOST_JUDGED)
    rows = np.arange(0, points.shape[0], step)
    part = np.asarray(points[rows], np.float64)
    valid = np.isfinite(part).all(axis=-1)
    row, column = np.nonzero(valid)
    pixels = projection.pixels(part[valid])
    off = np.hypot(pixels[:, 0] - rows[row], pixels[:, 1] - column)
    off = off[np.isfinite(off)]
    return float(np.median(off)) if len(off) else np.inf


def other_orders(shape: tuple[int, ...]) -> Iterator[Order]:
    """Yield the other orders in which a file may have meant its pixels (rows, columns).

    Rows are columns; numbers of rows and columns are exchanged; pixels run row by row where the format has
    columns; and these with rows as columns.
    """
    n_rows, n_columns = shape[:2]

    def turned(image: NDArray[Any]) -> NDArray[Any]:
        return image.swapaxes(0, 1)

    def exchanged(image: NDArray[Any]) -> NDArray[Any]:
        return image.reshape(n_columns, n_rows, *image.shape[2:])

    def row_by_row(image: NDArray[Any]) -> NDArray[Any]:
        return turned(image).reshape(n_rows, n_columns, *image.shape[2:])

    yield turned
    for order in (exchanged, row_by_row):
        yield order
        yield lambda image, order=order: turned(order(image))  # type: ignore[misc]


def in_other_order(
    images: Sequence[Any], fit: Callable[[FloatArray], tuple[Projection | None, str]]
) -> tuple[Projection, list[Any]] | None:
    """Return the projection of points, and all their images, in another order that fits; None for none.

    Parameters
    ----------
    images : sequence of (rows, columns, ...) arrays or None
        The first is the points of the sensor's frame, metres, NaN for none.
    fit : callable
        Estimates the projection of points; None with the cause where there is none.
    """
    for order in other_orders(images[0].shape):
        projection, _ = fit(order(images[0]))
        if projection is not None and own_pixel_distance(order(images[0]), projection) < _OWN_PX:
            ordered = [None if image is None else np.ascontiguousarray(order(image)) for image in images]
            for image in ordered:
                if image is not None:
                    image.setflags(write=False)
            return projection, ordered
    return None


def line_steps(points: NDArray[Any]) -> tuple[int, int]:
    """Return the steps of the rows and of the columns that hold points (rows, columns, 3), NaN for none.

    They are those of thinned scans, of which every k-th row and column was written, and 1 for few of them.
    """
    held = [np.zeros(n, np.bool_) for n in points.shape[:2]]
    for rows in row_blocks(points.shape, points):
        known = np.isfinite(points[rows][..., 0])
        held[0][rows], held[1] = known.any(axis=1), held[1] | known.any(axis=0)
    numbers = [np.flatnonzero(axis) for axis in held]
    steps = [int(np.gcd.reduce(np.diff(axis))) if len(axis) >= _FEWEST_LINES else 1 for axis in numbers]
    return steps[0], steps[1]
