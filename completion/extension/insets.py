# SPDX-License-Identifier: MIT
"""Insets: panes, door leaves and backs of niches, which lie behind a wall and are seen through it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPoint, contains_xy

from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Plane

_DEEPEST_M = 0.5  # as thick as walls are
_PARALLEL = np.cos(np.radians(5.0))
_APART = 3.0  # standard deviations of both planes, flatness counted, by which one lies behind at least
_THROUGH = 0.5  # share of a surface that is seen through the outline of the other
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
        (k, one.fit.surface)
        for k, one in enumerate(surfaces)
        if isinstance(one.fit.surface, Plane) and one.n_pixels
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
        candidates = (normals @ normals[at] >= _PARALLEL) & (behind <= _DEEPEST_M)
        candidates &= behind > _APART * np.hypot(sd[at], sd)
        for other in np.flatnonzero(candidates)[np.argsort(behind[candidates], kind="stable")]:
            wall, plane = planes[other]
            if _share_inside(planes[at][1], points, beams[other][1]) >= _THROUGH:
                continue  # a thing on it: a wall with a hole lies around what is seen through it
            if _share_through(plane, beams[other][1], origins, points) >= _THROUGH:
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
