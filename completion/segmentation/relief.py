# SPDX-License-Identifier: MIT
"""Relief: pieces that an uneven plane broke into are joined, by how uneven the pieces around are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.fitting.result import allow_for_warp
from completion.observe.observation import Observation, PixelSet, ScanPixels
from completion.observe.refitting import refit_each
from completion.observe.tolerance import FLATNESS_M
from completion.segmentation import limits
from completion.segmentation.regions import Groups, Region, SegmentationOptions
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane, Surface

_SAMPLE = 1000  # points of a piece that are looked at


@dataclass(frozen=True, slots=True, eq=False)
class PlateSample:
    """Some points of a plane piece, or of several together."""

    plane: Plane
    n_pixels: int
    points: FloatArray  # (n, 3)
    noise: FloatArray  # (n,) standard deviation along the normal, metres
    bias: float  # what the sensor bends flat walls by at its range, metres

    @property
    def size(self) -> float:
        """Root mean square distance of its points from their middle, metres."""
        return float(np.sqrt(self.points.var(axis=0).sum()))

    def relief(self, plane: Surface) -> float:
        """How far it strays from a plane, rms beyond noise and what the sensor bends walls by, metres."""
        square = np.mean(np.square(plane.distance(self.points)) - np.square(self.noise)) - self.bias**2
        return float(np.sqrt(max(square, 0.0)))


def plate_of(plane: Plane, pixels: PixelSet, observation: Observation) -> PlateSample:
    """Return a piece by its plane and its pixels."""
    flat = pixels.flat[np.linspace(0, len(pixels) - 1, min(_SAMPLE, len(pixels))).astype(np.int64)]
    ranges = observation.scan.ranges.ravel()[flat]
    cosine = np.abs(observation.rays_at(flat) @ plane.normal_direction)
    noise = observation.noise.sigma(ranges) * cosine
    bias = float(observation.noise.bias(np.array([np.median(ranges)]))[0])
    return PlateSample(plane, len(pixels), observation.points_at(flat), noise, bias)


def together(plates: Sequence[PlateSample]) -> PlateSample:
    """Return several plates as one, each by as many points as its pixels are worth, on their common plane."""
    most = max(plate.n_pixels / len(plate.points) for plate in plates)
    steps = [max(1, round(most * len(plate.points) / plate.n_pixels)) for plate in plates]
    points = np.concatenate([plate.points[::step] for plate, step in zip(plates, steps, strict=True)])
    noise = np.concatenate([plate.noise[::step] for plate, step in zip(plates, steps, strict=True)])
    centre = points.mean(axis=0)
    normal = np.linalg.eigh((points - centre).T @ (points - centre))[1][:, 0]
    facing = float(normal @ max(plates, key=lambda plate: plate.n_pixels).plane.normal_direction)
    weights = [plate.n_pixels for plate in plates]
    return PlateSample(
        plane=Plane(centre, normal if facing >= 0 else -normal),
        n_pixels=sum(weights),
        points=points,
        noise=noise,
        bias=float(np.average([plate.bias for plate in plates], weights=weights)),
    )


def find_seams(pixels: Sequence[PixelSet], observation: Observation) -> dict[tuple[int, int], FloatArray]:
    """Return the measured points (n, 3) at which each two pieces, by their indices, touch or nearly so."""
    rows, columns = observation.scan.shape
    labels = np.zeros((rows, columns), np.int32)
    for k, pixel in enumerate(pixels, start=1):
        labels.ravel()[pixel.flat] = k
    away, nearest = cv2.distanceTransformWithLabels(
        (labels == 0).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    label_of = np.zeros(int(nearest.max()) + 1, np.int32)
    label_of[nearest[labels > 0]] = labels[labels > 0]
    grown = np.where(away <= (limits.CONTACT_PIXELS + 1) / 2, label_of[nearest], 0)
    flat = np.arange(rows * columns).reshape(rows, columns)
    below, right = (slice(1, None), slice(None)), (slice(None), slice(1, None))
    keys, places = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for here, there in (((slice(-1), slice(None)), below), ((slice(None), slice(-1)), right)):
        first, second = grown[here], grown[there]
        at = (first != second) & (first > 0) & (second > 0)
        region_a, other = first[at].astype(np.int64), second[at].astype(np.int64)
        keys.append((np.minimum(region_a, other) - 1) * len(pixels) + np.maximum(region_a, other) - 1)
        places.append(flat[here][at])
    return _by_pair(np.concatenate(keys), np.concatenate(places), len(pixels), observation)


def _by_pair(
    key: NDArray[np.int64], place: NDArray[np.int64], n: int, observation: Observation
) -> dict[tuple[int, int], FloatArray]:
    """The points of the pixels `place` (n,) whose keys, first * n + second, are those of one pair."""
    order = np.lexsort([place, key])
    key, place = key[order], place[order]
    numbers, starts = np.unique(key, return_index=True)
    if not len(numbers):
        return {}
    seams = {}
    for number, sample in zip(numbers.tolist(), np.split(place, starts[1:]), strict=True):
        if len(sample) >= limits.FEWEST_CONTACTS:
            sample = sample[observation.valid.ravel()[sample]]
            seams[divmod(number, n)] = observation.points_at(sample)
    return seams


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
        flags = {pair: is_met for pair, is_met in meets.items() if sheet.issuperset(pair)}
        _join(groups, plates, flags, relief if options.flatness_m is None else 0.0, least)
    return [
        _join_regions(
            [regions[k] for k in numbers], [plates[k] for k in numbers if k in plates], observation, least
        )
        for numbers in groups.all()
    ]


def _join_regions(
    regions: Sequence[Region], plates: Sequence[PlateSample], observation: Observation, flatness_m: float
) -> Region:
    """Some regions as one; a plane's relief told."""
    if not plates:
        return regions[0]
    if len(regions) == 1:
        return replace(regions[0], relief_m=plates[0].relief(plates[0].plane))
    pixels = PixelSet.union([region.pixels for region in regions], observation.scan.shape)
    whole = together(plates)
    (fit,) = refit_each([whole.plane], [observation], [ScanPixels.of([pixels])], flatness_m, n_rounds=2)
    if fit is None:
        return max(regions, key=lambda region: region.n_pixels)
    relief = whole.relief(fit.surface)
    return Region(allow_for_warp(fit, whole.points, relief), pixels, relief)


