# SPDX-License-Identifier: MIT
"""Surfaces, poses, meshes, range images, built-in scenes and file formats."""

from scenes.builtin import builtin_names, builtin_scene
from scenes.checks import InputError
from scenes.mesh import Appearance, LabelledMesh
from scenes.pose import Pose
from scenes.projection import PinholeProjection, Projection, SphericalProjection
from scenes.range_image import RangeImage, ScanTruth
from scenes.raycast import Hits, RayCaster
from scenes.scene import Scene
from scenes.surfaces import Cylinder, Plane, Surface, surfaces_close

__all__ = [
    "Appearance",
    "Cylinder",
    "Hits",
    "InputError",
    "LabelledMesh",
    "PinholeProjection",
    "Plane",
    "Pose",
    "Projection",
    "RangeImage",
    "RayCaster",
    "ScanTruth",
    "Scene",
    "SphericalProjection",
    "Surface",
    "builtin_names",
    "builtin_scene",
    "surfaces_close",
]
