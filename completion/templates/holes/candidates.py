# SPDX-License-Identifier: MIT
"""Candidates: single circles that may be holes, each by itself."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, ndimage

from completion.templates.holes.measuring.openings import Openings
from completion.templates.holes.measuring.survey import Survey
from completion.templates.holes.rims import rim_scores
from scenes.checks import FloatArray

LEAST = 1.8  # spacings: radius of the smallest hole
_STEP, _RATIO = 0.4, 1.12  # spacings, and ratio, between radii that are tried
_LARGEST = 0.22  # of the plate's longest side
_CELLS = 10  # of the image in a radius at least, where it is made coarser
_RING = 1.5  # spacings: width of the ring
_EMPTY, _MET = 0.12, 0.3  # of the points expected: most within the disc, least on the ring
_MOST_PLACES, _MOST, _N_ROUNDS = 300, 60, 6
_LEAST_EVIDENCE = 3.0  # nats
_SHRINK = (0.5, 0.25, 0.12)  # spacings: steps of the local search
LARGE, _WIDENED = 8.0, (1.0, 0.5, 0.25, 0.12)  # spacings from which circles are large, and their steps


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
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


def candidates(survey: Survey, opened: Openings, radius: float | None = None) -> Candidates:
    """Find circles with an empty inside and plate around, of any radius or of one that is given.

    For each radius two convolutions count the plate's points in the disc and on the ring about every cell;
    local maxima are weighed, and moved to where they are most evident.
    """
    radii = _radii(survey) if radius is None else np.array([radius])
    places = [_places(survey, float(one)) for one in radii]
    centres = np.concatenate([place for place, _ in places])
    sizes = np.repeat(radii, [len(place) for place, _ in places])
    best = np.argsort(-np.concatenate([score for _, score in places]), kind="stable")[: 4 * _MOST_PLACES]
    centres, sizes = centres[best], sizes[best]
    if not len(centres):
        return Candidates(centres, sizes, np.zeros(0))
    soft = np.full(len(sizes), 0.35 * survey.spacing)
    evidence = rim_scores(survey, centres, sizes, soft).evidence
    best = np.argsort(-evidence, kind="stable")[:_MOST_PLACES]
    found = _climbed(survey, Candidates(centres[best], sizes[best], evidence[best]), radius is not None)
    more = opened.evidence(found.centres, found.radii, survey.spacing)
    return _distinct(replace(found, evidence=found.evidence + more))


def _radii(survey: Survey) -> FloatArray:
    """Radii to try, closer together than the spacing where they are small."""
    extent = np.array(survey.counts.shape) * survey.cell
    found, radius = list[float](), LEAST * survey.spacing
    while radius < _LARGEST * extent.max():
        found.append(radius)
        radius = max(radius + _STEP * survey.spacing, min(radius * _RATIO, radius + 2 * survey.spacing))
    return np.array(found)


def _places(survey: Survey, radius: float) -> tuple[FloatArray, FloatArray]:
    """Centres (m, 2) of circles of one radius, and how much of the ring less of the disc is filled (m,)."""
    cell, counts, densities = _coarser(survey, radius)
    ring, disc = radius + max(_RING * survey.spacing, 1.5 * cell), radius - 0.5 * cell
    half = int(np.ceil(ring / cell)) + 1
    padded = np.pad(counts, half)
    expected = np.pad(densities, half, mode="edge") * np.pi
    shape = tuple(fft.next_fast_len(n + 2 * half, real=True) for n in padded.shape)
    across = np.arange(-half, half + 1) * cell
    far = np.hypot(across[:, None], across[None])
    image = fft.rfft2(padded, shape)

    def counted(kernel: FloatArray) -> FloatArray:
        summed = fft.irfft2(image * fft.rfft2(kernel, shape), shape)
        return np.asarray(summed[half : half + padded.shape[0], half : half + padded.shape[1]])

    inside = counted((far <= disc).astype(np.float64)) / (expected * disc**2)
    around = counted(((far > disc) & (far <= ring)).astype(np.float64)) / (expected * (ring**2 - disc**2))
    score = around - 3 * inside
    top = ndimage.maximum_filter(score, size=3) == score
    cells = np.argwhere(top & (inside < _EMPTY) & (around > _MET))
    centres = survey.corner + (cells - half + 0.5) * cell
    return centres, score[tuple(cells.T)] * np.sqrt(radius / survey.spacing)


def _coarser(survey: Survey, radius: float) -> tuple[float, FloatArray, FloatArray]:
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


def _climbed(survey: Survey, begun: Candidates, is_given: bool) -> Candidates:
    """The candidates moved, step by step, to the most evident circles near them."""
    found = begun
    moves = np.concatenate([np.eye(3), -np.eye(3)])
    moves = moves[moves[:, 2] == 0] if is_given else moves
    for step in _SHRINK:
        found = _ascended(survey, found, moves, step)
        kept = np.argsort(-found.evidence, kind="stable")[: max(_MOST, len(found) // 2)]
        found = _distinct(Candidates(found.centres[kept], found.radii[kept], found.evidence[kept]), 2 * _MOST)
    return found if is_given else _grown(survey, found)


def _grown(survey: Survey, begun: Candidates) -> Candidates:
    """The candidates, large ones moved and widened at once.

    A circle in a larger one, which it touches, can neither be moved nor widened by more than its rim is
    soft, which is little against a large one.
    """
    large = np.flatnonzero(begun.radii > LARGE * survey.spacing)
    if not len(large):
        return begun
    found = Candidates(begun.centres[large], begun.radii[large], begun.evidence[large])
    around = 2 * np.pi * np.arange(8) / 8
    out = np.column_stack([np.cos(around), np.sin(around), np.ones(8)])
    moves = np.concatenate([out, -out, np.eye(3), -np.eye(3)])
    for step in _WIDENED:
        found = _ascended(survey, found, moves, step)
    merged = [getattr(begun, name).copy() for name in ("centres", "radii", "evidence")]
    for whole, part in zip(merged, (found.centres, found.radii, found.evidence), strict=True):
        whole[large] = part
    return _distinct(Candidates(*merged), 2 * _MOST)


def _ascended(survey: Survey, begun: Candidates, moves: FloatArray, step: float) -> Candidates:
    """The candidates moved by moves (k, 3) of centre and radius, as long as they become more evident."""
    centres, radii = begun.centres.copy(), begun.radii.copy()
    length = step * np.maximum(survey.spacing, radii / _CELLS)
    soft = np.maximum(0.7 * length, survey.plate.noise)
    evidence = rim_scores(survey, centres, radii, soft).evidence
    active = np.arange(len(radii))
    for _ in range(_N_ROUNDS):
        tried = centres[active, None] + moves[None, :, :2] * length[active, None, None]
        sizes = np.maximum(
            radii[active, None] + moves[None, :, 2] * length[active, None], LEAST * survey.spacing
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
    return Candidates(centres, radii, evidence)


def _distinct(found: Candidates, most: int = _MOST) -> Candidates:
    """The most evident, of which centres or radii differ by a fourth of the radius."""
    order = np.argsort(-found.evidence, kind="stable")
    kept = list[int]()
    for k in order:
        if found.evidence[k] < _LEAST_EVIDENCE or len(kept) == most:
            break
        gap = np.hypot(*(found.centres[kept] - found.centres[k]).T) if kept else np.zeros(0)
        nearly = (gap < 0.25 * found.radii[k]) & (
            np.abs(found.radii[kept] - found.radii[k]) < 0.25 * found.radii[k]
        )
        if not nearly.any():
            kept.append(int(k))
    return Candidates(found.centres[kept], found.radii[kept], found.evidence[kept])
