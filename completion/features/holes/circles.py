# SPDX-License-Identifier: MIT
"""Circles: single circles that may be holes, by the rims where the plate ends."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy import fft, ndimage
from scipy.special import ndtr

from completion.features.holes import limits
from completion.features.holes.plates import Openings, PlateSurvey
from scenes.checks import BoolArray, FloatArray, IntArray

N_SECTORS = 16
_INNER, _OUTER = 10, 6  # rings within the radius, and beyond it


@dataclass(frozen=True, slots=True, eq=False)
class RimScores:
    """Evidence of m circles.

    Attributes
    ----------
    evidence : (m,) float
        Log odds of a hole against the plate and against a lost patch of any shape, nats.
    seen : (m, k) bool
        Sectors in which the plate begins at the rim rather than farther out.
    filled : (m,) float
        Log odds of the plate against the hole in its inside; large where measured surface fills it.
    """

    evidence: FloatArray
    seen: BoolArray
    filled: FloatArray


def rim_scores(survey: PlateSurvey, centres: FloatArray, radii: FloatArray, soft: FloatArray) -> RimScores:
    """Weigh circles (m, 2), (m,) whose radii are known to `soft` (m,).

    In each of 16 sectors the plate begins at some distance g from the centre. Its points are a Poisson
    process of density rho beyond g and of a small density eps rho before it:
    log L(g) = n(r < g) log eps + rho (1 - eps) angle g^2 / 2, less what a plate without a hole has. A lost
    patch ends at some b in each sector, of one prior with or without a hole: the plate begins at b without
    one, and at max(R, b) with one. So sectors that are lost beyond the rim say nothing.
    """
    if not len(centres):
        return RimScores(np.zeros(0), np.zeros((0, N_SECTORS), dtype=np.bool_), np.zeros(0))
    level = survey.level(radii)
    scores = [_scores(survey, centres[at], radii[at], soft[at], level=int(level[at[0]]))
              for at in (np.flatnonzero(level == step_level) for step_level in np.unique(level))]  # fmt: skip
    back = np.argsort(np.argsort(level, kind="stable"), kind="stable")
    return RimScores(
        *(np.concatenate([getattr(score, f.name) for score in scores])[back] for f in fields(RimScores))
    )


def _scores(
    survey: PlateSurvey, centres: FloatArray, radii: FloatArray, soft: FloatArray, *, level: int
) -> RimScores:
    """The same of circles for which a fourth of the points, or of these, suffices."""
    m, beyond = len(centres), limits.BEYOND_RIM * survey.spacing * 2**level
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
    patch, ends = _anywhere(log_l, grid)
    begins = np.log((1 - limits.LOST_SHARE) * radii / grid[:, -1])[:, None] + at_rim
    whole, lost = np.log(1 - limits.LOST_SHARE), np.log(limits.LOST_SHARE)
    hole = np.logaddexp(whole + at_rim.sum(axis=1), lost + np.logaddexp(begins, ends).sum(axis=1))
    none = np.logaddexp(whole, lost + patch.sum(axis=1))
    inside = before[:, :, _INNER - 2].sum(axis=1) * np.log(eps) + expected[:, _INNER - 2] * N_SECTORS
    return RimScores(hole - none, np.asarray(begins > ends, dtype=np.bool_), -inside)


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
    """Log likelihood (m, k) of a patch that ends anywhere, and of its part that ends beyond the rim."""
    top = log_l.max(axis=2)
    likely = np.exp(log_l - top[:, :, None])
    middle = (likely[:, :, 1:] + likely[:, :, :-1]) / 2
    share = np.diff(grid, axis=1) / grid[:, -1:]
    last = likely[:, :, -1]
    patch = (1 - limits.LOST_SHARE) * np.einsum("mkr,mr->mk", middle, share) + limits.LOST_SHARE * last
    lost = (1 - limits.LOST_SHARE) * np.einsum("mkr,mr->mk", middle[:, :, _INNER:], share[:, _INNER:])
    lost += limits.LOST_SHARE * last
    with np.errstate(divide="ignore"):
        return top + np.log(patch), top + np.log(lost)


_STEP, _RATIO = 0.4, 1.12  # spacings, and ratio, between radii that are tried
_CELLS = 10  # of the image in a radius at least, where it is made coarser
_MOST_PLACES, _MOST, _N_ROUNDS = 300, 60, 6
_SHRINK = (0.5, 0.25, 0.12)  # spacings: steps of the local search
_WIDENED = (1.0, 0.5, 0.25, 0.12)  # the same of large circles


@dataclass(frozen=True, slots=True, eq=False)
class HoleCandidates:
    """Circles that may be holes.

    Attributes
    ----------
    centres : (m, 2) float
        In the plate's chart.
    radii : (m,) float
        Of them.
    evidence : (m,) float
        Log odds of each, nats.
    """

    centres: FloatArray
    radii: FloatArray
    evidence: FloatArray

    def __len__(self) -> int:
        return len(self.radii)


def candidates(survey: PlateSurvey, opened: Openings, radius: float | None = None) -> HoleCandidates:
    """Find circles with an empty inside and plate around, of any radius or of one that is given.

    For each radius two convolutions count the plate's points in the disc and on the ring about every cell;
    local maxima are weighed, and moved to where they are most evident.
    """
    radii = _radii(survey) if radius is None else np.array([radius])
    places = [_places(survey, float(radius)) for radius in radii]
    centres = np.concatenate([place for place, _ in places])
    sizes = np.repeat(radii, [len(place) for place, _ in places])
    best = np.argsort(-np.concatenate([score for _, score in places]), kind="stable")[: 4 * _MOST_PLACES]
    centres, sizes = centres[best], sizes[best]
    if not len(centres):
        return HoleCandidates(centres, sizes, np.zeros(0))
    soft = np.full(len(sizes), 0.35 * survey.spacing)
    evidence = rim_scores(survey, centres, sizes, soft).evidence
    best = np.argsort(-evidence, kind="stable")[:_MOST_PLACES]
    circles = _climb(survey, HoleCandidates(centres[best], sizes[best], evidence[best]), radius is not None)
    more = opened.evidence(circles.centres, circles.radii, survey.spacing)
    return _distinct(replace(circles, evidence=circles.evidence + more))


def _radii(survey: PlateSurvey) -> FloatArray:
    """Radii to try, closer together than the spacing where they are small."""
    extent = np.array(survey.counts.shape) * survey.cell
    radii, radius = list[float](), limits.LEAST_RADIUS * survey.spacing
    while radius < limits.MOST_RADIUS * extent.max():
        radii.append(radius)
        radius = max(radius + _STEP * survey.spacing, min(radius * _RATIO, radius + 2 * survey.spacing))
    return np.array(radii)


def _places(survey: PlateSurvey, radius: float) -> tuple[FloatArray, FloatArray]:
    """Centres (m, 2) of circles of one radius, and how much of the ring less of the disc is filled (m,)."""
    cell, counts, densities = _coarser(survey, radius)
    ring, disc = radius + max(limits.RIM_BAND * survey.spacing, 1.5 * cell), radius - 0.5 * cell
    half = int(np.ceil(ring / cell)) + 1
    padded = np.pad(counts, half)
    expected = np.pad(densities, half, mode="edge") * np.pi
    shape = tuple(fft.next_fast_len(n + 2 * half, real=True) for n in padded.shape)
    across = np.arange(-half, half + 1) * cell
    far = np.hypot(across[:, None], across[None])
    image = fft.rfft2(padded, shape)

    def count(kernel: FloatArray) -> FloatArray:
        summed = fft.irfft2(image * fft.rfft2(kernel, shape), shape)
        return np.asarray(summed[half : half + padded.shape[0], half : half + padded.shape[1]])

    inside = count((far <= disc).astype(np.float64)) / (expected * disc**2)
    around = count(((far > disc) & (far <= ring)).astype(np.float64)) / (expected * (ring**2 - disc**2))
    score = around - 3 * inside
    top = ndimage.maximum_filter(score, size=3) == score
    cells = np.argwhere(top & (inside < limits.EMPTY_SHARE) & (around > limits.MET_SHARE))
    centres = survey.corner + (cells - half + 0.5) * cell
    return centres, score[tuple(cells.T)] * np.sqrt(radius / survey.spacing)


def _coarser(survey: PlateSurvey, radius: float) -> tuple[float, FloatArray, FloatArray]:
    """Side of cells of which a radius has some, points in each of them, and their density."""
    factor = max(1, int(radius / (_CELLS * survey.cell)))
    if factor == 1:
        return survey.cell, survey.counts, survey.densities
    shape = [-(-n // factor) for n in survey.counts.shape]
    grown = [(0, factor * size - n) for size, n in zip(shape, survey.counts.shape, strict=True)]
    blocks = (shape[0], factor, shape[1], factor)
    counts = np.pad(survey.counts, grown).reshape(blocks).sum(axis=(1, 3))
    densities = np.pad(survey.densities, grown, mode="edge").reshape(blocks).mean(axis=(1, 3))
    return factor * survey.cell, counts, densities


def _climb(survey: PlateSurvey, begun: HoleCandidates, is_given: bool) -> HoleCandidates:
    """The candidates moved, step by step, to the most evident circles near them."""
    distinct = begun
    moves = np.concatenate([np.eye(3), -np.eye(3)])
    moves = moves[moves[:, 2] == 0] if is_given else moves
    for step in _SHRINK:
        distinct = _ascend(survey, distinct, moves, step)
        kept = np.argsort(-distinct.evidence, kind="stable")[: max(_MOST, len(distinct) // 2)]
        distinct = _distinct(
            HoleCandidates(distinct.centres[kept], distinct.radii[kept], distinct.evidence[kept]), 2 * _MOST
        )
    return distinct if is_given else _grown(survey, distinct)


def _grown(survey: PlateSurvey, begun: HoleCandidates) -> HoleCandidates:
    """The candidates, large ones moved and widened at once.

    A circle in a larger one, which it touches, can neither be moved nor widened by more than its rim is
    soft, which is little against a large one.
    """
    large = np.flatnonzero(begun.radii > limits.LARGE_RADIUS * survey.spacing)
    if not len(large):
        return begun
    circles = HoleCandidates(begun.centres[large], begun.radii[large], begun.evidence[large])
    around = 2 * np.pi * np.arange(8) / 8
    out = np.column_stack([np.cos(around), np.sin(around), np.ones(8)])
    moves = np.concatenate([out, -out, np.eye(3), -np.eye(3)])
    for step in _WIDENED:
        circles = _ascend(survey, circles, moves, step)
    merged = [getattr(begun, name).copy() for name in ("centres", "radii", "evidence")]
    for whole, part in zip(merged, (circles.centres, circles.radii, circles.evidence), strict=True):
        whole[large] = part
    return _distinct(HoleCandidates(*merged), 2 * _MOST)


def _ascend(survey: PlateSurvey, begun: HoleCandidates, moves: FloatArray, step: float) -> HoleCandidates:
    """The candidates moved by moves (k, 3) of centre and radius, as long as they become more evident."""
    centres, radii = begun.centres.copy(), begun.radii.copy()
    length = step * np.maximum(survey.spacing, radii / _CELLS)
    soft = np.maximum(0.7 * length, survey.plate.noise)
    evidence = rim_scores(survey, centres, radii, soft).evidence
    active = np.arange(len(radii))
    for _ in range(_N_ROUNDS):
        tried = centres[active, None] + moves[None, :, :2] * length[active, None, None]
        sizes = np.maximum(
            radii[active, None] + moves[None, :, 2] * length[active, None],
            limits.LEAST_RADIUS * survey.spacing,
        )
        each = np.repeat(soft[active], len(moves))
        flat = rim_scores(survey, tried.reshape(-1, 2), sizes.ravel(), each)
        values = flat.evidence.reshape(sizes.shape)
        best = values.argmax(axis=1)
        rows = np.flatnonzero(values.max(axis=1) > evidence[active] + 1e-9)
        active, best = active[rows], best[rows]
        centres[active], radii[active] = tried[rows, best], sizes[rows, best]
        evidence[active] = values[rows, best]
        if not len(active):
            break
    return HoleCandidates(centres, radii, evidence)


def _distinct(circles: HoleCandidates, most: int = _MOST) -> HoleCandidates:
    """The most evident, of which centres or radii differ by a fourth of the radius."""
    order = np.argsort(-circles.evidence, kind="stable")
    kept = list[int]()
    for k in order:
        if circles.evidence[k] < limits.SURE_NATS or len(kept) == most:
            break
        gap = np.hypot(*(circles.centres[kept] - circles.centres[k]).T) if kept else np.zeros(0)
        nearly = (gap < 0.25 * circles.radii[k]) & (
            np.abs(circles.radii[kept] - circles.radii[k]) < 0.25 * circles.radii[k]
        )
        if not nearly.any():
            kept.append(int(k))
    return HoleCandidates(circles.centres[kept], circles.radii[kept], circles.evidence[kept])
