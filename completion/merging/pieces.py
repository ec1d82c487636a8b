# SPDX-License-Identifier: MIT
"""Pieces: what merging compares, regions or several that are one; those of one frame that others refute."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from completion.evidence.sight import ScanSight, pixel_of
from completion.fitting.result import SurfaceFit, allow_for_warp
from completion.merging.agreement import FittedPart, PoseDoubt
from completion.merging.limits import AS_NEAR, MAJORITY, VOTES
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation, PixelSet, ScanPixels
from completion.observe.rays import deviation_at, dot, minus
from completion.observe.refitting import refit_each
from completion.observe.tolerance import Tolerance
from completion.segmentation.regions import Region
from scenes.card import shown
from scenes.checks import FloatArray
from scenes.run.mapping import NoSpill, Spill, trim
from texture.engine.compiled import compiled

_N_SAMPLE = 400  # points of a piece that take part in the pair tests


@dataclass(frozen=True, slots=True, eq=False)
class SurfacePiece:
    """A part of a surface with its pixels, and what the tests need."""

    fit: SurfaceFit
    pixels: tuple[tuple[int, PixelSet], ...]  # by scan, ascending
    part: FittedPart
    n_regions: int
    n_pixels: int
    systematic_m: float  # error that neighbouring ranges have in common
    sample: tuple[tuple[int, NDArray[np.int32]], ...]  # by scan: flat pixels of the points in `part`
    relief_m: float = 0.0  # how far it strays from its plane, rms beyond noise and sensor, metres

    @classmethod
    def of_region(
        cls, scan: int, region: Region, observation: Observation, tolerance: Tolerance
    ) -> SurfacePiece:
        """Return a region of a scan as a piece."""
        trim()
        pixel = region.pixels.flat
        n_pixels = len(pixel)
        pixel = pixel[np.linspace(0, n_pixels - 1, min(_N_SAMPLE, n_pixels)).astype(np.int64)]
        points = observation.points_at(pixel)
        distance = float(np.median(observation.scan.ranges.ravel()[pixel]))
        systematic = float(np.hypot(tolerance.flatness_m, observation.noise.bias(np.array([distance]))[0]))
        error = tolerance.of_pose(observation.pose_error_m).registration_m
        scale = float(np.hypot(observation.sigma_at(pixel).mean(), tolerance.flatness_m))
        part = FittedPart.of(region.fit, points, scale, systematic, PoseDoubt(scan, error, error / distance))
        return cls(
            fit=region.fit,
            pixels=((scan, region.pixels),),
            part=part,
            n_regions=1,
            n_pixels=n_pixels,
            systematic_m=systematic,
            sample=((scan, pixel),),
            relief_m=region.relief_m,
        )

    @classmethod
    def fuse(
        cls,
        pieces: Sequence[SurfacePiece],
        fitted: PieceFit,
        observations: Sequence[Observation],
    ) -> SurfacePiece:
        """Return what some pieces of one surface are together, from all their pixels and the fit to them.

        Its systematic error and scale are the means of theirs, by their pixels.
        """
        if len(pieces) == 1:
            return pieces[0]
        trim()
        weight = np.array([piece.n_pixels for piece in pieces], dtype=np.float64)
        systematic = float(np.average([piece.systematic_m for piece in pieces], weights=weight))
        scale = float(np.average([piece.part.scale for piece in pieces], weights=weight))
        held = fitted.pixels.held
        sample = _sample_pixels(held)
        points = np.concatenate([observations[number].points_at(members) for number, members in sample])
        return cls(
            fit=fitted.fit,
            pixels=held,
            part=FittedPart.of(fitted.fit, points, scale, systematic, _doubt_of(pieces, weight)),
            n_regions=sum(piece.n_regions for piece in pieces),
            n_pixels=int(weight.sum()),
            systematic_m=systematic,
            sample=sample,
            relief_m=_relief_of(pieces),
        )

    def subsample(self, share: float) -> list[tuple[int, NDArray[np.int32]]]:
        """Return a share of the sample by scan, flat pixels (n,), one of each scan at least."""
        step = max(int(1 / share), 1)
        return [(scan, members[::step]) for scan, members in self.sample]


def _sample_pixels(held: Sequence[tuple[int, PixelSet]]) -> tuple[tuple[int, NDArray[np.int32]], ...]:
    """Some flat pixels (n,) by scan, evenly over all of them, without bringing these together."""
    ends = np.cumsum([len(pixel_set) for _, pixel_set in held])
    chosen = np.linspace(0, ends[-1] - 1, min(_N_SAMPLE, int(ends[-1]))).astype(np.int64)
    which = np.searchsorted(ends, chosen, side="right")
    return tuple(
        (held[k][0], held[k][1].flat[chosen[which == k] - (ends[k] - len(held[k][1]))])
        for k in np.unique(which).tolist()
    )


def _doubt_of(pieces: Sequence[SurfacePiece], weight: FloatArray) -> PoseDoubt:
    """The means (n,) of what is doubtful of the poses, by their pixels."""
    doubts = [piece.part.doubt for piece in pieces]
    scans = {doubt.scan for doubt in doubts}
    shift, turn = (
        float(np.average(doubts_of_kind, weights=weight))
        for doubts_of_kind in ([doubt.shift_m for doubt in doubts], [doubt.turn for doubt in doubts])
    )
    return PoseDoubt(scans.pop() if len(scans) == 1 else -1, shift, turn)


class PieceFit(NamedTuple):
    """All pixels of some pieces of one surface, and its fit to them."""

    pixels: ScanPixels
    fit: SurfaceFit


def fit_groups(
    groups: Sequence[Sequence[SurfacePiece]],
    observations: Sequence[Observation],
    tolerance: Tolerance,
    spill: Spill | NoSpill,
) -> list[PieceFit]:
    """Fit a surface to all pixels of each group of pieces, which are kept where `spill` keeps them.

    The fit of a piece alone stays. Where the pixels determine no surface, that of the largest piece does.
    """
    starts = [max(pieces, key=lambda piece: piece.n_pixels).fit for pieces in groups]
    shapes = np.array([seen.scan.shape for seen in observations], np.int32).reshape(-1, 2)
    pixels = [ScanPixels(_together(pieces, spill), shapes) for pieces in groups]
    several = [k for k, pieces in enumerate(groups) if len(pieces) > 1]
    surfaces = [starts[k].surface for k in several]
    chosen = [pixels[k] for k in several]
    fits = refit_each(surfaces, observations, chosen, tolerance.flatness_m, n_rounds=2)
    anew = {
        k: _with_relief(fit, groups[k], tolerance.flatness_m)
        for k, fit in zip(several, fits, strict=True)
        if fit is not None
    }
    return [PieceFit(pixel, anew.get(k, starts[k])) for k, pixel in enumerate(pixels)]


def _relief_of(pieces: Sequence[SurfacePiece]) -> float:
    """How far some pieces of one surface stray from their planes, the mean by pixels, metres."""
    weights = [piece.n_pixels for piece in pieces]
    return float(np.sqrt(np.average([piece.relief_m**2 for piece in pieces], weights=weights)))


def _with_relief(fit: SurfaceFit, pieces: Sequence[SurfacePiece], flatness_m: float) -> SurfaceFit:
    """The fit to some pieces, with their relief as a warp as long as all of them where that is uneven."""
    relief = _relief_of(pieces)
    if relief <= flatness_m:
        return fit
    return allow_for_warp(fit, np.concatenate([piece.part.points for piece in pieces]), relief)


def _together(pieces: Sequence[SurfacePiece], spill: Spill | NoSpill) -> tuple[tuple[int, PixelSet], ...]:
    """The pixels of some pieces, by scan; those of one are kept before the next are put together."""
    entries: dict[int, list[PixelSet]] = {}
    for scan, sample in (pair for piece in pieces for pair in piece.pixels):
        entries.setdefault(scan, []).append(sample)
    kept = []
    for scan, members in sorted(entries.items(), key=lambda item: item[0]):
        trim()
        kept.append(
            (scan, spill.keep(members[0] if len(members) == 1 else PixelSet.union(members, members[0].shape)))
        )
    return tuple(kept)


@shown
class UnconfirmedRegions(NamedTuple):
    """What was left out of a sequence: regions of single frames, and their pixels."""

    n_regions: int
    n_pixels: int

    @classmethod
    def of(cls, regions: Sequence[Sequence[Region]], merged: Sequence[MergedSurface]) -> UnconfirmedRegions:
        """Count the regions, and the pixels, of all scans that are of no merged surface."""
        n_regions = sum(len(region) for region in regions) - sum(surface.n_parts for surface in merged)
        n_pixels = sum(region.n_pixels for group in regions for region in group) - sum(
            surface.n_pixels for surface in merged
        )
        return cls(n_regions, n_pixels)


def drop_unconfirmed(
    groups: Sequence[list[SurfacePiece]], sights: Sequence[ScanSight], first: int
) -> list[list[SurfacePiece]]:
    """Return the groups without pieces of one frame that five others did not find again.

    Far off, noise makes planes of its own, and each frame of a sequence makes other ones. A frame speaks
    against a piece if it measured where most of its points are, from as near, and nothing stood before them,
    but no piece of it is of the same surface. Pixels of what is left out are of no surface, and stay
    measured.

    Parameters
    ----------
    groups : sequence of list of Piece
        The pieces of each surface, all of them of these frames.
    sights : sequence of Sight
        Consecutive frames of a sequence.
    first : int
        Number of the first of them.
    """
    alone = [number for number, group in enumerate(groups) if len(group) == 1]
    if not alone or len(sights) <= VOTES:
        return list(groups)
    pieces = [groups[number][0] for number in alone]
    which = np.repeat(np.arange(len(pieces)), [len(piece.part.points) for piece in pieces])
    points = np.concatenate([piece.part.points for piece in pieces])
    scale = np.array([piece.part.scale for piece in pieces])[which]
    first_scans = np.array([piece.pixels[0][0] - first for piece in pieces])
    reach = np.empty(len(points))
    for scan in np.unique(first_scans).tolist():
        of_scan = first_scans[which] == scan
        reach[of_scan] = np.linalg.norm(points[of_scan] - np.array(sights[scan].eye.origin), axis=1)

    n_points, votes = np.bincount(which), np.zeros(len(pieces), np.int64)
    for number, sight in enumerate(sights):
        sees = _sees(sight, points, scale, AS_NEAR * reach)
        share = np.bincount(which, sees, minlength=len(pieces)) / n_points
        votes += (share > MAJORITY) & (first_scans != number)
        trim()
    left_out = {number for number, n in zip(alone, votes.tolist(), strict=True) if n >= VOTES}
    return [group for number, group in enumerate(groups) if number not in left_out]


@compiled
def _sees(sight: ScanSight, points: FloatArray, scale: FloatArray, farthest: FloatArray) -> NDArray[np.int8]:
    """Tell at which points (n, 3), known to `scale` (n,), a scan measured with nothing before them.

    From no farther than `farthest` (n,), metres.
    """
    eye, sees = sight.eye, np.zeros(len(points), np.int8)
    for i in range(len(points)):
        place = points[i, 0], points[i, 1], points[i, 2]
        ray = minus(place, eye.origin)
        distance = np.sqrt(dot(ray, ray))
        if distance > farthest[i]:
            continue
        pixel = pixel_of(eye, sight.angles, place)
        if pixel < 0 or not np.isfinite(sight.ranges[pixel]):
            continue
        measured = sight.ranges[pixel]
        sigma = deviation_at(sight.noise, measured)
        allowed = eye.n_sigma * np.sqrt(sigma * sigma + scale[i] * scale[i]) + eye.registration_m
        sees[i] = measured >= distance - allowed
    return sees
