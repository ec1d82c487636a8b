# SPDX-License-Identifier: MIT
"""Agreement: whether two fitted surfaces may be one, by their covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from completion.evidence.form import Form, form_of
from completion.fitting.result import SurfaceFit, warped
from completion.merging.plane_pairs import compare_plane_pairs, compare_planes, density
from scenes.checks import FloatArray, IntArray

_CHI2 = {3: 16.27, 5: 20.52}  # 99.9 % quantiles: one true pair in a thousand stays apart
_STEEPEST = 1.0  # radians of tilt that an unrelated surface may have as well
LEAST_COSINE = 0.5  # of the normals of two parts of one surface
LEAST_FACING = 0.8  # of those of a part and of the surface that it lies on
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
class Part:
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
    ) -> Part:
        """Return the part of points (m, 3), with a systematic error: a warp as long as the part.

        Such a warp is one sample of the surface, not many. It adds s^2 (mean g g')^-1 to the covariance, with
        s the systematic error and g the gradient of the surface's height by its parameters.
        """
        few = points[np.unique(np.linspace(0, len(points) - 1, _FEW).astype(np.int64))]
        return cls(
            fit=fit,
            covariance=warped(fit, points, systematic_m).covariance,
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


def compare(one: Part, other: Part) -> Agreement:
    """Compare two parts of one kind.

    The difference is the height of the other surface above this one at points of both, expressed by the
    parameters of this one, and so is the other's covariance. The evidence is for that against an unrelated
    surface, which lies anywhere within the size of the points, with any tilt.
    """
    if one.form.is_curved:
        return compare_at_points(one, other)
    doubt = one.doubt.against(other.doubt)
    square, log_density = compare_planes(
        one.form, other.form, one.covariance, other.covariance, doubt, LEAST_COSINE
    )
    return _agreement(one, other, square, log_density)


def compare_all(parts: Sequence[Part], pairs: IntArray) -> tuple[FloatArray, FloatArray]:
    """How pairs (k, 2) of parts `compare`: `Agreement.chi2` (k,) and `Agreement.log_evidence` (k,)."""
    chi2, log_evidence = np.zeros(len(pairs)), np.zeros(len(pairs))
    curved = np.array([one.form.is_curved for one in parts], dtype=np.bool_)
    flat = np.flatnonzero(~curved[pairs].any(axis=1))
    for k in np.flatnonzero(curved[pairs].any(axis=1)).tolist():
        found = compare(parts[pairs[k, 0]], parts[pairs[k, 1]])
        chi2[k], log_evidence[k] = found.chi2, found.log_evidence
    if len(flat):
        table = _Planes.of(parts)
        for start in range(0, len(flat), _TOGETHER):
            some = flat[start : start + _TOGETHER]
            chi2[some], log_evidence[some] = table.compared(pairs[some])
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
    def of(cls, parts: Sequence[Part]) -> _Planes:
        """Return the numbers of parts; those of curved ones are 0."""
        forms, covariances = np.zeros((len(parts), 12)), np.zeros((len(parts), 3, 3))
        for number, one in enumerate(parts):
            if not one.form.is_curved:
                forms[number] = *one.form.point, *one.form.axis, *one.form.first, *one.form.second
                covariances[number] = one.covariance
        doubts = [one.doubt for one in parts]
        return cls(
            forms=forms,
            covariances=covariances,
            boxes=np.array([one.box for one in parts]),
            scans=np.array([one.scan for one in doubts], dtype=np.int64),
            doubts=np.array([(one.shift_m**2, one.turn**2) for one in doubts]),
        )

    def compared(self, pairs: IntArray) -> tuple[FloatArray, FloatArray]:
        """`compare` of pairs (k, 2) of planes."""
        one, other = pairs.T
        is_of_one_scan = (self.scans[one] == self.scans[other]) & (self.scans[one] >= 0)
        doubts = np.where(is_of_one_scan[:, None], 0.0, self.doubts[one] + self.doubts[other])
        square, log_density = compare_plane_pairs(
            pairs.astype(np.int64), self.forms, self.covariances, doubts, LEAST_COSINE
        )
        low = np.minimum(self.boxes[one, 0], self.boxes[other, 0])
        high = np.maximum(self.boxes[one, 1], self.boxes[other, 1])
        return square / _CHI2[3], log_density + _log_prior_volume(1, np.linalg.norm(high - low, axis=1))


def compare_at_points(one: Part, other: Part) -> Agreement:
    """Compare two parts of one kind by the least squares that `compare` solves for planes in closed form."""
    here, there = one.fit.surface, other.fit.surface
    points = np.concatenate([one.few, other.few])
    feet = points - there.distance(points)[:, None] * there.normal(points)
    facing = np.einsum("ij,ij->i", here.normal(feet), there.normal(feet))
    if float(np.median(facing)) < LEAST_COSINE:
        return _agreement(one, other, np.inf, -np.inf)
    basis = np.linalg.pinv(one.fit.gradient(feet))
    difference = basis @ here.distance(feet)
    carried = basis @ other.fit.gradient(feet)
    covariance = one.covariance + carried @ other.covariance @ carried.T
    covariance = covariance + _doubtful(len(covariance), *one.doubt.against(other.doubt))
    return _agreement(one, other, *density(difference, covariance))


def _agreement(one: Part, other: Part, square: float, log_density: float) -> Agreement:
    """The agreement from squared Mahalanobis distance and log density of a difference."""
    size = np.maximum(one.box[1], other.box[1]) - np.minimum(one.box[0], other.box[0])
    volume = _log_prior_volume(3 if one.form.is_curved else 1, np.sqrt(size @ size))
    return Agreement(square / _CHI2[len(one.covariance)], log_density + float(volume))


def lies_on(small: Part, large: Part) -> bool:
    """Tell whether a part lies within noise of a surface and faces alike; its own fit may say little."""
    surface = large.fit.surface
    allowed = np.square(small.scale) + large.variance_at(small.points, small.doubt.against(large.doubt))
    square = float(np.mean(np.square(surface.distance(small.points)) / allowed))
    facing = np.einsum("ij,ij->i", surface.normal(small.points), small.fit.surface.normal(small.points))
    return square <= 1 + small.slack and float(np.median(facing)) > LEAST_FACING


def log_evidence_of_height(small: Part, large: Part) -> float:
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
    return np.asarray(lengths * np.log(2 * size) + 2 * np.log(2 * _STEEPEST))
