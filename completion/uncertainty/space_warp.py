# SPDX-License-Identifier: MIT
"""Space warp: a distortion as long as the whole part, and what it does to all fits together.

A casting, or a scan whose scale and pose drift, is bent as a whole: each point is displaced by a polynomial
of second order in space. Fits take on most of it, and turn against each other. What they leave shows in
residuals, of which all surfaces together tell how large the displacement is, and which it may have been.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.uncertainty.limits import FEWEST_POINTS, LEAST_LOG_EVIDENCE
from scenes.checks import FloatArray

N_MODES = 24  # six terms of second order along each of three axes, and six strains
_MOST_POINTS = 1_500
_SIZES = np.geomspace(1e-3, 1e3, 61)  # of displacements that are tried, in deviations of a point


@dataclass(frozen=True, slots=True, eq=False)
class SpaceWarp:
    """A warp of all that was measured.

    Attributes
    ----------
    rms_m : float
        How far points were displaced, root mean square over the surfaces that tell, metres.
    shared : (p, p) float
        What it does to the parameters of all surfaces, fit by fit: covariance of what it may have been, and
        the square of what it most probably was.
    freedom : float
        How many of its 24 terms the residuals tell.
    """

    rms_m: float
    shared: FloatArray
    freedom: float


def find_warp(fits: Sequence[SurfaceFit], points: Sequence[FloatArray]) -> SpaceWarp | None:
    """Return the warp that the residuals of surfaces show, None where they show none.

    Of a displacement sum_k a_k m_k(x) with m_k the terms of second order and a ~ N(0, t^2), fits take on the
    part that their parameters can follow, and r = sum_k a_k (m_k' n)_left + noise is left. The size t is the
    most probable of those tried (MacKay 1992, Bayesian interpolation, on evidence).

    Parameters
    ----------
    fits : sequence of SurfaceFit
        In one frame.
    points : sequence of (n, 3) float
        Those of each fit.
    """
    samples = [point[:: max(1, len(point) // _MOST_POINTS)] for point in points]
    telling = [k for k, points_used in enumerate(samples) if len(points_used) >= FEWEST_POINTS]
    if not telling:
        return None
    every = np.concatenate([samples[k] for k in telling])
    middle, reach = every.mean(axis=0), np.maximum(every.std(axis=0), 1e-9 * np.ptp(every) + 1e-300)
    pulls, normal, right, square, n = [], np.zeros((N_MODES, N_MODES)), np.zeros(N_MODES), 0.0, 0
    for fit, points_used in zip(fits, samples, strict=True):
        if not len(points_used):
            pulls.append(np.zeros((len(fit.covariance), N_MODES)))
            continue
        off, normals = fit.surface.distance(points_used), fit.surface.normal(points_used)
        at = points_used - off[:, None] * normals  # noise must not displace itself
        along = np.einsum("nmi,ni->nm", _displacements(at, middle, reach), normals)
        gradient = fit.gradient(at)
        pull = np.linalg.lstsq(gradient, along, rcond=1e-10)[0]
        pulls.append(pull)
        if len(points_used) >= FEWEST_POINTS:
            left = along - gradient @ pull
            normal += left.T @ left / fit.inflation
            right += left.T @ off / fit.inflation
            square, n = square + float(off @ off) / fit.inflation, n + len(points_used)
    amplitude = np.linalg.lstsq(normal, right, rcond=1e-10)[0]
    variance = max(square - float(right @ amplitude), 1e-12 * square) / max(n - N_MODES, 1)
    if variance <= 0:
        return None
    size, evidence = _most_probable(normal / variance, right / variance, np.sqrt(variance))
    if evidence < LEAST_LOG_EVIDENCE:
        return None
    precision = normal / variance + np.eye(N_MODES) / size**2
    covariance = np.linalg.inv(precision)
    mean = covariance @ right / variance
    spread = covariance + np.outer(mean, mean)
    whole = np.concatenate(pulls)
    moved = np.einsum("nmi,m->ni", _displacements(every, middle, reach), mean)
    return SpaceWarp(
        rms_m=float(np.sqrt(np.mean(np.sum(moved**2, axis=1)))),
        shared=np.asarray(whole @ spread @ whole.T),
        freedom=max(float(N_MODES - np.trace(covariance) / size**2), 1.0),
    )


def _displacements(points: FloatArray, middle: FloatArray, reach: FloatArray) -> FloatArray:
    """How far each mode displaces points (n, 3): (n, 24, 3), of a unit's size where they usually are.

    Terms of second order, and the symmetric ones of first order: stretches and shears. Those of second order
    about another middle have these in them, and what turns or shifts the whole moves no surface against
    another.
    """
    place = (points - middle) / reach
    pairs = list(combinations_with_replacement(range(3), 2))
    bends = np.stack([place[:, a] * place[:, b] - float(a == b) for a, b in pairs], axis=1)
    strains = np.zeros((len(points), len(pairs), 3))
    for k, (a, b) in enumerate(pairs):
        strains[:, k, a] += place[:, b] / (1.0 if a == b else 2.0)
        strains[:, k, b] += place[:, a] / 2.0 if a != b else 0.0
    along = (bends[:, :, None, None] * np.eye(3)).reshape(len(points), -1, 3)
    return np.concatenate([along, strains], axis=1)


def _most_probable(normal: FloatArray, right: FloatArray, unit: float) -> tuple[float, float]:
    """The size of the amplitudes under which residuals are most probable, and by how many nats over none."""
    values, vectors = np.linalg.eigh(normal)
    values, along = np.maximum(values, 0.0), vectors.T @ right
    squares = np.square(_SIZES * unit)[:, None]
    gain = 1 + squares * values
    log_evidence = 0.5 * np.sum(squares * np.square(along) / gain - np.log(gain), axis=1)
    best = int(np.argmax(log_evidence))
    return float(_SIZES[best] * unit), float(log_evidence[best] - np.log(len(_SIZES)))
