# SPDX-License-Identifier: MIT
"""Parts of planes, cylinders and cones as fits: figure 1 of Fisher (2004), rows of ribs, mirrors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from completion.fitting.euclidean import fit_euclidean, fit_plane
from completion.fitting.result import SurfaceFit
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder

BASE, TOP, SIDE, FRONT, SLOPE, WIDE, BORE, TAPER = range(8)
"""Surfaces of the part, in millimetres."""

Warp = Callable[[FloatArray], FloatArray]
"""Where points (n, 3) of the part are measured, when the whole is warped."""


def unwarped(points: FloatArray) -> FloatArray:
    """Leave points (n, 3) where they are."""
    return points


def plane_fit(
    rng: np.random.Generator,
    centre: Sequence[float],
    normal: Sequence[float],
    along: Sequence[float],
    sides: tuple[float, float],
    *,
    sigma: float,
    n: int,
    warp: Warp = unwarped,
    kept: list[FloatArray] | None = None,
) -> SurfaceFit:
    """A plane fitted to points of a rectangle."""
    unit, first, middle = (np.asarray(one, dtype=float) for one in (normal, along, centre))
    reach = rng.uniform(-0.5, 0.5, (n, 2)) * sides
    points = middle + reach[:, :1] * first + reach[:, 1:] * np.cross(unit, first)
    points = warp(points) + sigma * rng.normal(size=(n, 1)) * unit
    if kept is not None:
        kept.append(points)
    return fit_plane(points, middle + 100 * unit)


def axial_fit(
    rng: np.random.Generator,
    radius: float,
    arc: float,
    heights: tuple[float, float],
    *,
    sigma: float,
    n: int,
    half_angle: float = 0.0,
    warp: Warp = unwarped,
    kept: list[FloatArray] | None = None,
) -> SurfaceFit:
    """A cylinder or cone round z fitted to points of an arc; `radius` at height 0."""
    angle, height = rng.uniform(-arc / 2, arc / 2, n), rng.uniform(*heights, n)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    normal = out * np.cos(half_angle) - np.array([0, 0, np.sin(half_angle)])
    points = out * (radius + height * np.tan(half_angle))[:, None] + height[:, None] * np.array([0, 0, 1.0])
    points = warp(points) + sigma * rng.normal(size=(n, 1)) * normal
    if kept is not None:
        kept.append(points)
    middle = float(np.mean(heights))
    if half_angle:
        cone = Cone((0, 0, middle), (0, 0, 1), radius + float(np.tan(half_angle)) * middle, half_angle)
        return fit_euclidean(points, "cone", cone)
    cylinder = Cylinder((0, 0, middle), (0, 0, 1), radius)
    return fit_euclidean(points, "cylinder", cylinder)


def figure_one(
    seed: int,
    sigma: float,
    n: int = 2000,
    *,
    warp: Warp = unwarped,
    kept: list[FloatArray] | None = None,
) -> list[SurfaceFit]:
    """Fit the part's surfaces to n points each, of noise sigma, in millimetres; those go to `kept`."""
    rng = np.random.default_rng(seed)
    tilt, cone = float(np.radians(60.0)), float(np.radians(15.0))
    flat = partial(plane_fit, rng, sigma=sigma, n=n, warp=warp, kept=kept)
    fits = [
        flat((0, 0, 0), (0, 0, -1), (1, 0, 0), (100, 80)),
        flat((0, 0, 40), (0, 0, 1), (1, 0, 0), (100, 80)),
        flat((-50, 0, 20), (-1, 0, 0), (0, 1, 0), (80, 40)),
        flat((0, -40, 20), (0, -1, 0), (1, 0, 0), (100, 40)),
        flat((60, 0, 20), (np.sin(tilt), 0, np.cos(tilt)), (0, 1, 0), (60, 30)),
    ]
    turned = partial(axial_fit, rng, sigma=sigma, n=n, warp=warp, kept=kept)
    fits.append(turned(60.0, tilt, (0, 40)))
    fits.append(turned(20.0, 2 * np.pi, (0, 40)))
    fits.append(turned(20.0, 2 * np.pi, (40, 60), half_angle=cone))
    return fits
