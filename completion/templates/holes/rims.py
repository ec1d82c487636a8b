# SPDX-License-Identifier: MIT
"""Rims: circles in which there is no plate, and how much more evident each is than a patch that was lost."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from scipy.special import ndtr

from completion.templates.holes.measuring.survey import Survey
from scenes.checks import BoolArray, FloatArray, IntArray

N_SECTORS = 16
_INNER, _OUTER = 10, 6  # rings within the radius, and beyond it
_BEYOND = 3.0  # spacings beyond the rim that are looked at
_LOST = 0.3  # of sectors beyond a rim, before anything is measured
_FAR = 0.3  # of sectors of a lost patch that reach farther than is looked at
_PATCH = 0.3  # that a place is in a patch


@dataclass(frozen=True, slots=True, eq=False)
class RimScores:
    """Evidence of m circles.

    Attributes
    ----------
    evidence : (m,) float
        Log odds of a hole against the plate and against a lost patch of any shape, nats.
    against_patch : (m,) float
        Against the patch alone.
    seen : (m, k) bool
        Sectors in which the plate begins at the rim rather than farther out.
    filled : (m,) float
        Log odds of the plate against the hole in its inside; large where measured surface fills it.
    """

    evidence: FloatArray
    against_patch: FloatArray
    seen: BoolArray
    filled: FloatArray


def rim_scores(survey: Survey, centres: FloatArray, radii: FloatArray, soft: FloatArray) -> RimScores:
    """Weigh circles (m, 2), (m,) whose radii are known to `soft` (m,).

    In each of 16 sectors the plate begins at some distance g from the centre. Its points are a Poisson
    process of density rho beyond g and of a small density eps rho before it:
    log L(g) = n(r < g) log eps + rho (1 - eps) angle g^2 / 2, less what a plate without a hole has. A hole
    says g = R, or farther out where surface was lost; a patch says any g.
    """
    if not len(centres):
        return RimScores(np.zeros(0), np.zeros(0), np.zeros((0, N_SECTORS), dtype=np.bool_), np.zeros(0))
    level = survey.level(radii)
    scores = [_scores(survey, centres[at], radii[at], soft[at], level=int(level[at[0]]))
              for at in (np.flatnonzero(level == one) for one in np.unique(level))]  # fmt: skip
    back = np.argsort(np.argsort(level, kind="stable"), kind="stable")
    return RimScores(
        *(np.concatenate([getattr(one, f.name) for one in scores])[back] for f in fields(RimScores))
    )


def _scores(
    survey: Survey, centres: FloatArray, radii: FloatArray, soft: FloatArray, *, level: int
) -> RimScores:
    """The same of circles for which a fourth of the points, or of these, suffices."""
    m, beyond = len(centres), _BEYOND * survey.spacing * 2**level
    owner, offset = survey.near(centres, radii + beyond, level)
    far = np.hypot(*offset.T)
    sector = ((np.arctan2(offset[:, 1], offset[:, 0]) / (2 * np.pi) % 1.0) * N_SECTORS).astype(np.int64)
    wedge = owner * N_SECTORS + sector % N_SECTORS
    eps = survey.stray
    rate = survey.density_at(centres) / 4**level * (1 - eps) * np.pi / N_SECTORS
    grid, before = _rings(wedge, owner, far, radii, beyond)
    expected = rate[:, None] * grid**2
    log_l = before * np.log(eps) + expected[:, None, :]
    # a hole's own rim is soft: its radius is known to so much
    rising = np.log(eps + (1 - eps) * ndtr((far - radii[owner]) / soft[owner]))
    begun = np.bincount(wedge, rising, minlength=m * N_SECTORS).reshape(m, N_SECTORS)
    at_rim = begun + (rate * (radii**2 + soft**2))[:, None]
    patch, lost = _anywhere(log_l, grid)
    begins, ends = np.log(1 - _LOST) + at_rim, np.log(_LOST) + lost
    hole, patch = np.logaddexp(begins, ends).sum(axis=1), patch.sum(axis=1)
    none = np.logaddexp(np.log(_PATCH) + patch, np.log(1 - _PATCH))
    inside = before[:, :, _INNER - 2].sum(axis=1) * np.log(eps) + expected[:, _INNER - 2] * N_SECTORS
    return RimScores(hole - none, hole - patch, np.asarray(begins > ends, dtype=np.bool_), -inside)


def _rings(
    wedge: IntArray, owner: IntArray, far: FloatArray, radii: FloatArray, beyond: float
) -> tuple[FloatArray, FloatArray]:
    """Radii (m, rings + 1) of rings about each circle, and points (m, k, rings + 1) nearer than each."""
    m, rings = len(radii), _INNER + _OUTER
    inner, outer = np.linspace(0, 1, _INNER + 1), np.linspace(0, 1, _OUTER + 1)[1:]
    grid = np.hstack([radii[:, None] * inner, radii[:, None] + beyond * outer])
    size = radii[owner]
    out = np.where(far < size, far / size * _INNER, _INNER + (far - size) / beyond * _OUTER)
    place = wedge * rings + np.clip(out.astype(np.int64), 0, rings - 1)
    counts = np.bincount(place, minlength=m * N_SECTORS * rings).reshape(m, N_SECTORS, rings)
    before = np.zeros((m, N_SECTORS, rings + 1))
    np.cumsum(counts, axis=2, out=before[:, :, 1:])
    return grid, before


def _anywhere(log_l: FloatArray, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Log likelihood (m, k) of a plate that begins anywhere, and anywhere beyond the rim, or farther out."""
    top = log_l.max(axis=2)
    likely = np.exp(log_l - top[:, :, None])
    middle = (likely[:, :, 1:] + likely[:, :, :-1]) / 2
    share = np.diff(grid, axis=1) / grid[:, -1:]
    last = likely[:, :, -1]
    patch = (1 - _FAR) * np.einsum("mkr,mr->mk", middle, share) + _FAR * last
    lost = (middle[:, :, _INNER:].mean(axis=2) + last) / 2
    with np.errstate(divide="ignore"):
        return top + np.log(patch), top + np.log(lost)
