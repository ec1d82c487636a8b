# SPDX-License-Identifier: MIT
"""Adjacency: which surfaces enclose the room, which meet, and which are insets of a wall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import GeometryCollection, LineString, MultiPoint, contains_xy
from shapely.geometry.base import BaseGeometry

from completion.boundary.boundary_pixels import BoundaryKind, BoundaryPixels
from completion.evidence.evidence import Scans
from completion.extension import limits
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation, ScanPixels
from completion.room.roles import NO_ROOM, Room, assign_roles
from scenes.checks import BoolArray, FloatArray
from scenes.inclination import Up
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Cylinder, Plane

_N_POINTS = 400  # of a surface that are looked at


def find_insets(
    surfaces: Sequence[MergedSurface], observations: Sequence[Observation], flatness_m: float
) -> NDArray[np.int64]:
    """Find which plane each surface is an inset of: the nearest one through whose outline most of it is seen.

    A pane lies up to half a metre behind a parallel wall, and the beams that met it passed the wall's plane
    inside the outline of what was measured of the wall. It ends at its reveal, wherever that is hidden. What
    most of lies before the inside of a surface's own outline is a thing on it, no wall.

    Parameters
    ----------
    surfaces : sequence of MergedSurface
        All surfaces, working frame.
    observations : sequence of Observation
        The scans.
    flatness_m : float
        By how much surfaces may stray from planes, metres.

    Returns
    -------
    (n,) int64
        Index of the wall, -1 for what is no inset.
    """
    hosts = np.full(len(surfaces), -1, np.int64)
    planes = [
        (k, surface.fit.surface)
        for k, surface in enumerate(surfaces)
        if isinstance(surface.fit.surface, Plane) and surface.n_pixels
    ]
    if len(planes) < 2:
        return hosts
    beams = [_beams(surfaces[k], observations) for k, _ in planes]
    normals = np.array([plane.normal_direction for _, plane in planes])
    middles = np.array([points.mean(axis=0) for _, points in beams])
    sd = np.array([
        np.hypot(surfaces[k].fit.standard_deviation(middle[None])[0], flatness_m)
        for (k, _), middle in zip(planes, middles, strict=True)
    ])  # fmt: skip
    for at, (origins, points) in enumerate(beams):
        behind = -np.einsum("ij,ij->i", normals, middles[at] - middles)
        candidates = (normals @ normals[at] >= limits.PARALLEL_COSINE) & (behind <= limits.DEEPEST_M)
        candidates &= behind > limits.APART_SD * np.hypot(sd[at], sd)
        for other in np.flatnonzero(candidates)[np.argsort(behind[candidates], kind="stable")]:
            wall, plane = planes[other]
            if _share_inside(planes[at][1], points, beams[other][1]) >= limits.THROUGH_SHARE:
                continue  # a thing on it: a wall with a hole lies around what is seen through it
            if _share_through(plane, beams[other][1], origins, points) >= limits.THROUGH_SHARE:
                hosts[planes[at][0]] = wall
                break
    return hosts


def _beams(merged: MergedSurface, observations: Sequence[Observation]) -> tuple[FloatArray, FloatArray]:
    """Origins and points (n, 3) of some of a surface's beams."""
    origins, points = [], []
    for seen, pixels in merged.sampled_by(observations, _N_POINTS):
        points.append(seen.points_at(pixels))
        origins.append(np.broadcast_to(seen.scan.origin, points[-1].shape))
        trim()
    return np.concatenate(origins), np.concatenate(points)


def _share_inside(plane: Plane, measured: FloatArray, points: FloatArray) -> float:
    """Share of points (n, 3) whose feet on a plane lie inside the hull of its `measured` points."""
    outline = MultiPoint(plane.to_uv(measured)).convex_hull
    return float(np.mean(contains_xy(outline, *plane.to_uv(points).T)))


def _share_through(wall: Plane, measured: FloatArray, origins: FloatArray, points: FloatArray) -> float:
    """Share of beams that passed a wall's plane inside the hull of its `measured` points."""
    before, after = wall.distance(origins), wall.distance(points)
    passed = (before > 0) & (after < 0)
    if not passed.any():
        return 0.0
    part = before[passed, None] / (before - after)[passed, None]
    u, v = wall.to_uv(origins[passed] + part * (points - origins)[passed]).T
    outline = MultiPoint(wall.to_uv(measured)).convex_hull
    return float(np.count_nonzero(contains_xy(outline, u, v))) / len(points)


_N_BEAMS = 40_000


@dataclass(frozen=True, slots=True, eq=False)
class Adjacency:
    """How n surfaces lie to one another."""

    encloses: BoolArray  # (n,) walls, floors and ceilings of the room, vaults
    ends: BoolArray  # (n,) what others end at: those, and the base of what stands on it
    meets: BoolArray  # (n, n) pairs that lie side by side in some scan, in a crease or across a jump
    standing: FloatArray  # (n,) probability that what is upright on such a plane goes on to it
    is_inset: BoolArray  # (n,) panes, door leaves, backs of niches: seen through a wall
    room: Room = NO_ROOM


