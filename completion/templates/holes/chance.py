# SPDX-License-Identifier: MIT
"""Chance: how many patterns as regular as one are to be expected of circles that lie anywhere."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

from completion.templates.holes.candidates import Candidates
from completion.templates.holes.measuring.openings import Openings
from completion.templates.holes.measuring.survey import Survey
from completion.templates.holes.patterns import CIRCLE, GRID, SYMMETRIES, Pattern
from completion.templates.holes.rims import rim_scores
from scenes.checks import FloatArray, IntArray

_COUNTS = 10.0  # counts that a pattern might have had
_EXACT = 0.1  # spacings: to which a candidate's centre and radius are known at best
_SINGULAR = -20.0  # log of a determinant against that of parameters that move holes apart from others
_N_THROWN = 4_000  # places that tell how rare a hole's looks are
_SOFT = 0.3  # spacings: how exactly they are placed


def log_chance(
    pattern: Pattern, places: IntArray, chosen: IntArray, found: Candidates, *, area: float, spacing: float
) -> float:
    """Log of the expected number of patterns as regular, among candidates thrown on the plate at random.

    A-contrario detection (Desolneux, Moisan, Morel 2000). n circles can be chosen in N^n ways; the patterns
    of p parameters are a surface of that dimension in the 2 n coordinates of their centres, of measure
    integral sqrt(det J'J); what lies within the residual's length of it is a tube, whose share of all
    configurations, area^n, is the probability. Radii count likewise. N is, for each, the number of
    candidates at least as evident.

    Parameters
    ----------
    pattern : Pattern
        As fitted.
    places, chosen : (n,) int
        Numbers of holes of the pattern, and of the candidates that are there.
    found : Candidates
        All.
    area, spacing : float
        Of the plate, and of its points.
    """
    n, p = len(chosen), len(pattern.x)
    more = len(found) - np.searchsorted(np.sort(found.evidence), found.evidence[chosen], side="left")
    ways = float(np.log(np.maximum(more, np.arange(1, n + 1))).sum())
    symmetry = SYMMETRIES[pattern.kind] * (pattern.count if pattern.kind == CIRCLE else 1)
    slopes = pattern.slopes[places].reshape(2 * n, p)
    sign, determinant = np.linalg.slogdet(slopes.T @ slopes)
    alone = np.einsum("ij,ij->j", slopes, slopes)
    if sign <= 0 or determinant < _SINGULAR + np.log(np.maximum(alone, 1e-300)).sum():
        return np.inf  # these holes do not tell where the others are
    measure = 0.5 * determinant + _log_room(pattern, area)
    off = found.centres[chosen] - pattern.centres[places]
    freedom = 2 * n - p
    square = float(np.einsum("ij,ij->", off, off)) + freedom * (_EXACT * spacing) ** 2
    tube = freedom / 2 * np.log(np.pi * square) - gammaln(freedom / 2 + 1) if freedom else 0.0
    at_places = ways - np.log(symmetry) + measure + tube - n * np.log(area)
    skipped = gammaln(pattern.count + 1) - gammaln(n + 1) - gammaln(pattern.count - n + 1)
    return float(at_places + _log_alike(found, chosen, spacing) + skipped + np.log(_COUNTS))


def _log_room(pattern: Pattern, area: float) -> float:
    """Log of the measure of all parameters that patterns of this shape may have on a plate."""
    longest = np.sqrt(area)
    if pattern.kind == CIRCLE:
        return float(np.log(area * 2 * np.pi / pattern.count * longest / 2))
    room = np.log(area * 2 * np.pi * longest / max(pattern.shape[0] - 1, 1))
    return float(room + (np.log(longest / max(pattern.shape[1] - 1, 1)) if pattern.kind == GRID else 0.0))


def _log_alike(found: Candidates, chosen: IntArray, spacing: float) -> float:
    """Log of the probability that radii are as equal as those chosen (n,), of candidates as they are."""
    radii: FloatArray = found.radii[chosen]
    freedom = len(radii) - 1
    wide = 2 * np.sqrt(np.pi) * max(float(found.radii.std()), _EXACT * spacing)
    square = float(((radii - radii.mean()) ** 2).sum()) + freedom * (_EXACT * spacing) ** 2
    tube = freedom / 2 * np.log(np.pi * square) - gammaln(freedom / 2 + 1) + 0.5 * np.log(freedom + 1)
    return float(min(tube - freedom * np.log(wide), 0.0))


def looks(radius: float, survey: Survey, opened: Openings) -> FloatArray:
    """Return how much places thrown on a plate look like holes of a radius: log odds (m,), rising.

    Measured on the plate itself, losses and all: a model's log odds say less than how often they occur.
    Places that are plainly none are left out.
    """
    rng = np.random.default_rng(0)
    corner, extent = survey.corner, np.array(survey.counts.shape) * survey.cell
    places = corner + extent * rng.uniform(size=(_N_THROWN, 2))
    places = places[~survey.is_no_hole(places, np.full(_N_THROWN, radius))]
    radii = np.full(len(places), radius)
    thrown = rim_scores(survey, places, radii, np.full(len(places), _SOFT * survey.spacing)).evidence
    return np.asarray(np.sort(thrown + opened.evidence(places, radii, survey.spacing)))


def log_rarity(evidence: FloatArray, thrown: FloatArray) -> FloatArray:
    """Return less the log of the share of places that look (m,) as much like a hole as some do (n,)."""
    as_many = len(thrown) - np.searchsorted(thrown, evidence, side="left")
    return np.asarray(np.log(_N_THROWN + 1) - np.log(as_many + 1))
