# SPDX-License-Identifier: MIT
"""Descent: Levenberg-Marquardt on robust distances of a model, with noise and outliers as a mixture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from completion.features.junctions.models import Model
from scenes.checks import FloatArray

_N_MIXTURE_ROUNDS = 60
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
        for _ in range(_N_MIXTURE_ROUNDS):
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


_N_SAMPLE, _N_BEST = 600, 4  # points that all starts see; starts that see all points
_CAUCHY = (0.3, 0.1, 0.03)  # scales at unit RMS
_N_STEPS, _N_ROUNDS = 12, 30
_DAMPING = 1e-3
_LEAST_STEP, _COARSE_STEP = 1e-6, 1e-2  # of all residuals, by which the last step changes them
LEAST_SIGMA = 1e-6  # at unit RMS: what has no noise counts as this
_SAME = 1e-2  # at unit RMS: how far apart two surfaces may be and count as one

Weights = Callable[[FloatArray], FloatArray]
"""From distances (n,) to weights (n,)."""


class Descended(NamedTuple):
    """Where a descent ended."""

    model: Model
    mixture: Mixture  # of the distances
    log_likelihood: float  # of all points that it saw
    evaluations: int


def cauchy(scale: float) -> Weights:
    """Return Cauchy's weights at a scale, from distances (n,) to (n,)."""
    return lambda distance: 1 / (1 + (distance / scale) ** 2)


def descend(
    model: Model, points: FloatArray, weights: Weights, n_steps: int = _N_STEPS, least: float = _LEAST_STEP
) -> tuple[Model, int]:
    """Return the model after steps of reweighted, damped least squares on points (n, 3), and how many."""
    damping, n_spent = _DAMPING, 0
    distance, slopes = model.linearised(points)
    for _ in range(n_steps):
        weight = weights(distance)
        matrix, gradient = slopes.T @ (weight[:, None] * slopes), slopes.T @ (weight * distance)
        before = float(weight @ distance**2)
        scale = np.maximum(np.diag(matrix), 1e-12 * max(float(np.trace(matrix)), 1e-300))
        gained = False
        for _ in range(6):
            step = np.asarray(np.linalg.solve(matrix + damping * np.diag(scale), -gradient), dtype=float)
            moved = model.moved(step)
            new, new_slopes = moved.linearised(points)
            n_spent += 1
            if np.isfinite(new).all() and float(weight @ new**2) <= before:
                gained = True
                break
            damping *= 10
        if not gained:
            break
        model, distance, slopes = moved, new, new_slopes
        damping = max(damping / 10, 1e-9)
        if float(np.sqrt((step**2 * scale).sum())) < least * max(np.sqrt(before), 1e-300):
            break
    return model, n_spent


def descend_from(
    starts: Sequence[Model], points: FloatArray, reach: float, near: Sequence[Model] = ()
) -> list[Descended]:
    """Return where several starts lead, the most likely first.

    Each goes down by Cauchy's weights at falling scales on 600 of the points; the four most likely go on as
    mixtures of noise and outliers on all. Those that are `near` a solution need no such way down, which may
    lead them off, and four of them go on as well.

    Parameters
    ----------
    starts : sequence of Model
        Of one kind.
    points : (n, 3) float
        At unit RMS about the origin, as the models are.
    reach : float
        Of outliers, across the surface.
    """
    sample = points[:: max(1, len(points) // _N_SAMPLE)]
    coarse = [_coarse(start, sample, reach) for start in starts]
    coarse.sort(key=lambda one: -one.log_likelihood)
    begun = sorted((_begun(one, points, reach) for one in near), key=lambda one: -one.log_likelihood)
    chosen = _distinct(coarse, sample)[:_N_BEST] + _distinct(begun, sample)[:_N_BEST]
    fine = [settled(one, points) for one in _distinct(chosen, sample)]
    spent = sum(one.evaluations for one in coarse)
    fine.sort(key=lambda one: -one.log_likelihood)
    return [one._replace(evaluations=one.evaluations + spent) for one in fine]


def _coarse(start: Model, sample: FloatArray, reach: float) -> Descended:
    """Where Cauchy's weights lead on a sample (n, 3)."""
    model, spent = start, 0
    for scale in _CAUCHY:
        model, n = descend(model, sample, cauchy(scale), least=_COARSE_STEP)
        spent += n
    distances = model.distance(sample)
    mixture = Mixture.of(distances, reach, _CAUCHY[-1], LEAST_SIGMA)
    return Descended(model, mixture, float(mixture.log_densities(distances).sum()), spent)


def _begun(start: Model, points: FloatArray, reach: float) -> Descended:
    """A start as it is, by all points (n, 3)."""
    distances = start.distance(points)
    mixture = Mixture.of(distances, reach, _CAUCHY[-1], LEAST_SIGMA)
    return Descended(start, mixture, float(mixture.log_densities(distances).sum()), 1)


def _distinct(found: Sequence[Descended], sample: FloatArray) -> list[Descended]:
    """Those that are not the same surface as one before."""
    kept: list[Descended] = []
    sizes: list[FloatArray] = []
    for one in found:
        size = np.abs(one.model.distance(sample))
        if all(np.abs(size - other).mean() > _SAME for other in sizes):
            kept.append(one)
            sizes.append(size)
    return kept


def settled(found: Descended, points: FloatArray, n_rounds: int = _N_ROUNDS) -> Descended:
    """Return where all points (n, 3) lead, weighed by how likely each is noise, until the scale stands."""
    model, mixture, spent = found.model, found.mixture, found.evaluations
    for _ in range(n_rounds):
        before = mixture.sigma
        mixture = Mixture.of(model.distance(points), mixture.reach, before, LEAST_SIGMA)
        model, n = descend(model, points, mixture.weights, 4)
        spent += n
        if abs(mixture.sigma - before) < 1e-4 * before:
            break
    distances = model.distance(points)
    mixture = Mixture.of(distances, mixture.reach, mixture.sigma, LEAST_SIGMA)
    return Descended(model, mixture, float(mixture.log_densities(distances).sum()), spent)
