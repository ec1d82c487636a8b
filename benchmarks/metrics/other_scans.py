# SPDX-License-Identifier: MIT
"""Other scans as reference: area, points and colour that registered scans confirm or refute."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skimage.color import rgb2lab

from benchmarks.metrics.inferred import Samples
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.rays.raycast import RayCaster
from scenes.scan.colour import unit_colour
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

BUFFERS_M = (0.01, 0.02, 0.05, 0.1, 0.2)


TOLERANCE_M = 0.03
_AROUND_M, _MOSTLY = 0.1, 0.7  # of planar points
_SAME_WAY = np.cos(np.radians(30.0))  # normals of what is taken for the same surface


@dataclass(frozen=True, slots=True)
class BufferScore:
    """How inferred area and reference points agree within a buffer (after Khoshelham et al. 2018)."""

    buffer_m: float  # distance in metres within which they match
    completeness: float  # share of the reference points with inferred area in the buffer; NaN without points
    # share of the inferred area with a reference point in the buffer, of all of which anything is known; NaN
    # where nothing is
    correctness: float
    # median distance across the inferred surface of the reference points in the buffer, metres; NaN without
    # any
    accuracy_m: float


def score_buffers(
    samples: Samples,
    counted: BoolArray,
    refuted: BoolArray,
    reference: FloatArray,
    buffers_m: Sequence[float] = BUFFERS_M,
) -> tuple[BufferScore, ...]:
    """Match inferred area with reference points within each buffer.

    `samples`: inferred area. `counted`, `refuted` (n,) bool: samples that count, and those that a beam of
    another scan goes through. `reference` (m, 3) float: measured points that should have been inferred,
    metres. `buffers_m`: distances in metres.
    """
    to_reference = _nearest(samples.points, reference)[0]
    to_sample, which = _nearest(reference, samples.points)
    found = np.isfinite(to_sample)
    across = np.full(len(reference), np.inf)
    offset = reference[found] - samples.points[which[found]]
    across[found] = np.abs(np.einsum("ij,ij->i", offset, samples.normals[which[found]]))
    scores = []
    for buffer in buffers_m:
        near, matched = counted & (to_reference <= buffer), to_sample <= buffer
        known = float(samples.areas[near | (counted & refuted)].sum())
        scores.append(
            BufferScore(
                float(buffer),
                float(matched.mean()) if len(reference) else float("nan"),
                float(samples.areas[near].sum()) / known if known > 0 else float("nan"),
                float(np.median(across[matched])) if matched.any() else float("nan"),
            )
        )
    return tuple(scores)


def _nearest(points: FloatArray, others: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Distance (n,) from each point to the nearest of the others, inf without any, and its number."""
    if not len(points) or not len(others):
        return np.full(len(points), np.inf), np.zeros(len(points), np.int64)
    distance, number = cKDTree(others).query(points)
    return np.asarray(distance, dtype=np.float64), np.asarray(number, dtype=np.int64)


_VOXEL_M = 0.02  # reference points are thinned to one in each
_MAX_TOLERANCE_M = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class HiddenScore:
    """Inferred area against what other scans saw.

    `right_m2`, `wrong_m2`, `unknown_m2`: counted area. `reference` (n, 3): reference points, one in each
    voxel of 2 cm, that the input scan did not see and that are in its view; `seen_from` (n, 3): from where;
    `is_found` (n,): whether inferred area is near.
    """

    # (n,) int8: For each sample: 1 right (a reference point is near), -1 wrong (a beam of another scan goes
    # through), 0 unknown, 2 not counted (not hidden from the input scan, or beside what it measured)
    state: NDArray[np.int8]
    right_m2: float
    wrong_m2: float
    unknown_m2: float
    reference: FloatArray
    seen_from: FloatArray
    is_found: BoolArray
    buffers: tuple[BufferScore, ...]  # the same area and points matched within other distances

    @property
    def precision(self) -> float:
        """Right over right and wrong area; NaN where neither is known."""
        known = self.right_m2 + self.wrong_m2
        return self.right_m2 / known if known > 0 else float("nan")

    @property
    def recall(self) -> float:
        """Share of the reference points that were found; NaN where there are none."""
        return float(self.is_found.mean()) if len(self.reference) else float("nan")

    def reachable(self, planes: Sequence[Plane], tolerance_m: float) -> BoolArray:
        """Which reference points (n,) lie on planes that were measured elsewhere, and were seen from before.

        A point counts if most of those within 10 cm of it lie within the tolerance of the plane, too.
        """
        is_reachable = np.zeros(len(self.reference), dtype=np.bool_)
        tree = cKDTree(self.reference) if len(self.reference) else None
        for plane in planes:
            is_on = np.abs(plane.distance(self.reference)) <= tolerance_m
            at = np.flatnonzero(is_on & (plane.distance(self.seen_from) > 0) & ~is_reachable)
            if tree is not None and len(at):
                around = tree.query_ball_point(self.reference[at], _AROUND_M)
                is_reachable[at] = [is_on[near].mean() >= _MOSTLY for near in around]
        return is_reachable

    @property
    def unknown_share(self) -> float:
        """Share of the counted area of which the other scans know nothing; NaN without area."""
        area = self.right_m2 + self.wrong_m2 + self.unknown_m2
        return self.unknown_m2 / area if area > 0 else float("nan")