def _meets(first: PlateSample, second: PlateSample, seam: FloatArray, flatness_m: float) -> bool:
    """Tell whether the planes of two pieces are one and the same at the points (n, 3) between them."""
    if first.plane.normal_direction @ second.plane.normal_direction < limits.SAME_COSINE or not len(seam):
        return False
    relief = max(first.relief(first.plane), second.relief(second.plane), flatness_m)
    noise = max(float(np.sqrt(np.mean(np.square(plate.noise)))) for plate in (first, second))
    apart = np.mean(np.square(first.plane.distance(seam) - second.plane.distance(seam)))
    return bool(np.sqrt(apart) <= max(limits.MEET_SD * relief, limits.BLURRED_SD * noise))


def _sheets(
    n: int, plates: Mapping[int, PlateSample], pairs: Sequence[Pair]
) -> list[tuple[frozenset[int], float]]:
    """The pieces of each sheet of several that meet in pairs, and its relief over the root of the size."""
    groups = Groups(n)
    for i, j in pairs:
        if not groups.are_one(i, j):
            groups.join(i, j)
    sheets = []
    for several in groups.all():
        sheet = frozenset(several)
        strays = [_strays([plates[i], plates[j]]) for i, j in pairs if i in sheet]
        if strays:
            values = [stray / np.sqrt(size) for stray, size in strays]
            sheets.append((sheet, float(np.median(values)) if len(values) >= limits.FEWEST_PAIRS else 0.0))
    return sheets


def _strays(plates: Sequence[PlateSample]) -> tuple[float, float]:
    """How far the worst of some pieces strays from the plane of all, and their size, metres."""
    whole = together(plates)
    return max(plate.relief(whole.plane) for plate in plates), whole.size


def _join(
    groups: Groups,
    plates: Mapping[int, PlateSample],
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
                first, second = sorted((tuple(groups.of(i)), tuple(groups.of(j))))
                touching[first, second] = touching.get((first, second), True) and is_met
        for (first, second), is_met in touching.items():
            if is_met and (first, second) not in rated:
                stray, size = _strays([plates[k] for k in (*first, *second)])
                larger = max(
                    (together([plates[k] for k in numbers]) for numbers in (first, second)), key=_size
                )
                per_root = max(relief, larger.relief(larger.plane) / np.sqrt(larger.size))
                rated[first, second] = stray / (limits.STRAY * max(per_root * np.sqrt(size), flatness_m))
        best = min(((rated[pair], pair) for pair, is_met in touching.items() if is_met), default=None)
        if best is None or best[0] > 1:
            return
        groups.join(best[1][0][0], best[1][1][0])


def _size(plate: PlateSample) -> float:
    return plate.size


def typical_relief(regions: Sequence[Sequence[Region]]) -> float:
    """Return how far the planes of some scans stray from their ideal form, metres: the median by pixels.

    At least what any surface may (`FLATNESS_M`).
    """
    planes = [region for group in regions for region in group if isinstance(region.fit.surface, Plane)]
    if not planes:
        return FLATNESS_M
    relief = np.array([plane.relief_m for plane in planes])
    order = np.argsort(relief, kind="stable")
    share = np.cumsum(np.array([plane.n_pixels for plane in planes])[order])
    return max(float(relief[order][np.searchsorted(share, share[-1] / 2)]), FLATNESS_M)
