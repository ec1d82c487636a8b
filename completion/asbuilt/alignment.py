# SPDX-License-Identifier: MIT
"""Alignment and deviations in one estimate: a mixed model of faces, poses and sensor.

A beam that ended on face f, seen from station s, says of the distance y of its end from the face

    y = g x_f + J(p; s) xi_s + J(p; 0) gamma + M(p) beta + noise,    J(p; o) = [(p - o) x n, n]

with the deviation x_f of the face (g: `FaceBeams.columns`), the pose error xi_s ~ N(0, registration), the
misfit gamma of all scans, nearly free, and the sensor's own errors beta of unit variance. Faces are where the
design has them but for a Student distribution of three degrees of freedom, whose scale tau is estimated by
expectation and maximisation (Lange, Little & Taylor 1989): one face pulls on the alignment with at most
1 / tau^2, however many beams it has, and one that moved with almost nothing.

Faces are eliminated one by one, so that what is solved has as many unknowns as poses have. What pairs of a
face and a scan are off by beyond their noise, as where things stand before walls, widens all variances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt import limits
from completion.asbuilt.agreement import N_SHARED, FaceBeams, median
from completion.asbuilt.faces import N_COLUMNS
from scenes.checks import ArrayValue, FloatArray
from scenes.run.mapping import trim

_MEDIAN_SQUARE = 0.455  # of a standard normal number
_FEWEST_LEFT = 30  # pairs more than unknowns, that tell by how much they differ
_SETTLED = 0.01  # of tau, and of the weights of faces, between two rounds
_UNUSED = 1e-12  # information of a parameter that no beam tells


@dataclass(frozen=True, slots=True, eq=False)
class Aligned(ArrayValue):
    """Deviations of faces, and motions of scans, with their errors.

    Attributes
    ----------
    faces : (q,) int
        Faces with beams, ascending.
    x : (q, 5) float
        Their deviations, metres, as the alignment has them.
    own_x, own_covariance : (q, 5), (q, 5, 5) float
        The same without the assumption that the tested face is near its place.
    tau_m : float
        Scale of their distribution.
    motion : (s + 1, 6) float
        Rotation vector and shift of the points of each scan, in the end of all scans together; to be
        subtracted.
    covariance : (6 (s + 1) + 12,) * 2 float
        Of all of these and the sensor's errors.
    inverse : (q, 5, 5) float
        Inverse information of each face, as if the poses were known, with the prior.
    coupling : (q, 5, k) float
        Information between a face and the poses.
    prior : (q,) float
        Precision of the prior of each parameter of a face.
    """

    faces: NDArray[np.int64]
    x: FloatArray
    own_x: FloatArray
    own_covariance: FloatArray
    tau_m: float
    motion: FloatArray
    covariance: FloatArray
    inverse: FloatArray
    coupling: FloatArray
    prior: FloatArray

    def among(self, a: int, b: int) -> FloatArray:
        """Covariance (5, 5) of the parameters of two faces, by their places in `faces`."""
        left, right = self.inverse[a] @ self.coupling[a], self.inverse[b] @ self.coupling[b]
        total = left @ self.covariance @ right.T
        return np.asarray(total + self.inverse[a] if a == b else total)


@dataclass(frozen=True, slots=True, eq=False)
class PoseErrors:
    """Standard deviations of poses: of each scan (m, rad), and of all together, 0 where they are fixed."""

    scan: tuple[float, float]
    common: tuple[float, float]


def align(
    beams: FaceBeams,
    is_on: NDArray[np.bool_],
    origins: FloatArray,
    *,
    speaks: NDArray[np.bool_],
    moved: FloatArray,
    errors: PoseErrors,
    bias: FloatArray,
    scale: float,
) -> Aligned:
    """Estimate deviations of faces and motions of s scans jointly.

    Parameters
    ----------
    beams : FaceBeams
        Beams (n,) of faces.
    is_on : (n,) bool
        Those that lie on the surface of their face.
    origins : (s, 3) float
        Where the scans stood, metres; the design's middle is the origin.
    speaks : (F,) bool
        Which faces say something of the alignment; others may lie anywhere.
    moved : (s + 1, 6) float
        Motions that were taken off the scans already, and off all of them.
    errors : PoseErrors
        How well poses are known.
    bias : (s,) float
        What pairs of a face and a scan are off by alike, as a share of the noise of single beams.
    scale : float
        Of lengths, 1 for a building.
    """
    trim()
    system = _assemble(beams, is_on, origins, speaks, bias=bias, scale=scale)
    trim()
    size = system.poses.shape[0]
    prior = _pose_precision(len(origins), errors)
    prior_right = np.zeros(size)
    prior_right[: moved.size] = -prior[: moved.size] * moved.ravel()
    solved, tau, precision = _estimate(system, prior, prior_right, scale)
    excess = _excess(system, solved)
    if excess > 1.0:
        system = system.widened(excess)
        solved, tau, precision = _estimate(system, prior, prior_right, scale)
    information = np.linalg.inv(solved.blocks)
    own = information - np.eye(N_COLUMNS) * precision[:, None, None]
    own = _positive(own)
    own_covariance: FloatArray = np.linalg.inv(own).astype(np.float64)
    own_x = np.einsum("qij,qjk,qk->qi", own_covariance, information, solved.x)
    motion = solved.poses[: size - N_SHARED].reshape(-1, 6)
    return Aligned(
        faces=system.faces,
        x=solved.x,
        own_x=np.where(system.used, own_x, 0.0),
        own_covariance=own_covariance,
        tau_m=tau,
        motion=motion,
        covariance=solved.covariance,
        inverse=solved.inverse,
        coupling=system.coupling,
        prior=precision,
    )


def _estimate(
    system: _System, prior: FloatArray, prior_right: FloatArray, scale: float
) -> tuple[_Solved, float, FloatArray]:
    """Solve, with tau and the weight of each face by expectation and maximisation."""
    tau, weight = 2e-3 * scale, np.ones(len(system.faces))
    least, most = limits.LEAST_TAU_M * scale, limits.MOST_TAU_M * scale
    near, anywhere = system.speaks, 1.0 / (limits.FAR_M * scale) ** 2
    used = system.used.sum(axis=1)
    for _ in range(limits.ROUNDS):
        precision = np.where(near, weight / tau**2, anywhere)
        solved = _solve(system, prior, prior_right, precision)
        spread = np.einsum("qii->qi", solved.blocks)
        square = np.where(system.used, np.square(solved.x) + spread, 0.0).sum(axis=1)
        before = tau, weight
        weight = (limits.FREEDOM + used) / (limits.FREEDOM + square / tau**2)
        if near.any():
            tau = float(np.clip(np.sqrt((weight * square)[near].sum() / used[near].sum()), least, most))
        change = np.abs(weight - before[1]).max(initial=0.0)
        if abs(tau - before[0]) < _SETTLED * tau and change < _SETTLED:
            break
    precision = np.where(near, weight / tau**2, anywhere)
    return _solve(system, prior, prior_right, precision), tau, precision


def _excess(system: _System, solved: _Solved) -> float:
    """How much larger the squares of what pairs are off by are than their variances, robustly; 1 at least."""
    pairs = system.pairs
    left_over = len(pairs.y) - len(np.unique(pairs.face)) - 3 * len(np.unique(pairs.scan))
    if left_over < _FEWEST_LEFT:
        return 1.0
    own = solved.poses[: -6 - N_SHARED].reshape(-1, 6)[pairs.scan]
    left = pairs.y - np.einsum("pi,pi->p", pairs.columns, solved.x[pairs.face])
    left -= np.einsum("pi,pi->p", pairs.about_scan, own) + pairs.rest @ solved.poses[-6 - N_SHARED :]
    square = float(np.median(np.square(left) * pairs.weight)) / _MEDIAN_SQUARE
    return max(square * len(pairs.y) / left_over, 1.0)


class _Pairs(NamedTuple):
    """Means over the beams of each pair (p,) of a face that speaks and a scan, and its weight."""

    face: NDArray[np.int64]
    scan: NDArray[np.int64]
    y: FloatArray
    columns: FloatArray
    about_scan: FloatArray
    rest: FloatArray
    weight: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _System:
    """Normal equations: blocks of faces (q, 5, 5), of poses and sensor (k, k), between, and right sides."""

    faces: NDArray[np.int64]
    blocks: FloatArray
    coupling: FloatArray
    poses: FloatArray
    right_faces: FloatArray
    right_poses: FloatArray
    used: NDArray[np.bool_]  # (q, 5) parameters that there are
    speaks: NDArray[np.bool_]  # (q,) which say something of the poses
    pairs: _Pairs

    def widened(self, factor: float) -> _System:
        """The same with all variances so many times as large."""
        names = ("blocks", "coupling", "poses", "right_faces", "right_poses")
        return replace(self, **{name: getattr(self, name) / factor for name in names})


def _assemble(
    beams: FaceBeams,
    is_on: NDArray[np.bool_],
    origins: FloatArray,
    speaks: NDArray[np.bool_],
    *,
    bias: FloatArray,
    scale: float,
) -> _System:
    faces = np.unique(beams.face[is_on]).astype(np.int64)
    speaks = speaks[faces]
    n_scans, size = len(origins), 6 * (len(origins) + 1) + N_SHARED
    blocks, coupling = np.zeros((len(faces), N_COLUMNS, N_COLUMNS)), np.zeros((len(faces), N_COLUMNS, size))
    right_faces, right_poses = np.zeros((len(faces), N_COLUMNS)), np.zeros(size)
    poses = np.zeros((size, size))
    used = np.zeros((len(faces), N_COLUMNS), np.bool_)
    index = np.flatnonzero(is_on)
    pair = beams.face[index].astype(np.int64) * n_scans + beams.scan[index]
    starts = np.flatnonzero(np.diff(pair, prepend=-1))
    common, pairs = slice(6 * n_scans, size), list[tuple[Any, ...]]()
    about_own = np.cross(beams.points - origins[beams.scan], beams.normal)
    about_middle = np.cross(beams.points, beams.normal)
    for rows in np.split(index, starts[1:]) if len(index) else ():
        n = len(rows)
        rows = rows[:: max(1, -(-n // limits.PAIR_BEAMS))]
        place, scan = int(np.searchsorted(faces, beams.face[rows[0]])), int(beams.scan[rows[0]])
        y, g = beams.distance[rows], beams.columns[rows]
        sigma = beams.sigma[rows]
        spread = 1.4826 * median(np.abs(y - median(y))) if n > 10 else 0.0
        flat = median(sigma)
        weight = n / len(rows) / np.square(np.maximum(sigma, min(spread, 3 * flat)))
        form = np.hypot(limits.FORM_M * scale, bias[scan] * flat)
        weight = weight / (1.0 + weight.sum() * form**2)
        normal = beams.normal[rows]
        about_scan = np.concatenate([about_own[rows], normal], axis=1)
        rest = np.concatenate([about_middle[rows], normal, beams.shared[rows]], axis=1)
        weighted = g * weight[:, None]
        own = slice(6 * scan, 6 * scan + 6)
        blocks[place] += weighted.T @ g
        used[place] |= np.abs(g).max(axis=0) > 1e-9
        coupling[place][:, own] += weighted.T @ about_scan
        coupling[place][:, common] += weighted.T @ rest
        right_faces[place] += weighted.T @ y
        left = about_scan * weight[:, None]
        if not speaks[place]:
            continue
        total = weight.sum()
        pairs.append((
            place, scan, weight @ y / total, weight @ g / total, weight @ about_scan / total,
            weight @ rest / total, total,
        ))  # fmt: skip
        poses[own, own] += left.T @ about_scan
        cross = left.T @ rest
        poses[own, common] += cross
        poses[common, own] += cross.T
        poses[common, common] += (rest * weight[:, None]).T @ rest
        right_poses[own] += left.T @ y
        right_poses[common] += rest.T @ (weight * y)
    return _System(
        faces=faces, blocks=blocks, coupling=coupling, poses=poses, right_faces=right_faces,
        right_poses=right_poses, used=used, speaks=speaks, pairs=_joined(pairs, size - 6 * n_scans),
    )  # fmt: skip


def _joined(pairs: Sequence[tuple[Any, ...]], n_rest: int) -> _Pairs:
    """Pairs as arrays."""
    face, scan, y, columns, about_scan, rest, weight = zip(*pairs, strict=True) if pairs else ((),) * 7
    return _Pairs(
        face=np.array(face, np.int64),
        scan=np.array(scan, np.int64),
        y=np.array(y, float),
        columns=np.array(columns).reshape(-1, N_COLUMNS),
        about_scan=np.array(about_scan).reshape(-1, 6),
        rest=np.array(rest).reshape(-1, n_rest),
        weight=np.array(weight, float),
    )


def _pose_precision(n_scans: int, errors: PoseErrors) -> FloatArray:
    """Precision of the unknowns of poses and sensor (k,)."""

    def of(pair: tuple[float, float]) -> list[float]:
        shift, turn = (1.0 / max(sd, 1e-9) ** 2 for sd in pair)
        return [turn] * 3 + [shift] * 3

    return np.array(of(errors.scan) * n_scans + of(errors.common) + [1.0] * N_SHARED)


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    x: FloatArray
    poses: FloatArray
    covariance: FloatArray
    inverse: FloatArray
    blocks: FloatArray  # (q, 5, 5) posterior covariance of each face


def _solve(system: _System, prior: FloatArray, prior_right: FloatArray, precision: FloatArray) -> _Solved:
    """Solve by the Schur complement of the faces."""
    blocks = system.blocks + np.eye(N_COLUMNS) * precision[:, None, None]
    inverse: FloatArray = np.linalg.inv(blocks).astype(np.float64)
    reduced = np.einsum("qij,qjk->qik", inverse, system.coupling)
    near, size = system.speaks, len(prior)
    held, rest = system.coupling[near].reshape(-1, size), reduced[near].reshape(-1, size)
    left = system.poses + np.diag(prior) - held.T @ rest
    right = system.right_poses + prior_right - rest.T @ system.right_faces[near].ravel()
    covariance: FloatArray = np.linalg.inv((left + left.T) / 2).astype(np.float64)
    poses = covariance @ right
    del held, rest  # as large as the coupling
    x = np.einsum("qij,qj->qi", inverse, system.right_faces) - reduced @ poses
    shared = np.einsum("qik,kl,qjl->qij", reduced, covariance, reduced, optimize=True)
    return _Solved(x, poses, covariance, inverse, np.asarray(inverse + shared))


def _positive(information: FloatArray) -> FloatArray:
    """The information (q, 5, 5) with what is not known as nearly nothing, so that it can be inverted."""
    values, vectors = np.linalg.eigh((information + np.swapaxes(information, 1, 2)) / 2)
    top = np.maximum(values[:, -1:], _UNUSED)
    kept = np.maximum(values, top * 1e-9)
    fixed = np.einsum("qij,qj,qkj->qik", vectors, kept, vectors)
    return np.asarray(fixed)