def score_by_others(
    scans: Sequence[RangeImage],
    others: Sequence[RangeImage],
    samples: Samples,
    *,
    tolerance_m: float = 0.03,
    apart_m: float = 0.1,
) -> HiddenScore:
    """Score what was inferred from `scans` by what other registered ones saw.

    Only area counts that stands behind something in one of `scans` and farther than `apart_m` from all that
    they measured, and so do reference points: slivers beside seen surface would decide everything else.
    Area is right within `tolerance_m` of a reference point; else wrong where a beam of another scan goes
    through it by more than that; else nothing is known of it.
    `scans`: those that were completed together. `others`: registered scans of the same place. `samples`:
    inferred area, world coordinates. `tolerance_m`, `apart_m`: metres.
    """
    own = cKDTree(np.concatenate([scan.points()[scan.valid] for scan in scans]))
    counted = _hidden_and_apart(scans, own, samples.points, tolerance_m, apart_m)
    points = np.concatenate([other.points()[other.valid] for other in others])
    kept = _thinned(points)
    kept = kept[_hidden_and_apart(scans, own, points[kept], tolerance_m, apart_m)]
    reference = points[kept]
    of = np.repeat(np.arange(len(others)), [np.count_nonzero(other.valid) for other in others])[kept]
    right = counted & _near(samples.points, reference, tolerance_m)
    crossed = _crossed(samples.points, samples.normals, others, tolerance_m)
    wrong = counted & crossed & ~right
    state = np.select([right, wrong, counted], [1, -1, 0], 2).astype(np.int8)
    found = _near(reference, samples.points, tolerance_m)
    right_m2, wrong_m2, unknown_m2 = (float(samples.areas[state == code].sum()) for code in (1, -1, 0))
    buffers = score_buffers(samples, counted, crossed, reference)
    return HiddenScore(
        state=state,
        right_m2=right_m2,
        wrong_m2=wrong_m2,
        unknown_m2=unknown_m2,
        reference=reference,
        seen_from=np.array([other.origin for other in others])[of],
        is_found=found,
        buffers=buffers,
    )


def seen_by_others(
    points: FloatArray, normals: FloatArray, others: Sequence[RangeImage], tolerance_m: float
) -> NDArray[np.int8]:
    """Tell what scans say of places (n, 3) with normals: 1 surface, -1 a beam goes through, 0 nothing.

    `tolerance_m`: metres.
    """
    reference = np.concatenate([other.points()[other.valid] for other in others])
    reference = reference[_thinned(reference)]
    right = _near(points, reference, tolerance_m)
    return np.where(right, 1, np.where(_crossed(points, normals, others, tolerance_m), -1, 0)).astype(np.int8)


def _crossed(
    points: FloatArray, normals: FloatArray, others: Sequence[RangeImage], tolerance_m: float
) -> BoolArray:
    """Points (n, 3) that a beam of some scan goes through."""
    crossed = np.zeros(len(points), dtype=np.bool_)
    for other in others:
        crossed |= _beyond(other, points, normals, tolerance_m)
    return crossed


def _hidden_and_apart(
    scans: Sequence[RangeImage], own: cKDTree, points: FloatArray, tolerance_m: float, apart_m: float
) -> BoolArray:
    """Points that something stands before in one of the scans, far from all that they measured."""
    hidden = np.zeros(len(points), dtype=np.bool_)
    for scan in scans:
        distance, measured = _ranges_at(scan, points)
        hidden |= measured < distance - tolerance_m
    near = np.zeros(len(points), dtype=np.bool_)
    near[hidden] = np.isfinite(own.query(points[hidden], distance_upper_bound=apart_m)[0])
    return np.asarray(hidden & ~near, dtype=np.bool_)


def _beyond(scan: RangeImage, points: FloatArray, normals: FloatArray, tolerance_m: float) -> BoolArray:
    """Points that a beam of the scan goes through, by more than the tolerance across the surface."""
    distance, measured = _ranges_at(scan, points)
    ray = points - scan.origin
    cosine = np.abs(np.einsum("ij,ij->i", ray, normals)) / np.maximum(distance, 1e-12)
    along = np.minimum(tolerance_m / np.maximum(cosine, 1e-3), _MAX_TOLERANCE_M)
    return np.asarray(np.isfinite(measured) & (measured > distance + along), dtype=np.bool_)


