# SPDX-License-Identifier: MIT
"""Material: points, meshes and scans as what templates are fitted to, with their noise and spacing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from completion.features.engine.template import Beams, Measured
from completion.observe.range_noise import estimate_noise
from scenes.checks import FloatArray, InputError, IntArray, check_points
from scenes.scan.range_image import RangeImage

_AROUND = 12  # neighbours that a point's plane is fitted to
_SAMPLE = 4000  # points that tell noise and spacing
_FEWEST = 20
_PARAMETERS_OF_A_PLANE = 3


def of_points(points: FloatArray, *, faces: IntArray | None = None, noise: float | None = None) -> Measured:
    """Return points, or a mesh's vertices with its faces, as material.

    Parameters
    ----------
    points : (n, 3) float
        In any unit.
    faces : (m, 3) int, optional
        Triangles.
    noise : float, optional
        Standard deviation across the surface; when None it is read off how far points lie from planes through
        their neighbours, in the flattest half.

    Raises
    ------
    InputError
        Fewer than 20 points, not finite, or all at one place.
    """
    held = check_points("points", points)
    if len(held) < _FEWEST:
        raise InputError(f"features need {_FEWEST} points at least, got {len(held)}")
    _check_extent(held)
    spacing, rough = _spacing_and_noise(held)
    return Measured(held, rough if noise is None else float(noise), spacing, faces=faces)


def of_scans(scans: Sequence[RangeImage], *, sigma_m: float | None = None) -> Measured:
    """Return all scans in the world as material: their points in turn, and every beam.

    Raises InputError: scans in which nothing came back.
    """
    origins, directions, ranges, points, noise = [], [], [], [], []
    for scan in scans:
        n = scan.ranges.size
        origins.append(np.broadcast_to(scan.origin, (n, 3)))
        directions.append(scan.rays().reshape(n, 3))
        ranges.append(scan.ranges.ravel())
        points.append(scan.points().reshape(n, 3))
        known = scan.sigma_m if sigma_m is None else sigma_m
        away = np.median(scan.ranges[scan.valid]) if scan.valid.any() else 0.0
        noise.append(float(estimate_noise(scan).sigma(np.array([away]))[0]) if known is None else known)
    beams = Beams(np.concatenate(origins), np.concatenate(directions), np.concatenate(ranges))
    back = np.flatnonzero(np.isfinite(beams.ranges))
    if len(back) < _FEWEST:
        raise InputError(f"features need {_FEWEST} points at least, got {len(back)}")
    held = np.concatenate(points)[back]
    _check_extent(held)
    spacing, _ = _spacing_and_noise(held)
    return Measured(held, float(np.median(noise)), spacing, beams=beams, beam_of_point=back)


def _check_extent(points: FloatArray) -> None:
    if not np.ptp(points, axis=0).any():
        raise InputError(f"all {len(points)} points lie at one place: there is nothing to find")


def _spacing_and_noise(points: FloatArray) -> tuple[float, float]:
    """Median distance to the nearest neighbour, and deviation from planes through neighbours."""
    tree, step = cKDTree(points), max(1, len(points) // _SAMPLE)
    some = points[::step]
    away, near = tree.query(some, k=min(_AROUND + 1, len(points)))
    group = points[near] - points[near].mean(axis=1, keepdims=True)
    least = np.linalg.svd(group, compute_uv=False)[:, -1]
    rough = least / np.sqrt(max(near.shape[1] - _PARAMETERS_OF_A_PLANE, 1))
    return float(np.median(away[:, 1])), float(np.quantile(rough, 0.25))
