# SPDX-License-Identifier: MIT
"""Region growing: from a seed to all connected pixels that one plane or cylinder explains."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from completion.fitting.consensus import consensus_cylinder
from completion.fitting.euclidean import fit_cylinder, fit_plane
from completion.fitting.result import FitError, SurfaceFit
from completion.observation import Observation
from scenes.checks import BoolArray, FloatArray, check_options
from scenes.surfaces import Cylinder

_N_GROWTHS = 15
_FIT_SAMPLE = 20_000

Box = tuple[slice, slice]


@dataclass(frozen=True, kw_only=True, slots=True)
class SegmentationOptions:
    """How a range image is cut into regions.

    Attributes
    ----------
    n_sigma : float
        A pixel belongs to a surface within this many standard deviations.
    flatness_m : float
        How far a real wall may stray from its plane, beside the noise, metres.
    max_angle_deg : float
        Largest angle between a pixel's normal and the surface's.
    min_pixels : int
        Smaller regions are left unsegmented.
    min_arc_deg : float
        A cylinder seen over less of an arc is kept as the plane it looks like.
    max_regions : int
        Stop after so many regions.
    """

    n_sigma: float = 3.0
    flatness_m: float = 0.001
    max_angle_deg: float = 25.0
    min_pixels: int = 80
    min_arc_deg: float = 40.0
    max_regions: int = 150

    def __post_init__(self) -> None:
        check_options(
            self,
            n_sigma=(0.0, np.inf),
            flatness_m=(0.0, np.inf),
            max_angle_deg=(0.0, 90.0),
            min_pixels=(3, np.inf),
            min_arc_deg=(0.0, 360.0),
            max_regions=(0, np.inf),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A connected part of a scan that lies on one surface.

    Attributes
    ----------
    fit : SurfaceFit
        Its surface, in the working frame.
    mask : (rows, columns) bool
        Its pixels.
    """

    fit: SurfaceFit
    mask: BoolArray

    @property
    def n_pixels(self) -> int:
        """How many pixels it has."""
        return int(self.mask.sum())


def grow(
    fit: SurfaceFit,
    seed: BoolArray,
    free: BoolArray,
    observation: Observation,
    tolerance: FloatArray,
    options: SegmentationOptions,
) -> Region | None:
    """Grow and refit in turn until the region stands still; None when it stays too small."""
    if not seed.any():
        return None
    mask, size = seed, 0
    for _ in range(_N_GROWTHS):
        box = _box_around(mask, observation.window)
        members = _members(fit, box, free, observation, tolerance, options)
        mask = np.zeros_like(free)
        mask[box] = _connected(members, seed[box])
        n_pixels = int(mask.sum())
        if n_pixels < options.min_pixels:
            return None
        try:
            fit = refit(fit, mask, observation)
        except FitError:
            return None
        if abs(n_pixels - size) <= 0.002 * n_pixels:
            break
        size = n_pixels
    return Region(fit, mask)