def _ranges_at(scan: RangeImage, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance of points from the sensor, and the range measured in their pixel; inf for none."""
    pixels = scan.pixels(points)
    inside = np.isfinite(pixels).all(axis=1)
    row, column = np.rint(pixels[inside]).astype(np.int64).T
    measured = np.full(len(points), np.inf)
    measured[inside] = scan.ranges[row, column]
    return np.linalg.norm(points - scan.origin, axis=1), measured


def _near(points: FloatArray, reference: FloatArray, reach_m: float) -> BoolArray:
    if not len(points) or not len(reference):
        return np.zeros(len(points), dtype=np.bool_)
    distance, _ = cKDTree(reference).query(points, distance_upper_bound=reach_m)
    return np.asarray(np.isfinite(distance), dtype=np.bool_)


def _thinned(points: FloatArray) -> IntArray:
    """One of the points in each voxel, the first, by number."""
    _, first = np.unique(np.floor(points / _VOXEL_M).astype(np.int64), axis=0, return_index=True)
    return np.sort(first)


PATCH_M = 0.05  # colours are compared as means over so much: a texture is continued, not reproduced


@dataclass(frozen=True, slots=True, eq=False)
class ColourScore:
    """Colour differences in patches of 5 cm."""

    # (n,) float: CIELAB distance (CIE 1976) between the means of claimed and seen colour in each patch
    difference: FloatArray
    n_points: int  # places that another scan saw at all

    @property
    def median(self) -> float:
        """Median difference; NaN without patches."""
        return float(np.median(self.difference)) if len(self.difference) else float("nan")


def score_colour(
    points: FloatArray,
    colours: NDArray[np.uint8],
    others: Sequence[RangeImage],
    *,
    tolerance_m: float = 0.03,
) -> ColourScore:
    """Compare the colour claimed at places with that of other scans that measured them.

    A scan measured a place if the range in its pixel is the place's distance, within the tolerance. Patches
    are cubes of 5 cm. A difference of about 2 can just be seen; scans of one place differ by exposure.
    `points` (n, 3) float: world coordinates. `colours` (n, 3) uint8: sRGB. `others`: registered scans, those
    without colour are left out. `tolerance_m`: metres.
    """
    seen, count = np.zeros((len(points), 3)), np.zeros(len(points))
    for other in others:
        if other.colour is None:
            continue
        here, pixel = _measured(other, points, tolerance_m)
        seen[here] += unit_colour(other.colour[pixel[:, 0], pixel[:, 1]])
        count[here] += 1
    known = count > 0
    if not known.any():
        return ColourScore(np.zeros(0), 0)
    reference = seen[known] / count[known, None]
    cubes = np.floor(points[known] / PATCH_M).astype(np.int64)
    _, patch = np.unique(cubes, axis=0, return_inverse=True)
    claimed = _means(colours[known] / 255.0, patch)
    difference = np.linalg.norm(_lab(claimed) - _lab(_means(reference, patch)), axis=1)
    return ColourScore(difference, int(np.count_nonzero(known)))


def _measured(
    scan: RangeImage, points: FloatArray, tolerance_m: float
) -> tuple[BoolArray, NDArray[np.int64]]:
    """Which points a scan measured, and the pixels (row, column) of these."""
    position = scan.pixels(points)
    here = np.asarray(np.isfinite(position).all(axis=1), dtype=np.bool_)
    pixel = np.rint(position[here]).astype(np.int64)
    distance = np.linalg.norm(points[here] - scan.origin, axis=1)
    near = np.abs(scan.ranges[pixel[:, 0], pixel[:, 1]] - distance) <= tolerance_m
    here[here] = near
    return here, pixel[near]


def _means(values: FloatArray, group: NDArray[np.int64]) -> FloatArray:
    """Mean values (k, 3) of each group."""
    count = np.bincount(group)
    sums = np.column_stack([np.bincount(group, values[:, channel]) for channel in range(3)])
    return np.asarray(sums / count[:, None], dtype=np.float64)


def _lab(colour: FloatArray) -> FloatArray:
    """CIELAB (n, 3) of sRGB colours 0..1."""
    return np.asarray(rgb2lab(colour), dtype=np.float64)


def is_there(points: FloatArray, normals: FloatArray, caster: RayCaster) -> BoolArray:
    """Tell which places (n, 3) have surface of nearly their direction within 3 cm along their normal."""
    return _meets(points, normals, caster) | _meets(points, -normals, caster)


def _meets(points: FloatArray, normals: FloatArray, caster: RayCaster) -> BoolArray:
    hits = caster.first_hit(points - TOLERANCE_M * normals, normals)
    near = hits.ranges <= 2 * TOLERANCE_M
    return np.asarray(near & (hits.incidence_cosine >= _SAME_WAY), dtype=np.bool_)
