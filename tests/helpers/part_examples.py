# SPDX-License-Identifier: MIT
"""Parts whose surfaces and relations are known: that of figure 1 of the paper, and rows of walls."""

from __future__ import annotations

import numpy as np

from completion.fitting.euclidean import fit_euclidean, fit_plane
from completion.fitting.result import SurfaceFit
from scenes.surfaces.catalogue import Cone, Cylinder, Plane

BASE, TOP, SIDE, FRONT, SLOPE, WIDE, BORE, TAPER = range(8)
"""Surfaces of `figure_one`, lengths in millimetres."""


def plane_fit(rng, centre, normal, along, sides, sigma, n):
    """A plane fitted to points of a rectangle."""
    normal, along = np.asarray(normal, dtype=float), np.asarray(along, dtype=float)
    across = np.cross(normal, along)
    reach = rng.uniform(-0.5, 0.5, (n, 2)) * sides
    points = np.asarray(centre) + reach[:, :1] * along + reach[:, 1:] * across
    points += sigma * rng.normal(size=(n, 1)) * normal
    return fit_plane(points, np.asarray(centre) + 100 * normal)


def axial_fit(rng, radius, arc, heights, sigma, n, half_angle=0.0):
    """A cylinder or cone round z fitted to points of an arc; `radius` at height 0."""
    angle, height = rng.uniform(-arc / 2, arc / 2, n), rng.uniform(*heights, n)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    normal = out * np.cos(half_angle) - np.array([0, 0, np.sin(half_angle)])
    points = out * (radius + height * np.tan(half_angle))[:, None] + height[:, None] * np.array([0, 0, 1.0])
    points += sigma * rng.normal(size=(n, 1)) * normal
    middle = np.mean(heights)
    if half_angle:
        start = Cone((0, 0, middle), (0, 0, 1), radius + np.tan(half_angle) * middle, half_angle)
        return fit_euclidean(points, "cone", start)
    return fit_euclidean(points, "cylinder", Cylinder((0, 0, middle), (0, 0, 1), radius))


def figure_one(seed: int, sigma: float, n: int = 2000) -> list[SurfaceFit]:
    """Five planes, a R60 of which 60 deg are seen, a R20 and a 15 deg cone on the same axis."""
    rng = np.random.default_rng(seed)
    tilt = np.radians(60.0)
    planes = [
        ([0, 0, 0], [0, 0, -1], [1, 0, 0], (100, 80)),
        ([0, 0, 40], [0, 0, 1], [1, 0, 0], (100, 80)),
        ([-50, 0, 20], [-1, 0, 0], [0, 1, 0], (80, 40)),
        ([0, -40, 20], [0, -1, 0], [1, 0, 0], (100, 40)),
        ([60, 0, 20], [np.sin(tilt), 0, np.cos(tilt)], [0, 1, 0], (60, 30)),
    ]
    fits = [plane_fit(rng, *plane, sigma, n) for plane in planes]
    fits.append(axial_fit(rng, 60.0, tilt, (0, 40), sigma, n))
    fits.append(axial_fit(rng, 20.0, 2 * np.pi, (0, 40), sigma, n))
    fits.append(axial_fit(rng, 20.0, 2 * np.pi, (40, 60), sigma, n, np.radians(15.0)))
    return fits


def walls(seed: int, places, sigma: float = 2e-3, turns_deg=None) -> list[SurfaceFit]:
    """Parallel walls x = place, 3 m wide and 2.5 m high, in metres, turned as told about z."""
    rng = np.random.default_rng(seed)
    turns = np.zeros(len(places)) if turns_deg is None else np.radians(turns_deg)
    return [
        plane_fit(
            rng,
            (place, 0, 1.25),
            (np.cos(turn), np.sin(turn), 0),
            (-np.sin(turn), np.cos(turn), 0),
            (3.0, 2.5),
            sigma,
            400,
        )
        for place, turn in zip(places, turns, strict=True)
    ]


def exact(surface, deviation: float = 1e-3) -> SurfaceFit:
    """A fit of a surface as it is, with all parameters equally well known."""
    k = {Plane: 3, Cylinder: 5, Cone: 6}.get(type(surface), 4)
    return SurfaceFit(surface, deviation, deviation**2 * np.eye(k), 100)
