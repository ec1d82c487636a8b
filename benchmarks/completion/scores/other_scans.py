# SPDX-License-Identifier: MIT
"""Other scans as reference: what was inferred from some, scored by what registered ones saw there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.completion.scores.buffers import BufferScore, score_buffers
from benchmarks.completion.truth.samples import Samples
from scenes.checks import BoolArray, FloatArray
from scenes.scan.range_image import RangeImage

_VOXEL_M = 0.02  # reference points are thinned to one in each
_MAX_TOLERANCE_M = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class HiddenScore:
    """Inferred area against what other scans saw.

    Attributes
    ----------
    state : (n,) int8
        For each sample: 1 right (a reference point is near), -1 wrong (a beam of another scan goes
        through), 0 unknown, 2 not counted (not hidden from the input scan, or beside what it measured).
    right_m2, wrong_m2, unknown_m2 : float
        Counted area.
    n_reference, n_found : int
        Reference points, one in each voxel of 2 cm, that the input scan did not see and that are in its
        view; and those of them with inferred area near.
    buffers : tuple of BufferScore
        The same area and points matched within other distances.
    """

    state: NDArray[np.int8]
    right_m2: float
    wrong_m2: float
    unknown_m2: float
    n_reference: int
    n_found: int
    buffers: tuple[BufferScore, ...]

    @property
    def precision(self) -> float:
        """Right over right and wrong area; NaN where neither is known."""
        known = self.right_m2 + self.wrong_m2
        return self.right_m2 / known if known > 0 else float("nan")

    @property
    def recall(self) -> float:
        """Share of the reference points that were found; NaN where there are none."""
        return self.n_found / self.n_reference if self.n_reference else float("nan")

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

    Parameters
    ----------
    scans : sequence of RangeImage
        Those that were completed together.
    others : sequence of RangeImage
        Registered scans of the same place.
    samples : Samples
        Inferred area, world coordinates.
    tolerance_m, apart_m : float
        Metres.
    """
    own = cKDTree(np.concatenate([scan.points()[scan.valid] for scan in scans]))
    counted = _hidden_and_apart(scans, own, samples.points, tolerance_m, apart_m)
    reference = _thinned(np.concatenate([other.points()[other.valid] for other in others]))
    reference = reference[_hidden_and_apart(scans, own, reference, tolerance_m, apart_m)]
    right = counted & _near(samples.points, reference, tolerance_m)
    crossed = np.zeros(len(right), dtype=np.bool_)
    for other in others:
        crossed |= _beyond(other, samples.points, samples.normals, tolerance_m)
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
        n_reference=len(reference),
        n_found=int(found.sum()),
        buffers=buffers,
    )


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


def _thinned(points: FloatArray) -> FloatArray:
    """One point in each voxel, the first."""
    _, first = np.unique(np.floor(points / _VOXEL_M).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]