def _box_around(mask: BoolArray, window: int) -> Box:
    """Rows and columns of the mask and as much again on every side."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    up = max(int(rows[-1] - rows[0]), 3 * window)
    across = max(int(columns[-1] - columns[0]), 3 * window)
    return (
        slice(max(int(rows[0]) - up, 0), int(rows[-1]) + up + 1),
        slice(max(int(columns[0]) - across, 0), int(columns[-1]) + across + 1),
    )


def _members(
    fit: SurfaceFit,
    box: Box,
    free: BoolArray,
    observation: Observation,
    tolerance: FloatArray,
    options: SegmentationOptions,
) -> BoolArray:
    """Free pixels of the box within tolerance of the surface whose normals, where known, agree with it."""
    members = free[box].copy()
    members[members] = (
        np.abs(fit.surface.distance(observation.points[box][members])) <= tolerance[box][members]
    )
    points, normals = observation.points[box][members], observation.normals[box][members]
    cosine = np.abs(np.einsum("ij,ij->i", normals, fit.surface.normal(points)))
    allowed = np.radians(options.max_angle_deg) + 2.0 * observation.normal_sd[box][members]
    rough = observation.roughness[box][members] > tolerance[box][members]
    members[members] = (cosine >= np.cos(np.minimum(allowed, np.pi / 2))) | ~np.isfinite(cosine) | rough
    return members


def _connected(members: BoolArray, seed: BoolArray) -> BoolArray:
    """The part of `members` connected with `seed`, thin bridges cut first."""
    opened = cv2.morphologyEx(members.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    n_parts, part = cv2.connectedComponents(opened, connectivity=4)
    inside = np.bincount(part[seed & (opened > 0)], minlength=n_parts)
    inside[0] = 0
    if inside.sum() == 0:
        return np.zeros_like(members)
    core = (part == int(np.argmax(inside))).astype(np.uint8)
    grown = cv2.dilate(core, np.ones((3, 3), np.uint8)) > 0
    return np.asarray(grown & members, dtype=np.bool_)


def refit(fit: SurfaceFit, mask: BoolArray, observation: Observation) -> SurfaceFit:
    """Fit the same kind of surface again, to the pixels of `mask`; raises FitError."""
    points = _thinned(observation.points[mask])
    if isinstance(fit.surface, Cylinder):
        return fit_cylinder(points, fit.surface)
    return fit_plane(points, observation.scan.origin)


def _thinned(points: FloatArray) -> FloatArray:
    return points[:: max(1, len(points) // _FIT_SAMPLE)]


def is_curved(plane: Region, observation: Observation) -> bool:
    """Tell whether the residuals of a plane bend by more than the noise can explain."""
    points = _thinned(observation.points[plane.mask])
    uv = plane.fit.surface.to_uv(points)
    uv = uv / np.maximum(np.abs(uv).max(), 1e-12)
    residual = plane.fit.surface.distance(points)
    u, v = uv[:, 0], uv[:, 1]
    basis = np.column_stack([np.ones(len(u)), u, v, u * u, u * v, v * v])
    solution, _, rank, _ = np.linalg.lstsq(basis, residual, rcond=None)
    if rank < 6:
        return False
    bent = basis @ solution
    left = float(np.var(residual - bent))
    return float(np.var(bent)) > 0.05 * left


def grow_cylinder(
    around: BoolArray,
    free: BoolArray,
    observation: Observation,
    tolerance: FloatArray,
    options: SegmentationOptions,
) -> Region | None:
    """Grow a cylinder from the neighbourhood of a patch; None when it is none or its arc is too short."""
    start_mask = _smooth_neighbourhood(around, free, observation, tolerance)
    if start_mask.sum() < options.min_pixels:
        return None
    points, normals = _thinned(observation.points[start_mask]), _thinned(observation.normals[start_mask])
    limit = float(np.median(tolerance[start_mask]))
    try:
        first, inliers = consensus_cylinder(points, normals, limit)
        fit = fit_cylinder(points[inliers], first)
        box = _box_around(start_mask, observation.window)
        start_mask[box] &= _members(fit, box, free, observation, tolerance, options)
        region = grow(fit, start_mask, free, observation, tolerance, options)
    except FitError:
        return None
    if region is None or not isinstance(region.fit.surface, Cylinder):
        return None
    arc = observed_arc(region.fit.surface, observation.points[region.mask])
    noise = float(np.sqrt(np.median(tolerance[region.mask]) ** 2 / options.n_sigma**2))
    if arc < np.radians(options.min_arc_deg) or region.fit.rms > 2.0 * noise:
        return None
    return region


def _smooth_neighbourhood(
    around: BoolArray, free: BoolArray, observation: Observation, tolerance: FloatArray
) -> BoolArray:
    """Smooth pixels connected with a patch, in a box that reaches as far again on every side."""
    box = _box_around(around, observation.window)
    smooth = free[box] & (observation.roughness[box] <= tolerance[box])
    found = np.zeros_like(around)
    found[box] = _connected(smooth, around[box]) & np.isfinite(observation.normals[box]).all(axis=-1)
    return found


def observed_arc(cylinder: Cylinder, points: FloatArray) -> float:
    """Angle in radians that `points` cover around the axis: a full turn less the largest gap."""
    angle = np.sort(cylinder.to_uv(points)[:, 0] / cylinder.radius)
    if len(angle) < 2:
        return 0.0
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    return float(2 * np.pi - gaps.max())
