# SPDX-License-Identifier: MIT
"""Flat scans: what each pixel of a plane is moved by along its ray, so that ripple goes and relief stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.boundary.range_mesh import mesh_range_image
from completion.extension.patch import Patch
from completion.flattening.flat import FlatSurface, FlattenedMesh, FlatteningOptions, RegionKind, flat_record
from completion.flattening.pipeline import flatten_mesh
from completion.observe.observation import Observation
from completion.observe.range_noise import depth_step
from scenes.checks import FloatArray, Value
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Plane

_MOST_TOLD = 3  # surfaces that are named
_STEP = 6.0  # pixels' footprints, and standard deviations, that neighbours may be apart


@dataclass(frozen=True, slots=True, eq=False)
class FlatScan(Value):
    """A scan whose planes are flattened.

    Attributes
    ----------
    shift_m : (rows, columns) float32
        By how much each pixel moves along its ray, metres.
    surfaces : tuple of FlatSurface
        What became of each plane that it measured, by the number of the surface.
    n_turned, n_crossing : int
        Triangles that turned over, and that cross others anew: 0, or it is a fault.
    """

    shift_m: NDArray[np.float32]
    surfaces: tuple[FlatSurface, ...]
    n_turned: int
    n_crossing: int

    @property
    def moved_max_m(self) -> float:
        """How far a pixel was moved at most, metres."""
        return float(np.abs(self.shift_m).max(initial=0.0))


def flatten_scan(
    seen: Observation,
    owner: NDArray[np.int32],
    patches: Sequence[Patch],
    options: FlatteningOptions,
    seed: int,
) -> FlatScan:
    """Flatten the planes of one scan; `owner` (rows, columns) numbers the patches of its pixels, from 1.

    A pixel moves along its ray, so that a triangle of neighbouring pixels cannot turn over. Where a ray meets
    its plane too flatly it stays.
    """
    shift = np.zeros(owner.shape, np.float32)
    surfaces, n_turned, n_crossing = list[FlatSurface](), 0, 0
    for number in np.unique(owner[owner > 0]).tolist():
        if not isinstance(patches[number - 1].source.fit.surface, Plane):
            continue
        pixel, flat = _flatten_plane(seen, owner == number, patches[number - 1], options, seed)
        trim()
        if flat is None:
            continue
        moved = flat.vertices - seen.points_at(pixel)
        shift.ravel()[pixel] = np.einsum("ij,ij->i", moved, seen.rays_at(pixel))
        surfaces.append(flat.surfaces[0].with_label(number))
        n_turned, n_crossing = n_turned + flat.n_turned, n_crossing + flat.n_crossing
    return FlatScan(shift, tuple(surfaces), n_turned, n_crossing)


def _flatten_plane(
    seen: Observation, is_plane: NDArray[np.bool_], patch: Patch, options: FlatteningOptions, seed: int
) -> tuple[NDArray[np.int64], FlattenedMesh | None]:
    """Flat pixels (n,) of a plane, and their mesh flattened; None where they are too few for a triangle."""
    rows, columns = (np.flatnonzero(is_plane.any(axis=axis)) for axis in (1, 0))
    window = np.ix_(np.arange(rows[0], rows[-1] + 1), np.arange(columns[0], columns[-1] + 1))
    flat = (window[0] * is_plane.shape[1] + window[1]).ravel()
    ranges = seen.scan.ranges.ravel()[flat]
    members = is_plane[window] & np.isfinite(ranges).reshape(is_plane[window].shape)
    pixel = flat[members.ravel()]
    if len(pixel) < 3:
        return pixel, None
    footprint = np.where(np.isfinite(ranges), ranges, 0.0) * seen.scan.projection.pixel_angle
    allowed = _STEP * (footprint + seen.noise.deviation(ranges)).reshape(members.shape)
    points = seen.points_at(flat).reshape(*members.shape, 3)
    faces = mesh_range_image(points, members, allowed, seen.scan.origin)
    number = np.cumsum(members.ravel()) - 1
    vertices = points[members]
    labels = np.ones(len(vertices), np.int64)
    fit = patch.source.fit
    mesh = (vertices, number[faces].astype(np.int32), labels, [fit])
    rounding = _rounding_m(seen, pixel, fit.surface.normal(vertices))
    how = replace(options, rounding_m=max(rounding, options.rounding_m))
    return pixel, flatten_mesh(*mesh, how, origin=seen.scan.origin, rng=seed)


def _rounding_m(seen: Observation, pixel: NDArray[np.int64], normals: FloatArray) -> float:
    """How much the heights of pixels (n,) over their plane differ by the steps of ranges, metres."""
    ranges = seen.scan.ranges.ravel()[pixel]
    middle = float(np.median(ranges))
    step = depth_step(seen.scan, middle, float(ranges.max()))  # cameras' steps grow with the distance
    if not step:
        return 0.0
    far = ranges >= middle
    cosine = np.abs(np.einsum("ij,ij->i", seen.rays_at(pixel[far]), normals[far]))
    return step * float(np.median(cosine))


def flat_doubts(scans: Sequence[FlatScan]) -> tuple[str, ...]:
    """Return what is to be known of flattened scans, a sentence each."""
    doubts = [
        f"surface {surface.label} in scan {scan}, flattened: {surface.doubt}"
        for scan, held in enumerate(scans, start=1)
        for surface in held.surfaces
        if surface.doubt
    ]
    if len(doubts) > _MOST_TOLD:
        doubts[_MOST_TOLD:] = [f"so it is with {len(doubts) - _MOST_TOLD} others"]
    wrong = sum(scan.n_turned + scan.n_crossing for scan in scans)
    return (
        *doubts,
        *([f"flattening turned {wrong} triangles over or made them cross others"] if wrong else []),
    )


def surface_flattening(scans: Sequence[FlatScan], number: int) -> dict[str, Any]:
    """Return what became of a surface, in all scans together and in each."""
    every = [
        (scan, surface)
        for scan, held in enumerate(scans, start=1)
        for surface in held.surfaces
        if surface.label == number
    ]
    done = [surface for _, surface in every if surface.is_flattened]
    size = np.array([surface.n for surface in done])
    plain = size - np.array([surface.n_relief for surface in done], dtype=np.int64)
    relief = [region for surface in done for region in surface.regions if region.kind is RegionKind.RELIEF]
    return {
        "is_flattened": bool(done),
        "rms_before_m": _pooled_rms([surface.rms_before_m for surface in done], size),
        "rms_after_m": _pooled_rms([surface.rms_after_m for surface in done], size),
        "ripple_before_m": _pooled_rms([surface.ripple_before_m for surface in done], plain),
        "ripple_after_m": _pooled_rms([surface.ripple_after_m for surface in done], plain),
        "relief_areas": len(relief),
        "scans": [{"scan": scan, **flat_record(surface)} for scan, surface in every],
    }


def whole_flattening(scans: Sequence[FlatScan]) -> dict[str, Any]:
    """Return what became of all planes of all scans."""
    every = [plane for scan in scans for plane in scan.surfaces]
    done = [plane for plane in every if plane.is_flattened]
    plain = np.array([plane.n - plane.n_relief for plane in done], dtype=np.int64)
    return {
        "planes": len({plane.label for plane in done}),
        "planes_left": len({plane.label for plane in every} - {plane.label for plane in done}),
        "ripple_before_m": _pooled_rms([plane.ripple_before_m for plane in done], plain),
        "ripple_after_m": _pooled_rms([plane.ripple_after_m for plane in done], plain),
        "relief_areas": sum(region.kind is RegionKind.RELIEF for plane in done for region in plane.regions),
        "moved_max_m": max((scan.moved_max_m for scan in scans), default=0.0),
        "turned_over": sum(scan.n_turned for scan in scans),
        "crossing_anew": sum(scan.n_crossing for scan in scans),
    }


def _pooled_rms(rms: Sequence[float], size: NDArray[np.int64]) -> float:
    """Root mean square of parts of so many points each; 0 of none."""
    return float(np.sqrt(np.sum(np.square(rms) * size) / max(int(np.sum(size)), 1))) if len(rms) else 0.0
