# SPDX-License-Identifier: MIT
"""Enclosure: the surfaces that bound all that was measured, as walls, floors and vaults do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from shapely import MultiPoint, contains_xy
from shapely.geometry.base import BaseGeometry

from completion.merging.pipeline import MergedSurface
from completion.observe.observation import Observation
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_INNER_SHARE = 0.88  # of all measured points on the inner side: some lie beyond windows that are half hidden
_LEAST_PIXELS = 0.02  # of all measured points on the surface itself
_N_BEAMS = 40_000


def find_enclosing(
    surfaces: Sequence[MergedSurface], observations: Sequence[Observation], scale: float
) -> BoolArray:
    """Tell which surfaces (n,) have nearly all measured points on their inner side: walls, floors, vaults.

    A point that was seen through a plane, inside the outline of its measured part, lies behind a window, a
    door or a niche, and does not count. A point that was seen past the outline counts against the plane.

    Parameters
    ----------
    surfaces : sequence of MergedSurface
        All surfaces, working frame.
    observations : sequence of Observation
        All scans.
    scale : float
        Distance in metres below which a point counts as on the surface.
    """
    least = _LEAST_PIXELS * sum(surface.n_pixels for surface in surfaces)
    found = [
        surface.n_pixels >= least
        and _may_enclose(surface.fit.surface)
        and _holds(surface, observations, scale)
        for surface in surfaces
    ]
    return np.array(found, dtype=np.bool_)


def _may_enclose(surface: Surface) -> bool:
    """Planes, and cylinders seen from inside."""
    return isinstance(surface, Plane) or (isinstance(surface, Cylinder) and surface.concave)


def _holds(merged: MergedSurface, observations: Sequence[Observation], scale: float) -> bool:
    """Tell whether nearly all points that were not seen through a surface lie on its inner side."""
    surface, slack = merged.fit.surface, 3 * max(scale, merged.fit.rms)
    outline = MultiPoint(surface.to_uv(merged.points(observations))).convex_hull
    stride = max(1, sum(int(seen.valid.sum()) for seen in observations) // _N_BEAMS)
    n_inner = n_outer = 0
    for seen in observations:
        points, rays = seen.points[seen.valid][::stride], seen.rays[seen.valid][::stride]
        inner = surface.distance(points) > -slack
        outer = ~inner
        if isinstance(surface, Plane):
            outer[outer] &= ~_passes_inside(surface, outline, seen.scan.origin, rays[outer])
        n_inner, n_outer = n_inner + int(inner.sum()), n_outer + int(outer.sum())
    return n_inner >= _INNER_SHARE * max(n_inner + n_outer, 1)


def _passes_inside(plane: Plane, outline: BaseGeometry, origin: FloatArray, rays: FloatArray) -> BoolArray:
    """Tell which rays (n, 3) meet the plane inside an outline in its chart."""
    ranges = plane.ray_ranges(origin, rays)
    meets = np.isfinite(ranges)
    inside = np.zeros(len(rays), dtype=np.bool_)
    u, v = plane.to_uv(origin + ranges[meets, None] * rays[meets]).T
    inside[meets] = contains_xy(outline, u, v)
    return inside
