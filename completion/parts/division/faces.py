# SPDX-License-Identifier: MIT
"""Faces: connected pieces of surfaces, their fits, and which of them are on one surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from completion.fitting.euclidean import fit_euclidean, fit_plane
from completion.fitting.result import FitError, SurfaceFit, inflated
from completion.parts.division.adjusting import N_PARAMETERS
from completion.parts.division.growing import refine_surface
from completion.parts.division.labelling import pieces_of
from completion.parts.division.limits import CUT, NEARLY_ALL
from completion.parts.division.neighbourhoods import Neighbourhoods
from scenes.checks import FloatArray, InputError, IntArray
from scenes.surfaces.catalogue import Plane, Surface

_N_NEAR = 4  # points among whose labels one that was left out finds its own
_CHUNK = 65_536
_N_BESIDE = 9  # points, itself among them, whose faces a point may have
_MOST_ROUNDS = 40  # by each of which labels move on by a neighbour
_MOST_COMPARED = 500


def numbered_faces(
    about: Neighbourhoods, surfaces: Sequence[Surface], labels: IntArray
) -> tuple[list[Surface], IntArray]:
    """Return the surface of each face, and labels (n,) of faces, the largest first, from labels of surfaces.

    A piece with too few points to determine its surface is none.
    """
    n, piece = pieces_of(about, labels)
    count = np.bincount(piece, minlength=n)
    first = np.full(n, -1, dtype=np.int64)
    first[piece[::-1]] = np.arange(len(piece))[::-1]
    label = labels[first]
    least = np.array([0, *(N_PARAMETERS[surface.kind] + 2 for surface in surfaces)])
    kept = [
        piece_number
        for piece_number in np.lexsort((first, -count))
        if label[piece_number] > 0 and count[piece_number] >= least[label[piece_number]]
    ]
    number = np.zeros(n, dtype=np.int64)
    number[kept] = np.arange(1, len(kept) + 1)
    return [surfaces[label[piece_number] - 1] for piece_number in kept], number[piece]


def spread(
    points: FloatArray, sample: FloatArray, faces: Sequence[Surface], labels: IntArray, tolerance: float
) -> IntArray:
    """Labels (n,) of all points (n, 3): of the faces near, that which explains a point best.

    Which are near, labels (m,) of `sample` (m, 3) tell; `tolerance` is the deviation from faces, metres.
    """
    tree, labels_near = cKDTree(sample), np.zeros(len(points), dtype=np.int64)
    for start in range(0, len(points), _CHUNK):
        chunk = points[start : start + _CHUNK]
        near = np.atleast_2d(tree.query(chunk, k=min(_N_NEAR, len(sample)))[1].T).T
        candidates = labels[near]
        least, best = np.full(len(chunk), CUT * tolerance), np.zeros(len(chunk), dtype=np.int64)
        for number in np.unique(candidates[candidates > 0]):
            asked = np.flatnonzero((candidates == number).any(axis=1))
            distance = np.abs(faces[number - 1].distance(chunk[asked]))
            is_member = distance < least[asked] - 1e-3 * tolerance
            is_member |= (candidates[asked, 0] == number) & (distance <= CUT * tolerance)
            better = is_member & (best[asked] != candidates[asked, 0])
            least[asked[better]], best[asked[better]] = distance[better], number
        labels_near[start : start + len(chunk)] = best
    return labels_near


def settle(points: FloatArray, faces: Sequence[Surface], labels: IntArray) -> IntArray:
    """Labels (n,) of points (n, 3), each with the nearest of the faces that it and its neighbours have.

    Among sparse points the nearest may lie beyond a crease, and ripple is so large a tolerance that points
    beside the crease pass for its surface: they would be relief there.
    """
    near = cKDTree(points).query(points, k=min(_N_BESIDE, len(points)))[1]
    labels = labels.copy()
    for _ in range(_MOST_ROUNDS):
        mixed = np.flatnonzero((labels[near] != labels[:, None]).any(axis=1) & (labels > 0))
        beside, members = labels[near[mixed]], labels[mixed]
        least, best = np.full(len(mixed), np.inf), members.copy()
        for number in np.unique(beside[beside > 0]):
            asked = np.flatnonzero((beside == number).any(axis=1))
            distance = np.abs(faces[number - 1].distance(points[mixed[asked]]))
            nearer = distance < least[asked]
            least[asked[nearer]], best[asked[nearer]] = distance[nearer], number
        if (best == members).all():
            break
        labels[mixed] = best
    return labels


def fit_labels(
    points: FloatArray, faces: Sequence[Surface], labels: IntArray, least_m: float
) -> tuple[tuple[SurfaceFit, ...], IntArray]:
    """Fits to the points (n, 3) of each label, from the face's surface on, and the labels (n,) of these.

    A face whose points determine no surface is none. The covariance is at least that of residuals of
    `least_m`, metres.
    """
    order = np.argsort(labels, kind="stable")
    bounds = np.searchsorted(labels[order], np.arange(1, len(faces) + 2))
    fits, number = list[SurfaceFit](), np.zeros(len(faces) + 1, dtype=np.int64)
    for face, surface in enumerate(faces):
        members = points[order[bounds[face] : bounds[face + 1]]]
        fit = fitted_face(members, surface, least_m)
        if fit is not None:
            fits.append(fit)
            number[face + 1] = len(fits)
    return tuple(fits), number[labels]


def fitted_face(points: FloatArray, surface: Surface, least_m: float) -> SurfaceFit | None:
    """The fit to points (n, 3) from a surface on, as for `fit_labels`; None where they determine none."""
    try:
        fit = (
            fit_plane(points) if isinstance(surface, Plane) else fit_euclidean(points, surface.kind, surface)
        )
    except (FitError, InputError):
        return _known_face(points, surface, least_m)
    if not np.isfinite(fit.covariance).all():
        return _known_face(points, surface, least_m)
    fit = inflated(fit, points)
    grown = (least_m / fit.rms) ** 2 if 0 < fit.rms < least_m else 1.0
    return replace(fit, covariance=fit.covariance * grown)


def _known_face(points: FloatArray, surface: Surface, least_m: float) -> SurfaceFit | None:
    """A surface that is known already: of so few points, or so little bent, that residuals tell nothing."""
    refined = refine_surface(surface, points, least_m) if least_m > 0 else None
    if refined is None:
        return None
    rms = float(np.sqrt(np.mean(refined[0].distance(points) ** 2)))
    return SurfaceFit(refined[0], rms, refined[1], len(points))


def groups_of(
    points: FloatArray, fits: Sequence[SurfaceFit], labels: IntArray, tolerance: float
) -> tuple[int, ...]:
    """Numbers of surfaces, one a face: equal where the larger face's surface explains the smaller one.

    The faces are those of points (n, 3) by their labels (n,).

    It has to be known there, to two tolerances: of two planes far apart it is not said.
    """
    group = list(range(len(fits)))
    sizes = [fit.n for fit in fits]
    for small in range(len(fits)):
        members = np.flatnonzero(labels == small + 1)
        sample = points[members[:: max(1, len(members) // _MOST_COMPARED)]]
        for large in range(small):
            if group[large] != large or fits[large].surface.kind != fits[small].surface.kind:
                continue
            if sizes[large] < sizes[small]:
                continue
            deviation = fits[large].standard_deviation(sample)
            near = np.abs(fits[large].surface.distance(sample)) <= CUT * np.hypot(tolerance, deviation)
            if near.mean() >= NEARLY_ALL and np.median(deviation) <= 2 * tolerance:
                group[small] = large
                break
    return tuple(group)
