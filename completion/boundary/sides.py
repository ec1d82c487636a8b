# SPDX-License-Identifier: MIT
"""Sides: of the rectangle of what was measured of a surface, those at which the surface was seen to end."""

from __future__ import annotations

import numpy as np

from completion.boundary.boundary_pixels import Rim, RimPoints
from scenes.checks import FloatArray

_NEAR = 2.0  # steps between pixels, from a side
_RAGGED = 0.005  # of the rectangle: how far a side that is seen whole may stray


def ended_sides(rim: RimPoints, low: FloatArray, high: FloatArray) -> FloatArray:
    """Find the sides along most of which the surface was seen to end.

    It ends where the neighbouring beam went past it, or brought nothing back: a wall before the open sky, or
    beyond the scanner's reach. That says nothing of a single place behind which something else may be dark;
    but where most of a straight side is so, what is hidden of the side ends there too.

    Parameters
    ----------
    rim : RimPoints
        Of the surface, in its chart.
    low, high : (2,) float
        The rectangle of what was measured, chart coordinates in metres.

    Returns
    -------
    (2, 2) float
        Where the low and the high side (rows) along u and v (columns) end, metres; NaN where they were not
        seen to.
    """
    result = np.full((2, 2), np.nan)
    size = np.linalg.norm(rim.step, axis=1)
    ends = np.isin(rim.kind, (Rim.OWN_EDGE, Rim.NO_RETURN)) & (size > 0)
    for row, side in enumerate((low, high)):
        for axis in (0, 1):
            reach = _NEAR * size + _RAGGED * (high - low)[axis]
            near = ends & (np.abs(rim.uv[:, axis] - side[axis]) <= reach)
            if near.any():
                pixel = float(np.quantile(size[near], 0.75))
                along = np.unique(np.floor(rim.uv[near, 1 - axis] / pixel))
                if len(along) * pixel > (high - low)[1 - axis] / 2:
                    result[row, axis] = np.median(rim.uv[near, axis])
    return result
