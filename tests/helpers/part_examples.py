# SPDX-License-Identifier: MIT
"""Surfaces whose relations are known: rows of walls, and surfaces as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.cases.planes import plane_fit
from completion.fitting.chart import axis_frame
from completion.fitting.result import SurfaceFit
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cone, Cylinder, Plane


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
            sigma=sigma,
            n=400,
        )
        for place, turn in zip(places, turns, strict=True)
    ]


def exact(surface, deviation: float = 1e-3) -> SurfaceFit:
    """A fit of a surface as it is, with all parameters equally well known."""
    k = {Plane: 3, Cylinder: 5, Cone: 6}.get(type(surface), 4)
    return SurfaceFit(surface, deviation, deviation**2 * np.eye(k), 100)


def transformed(fit: SurfaceFit, pose: Pose) -> SurfaceFit:
    """A fit in another frame; the chart of an axis has directions of its own there."""
    surface, by = fit.surface.transform(pose), np.eye(len(fit.covariance))
    if not isinstance(surface, Plane):
        turn = axis_frame(surface.direction)[:2] @ pose.rotation @ axis_frame(fit.surface.direction)[:2].T
        by[:2, :2], by[2:4, 2:4] = turn, turn
    return replace(fit, surface=surface, covariance=by @ fit.covariance @ by.T)


def flipped(fit: SurfaceFit) -> SurfaceFit:
    """A plane's fit with its normal the other way; another's as it is."""
    surface = fit.surface
    if not isinstance(surface, Plane):
        return fit
    # its v turns over too: the slope along it changes its sign twice, the offset and the other once
    signs = np.diag([-1.0, -1.0, 1.0])
    turned = Plane(surface.point, -surface.normal_direction, surface.u_direction)
    return replace(fit, surface=turned, covariance=signs @ fit.covariance @ signs)


def scaled(fit: SurfaceFit, by: float) -> SurfaceFit:
    """A plane's, cylinder's or cone's fit in another unit of length."""
    surface = fit.surface
    if isinstance(surface, Plane):
        units, small = (
            np.array([by, 1, 1]),
            Plane(by * surface.point, surface.normal_direction, surface.u_direction),
        )
    elif isinstance(surface, Cylinder):
        units = np.array([by, by, 1, 1, by])
        small = Cylinder(by * surface.point, surface.direction, by * surface.radius)
    else:
        units = np.array([by, by, 1, 1, by, 1])
        small = Cone(by * surface.point, surface.direction, by * surface.radius, surface.half_angle)
    return replace(fit, surface=small, covariance=fit.covariance * np.outer(units, units))
