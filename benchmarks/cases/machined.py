# SPDX-License-Identifier: MIT
"""A machined part as made: one hole beside its place and one face too high, scanned from all sides."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from completion.asbuilt.faces import DesignFaces, find_faces, scale_of
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

PART = Path(os.environ.get("UNSEEN_DATA", "../shared/data")) / "scenes/objects/featuretype.STL"
HOLE_M, FACE_M, NOISE_M = 3e-4, 2e-4, 2e-5
_AWAY_M, _NEAR_M = 0.4, 1e-6
_LEAST_M2 = 1e-4  # of a face that is changed


@dataclass(frozen=True, slots=True, eq=False)
class MachinedPart:
    """A part as made, with what is not as designed.

    `hole` and `face` are numbers of faces of the design, `hole_m` (3,) the shift of the axis, `face_m` that
    of the face along its normal, metres.
    """

    made: Scene
    faces: DesignFaces
    hole: int
    face: int
    hole_m: FloatArray
    face_m: float


def machined(design: Scene, seed: int) -> MachinedPart:
    """Move one hole and one outer face of a part; corners go with them, so that neighbours stay flat."""
    rng = np.random.default_rng([480, seed])
    mesh = design.mesh
    faces = find_faces(mesh, scale_of(mesh))
    low, high = mesh.bounds()
    holes = np.flatnonzero((faces.sign < 0) & (faces.area > _LEAST_M2))
    reach = np.where(faces.normal > 0, high, low)
    outer = np.abs(np.einsum("ij,ij->i", faces.normal, reach - faces.centre)) < _NEAR_M
    flat = np.flatnonzero((faces.sign == 0) & outer & (faces.area > _LEAST_M2))
    hole, face = int(rng.choice(holes)), int(rng.choice(flat))
    angle = rng.uniform(0, 2 * np.pi)
    shift = HOLE_M * (np.cos(angle) * faces.u[hole] + np.sin(angle) * faces.v[hole])
    vertices = mesh.vertices.copy()
    away = vertices - faces.centre[hole]
    along = away @ faces.normal[hole]
    radial = np.linalg.norm(away - along[:, None] * faces.normal[hole], axis=1)
    is_rim = (np.abs(radial - faces.radius[hole]) < _NEAR_M) & (
        np.abs(along) <= faces.half[hole, 0] + _NEAR_M
    )
    vertices[is_rim] += shift
    height = float(FACE_M * rng.choice([-1.0, 1.0]))
    on_face = np.abs((mesh.vertices - faces.centre[face]) @ faces.normal[face]) < _NEAR_M
    vertices[on_face] += height * faces.normal[face]
    changed = LabelledMesh(vertices, mesh.faces, mesh.face_surface)
    made = replace(design, mesh=changed, name="as made")
    return MachinedPart(made, faces, hole, face, shift, height)


def part_scans(made: Scene, seed: int, n_pixels: int = 700) -> list[RangeImage]:
    """Scans of a part from fourteen sides by a fine range camera, at poses that are known."""
    rng = np.random.default_rng([481, seed])
    low, high = made.mesh.bounds()
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    away = _AWAY_M * size / 0.15
    sensor = PinholeSensor(
        fov_deg=float(2 * np.degrees(np.arctan(size / 2 / away))), width=n_pixels, height=n_pixels,
        min_range_m=0.05, max_range_m=10.0, name="structured light",
    )  # fmt: skip
    ways = [(np.cos(a), np.sin(a), z) for z in (0.6, -0.6) for a in np.arange(6) * np.pi / 3 + 0.2 + z]
    scans = []
    for k, way in enumerate([*ways, (0.05, 0.02, 1.0), (0.05, 0.02, -1.0)]):
        place = middle + away * np.array(way) / np.linalg.norm(way)
        scan = scan_scene(made, View(Pose.looking_at(place, middle), sensor), noise="none", truth=False)
        noisy = scan.ranges + NOISE_M * rng.normal(size=scan.ranges.shape)
        scans.append(replace(scan, ranges=noisy, sigma_m=None, name=f"side {k + 1}"))
    return scans
