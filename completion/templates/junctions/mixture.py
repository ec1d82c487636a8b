# SPDX-License-Identifier: MIT
"""Mixtures: distances as normal noise and evenly spread outliers, both told from the distances themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray

_N_ROUNDS = 60
_SHARES = (0.002, 0.9)  # of outliers, least and most


@dataclass(frozen=True, slots=True)
class Mixture:
    """Density of distances: (1 - share) N(d; 0, sigma) + share / reach.

    Attributes
    ----------
    sigma : float
        Of the noise.
    share : float
        Of outliers.
    reach : float
        Over which outliers are spread, across the surface.
    """

    sigma: float
    share: float
    reach: float

    @classmethod
    def of(cls, distances: FloatArray, reach: float, sigma: float, least: float) -> Mixture:
        """Return the most likely mixture of distances (n,), from a sigma near it and never below a least one.

        Expectation and maximisation (Dempster, Laird & Rubin 1977): a cut would take the outliers within it
        for noise, and the noise for larger than it is.
        """
        one = cls(max(sigma, least), 0.2, reach)
        square = distances**2
        for _ in range(_N_ROUNDS):
            weight = one.weights(distances)
            total = float(weight.sum())
            if total < 1:
                break
            new = max(float(np.sqrt(weight @ square / total)), least)
            share = float(np.clip(1 - total / len(distances), *_SHARES))
            done = abs(new - one.sigma) < 1e-5 * new
            one = cls(new, share, reach)
            if done:
                break
        return one

    def weights(self, distances: FloatArray) -> FloatArray:
        """Return how likely each of the distances (n,) is noise (n,)."""
        normal = (1 - self.share) * self._normal(distances)
        return np.asarray(normal / (normal + self.share / self.reach))

    def log_densities(self, distances: FloatArray) -> FloatArray:
        """Return the logarithms (n,) of the density of distances (n,)."""
        return np.log((1 - self.share) * self._normal(distances) + self.share / self.reach)

    def _normal(self, distances: FloatArray) -> FloatArray:
        return np.asarray(np.exp(-0.5 * (distances / self.sigma) ** 2) / (np.sqrt(2 * np.pi) * self.sigma))


def thickness(points: FloatArray) -> float:
    """Return the extent of points (n, 3) along the direction in which they vary least."""
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    return float(max(np.ptp(centred @ axes[:, 0]), 1e-300))