def find_adjacency(
    surfaces: Sequence[MergedSurface],
    boundaries: Sequence[BoundaryPixels],
    scans: Scans,
    up: Up | None = None,
) -> Adjacency:
    """Find which surfaces enclose the room or are insets, which meet, and how surely things stand on each.

    Surfaces are in the working frame, the boundary pixels of each in its own chart. `up` says which way is up
    in that frame; z when not given.
    """
    observations, flatness_m = scans.observations, scans.tolerance.flatness_m
    upward = up or Up(np.array([0.0, 0.0, 1.0]))
    is_inset = find_insets(surfaces, observations, flatness_m) >= 0
    room = assign_roles(surfaces, observations, flatness_m, upward).only(~is_inset)
    others = [not goes_by_room(surface.fit, upward) for surface in surfaces]
    encloses = find_enclosing(surfaces, observations, flatness_m, np.array(others, dtype=np.bool_))
    encloses = (encloses & ~is_inset) | np.array([role != "" for role in room.roles], dtype=np.bool_)
    ends = encloses | np.isin(np.arange(len(surfaces)), list(room.bases))
    meets = _meets(scans.owners, surfaces, observations, flatness_m)
    standing = _standing_probability(surfaces, boundaries, ends, meets)
    return Adjacency(
        encloses=encloses, ends=ends, meets=meets, standing=standing, is_inset=is_inset, room=room
    )


def goes_by_room(fit: SurfaceFit, up: Up) -> bool:
    """Tell whether the room says what a surface is: level and upright planes, where up is known."""
    inclination = fit.inclination(up.direction, up.sd_deg)
    return (
        up.is_decided and isinstance(fit.surface, Plane) and (inclination.is_level or inclination.is_upright)
    )


def stands_upright(fit: SurfaceFit, base: SurfaceFit) -> bool:
    """Tell whether a surface stands at right angles to a plane, within the limit of `Inclination`."""
    plane = base.surface
    if not isinstance(plane, Plane):
        return False
    return fit.inclination(plane.normal_direction, base.inclination(plane.normal_direction).sd_deg).is_upright


def _standing_probability(
    surfaces: Sequence[MergedSurface],
    boundaries: Sequence[BoundaryPixels],
    ends: BoolArray,
    meets: BoolArray,
) -> FloatArray:
    """Of the n surfaces whose end on its side was seen k end on the plane: (k + a) / (n + a + b)."""
    standing = np.zeros(len(surfaces))
    for number, base in enumerate(surfaces):
        plane = base.fit.surface
        if not ends[number] or not isinstance(plane, Plane):
            continue
        ending = [
            meets[number, other]
            for other in range(len(surfaces))
            if not ends[other]
            and stands_upright(surfaces[other].fit, base.fit)
            and (meets[number, other] or _ends_above(surfaces[other], boundaries[other], plane))
        ]
        standing[number] = (sum(ending) + limits.STANDING[0]) / (len(ending) + sum(limits.STANDING))
    return standing


def _ends_above(surface: MergedSurface, boundary: BoundaryPixels, base: Plane) -> bool:
    """Tell whether the boundary nearest to a plane is mostly the surface's own edge."""
    height = base.distance(surface.fit.surface.from_uv(boundary.uv))
    if not len(height):
        return False
    lowest = boundary.kind[height <= height.min() + 0.05 * np.ptp(height)]
    return bool(np.mean(lowest == BoundaryKind.OWN_EDGE) > 0.5)


def _meets(
    owners: Sequence[NDArray[np.int32]],
    surfaces: Sequence[MergedSurface],
    observations: Sequence[Observation],
    flatness_m: float,
) -> BoolArray:
    """Pairs (n, n) of surfaces with neighbouring pixels that lie on both."""
    n = len(surfaces)
    meetings = np.zeros((n + 1, n + 1), np.int64)
    for owner, observation in zip(owners, observations, strict=True):
        trim()
        for step in ((0, 2), (2, 0)):
            a = owner[: owner.shape[0] - step[0], : owner.shape[1] - step[1]]
            b = owner[step[0] :, step[1] :]
            rows, columns = np.nonzero((a != b) & (a > 0) & (b > 0))
            first, second = a[rows, columns], b[rows, columns]
            pixel = rows * owner.shape[1] + columns
            p = observation.points_at(pixel)
            q = observation.points_at(pixel + step[0] * owner.shape[1] + step[1])
            scale = np.hypot(observation.sigma_at(pixel), flatness_m)
            slack = 3 * scale + 2 * np.linalg.norm(p - q, axis=1)
            for i, j in {(int(i), int(j)) for i, j in zip(first, second, strict=True)}:
                pair = (first == i) & (second == j)
                near = np.abs(surfaces[j - 1].fit.surface.distance(p[pair])) <= slack[pair]
                near &= np.abs(surfaces[i - 1].fit.surface.distance(q[pair])) <= slack[pair]
                gap = np.linalg.norm(p[pair] - q[pair], axis=1)
                near &= gap <= np.quantile(gap, 0.9)
                meetings[i, j] += int(near.sum())
    both = meetings + meetings.T
    return np.asarray(both[1:, 1:] >= limits.MEETING_PAIRS, dtype=np.bool_)


