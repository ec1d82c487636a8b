# SPDX-License-Identifier: MIT
"""Rounded coordinates: what steps in a file do to a fit, which no residual shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from completion.fitting.result import SurfaceFit
from scenes.checks import FloatArray

TILT = 0.38
"""Tilt that rounding leaves in a plane, as a part of its shift; see `rounding_modes`."""


def rounding_modes(points: FloatArray, step_m: float) -> FloatArray:
    """Return how far rounded coordinates move points (n, 3) of a surface: (12, n, 3), metres.

    A plane along two axes moves by up to half a step along the third, step / sqrt(12) root mean square
    (Widrow & Kollar 2008): three modes. One that rises by less than two steps from side to side is tilted as
    well. In least-squares planes through 60 x 60 rounded points, that is at most 0.38 of the shift, in
    displacements' root mean square over the plane (a rise of half a step to one step): nine modes. Planes
    that rise by N steps average both out, to 1/8 of the shift at N = 2 and 1/20 at N = 4; they have the same
    modes, since steps lie along axes of the file that later poses hide.
    """
    spread = points - (points.mean(axis=0) if len(points) else 0.0)
    scale = np.sqrt(np.square(spread).mean(axis=0)) if len(points) else np.ones(3)
    linear = TILT * spread / np.maximum(scale, 1e-12)
    size = np.concatenate([np.ones((1, len(points))), linear.T])
    return np.asarray(
        step_m / np.sqrt(12) * np.einsum("kn,ij->kinj", size, np.eye(3)).reshape(12, len(points), 3)
    )


def allow_for_rounding(fit: SurfaceFit, points: FloatArray, step_m: float) -> SurfaceFit:
    """Return the fit with a covariance that allows for coordinates in steps; `points` (n, 3) are its own.

    What was held exactly stays so.
    """
    if not step_m:
        return fit
    sought = (np.diag(fit.covariance) != 0) | (not fit.held)
    gradient = fit.gradient(points)[:, sought]
    along = np.einsum("mij,ij->im", rounding_modes(points, step_m), fit.surface.normal(points))
    shift = np.zeros((len(sought), along.shape[1]))
    shift[sought] = np.linalg.pinv(gradient) @ along
    return replace(fit, covariance=fit.covariance + shift @ shift.T)
