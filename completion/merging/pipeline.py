# SPDX-License-Identifier: MIT
"""Merging: regions that are one surface, cut apart by an occluder, by noise or by different scans."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from completion.evidence.sight import ScanSight, sight_of
from completion.merging.agreement import (
    FittedPart,
    Prior,
    compare,
    compare_all,
    lies_on,
    log_evidence_of_height,
)
from completion.merging.candidates import find_candidates, find_hosts
from completion.merging.gaps import Sights, gap_is_hidden
from completion.merging.limits import APART_SD, LEAST_LOG_ODDS, LEAST_SAMPLE_SHARE, SMALL_SHARE
from completion.merging.merged_surface import MergedSurface
from completion.merging.pieces import SurfacePiece, drop_unconfirmed, fit_groups
from completion.observe.observation import LabelledBeams, Observation
from completion.observe.refitting import improve
from completion.observe.tolerance import Tolerance
from completion.segmentation.regions import Groups, Region
from scenes.checks import FloatArray, IntArray
from scenes.run.mapping import NO_SPILL, NoSpill, Spill, allocate, trim

_ALIKE, _DIFFERENT = 1, 2


class Verdicts:
    """Which of n parts differ from one another; pairs that were not compared are when they are asked for."""

    def __init__(self, parts: Sequence[FittedPart], pairs: IntArray, chi2: FloatArray) -> None:
        """Keep what pairs (k, 2) came to: they differ where `chi2` (k,) is more than 1."""
        self._parts = parts
        self._known: NDArray[np.int8] = allocate((len(parts), len(parts)), np.int8)
        for here, there in (pairs.T, pairs.T[::-1]):
            self._known[here, there] = np.where(chi2 > 1, _DIFFERENT, _ALIKE)

    def contradict(self, first: Sequence[int], second: Sequence[int]) -> bool:
        """Tell whether some pair across two groups of parts fails the test."""
        contradictions = self._known[np.ix_(first, second)]
        if (contradictions == _DIFFERENT).any():
            return True
        return any(self._differ(first[i], second[j]) for i, j in np.argwhere(contradictions == 0).tolist())

    def _differ(self, number: int, other: int) -> bool:
        """Compare two parts, the one with the lower number with the other."""
        first, second = min(number, other), max(number, other)
        is_so = compare(self._parts[first], self._parts[second]).chi2 > 1
        self._known[first, second] = self._known[second, first] = _DIFFERENT if is_so else _ALIKE
        return is_so


_MOST_SCANS = 64  # that are merged together, each pair of them
_BLOCK = 16  # scans, or blocks of them, that are merged together where there are more


def merge(
    observations: Sequence[Observation],
    regions: Sequence[Sequence[Region]],
    tolerance: Tolerance,
    *,
    across: bool = True,
    keys: Sequence[int] | None = None,
    sights: Sequence[ScanSight] = (),
    spill: Spill | NoSpill = NO_SPILL,
) -> list[MergedSurface]:
    """Join regions that one surface explains and that nothing observed keeps apart.

    Two regions join where four things hold. The difference of their parameters passes a chi-square test
    against both covariances, which are inflated for correlated residuals and hold flatness and systematic
    error. The odds for one surface are strong after it; before it they are the lower the more regions are
    nearer, and the larger the gap is beside what was measured (`agreement.Prior`). The surface fitted to both
    is no rougher than they are. The gap between them was hidden along a strip. Pairs are tried in the order
    of their agreement; groups join where all their pairs pass the test.

    Each pair of scans of a sequence may see one surface, so that pairs grow with the square of their number.
    More than 64 scans are therefore merged sixteen consecutive ones at a time, by the same tests. What is one
    surface there, fitted anew to all its pixels, is one region among those of the next sixteen such blocks,
    until sixteen or fewer blocks are left, which are merged together. Beams of all key frames keep gaps open
    throughout. What only one of sixteen frames took for a surface, though five others looked there, is left
    out.

    Parameters
    ----------
    observations : sequence of Observation
        The scans.
    regions : sequence of sequence of Region
        The regions of each scan.
    tolerance : Tolerance
        Flatness, registration, and what the gap test allows.
    across : bool
        Whether regions are joined across occluders at all.
    keys : sequence of int, optional
        Numbers of the key frames; all scans when not given.
    sights : sequence of Sight
        The scans as compiled loops read them; made where not given.
    spill : Spill or NoSpill
        Where the pixels of what is joined are kept.
    """

    def pieces_of(scan: int) -> list[SurfacePiece]:
        piece_none_none = (
            SurfacePiece.of_region(scan, region, observations[scan], tolerance) for region in regions[scan]
        )
        return [spill.keep(piece) for piece in piece_none_none]

    if across:
        sights = sights or [sight_of(seen, tolerance) for seen in observations]
        packed = Sights.of(sights if keys is None else [sights[number] for number in keys])
        pieces = _in_blocks(pieces_of, observations, sights, packed, tolerance, spill=spill)
        groups = _group_pieces(pieces, observations, packed, tolerance)
    else:
        groups = [[piece] for scan in range(len(observations)) for piece in pieces_of(scan)]
    merged = _merge_groups(groups, observations, tolerance, spill)
    return sorted(merged, key=lambda surface: -surface.n_pixels)


def _in_blocks(
    pieces_of: Callable[[int], list[SurfacePiece]],
    observations: Sequence[Observation],
    sights: Sequence[ScanSight],
    packed: Sights,
    tolerance: Tolerance,
    *,
    spill: Spill | NoSpill,
) -> list[SurfacePiece]:
    """Merge the pieces of sixteen consecutive scans, or blocks of them, at a time, while there are many.

    `pieces_of` makes the pieces of a scan by its number, when their block is reached.
    """
    limit, n_blocks = _MOST_SCANS, len(observations)
    while n_blocks > limit:
        limit, blocks = _BLOCK, []
        for first in range(0, n_blocks, _BLOCK):
            numbers = range(first, min(first + _BLOCK, n_blocks))
            pieces = [piece for number in numbers for piece in pieces_of(number)]
            groups = _group_pieces(pieces, observations, packed, tolerance)
            if n_blocks == len(observations):
                groups = drop_unconfirmed(groups, sights[first : first + _BLOCK], first)
            fitted = fit_groups(groups, observations, tolerance, spill)
            blocks.append([
                spill.keep(SurfacePiece.fuse(group, fit, observations))
                for group, fit in zip(groups, fitted, strict=True)
            ])  # fmt: skip
        pieces_of, n_blocks = blocks.__getitem__, len(blocks)
    return [piece for number in range(n_blocks) for piece in pieces_of(number)]


def _group_pieces(
    pieces: Sequence[SurfacePiece], observations: Sequence[Observation], sights: Sights, tolerance: Tolerance
) -> list[list[SurfacePiece]]:
    """The pieces of each surface."""
    groups = Groups(len(pieces))
    prior = Prior.of(
        [piece.part for piece in pieces], len({scan for piece in pieces for scan, _ in piece.sample})
    )
    _join_alike(groups, pieces, observations, sights, tolerance, prior=prior)
    _adopt_small(groups, pieces, sights, prior)
    return [[pieces[k] for k in several] for several in groups.all()]


def _join_alike(
    groups: Groups,
    parts: Sequence[SurfacePiece],
    observations: Sequence[Observation],
    sights: Sights,
    tolerance: Tolerance,
    *,
    prior: Prior,
) -> None:
    """Join the groups of pairs that pass all tests, those that agree best first."""
    alone = [part.part for part in parts]
    pairs, chi2, log_evidence = _agreements(alone)
    verdicts = Verdicts(alone, pairs, chi2)
    order = np.lexsort([pairs[:, 1], pairs[:, 0], chi2])
    tried = order[(chi2[order] <= 1) & (log_evidence[order] >= LEAST_LOG_ODDS)]
    for k in tried:  # of the pairs there are very many: no list of them
        i, j, evidence = int(pairs[k, 0]), int(pairs[k, 1]), float(log_evidence[k])
        if groups.are_one(i, j) or verdicts.contradict(groups.of(i), groups.of(j)):
            continue
        if evidence + prior.log_odds(i, j) < LEAST_LOG_ODDS:
            continue
        joined = [parts[k] for k in sorted(groups.of(i) + groups.of(j))]
        trim()
        if _hidden_between(parts[i], parts[j], sights) and _fits_all(joined, observations, tolerance):
            groups.join(i, j)


def _agreements(parts: Sequence[FittedPart]) -> tuple[IntArray, FloatArray, FloatArray]:
    """The pairs (k, 2) that come into question at all, and how they compare: chi2 (k,), log evidence (k,)."""
    pairs = find_candidates(parts)
    return pairs, *compare_all(parts, pairs)


def _fits_all(
    parts: Sequence[SurfacePiece], observations: Sequence[Observation], tolerance: Tolerance
) -> bool:
    """Tell whether one surface leaves each of the parts no rougher than its own noise and warps do."""
    start = max(parts, key=lambda piece: piece.n_pixels).fit.surface
    most = max(part.n_pixels for part in parts)
    shares = [max(part.n_pixels / most, LEAST_SAMPLE_SHARE) for part in parts]
    pairs = [pair for part, share in zip(parts, shares, strict=True) for pair in part.subsample(share)]
    pairs.sort(key=lambda pair: pair[0])
    beams = [
        LabelledBeams.at(observations[scan], np.concatenate([members for _, members in several]))
        for scan, several in groupby(pairs, key=lambda pair: pair[0])
    ]
    (joint,) = improve([start], beams, tolerance.flatness_m, n_rounds=2)
    if joint is None:
        return False
    scans = {part.part.doubt.scan for part in parts}
    among_several = len(scans) > 1 or min(scans) < 0
    for part in parts:
        value = (
            part.fit.rms**2 + (APART_SD * part.systematic_m) ** 2 + among_several * part.part.doubt.shift_m**2
        )
        if not np.mean(np.square(joint.distance(part.part.points))) <= (1 + part.part.slack) * value:
            return False
    return True


def _hidden_between(first: SurfacePiece, second: SurfacePiece, sights: Sights) -> bool:
    larger, smaller = (first, second) if first.n_pixels >= second.n_pixels else (second, first)
    return gap_is_hidden(smaller.part, larger.part, sights)


def _adopt_small(groups: Groups, parts: Sequence[SurfacePiece], sights: Sights, prior: Prior) -> None:
    """Put small parts that lie on a much larger one, but are too small to be tested, into its group.

    Far from where it was measured a surface is hardly known, and something small lies near it by chance: its
    height is to be evidence of that surface, as that of larger parts is.
    """
    by_size = sorted(range(len(parts)), key=lambda index: -parts[index].n_pixels)
    rank = {index: place for place, index in enumerate(by_size)}
    single = [j for j in reversed(by_size) if len(groups.of(j)) == 1]
    hosts = find_hosts([parts[j].part for j in single], [part.part for part in parts])
    for j, near in zip(single, hosts, strict=True):
        trim()
        small = parts[j]
        if len(groups.of(j)) > 1:
            continue
        for i in sorted(near, key=rank.__getitem__):
            large = parts[i]
            if small.n_pixels > SMALL_SHARE * large.n_pixels:
                break
            best = parts[min(groups.of(i), key=rank.__getitem__)]  # what is known best of that surface
            if not (lies_on(small.part, large.part) and lies_on(small.part, best.part)):
                continue
            evidence = log_evidence_of_height(small.part, best.part)
            if evidence + prior.log_odds(i, j) < LEAST_LOG_ODDS:
                continue
            if _hidden_between(large, small, sights):
                groups.join(i, j)
                break


def _merge_groups(
    groups: Sequence[Sequence[SurfacePiece]],
    observations: Sequence[Observation],
    tolerance: Tolerance,
    spill: Spill | NoSpill,
) -> list[MergedSurface]:
    """One surface for each group, those of several pieces first."""
    ordered = sorted(groups, key=lambda pieces: len(pieces) == 1)
    fitted = fit_groups(ordered, observations, tolerance, spill)
    return [
        MergedSurface(fit.fit, fit.pixels, sum(piece.n_regions for piece in pieces))
        for pieces, fit in zip(ordered, fitted, strict=True)
    ]
