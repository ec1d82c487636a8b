# SPDX-License-Identifier: MIT
"""Merging: regions that are one surface, cut apart by an occluder, by noise or by different scans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from completion.evidence.sight import sight_of
from completion.fitting.result import SurfaceFit
from completion.merging.agreement import Agreement, Part, compare, find_candidates, lies_on
from completion.merging.gaps import gap_is_hidden
from completion.merging.sights import Sights
from completion.observe.observation import Beams, Observation
from completion.observe.pixel_set import PixelSet
from completion.observe.refitting import improve, refit
from completion.observe.tolerance import Tolerance
from completion.segmentation.regions import Region
from scenes.checks import FloatArray

_N_SAMPLE = 400  # points of a region that take part in the pair tests
_LEAST_EVIDENCE = float(np.log(20.0))  # "strong" (Kass & Raftery 1995)
_APART = 4.0  # standard deviations of its warp by which any part of a surface may stand off the common fit
_SMALL = 0.05  # of another region's pixels: so small a part may lie on it without having its shape


@dataclass(frozen=True, slots=True, eq=False)
class MergedSurface:
    """One surface with all its pixels in all scans.

    Attributes
    ----------
    fit : SurfaceFit
        Fit to all its points, covariance inflated for correlated residuals; working frame.
    pixels : tuple of PixelSet
        Its pixels in each scan.
    n_parts : int
        How many regions were joined.
    """

    fit: SurfaceFit
    pixels: tuple[PixelSet, ...]
    n_parts: int

    @property
    def n_pixels(self) -> int:
        """Pixels in all scans together."""
        return sum(map(len, self.pixels))

    def points(self, observations: Sequence[Observation]) -> FloatArray:
        """Its measured points (n, 3) in the working frame."""
        return np.concatenate([o.points_at(p.flat) for o, p in zip(observations, self.pixels, strict=True)])


@dataclass(frozen=True, slots=True, eq=False)
class _ScanRegion:
    """A region with the scan it is from and what the tests need."""

    scan: int
    region: Region
    part: Part
    n_pixels: int
    systematic_m: float  # error that neighbouring ranges have in common
    beams: Beams  # of the points in `part`


def merge(
    observations: Sequence[Observation],
    regions: Sequence[Sequence[Region]],
    tolerance: Tolerance,
    *,
    across: bool = True,
) -> list[MergedSurface]:
    """Join regions that one surface explains and that nothing observed keeps apart.

    Two regions join where four things hold. The difference of their parameters passes a chi-square test
    against both covariances, which are inflated for correlated residuals and hold flatness and systematic
    error. That is strong evidence for one surface. The surface fitted to both is no rougher than they are.
    The gap between them was hidden along a strip. Pairs are tried in the order of their agreement; groups
    join where all their pairs pass the test.

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
    """
    parts = [
        _scan_region(index, region, observation, tolerance)
        for index, (observation, found) in enumerate(zip(observations, regions, strict=True))
        for region in found
    ]
    group, sights = np.arange(len(parts)), Sights.of([sight_of(seen, tolerance) for seen in observations])
    agreements = _agreements(parts) if across else {}
    for (i, j), agreement in sorted(agreements.items(), key=lambda item: (item[1].chi2, item[0])):
        if agreement.chi2 > 1:
            break
        if group[i] == group[j] or agreement.log_evidence < _LEAST_EVIDENCE:
            continue
        if _contradicted(group, group[i], group[j], agreements, parts):
            continue
        joined = [parts[k] for k in np.flatnonzero((group == group[i]) | (group == group[j])).tolist()]
        if _hidden_between(parts[i], parts[j], sights) and _fits_all(joined, tolerance):
            group[group == group[j]] = group[i]
    if across:
        _adopt_small(group, parts, sights)
    merged = _merged(group, parts, observations, tolerance)
    return sorted(merged, key=lambda surface: -surface.n_pixels)


def _scan_region(scan: int, region: Region, observation: Observation, tolerance: Tolerance) -> _ScanRegion:
    pixel = region.pixels.flat
    n_pixels = len(pixel)
    pixel = pixel[np.linspace(0, n_pixels - 1, min(_N_SAMPLE, n_pixels)).astype(np.int64)]
    points = observation.points_at(pixel)
    distance = float(np.median(observation.scan.ranges.ravel()[pixel]))
    systematic = np.hypot(tolerance.flatness_m, observation.noise.bias(np.array([distance]))[0])
    systematic = float(np.hypot(systematic, tolerance.registration_m))
    scale = float(np.hypot(observation.sigma_at(pixel).mean(), tolerance.flatness_m))
    part = Part.of(region.fit, points, scale, systematic)
    beams = Beams.at(observation, pixel)
    return _ScanRegion(scan, region, part, n_pixels, systematic_m=systematic, beams=beams)


def _agreements(parts: Sequence[_ScanRegion]) -> dict[tuple[int, int], Agreement]:
    """How the pairs compare that come into question at all."""
    if len(parts) < 2:
        return {}
    candidates = np.argwhere(np.triu(find_candidates([one.part for one in parts]), 1))
    return {(int(i), int(j)): compare(parts[i].part, parts[j].part) for i, j in candidates}


def _contradicted(
    group: NDArray[np.int64],
    one: int,
    other: int,
    agreements: dict[tuple[int, int], Agreement],
    parts: Sequence[_ScanRegion],
) -> bool:
    """Tell whether some pair across two groups fails the test that their best pair passed."""
    for pair in product(np.flatnonzero(group == one), np.flatnonzero(group == other)):
        i, j = sorted(map(int, pair))
        if (agreements.get((i, j)) or compare(parts[i].part, parts[j].part)).chi2 > 1:
            return True
    return False


def _fits_all(parts: Sequence[_ScanRegion], tolerance: Tolerance) -> bool:
    """Tell whether one surface leaves each of the parts no rougher than its own noise and warps do."""
    start = max(parts, key=lambda one: one.n_pixels).region.fit.surface
    (joint,) = improve([start], [one.beams for one in parts], tolerance.flatness_m, n_rounds=2)
    if joint is None:
        return False
    for one in parts:
        own = one.region.fit.rms**2 + (_APART * one.systematic_m) ** 2
        slack = 1 + 3 * np.sqrt(2 / len(one.part.points))
        if not np.mean(np.square(joint.distance(one.part.points))) <= slack * own:
            return False
    return True


def _hidden_between(one: _ScanRegion, other: _ScanRegion, sights: Sights) -> bool:
    larger, smaller = (one, other) if one.n_pixels >= other.n_pixels else (other, one)
    return gap_is_hidden(smaller.part, larger.part, sights)


def _adopt_small(group: NDArray[np.int64], parts: Sequence[_ScanRegion], sights: Sights) -> None:
    """Put small parts that lie on a much larger one, but are too small to be tested, into its group."""
    by_size = sorted(range(len(parts)), key=lambda index: -parts[index].n_pixels)
    for j in reversed(by_size):
        small = parts[j]
        if (group == group[j]).sum() > 1:
            continue
        for i in by_size:
            large = parts[i]
            if small.n_pixels > _SMALL * large.n_pixels:
                break
            if lies_on(small.part, large.part) and _hidden_between(large, small, sights):
                group[j] = group[i]
                break


def _merged(
    group: NDArray[np.int64],
    parts: Sequence[_ScanRegion],
    observations: Sequence[Observation],
    tolerance: Tolerance,
) -> list[MergedSurface]:
    """One surface for each group, those of several parts fitted anew."""
    members = [[parts[i] for i in np.flatnonzero(group == number).tolist()] for number in np.unique(group)]
    joined = [several for several in members if len(several) > 1]
    labels = [np.zeros(observation.scan.shape, np.int32) for observation in observations]
    for number, several in enumerate(joined, start=1):
        for one in several:
            labels[one.scan].ravel()[one.region.pixels.flat] = number
    starts = [max(several, key=lambda one: one.n_pixels).region.fit for several in joined]
    fits = refit([fit.surface for fit in starts], observations, labels, tolerance.flatness_m, n_rounds=2)
    surfaces = [
        MergedSurface(start if fit is None else fit, _pixels(several, observations), len(several))
        for several, start, fit in zip(joined, starts, fits, strict=True)
    ]
    single = [several[0] for several in members if len(several) == 1]
    return surfaces + [MergedSurface(one.region.fit, _pixels([one], observations), 1) for one in single]


def _pixels(parts: Sequence[_ScanRegion], observations: Sequence[Observation]) -> tuple[PixelSet, ...]:
    """The pixels of some parts in each scan."""
    return tuple(
        PixelSet.union([one.region.pixels for one in parts if one.scan == number], observation.scan.shape)
        for number, observation in enumerate(observations)
    )
