# SPDX-License-Identifier: MIT
"""Planning instances that come with patches of surface and an aperture of their own."""

from __future__ import annotations

import numpy as np

from nbv.scanning.sensor import PinholeSensor, Sensor
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.viewpoints import Candidates
from scenes.checks import FloatArray, InputError
from scenes.rays.raycast import RayCaster
from scenes.world.scene import Scene

_PATCH_TOLERANCE_M = 0.01


def patch_samples(scene: Scene, caster: RayCaster, candidates: Candidates) -> SurfaceSamples | None:
    """Return the patches of a planning instance as samples of equal area, None when it has none.

    A patch on the rim of a body counts as seen when the line of sight reaches within 1 cm of it.

    Raises
    ------
    InputError
        Patches that lie more than 1 cm from the scene's surface.
    """
    points, normals = candidates.patch_points, candidates.patch_normals
    if points is None or normals is None:
        return None
    if points.shape != normals.shape or not len(points):
        raise InputError(
            f"{len(points)} patch_points with {len(normals)} patch_normals; give as many of both"
        )
    hits = caster.first_hit(points + normals * _PATCH_TOLERANCE_M, -normals)
    off = ~(hits.ranges <= 2 * _PATCH_TOLERANCE_M)
    if off.any():
        first: FloatArray = points[int(np.argmax(off))]
        raise InputError(
            f"{int(off.sum())} of {len(points)} patches do not lie on {scene.name} within 1 cm "
            f"(first at {first.round(3).tolist()}); are they of another scene?"
        )
    areas = np.full(len(points), float(scene.mesh.face_areas().sum()) / len(points))
    surface = scene.mesh.face_surface[hits.face]
    return SurfaceSamples(
        points=points,
        normals=normals,
        areas=areas,
        face=hits.face,
        surface=surface,
        tolerance_m=_PATCH_TOLERANCE_M,
    )


def with_aperture(sensor: Sensor, candidates: Candidates | None) -> Sensor:
    """Return the sensor, with the conical aperture that the candidates ask for."""
    if candidates is None or candidates.half_angle_deg is None:
        return sensor
    name = f"{sensor.name}, cone of half angle {candidates.half_angle_deg:g} deg"
    pixels = 320
    return PinholeSensor(
        fov_deg=2 * candidates.half_angle_deg,
        width=pixels,
        height=pixels,
        min_range_m=sensor.min_range_m,
        max_range_m=sensor.max_range_m,
        name=name,
        aperture="circular",
        effects=sensor.effects,
    )
