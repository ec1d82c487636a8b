# SPDX-License-Identifier: MIT
"""Radii: how far the radius of each true cylinder is missed by the surface that continues it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.completion.truth.truth import TrueModel
from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Surface


def radius_errors(
    model: TrueModel,
    scans: Sequence[RangeImage],
    found: Sequence[Surface],
    true_surface: NDArray[np.int32],
    min_pixels: int = 200,
) -> FloatArray:
    """Return |radius found - true radius| (n,) in metres for each scored cylinder in view; inf if missed.

    Parameters
    ----------
    model : TrueModel
        The truth.
    scans : sequence of RangeImage
        With truth; a cylinder with fewer than `min_pixels` in all of them is not asked for.
    found : sequence of Surface
        Found surfaces, largest first; the first cylinder that continues the true one counts.
    true_surface : (k,) int
        For each found surface the id of the true one that it continues, -1 for none.
    """
    pixels = np.zeros(len(model.surfaces), np.int64)
    for scan in scans:
        if scan.truth is not None:
            met = scan.truth.surface[scan.truth.surface >= 0]
            pixels += np.bincount(met, minlength=len(pixels))
    errors = []
    for index, true in enumerate(model.surfaces):
        if isinstance(true, Cylinder) and model.scored[index] and pixels[index] >= min_pixels:
            radii = (
                surface.radius
                for surface, continued in zip(found, true_surface, strict=True)
                if continued == index and isinstance(surface, Cylinder)
            )
            errors.append(abs(next(radii, np.inf) - true.radius))
    return np.array(errors, dtype=np.float64)
