# SPDX-License-Identifier: MIT
"""Plain alternatives: how likely points are on the best plane or cylinder instead of a template."""

from __future__ import annotations

import numpy as np

from completion.fitting.euclidean import fit_euclidean
from completion.fitting.result import FitError
from completion.fitting.robust import TUKEY, fit_robust
from scenes.checks import FloatArray, InputError

MOST_POINTS = 3_000
_PARAMETERS = {"plane": 3, "cylinder": 5}


def log_likelihood(distances: FloatArray, sigma: float, reach: float) -> float:
    """Sum of the logarithms of densities of distances (n,): normal, and uniform up to `reach` for outliers.

    The share of outliers is that beyond 4.685 sigma, and never none or all.
    """
    size = np.abs(distances)
    share = float(np.clip(np.mean(size > TUKEY * sigma), 1 / (len(size) + 2), 1 - 1 / (len(size) + 2)))
    normal = np.exp(-0.5 * (size / sigma) ** 2) / (np.sqrt(2 * np.pi) * sigma)
    return float(np.log((1 - share) * normal + share / reach).sum())


def plain_likelihood(points: FloatArray, least_sigma: float, reach: float) -> tuple[float, str]:
    """Return the greatest log likelihood of a plain explanation, less what its parameters cost; and its name.

    A plane, a cylinder, robust or through all, each with the noise that suits it, or scattered points; a
    parameter costs log(n) / 2 (Schwarz 1978).

    Parameters
    ----------
    points : (n, 3) float
        At most some thousands.
    least_sigma : float
        Noise of points, at least.
    reach : float
        Of outliers: the diagonal of all.
    """
    best, name = -len(points) * float(np.log(reach)), "scattered points"
    for kind, k in _PARAMETERS.items():
        for robust in (True, False):
            try:
                fit = fit_robust(points, kind) if robust else fit_euclidean(points, kind)
            except (FitError, InputError):
                continue
            distances = fit.surface.distance(points)
            sigma = max(fit.rms, least_sigma)
            value = log_likelihood(distances, sigma, reach) - k / 2 * float(np.log(len(points)))
            if value > best:
                best, name = value, f"a {kind}"
    return best, name
