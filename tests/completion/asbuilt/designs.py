# SPDX-License-Identifier: MIT
"""Designs of boxes and tubes, and exact or noisy scans of them."""

import numpy as np

from nbv.scanning.sensor import SphericalSensor
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh, join_meshes
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from tests.helpers.buildings import Building

LEVEL = Pose.looking_at((0, 0, 0), (1, 0, 0)).rotation
FAR = Pose.from_parts(np.eye(3), np.array([500_000.0, 500_000.0, 200.0]))


def boxes(solids, glass=(), classes=None) -> ElementMesh:
    """Elements that are boxes, by name: (low, high); those in `glass` are clear."""
    made = Building()
    for name, (low, high) in solids.items():
        made.box(name, low, high)
    mesh, names = made.scene().mesh, list(solids)
    clear = np.isin(mesh.face_surface, [names.index(name) for name in glass])
    look = Appearance(np.full((len(clear), 3, 3), 0.5), opacity=np.where(clear, 0.2, 1.0)) if glass else None
    mesh = LabelledMesh(mesh.vertices, mesh.faces, mesh.face_surface, look)
    kinds = classes or {}
    return ElementMesh(mesh, tuple(Element(name, kinds.get(name, "IfcWall")) for name in names), "boxes")


def tube(radius_m, length_m, n=24, *, is_hole=False) -> LabelledMesh:
    """The side of a prism of n facets about z; of a hole with its normals inwards."""
    turn = 2 * np.pi * np.arange(n) / n
    ring = radius_m * np.column_stack([np.cos(turn), np.sin(turn)])
    vertices = np.vstack([np.column_stack([ring, np.full(n, z)]) for z in (0.0, length_m)])
    k, after = np.arange(n), (np.arange(n) + 1) % n
    faces = np.vstack([np.column_stack([k, after, after + n]), np.column_stack([k, after + n, k + n])])
    return LabelledMesh(vertices, faces[:, ::-1] if is_hole else faces)


def scanned(design, eye, *, n_pixels=60_000, sigma_m=0.0, rng=None, extras=(), name="s1", wrong=None):
    """A scan of a design and of boxes (low, high) that stand in it, from a level scanner."""
    meshes = [design.mesh, *(boxes({"extra": box}).mesh for box in extras)]
    mesh = join_meshes([LabelledMesh(one.vertices, one.faces) for one in meshes])
    width = int(np.sqrt(n_pixels * 360 / 145))
    sensor = SphericalSensor(
        azimuth_span_deg=360.0, elevation_min_deg=-60.0, elevation_max_deg=85.0, width=width,
        height=int(width * 145 / 360), max_range_m=40.0, name="scanner",
    )  # fmt: skip
    pose = Pose.from_parts(LEVEL, np.asarray(eye, float))
    ways = pose.rotate(sensor.projection.directions())
    ranges = RayCaster(mesh.vertices, mesh.faces, 1).first_hit(pose.translation[None], ways).ranges
    if sigma_m:
        ranges = ranges + np.random.default_rng(rng).normal(0, sigma_m, ranges.shape)
    stated = pose if wrong is None else wrong @ pose
    return RangeImage(ranges, sensor.projection, stated, sigma_m=sigma_m or 1e-4, name=name)


def moved(design: ElementMesh, pose: Pose) -> ElementMesh:
    """The design elsewhere."""
    return ElementMesh(design.mesh.transform(pose), design.elements, design.name)