def find_enclosing(
    surfaces: Sequence[MergedSurface],
    observations: Sequence[Observation],
    flatness_m: float,
    tried: BoolArray | None = None,
) -> BoolArray:
    """Tell which surfaces (n,) have nearly all measured points on their inner side: roofs, vaults.

    A point that was seen through a plane, inside the outline of its measured part, lies behind a window, a
    door or a niche, and does not count. A point that was seen past the outline counts against the plane.
    Points count as on the surface within noise and `flatness_m`, metres, by which surfaces stray. Only those
    that are to be `tried` (n,) are looked at.
    """
    is_tried = np.ones(len(surfaces), dtype=np.bool_) if tried is None else tried
    if not is_tried.any():
        return is_tried
    stride = max(1, sum(_n_returns(seen) for seen in observations) // _N_BEAMS)
    sigmas, beams = [], []
    for seen in observations:
        pixel = _returns(seen, stride)
        sigmas.append(seen.sigma_at(pixel))
        beams.append((seen.scan.origin, seen.points_at(pixel), seen.rays_at(pixel)))
    sigma = np.concatenate(sigmas)
    scale = float(np.median(np.hypot(sigma, flatness_m))) if len(sigma) else 0.0
    sizes = [surface.n_pixels for surface in surfaces]
    least = limits.LEAST_PIXELS * sum(sizes)
    flags = [
        bool(is_so) and size >= least and _holds(surface, observations, beams, scale)
        for surface, size, is_so in zip(surfaces, sizes, is_tried, strict=True)
    ]
    return np.array(flags, dtype=np.bool_)


def _n_returns(seen: Observation) -> int:
    trim()
    return int(np.count_nonzero(seen.valid))


def _returns(seen: Observation, stride: int) -> NDArray[np.int64]:
    """Every stride-th flat pixel (n,) that brought something back."""
    trim()
    return np.flatnonzero(seen.valid)[::stride].copy()


def _holds(
    merged: MergedSurface,
    observations: Sequence[Observation],
    beams: Sequence[tuple[FloatArray, FloatArray, FloatArray]],
    scale: float,
) -> bool:
    """Tell whether nearly all points that were not seen through a surface lie on its inner side.

    `beams` are the origin (3,), the points (n, 3) and the rays (n, 3) of each scan, thinned.
    """
    surface, slack = merged.fit.surface, 3 * max(scale, merged.fit.rms)
    if not isinstance(surface, Plane) and not (isinstance(surface, Cylinder) and surface.concave):
        return False
    beyond = [surface.distance(points) <= -slack for _, points, _ in beams]
    n_inner = sum(len(outer) - int(np.count_nonzero(outer)) for outer in beyond)
    n_outer = sum(int(np.count_nonzero(outer)) for outer in beyond)
    if isinstance(surface, Plane) and n_inner < limits.INNER_SHARE * (n_inner + n_outer):
        outline = _outline(surface, merged.pixels, observations)
        for (origin, _, rays), outer in zip(beams, beyond, strict=True):
            n_outer -= int(np.count_nonzero(_passes_inside(surface, outline, origin, rays[outer])))
    return n_inner >= limits.INNER_SHARE * max(n_inner + n_outer, 1)


def _outline(plane: Plane, pixels: ScanPixels, observations: Sequence[Observation]) -> BaseGeometry:
    """The convex hull of a plane's pixels in all scans, in its chart."""
    hulls = []
    for scan, sample in pixels.held:
        if len(sample) > 1:
            hulls.append(LineString(plane.to_uv(observations[scan].points_at(sample.flat))).convex_hull)
            trim()
    return GeometryCollection(hulls).convex_hull


def _passes_inside(plane: Plane, outline: BaseGeometry, origin: FloatArray, rays: FloatArray) -> BoolArray:
    """Tell which rays (n, 3) meet the plane inside an outline in its chart."""
    ranges = plane.ray_ranges(origin, rays)
    meets = np.isfinite(ranges)
    inside = np.zeros(len(rays), dtype=np.bool_)
    u, v = plane.to_uv(origin + ranges[meets, None] * rays[meets]).T
    inside[meets] = contains_xy(outline, u, v)
    return inside
