# SPDX-License-Identifier: MIT
"""Agreement: how probable it is that two fitted surfaces are one, by covariances and by their gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.evidence.form import Form, form_of
from completion.fitting.result import SurfaceFit, allow_for_warp
from completion.merging.limits import LEAST_COSINE, LEAST_FACING, STEEPEST
from completion.observe.rays import dot, minus
from scenes.checks import BoolArray, FloatArray, IntArray, read_only_view
from texture.engine.compiled import compiled, inlined

_LEAST_SCALE = 1e-150  # standard deviation that counts as none
_RANK = 1e-12  # of the greatest eigenvalue of a correlation, below which one counts as none


@compiled
def compare_planes(
    here: Form,
    there: Form,
    covariance: FloatArray,
    other: FloatArray,
    doubt: tuple[float, float],
    least_cosine: float,
) -> tuple[float, float]:
    """Return squared Mahalanobis distance and log density of the difference of two planes' parameters.

    Offset along the normal and slopes along u and v, with `covariance` (3, 3) in the chart of the first and
    `other` (3, 3) in that of the second, and `doubt` the variances of shift and turn between their scans.
    Over the chart of the first both the second's height and the charts' coordinates are linear, so three
    places say how its parameters carry over. (inf, -inf) where the cosine between the normals is less than
    `least_cosine`.
    """
    cosine = dot(here.axis, there.axis)
    if cosine < least_cosine:
        return np.inf, -np.inf
    offset = minus(here.point, there.point)
    height = np.array([
        -dot(offset, there.axis) / cosine,
        -dot(here.first, there.axis) / cosine,
        -dot(here.second, there.axis) / cosine,
    ])  # fmt: skip
    carried = np.zeros((3, 3))
    carried[0, 0] = 1.0
    for column in range(1, 3):
        side = there.first if column == 1 else there.second
        lean = dot(here.axis, side)
        carried[0, column] = dot(offset, side) + lean * height[0]
        carried[1, column] = dot(here.first, side) + lean * height[1]
        carried[2, column] = dot(here.second, side) + lean * height[2]
    total = covariance.copy()
    total[0, 0] += doubt[0]
    total[1, 1] += doubt[1]
    total[2, 2] += doubt[1]
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for m in range(3):
                    total[i, j] += carried[i, k] * other[k, m] * carried[j, m]
    return density(height, total)


@compiled
def compare_plane_pairs(
    pairs: NDArray[np.int64],
    forms: FloatArray,
    covariances: FloatArray,
    doubts: FloatArray,
    least_cosine: float,
) -> tuple[FloatArray, FloatArray]:
    """`compare_planes` of pairs (k, 2) of planes, both numbers (k,).

    `forms` (n, 12) are a plane's point, normal, u and v directions, `covariances` (n, 3, 3), `doubts` (k, 2)
    the variances of shift and turn between the scans of each pair.
    """
    square, log_density = np.empty(len(pairs)), np.empty(len(pairs))
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        here, there = _plane_of(forms[i]), _plane_of(forms[j])
        square[k], log_density[k] = compare_planes(
            here, there, covariances[i], covariances[j], (doubts[k, 0], doubts[k, 1]), least_cosine
        )
    return square, log_density


@inlined
def _plane_of(a: FloatArray) -> Form:
    """A plane by its numbers (12,)."""
    return Form(
        is_curved=False,
        point=(a[0], a[1], a[2]),
        axis=(a[3], a[4], a[5]),
        first=(a[6], a[7], a[8]),
        second=(a[9], a[10], a[11]),
        radius=1.0,
        outward=1.0,
    )


@compiled
def density(difference: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """Squared Mahalanobis distance of a difference (k,) with `covariance` (k, k), and its log density."""
    n = difference.size
    scale = np.empty(n)
    for i in range(n):
        scale[i] = max(np.sqrt(max(covariance[i, i], 0.0)), _LEAST_SCALE)
    correlation = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            correlation[i, j] = covariance[i, j] / (scale[i] * scale[j])
    values, vectors = np.linalg.eigh(correlation)
    largest, square, log_det = 0.0, 0.0, 0.0
    for k in range(n):
        largest = max(largest, abs(values[k]))
    for k in range(n):
        along = 0.0
        for i in range(n):
            along += vectors[i, k] * difference[i] / scale[i]
        if abs(values[k]) > _RANK * largest:
            square += along * along / values[k]
        log_det += np.log(abs(2 * np.pi * values[k] + _RANK)) + 2 * np.log(scale[k])
    return square, -(square + log_det) / 2


_CHI2 = {3: 16.27, 5: 20.52}  # 99.9 % quantiles: one true pair in a thousand stays apart
_TOGETHER = 4096  # pairs that are compared together
_FEW = 24  # points of a part that differences are read at


class PoseDoubt(NamedTuple):
    """How far the pose may be off of the scan that measured a part: the whole scan, as one rigid body.

    Parts of one scan therefore agree as if its pose were exact, and small parts may tilt no more than large
    ones.
    """

    scan: int = -1  # its number; -1 of parts that several scans measured
    shift_m: float = 0.0
    turn: float = 0.0  # radians

    def against(self, other: PoseDoubt) -> tuple[float, float]:
        """Variances of the shift, metres squared, and of the turn between two parts."""
        if self.scan == other.scan >= 0:
            return 0.0, 0.0
        return self.shift_m**2 + other.shift_m**2, self.turn**2 + other.turn**2


NO_DOUBT = PoseDoubt()


@dataclass(frozen=True, slots=True, eq=False)
class FittedPart:
    """A fitted surface with what tests of sameness need."""

    fit: SurfaceFit  # covariance inflated for correlated residuals
    covariance: FloatArray  # (k, k) that, and the systematic error of surface and sensor
    points: FloatArray  # (m, 3) some of its measured points, metres
    scale: float  # standard deviation of a single one of them about its surface, metres
    few: FloatArray  # (k, 3) of the points, those that differences are read at
    box: FloatArray  # (2, 3) least and greatest coordinates of these
    form: Form  # its surface, for compiled loops
    doubt: PoseDoubt  # of the scan that measured it

    @classmethod
    def of(
        cls,
        fit: SurfaceFit,
        points: FloatArray,
        scale: float,
        systematic_m: float,
        doubt: PoseDoubt = NO_DOUBT,
    ) -> FittedPart:
        """Return the part of points (m, 3), with a systematic error: a warp as long as the part.

        Such a warp is one sample of the surface, not many. It adds s^2 (mean g g')^-1 to the covariance, with
        s the systematic error and g the gradient of the surface's height by its parameters.
        """
        few = points[np.unique(np.linspace(0, len(points) - 1, _FEW).astype(np.int64))]
        return cls(
            fit=fit,
            covariance=allow_for_warp(fit, points, systematic_m).covariance,
            points=points,
            scale=scale,
            few=few,
            box=np.stack([few.min(axis=0), few.max(axis=0)]),
            form=form_of(fit.surface),
            doubt=doubt,
        )

    @property
    def slack(self) -> float:
        """Share by which a mean square over its points may exceed what is expected: three deviations."""
        return float(3 * np.sqrt(2 / len(self.points)))

    def middle(self) -> FloatArray:
        """The place (3,) on its surface nearest to the mean of its points."""
        mean = self.points.mean(axis=0, keepdims=True)
        surface = self.fit.surface
        return np.asarray(
            (mean - surface.distance(mean)[:, None] * surface.normal(mean))[0], dtype=np.float64
        )

    def spread(self) -> tuple[float, float]:
        """Bounds a and b: its surface's deviation is at most a + b d at a distance d from its own point."""
        variance = np.diag(self.covariance) + np.diag(_doubtful(len(self.covariance), *self.own_doubt()))
        if self.form.is_curved:
            return float(np.sqrt(2 * (variance[:2].sum() + variance[4]))), float(np.sqrt(variance[2:4].sum()))
        return float(np.sqrt(variance[0])), float(np.sqrt(variance[1:].sum()))

    def own_doubt(self) -> tuple[float, float]:
        """Variances of the shift, metres squared, and of the turn of the scan that measured it."""
        return self.doubt.shift_m**2, self.doubt.turn**2

    def variance_at(self, points: FloatArray, doubt: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
        """Variance (n,) of its surface along the normal at `points`, metres squared.

        Also by the pose, with these variances of shift and turn.
        """
        gradient = self.fit.gradient(points)
        covariance = self.covariance + _doubtful(len(self.covariance), *doubt)
        return np.asarray(np.einsum("ij,jk,ik->i", gradient, covariance, gradient), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How two parts compare."""

    chi2: float  # of their parameters' difference, over its 99.9 % quantile: they differ above 1
    log_evidence: float  # log of how many times likelier the difference is if they are one


def compare(first: FittedPart, second: FittedPart) -> Agreement:
    """Compare two parts of one kind.

    The difference is the height of the other surface above this one at points of both, expressed by the
    parameters of this one, and so is the other's covariance. The evidence is for that against an unrelated
    surface, which lies anywhere within the size of the points, with any tilt.
    """
    if first.form.is_curved:
        return compare_at_points(first, second)
    doubt = first.doubt.against(second.doubt)
    square, log_density = compare_planes(
        first.form, second.form, first.covariance, second.covariance, doubt, LEAST_COSINE
    )
    return _agreement(first, second, square, log_density)


def compare_all(parts: Sequence[FittedPart], pairs: IntArray) -> tuple[FloatArray, FloatArray]:
    """How pairs (k, 2) of parts `compare`: `Agreement.chi2` (k,) and `Agreement.log_evidence` (k,)."""
    chi2, log_evidence = np.zeros(len(pairs)), np.zeros(len(pairs))
    curved = np.array([part.form.is_curved for part in parts], dtype=np.bool_)
    flat = np.flatnonzero(~curved[pairs].any(axis=1))
    for k in np.flatnonzero(curved[pairs].any(axis=1)).tolist():
        agreement = compare(parts[pairs[k, 0]], parts[pairs[k, 1]])
        chi2[k], log_evidence[k] = agreement.chi2, agreement.log_evidence
    if len(flat):
        table = _Planes.of(parts)
        for start in range(0, len(flat), _TOGETHER):
            sample = flat[start : start + _TOGETHER]
            chi2[sample], log_evidence[sample] = table.compare_pairs(pairs[sample])
    return chi2, log_evidence


@dataclass(frozen=True, slots=True, eq=False)
class _Planes:
    """The numbers of n parts, of which those of planes are compared."""

    forms: FloatArray  # (n, 12) point, normal, u and v directions
    covariances: FloatArray  # (n, 3, 3)
    boxes: FloatArray  # (n, 2, 3)
    scans: IntArray  # (n,) that measured each, -1 for several
    doubts: FloatArray  # (n, 2) variances of shift and turn of its pose

    @classmethod
    def of(cls, parts: Sequence[FittedPart]) -> _Planes:
        """Return the numbers of parts; those of curved ones are 0."""
        forms, covariances = np.zeros((len(parts), 12)), np.zeros((len(parts), 3, 3))
        for number, part in enumerate(parts):
            if not part.form.is_curved:
                forms[number] = *part.form.point, *part.form.axis, *part.form.first, *part.form.second
                covariances[number] = part.covariance
        doubts = [part.doubt for part in parts]
        return cls(
            forms=forms,
            covariances=read_only_view(covariances),
            boxes=np.array([part.box for part in parts]),
            scans=np.array([doubt.scan for doubt in doubts], dtype=np.int64),
            doubts=np.array([(doubt.shift_m**2, doubt.turn**2) for doubt in doubts]),
        )

    def compare_pairs(self, pairs: IntArray) -> tuple[FloatArray, FloatArray]:
        """`compare` of pairs (k, 2) of planes."""
        first, second = pairs.T
        is_of_one_scan = (self.scans[first] == self.scans[second]) & (self.scans[first] >= 0)
        doubts = np.where(is_of_one_scan[:, None], 0.0, self.doubts[first] + self.doubts[second])
        square, log_density = compare_plane_pairs(
            pairs.astype(np.int64), self.forms, self.covariances, doubts, LEAST_COSINE
        )
        low = np.minimum(self.boxes[first, 0], self.boxes[second, 0])
        high = np.maximum(self.boxes[first, 1], self.boxes[second, 1])
        return square / _CHI2[3], log_density + _log_prior_volume(1, np.linalg.norm(high - low, axis=1))


def compare_at_points(first: FittedPart, second: FittedPart) -> Agreement:
    """Compare two parts of one kind by the least squares that `compare` solves for planes in closed form."""
    here, there = first.fit.surface, second.fit.surface
    points = np.concatenate([first.few, second.few])
    feet = points - there.distance(points)[:, None] * there.normal(points)
    facing = np.einsum("ij,ij->i", here.normal(feet), there.normal(feet))
    if float(np.median(facing)) < LEAST_COSINE:
        return _agreement(first, second, np.inf, -np.inf)
    basis = np.linalg.pinv(first.fit.gradient(feet))
    difference = basis @ here.distance(feet)
    carried = basis @ second.fit.gradient(feet)
    covariance = first.covariance + carried @ second.covariance @ carried.T
    covariance = covariance + _doubtful(len(covariance), *first.doubt.against(second.doubt))
    return _agreement(first, second, *density(difference, covariance))


def _agreement(first: FittedPart, second: FittedPart, square: float, log_density: float) -> Agreement:
    """The agreement from squared Mahalanobis distance and log density of a difference."""
    size = np.maximum(first.box[1], second.box[1]) - np.minimum(first.box[0], second.box[0])
    volume = _log_prior_volume(3 if first.form.is_curved else 1, np.sqrt(size @ size))
    return Agreement(square / _CHI2[len(first.covariance)], log_density + float(volume))


def lies_on(small: FittedPart, large: FittedPart) -> bool:
    """Tell whether a part lies within noise of a surface and faces alike; its own fit may say little."""
    surface = large.fit.surface
    allowed = np.square(small.scale) + large.variance_at(small.points, small.doubt.against(large.doubt))
    square = float(np.mean(np.square(surface.distance(small.points)) / allowed))
    facing = np.einsum("ij,ij->i", surface.normal(small.points), small.fit.surface.normal(small.points))
    return square <= 1 + small.slack and float(np.median(facing)) > LEAST_FACING


def log_evidence_of_height(small: FittedPart, large: FittedPart) -> float:
    """Log of how many times likelier a small part's height over a surface is if it is a part of it.

    Against an unrelated one, which lies anywhere within the size of both. A surface that is not known there,
    far from where it was measured, is evidence of nothing.
    """
    middle = small.points.mean(axis=0, keepdims=True)
    doubt = small.doubt.against(large.doubt)
    variance = small.scale**2 + float(large.variance_at(middle, doubt)[0])
    height = float(large.fit.surface.distance(middle)[0])
    size = np.linalg.norm(np.maximum(small.box[1], large.box[1]) - np.minimum(small.box[0], large.box[0]))
    return float(np.log(2 * size) - (np.log(2 * np.pi * variance) + height**2 / variance) / 2)


def _doubtful(n: int, shift: float, turn: float) -> FloatArray:
    """Covariance (n, n) of a surface's parameters by a pose: of planes and cylinders, tilts are the turn."""
    return np.diag([shift, turn, turn] if n == 3 else [shift, shift, turn, turn, 0.0])


def _log_prior_volume(lengths: int, size: FloatArray) -> FloatArray:
    """Logarithm of the volume of parameters that an unrelated surface near points of this size may have.

    So many of them are lengths, two are slopes.
    """
    return np.asarray(lengths * np.log(2 * size) + 2 * np.log(2 * STEEPEST))


_LEAST_AREA = 1e-9  # of a part's outline, square metres


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Odds that two of n parts are one surface, by what else is near and by the gap between them."""

    parts: Sequence[FittedPart]
    boxes: FloatArray  # (n, 2, 3) least and greatest coordinates of each, metres
    is_curved: BoolArray  # (n,)
    n_scans: int  # that they are of

    @classmethod
    def of(cls, parts: Sequence[FittedPart], n_scans: int) -> Prior:
        """Return the prior of the parts of so many scans."""
        boxes = np.array([part.box for part in parts]).reshape(-1, 2, 3)
        return cls(parts, boxes, np.array([part.form.is_curved for part in parts], dtype=np.bool_), n_scans)

    def log_odds(self, first: int, second: int) -> float:
        """Logarithm of the odds that two parts, by their indices, are one surface.

        A part has about one in its scan that goes on with it. With k others of its kind that are nearer than
        the second is, the odds for the second are 1 to k + 1: what is joined across a crowd agrees by chance
        more often. The nearer side's count holds.

        What is joined is claimed to go on over the gap as well. The size of things has no scale of its own,
        and with the prior 1 / A^2 of areas a surface of at least A0 has at least A with probability A0 / A
        (Gott 1993): A0 is what the outlines of both parts hold, A what the outline around both holds.
        """
        nearer = min(self._n_nearer(first, second), self._n_nearer(second, first))
        return -float(np.log1p(nearer / self.n_scans)) - _log_growth(self.parts[first], self.parts[second])

    def _n_nearer(self, first: int, second: int) -> int:
        """How many parts of its kind may be nearer to the first than the second is."""
        low, high = self.boxes[:, 0], self.boxes[:, 1]
        apart = np.maximum(np.maximum(low - high[first], low[first] - high), 0.0)
        square = np.einsum("ij,ij->i", apart, apart)
        rivals = (square < square[second]) & (self.is_curved == self.is_curved[first])
        return int(np.count_nonzero(rivals)) - int(rivals[first])


def _log_growth(part: FittedPart, other: FittedPart) -> float:
    """Logarithm of how many times the outline around both holds what their own outlines hold."""
    surface = other.fit.surface
    first, second = surface.to_uv(part.points), surface.to_uv(other.points)
    if np.isfinite(surface.period):
        first[:, 0] += np.rint((second[:, 0].mean() - first[:, 0]) / surface.period) * surface.period
    seen = max(_hull_area(first) + _hull_area(second), _LEAST_AREA)
    return float(np.log(max(_hull_area(np.concatenate([first, second])) / seen, 1.0)))


def _hull_area(uv: FloatArray) -> float:
    """Area of the convex hull of points (n, 2), square metres."""
    return float(cv2.contourArea(cv2.convexHull(uv.astype(np.float32))))
