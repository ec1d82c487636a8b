# SPDX-License-Identifier: MIT
"""Relief: pieces that an uneven plane broke into are joined, by how uneven the pieces around are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from completion.fitting.result import warped
from completion.observe.observation import Observation
from completion.observe.pixel_set import PixelSet, ScanPixels
from completion.observe.refits.refitting import refit_each
from completion.observe.tolerance import FLATNESS_M
from completion.segmentation.groups import Groups
from completion.segmentation.plate import Plate, plate_of, together
from completion.segmentation.regions import Region, SegmentationOptions
from completion.segmentation.seams import find_seams
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane

_MEET = 3.0 * np.sqrt(2.0)  # times their relief, by which two planes differ at a seam at most: both within 3
_BLURRED = 2.0  # times the noise, within which single ranges hardly tell two planes apart
_TILT = np.cos(np.radians(5.0))  # of pieces that tell how uneven a plane is
_LEAST_PAIRS = 3  # of them; fewer may be a ramp
_STRAY = 2.0  # times what is expected, by which any piece may stray from the common plane

Pair = tuple[int, int]


def join_relief(
    regions: Sequence[Region], observation: Observation, options: SegmentationOptions
) -> list[Region]:
    """Join the regions of a scan that are one uneven plane, and say of each plane how uneven it is.

    A plane that bends by more than the noise breaks into pieces, whose own planes meet where the pieces touch
    and tilt by a few degrees at most. Such pieces hang together in sheets. How far two of them stray from
    their common plane, beyond the noise and what the sensor itself bends, is the sheet's relief: the median
    of its pairs. It grows with the root of the size of what is looked at, as tolerances of buildings do (DIN
    18202: 4 mm over 1 m, 12 mm over 10 m). Pieces of a sheet join, those first that fit best, while none
    strays from the plane of all by more than twice the relief that is expected of their size, by the sheet's
    or by that of the larger one alone. One or two pairs tell nothing of a sheet: a ramp that meets a flat
    floor stays apart. Where the flatness is stated, it takes the place of the sheet's.

    What joined is fitted anew. Its covariance holds its relief as one warp as long as itself.
    """
    plates = {
        k: plate_of(region.fit.surface, region.pixels, observation)
        for k, region in enumerate(regions)
        if isinstance(region.fit.surface, Plane)
    }
    least, numbers = options.least_flatness_m, list(plates)
    seams = find_seams([regions[k].pixels for k in plates], observation)
    meets = {
        (numbers[i], numbers[j]): _meets(plates[numbers[i]], plates[numbers[j]], at, least)
        for (i, j), at in seams.items()
    }
    groups = Groups(len(regions))
    for sheet, relief in _sheets(len(regions), plates, [pair for pair, is_met in meets.items() if is_met]):
        own = {pair: is_met for pair, is_met in meets.items() if sheet.issuperset(pair)}
        _join(groups, plates, own, relief if options.flatness_m is None else 0.0, least)
    return [
        _joined([regions[k] for k in own], [plates[k] for k in own if k in plates], observation, least)
        for own in groups.all()
    ]


def _joined(
    regions: Sequence[Region], plates: Sequence[Plate], observation: Observation, flatness_m: float
) -> Region:
    """Some regions as one; a plane's relief told."""
    if not plates:
        return regions[0]
    if len(regions) == 1:
        return replace(regions[0], relief_m=plates[0].relief(plates[0].plane))
    pixels = PixelSet.union([one.pixels for one in regions], observation.scan.shape)
    whole = together(plates)
    (fit,) = refit_each([whole.plane], [observation], [ScanPixels.of([pixels])], flatness_m, n_rounds=2)
    if fit is None:
        return max(regions, key=lambda one: one.n_pixels)
    relief = whole.relief(fit.surface)
    return Region(warped(fit, whole.points, relief), pixels, relief)


def _meets(one: Plate, other: Plate, seam: FloatArray, flatness_m: float) -> bool:
    """Tell whether the planes of two pieces are one and the same at the points (n, 3) between them."""
    if one.plane.normal_direction @ other.plane.normal_direction < _TILT or not len(seam):
        return False
    relief = max(one.relief(one.plane), other.relief(other.plane), flatness_m)
    noise = max(float(np.sqrt(np.mean(np.square(plate.noise)))) for plate in (one, other))
    apart = np.mean(np.square(one.plane.distance(seam) - other.plane.distance(seam)))
    return bool(np.sqrt(apart) <= max(_MEET * relief, _BLURRED * noise))


def _sheets(n: int, plates: Mapping[int, Plate], pairs: Sequence[Pair]) -> list[tuple[frozenset[int], float]]:
    """The pieces of each sheet of several that meet in pairs, and its relief over the root of the size."""
    groups = Groups(n)
    for i, j in pairs:
        if not groups.are_one(i, j):
            groups.join(i, j)
    found = []
    for several in groups.all():
        sheet = frozenset(several)
        strays = [_strays([plates[i], plates[j]]) for i, j in pairs if i in sheet]
        if strays:
            values = [stray / np.sqrt(size) for stray, size in strays]
            found.append((sheet, float(np.median(values)) if len(values) >= _LEAST_PAIRS else 0.0))
    return found


def _strays(plates: Sequence[Plate]) -> tuple[float, float]:
    """How far the worst of some pieces strays from the plane of all, and their size, metres."""
    whole = together(plates)
    return max(one.relief(whole.plane) for one in plates), whole.size


def _join(
    groups: Groups,
    plates: Mapping[int, Plate],
    meets: Mapping[Pair, bool],
    relief: float,
    flatness_m: float,
) -> None:
    """Join the groups of a sheet that have one plane, those first that fit best, until no two have."""
    rated = dict[tuple[tuple[int, ...], tuple[int, ...]], float]()
    while True:
        touching = dict[tuple[tuple[int, ...], tuple[int, ...]], bool]()
        for (i, j), is_met in meets.items():
            if not groups.are_one(i, j):
                one, other = sorted((tuple(groups.of(i)), tuple(groups.of(j))))
                touching[one, other] = touching.get((one, other), True) and is_met
        for (one, other), is_met in touching.items():
            if is_met and (one, other) not in rated:
                stray, size = _strays([plates[k] for k in (*one, *other)])
                larger = max((together([plates[k] for k in own]) for own in (one, other)), key=_size)
                per_root = max(relief, larger.relief(larger.plane) / np.sqrt(larger.size))
                rated[one, other] = stray / (_STRAY * max(per_root * np.sqrt(size), flatness_m))
        best = min(((rated[pair], pair) for pair, is_met in touching.items() if is_met), default=None)
        if best is None or best[0] > 1:
            return
        groups.join(best[1][0][0], best[1][1][0])


def _size(plate: Plate) -> float:
    return plate.size


def typical_relief(regions: Sequence[Sequence[Region]]) -> float:
    """Return how far the planes of some scans stray from their ideal form, metres: the median by pixels.

    At least what any surface may (`FLATNESS_M`).
    """
    planes = [one for own in regions for one in own if isinstance(one.fit.surface, Plane)]
    if not planes:
        return FLATNESS_M
    relief = np.array([one.relief_m for one in planes])
    order = np.argsort(relief, kind="stable")
    share = np.cumsum(np.array([one.n_pixels for one in planes])[order])
    return max(float(relief[order][np.searchsorted(share, share[-1] / 2)]), FLATNESS_M)
