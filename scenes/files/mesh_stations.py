# SPDX-License-Identifier: MIT
"""Mesh stations: what scanners at given places would have measured of a mesh that somebody else made."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from scenes.checks import InputError, check_point
from scenes.files.scene_files import load_scene
from scenes.formats.format import Units
from scenes.mesh.orientation import Axis, world_from_file_up
from scenes.pose import Pose
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import MESH_SENSOR, RangeImage
from scenes.world.scene import Scene

_WIDTH, _HEIGHT = 1800, 900  # pixels all round, a fifth of a degree
_LEAST_PIXELS = 1_000  # that meet the mesh from a place


def scan_mesh(
    path: str | os.PathLike[str], origins: Sequence[Sequence[float]], units: Units = "m", up: str = "z"
) -> list[RangeImage]:
    """Return a scan of a mesh from each place: all round, 1,800 x 900 pixels, without noise of its own.

    A mesh does not say which beams made it. These are those that a scanner would have had: what a maker
    closed by a guess counts as measured, and what looks into the open through a hole is not known.

    Parameters
    ----------
    path : str or path
        The mesh, in any format that `load_scene` reads; its axes stay as they are.
    origins : sequence of (3,) float
        Where scanners stand, in the file's frame, metres.
    units : str
        Of the file.
    up : str
        Its axis that is up, where that is known to be x, y or z.

    Raises
    ------
    InputError
        An unusable mesh; a place that is not finite, or from where hardly any of it is seen.
    """
    upwards: Axis = "x" if up == "x" else "y" if up == "y" else "z"
    scene, from_file = load_scene(path, up=upwards, units=units), world_from_file_up(upwards)
    projection = SphericalProjection.regular(_WIDTH, _HEIGHT, 360.0, (-90.0, 90.0))
    told = (
        f"{Path(path).name} is a mesh, cast at by {_WIDTH} x {_HEIGHT} rays from each place given: what its "
        "maker closed counts as measured, and no measured beam vetoes what is inferred"
    )
    scans = []
    for number, origin in enumerate(origins, start=1):
        place = from_file.apply(check_point(f"place {number}", origin)[None])[0]
        scan = _seen_from(scene, Pose.looking_at(place, place + [1.0, 0.0, 0.0]), projection)
        n_met = int(scan.valid.sum())
        if n_met < _LEAST_PIXELS:
            raise InputError(
                f"{path}: from {', '.join(f'{value:g}' for value in origin)} only {n_met} of "
                f"{scan.ranges.size} rays meet the mesh; give places inside of rooms, and the file's --units"
            )
        scan = scan.transformed(from_file.inverse())
        name = scene.name if len(origins) == 1 else f"{scene.name} {number}"
        scans.append(replace(scan, name=name, warnings=(*scene.warnings, told) if number == 1 else ()))
    return scans


def _seen_from(scene: Scene, pose: Pose, projection: SphericalProjection) -> RangeImage:
    rays = pose.rotate(projection.directions().reshape(-1, 3)).reshape(*projection.shape, 3)
    hits = scene.ray_caster().first_hit(pose.translation[None], rays)
    ranges = np.where(np.isfinite(hits.ranges), hits.ranges, np.inf)
    return RangeImage(ranges.reshape(projection.shape), projection, pose, sensor=MESH_SENSOR)
