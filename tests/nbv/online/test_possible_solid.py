# SPDX-License-Identifier: MIT
"""The solid that scans of a ball leave possible: its measured surface, its shadow, and what is left of it."""

import numpy as np
import pytest
import trimesh

from nbv.online.occupancy import VoxelMap
from nbv.online.possible_solid import PossibleSurface
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene
from tests.nbv.online.test_occupancy import VOLUME, seen_once, squares

SENSOR = PinholeSensor(fov_deg=20, width=300, height=300, max_range_m=5.0)
RADIUS_M, FAR_M = 0.1, 1.0
AROUND = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]


def look_from(*directions: tuple[float, float, float], sigma_m: float = 0.0) -> VoxelMap:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS_M)
    scene = Scene(LabelledMesh(ball.vertices, ball.faces), (None,), ("ball",), "ball", "object")
    voxels = VoxelMap.unknown(scene.mesh.bounds(), outside_is_empty=True)
    for k, direction in enumerate(directions):
        pose = Pose.looking_at(FAR_M * np.array(direction, float), (0, 0, 0))
        scan = scan_scene(scene, pose, SENSOR, truth=False)
        noise = np.random.default_rng(k).normal(0.0, sigma_m, scan.shape)
        if sigma_m:
            scan = RangeImage(scan.ranges + noise, scan.projection, world_from_sensor=pose, sigma_m=sigma_m)
        voxels = voxels.integrate(scan, SENSOR)
    return voxels


def volume_of(surface: PossibleSurface) -> float:
    corners = surface.vertices[surface.faces]
    return float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6)


@pytest.mark.parametrize("sigma_m", [0.0, 0.0003])
def test_measured_surface_is_the_balls_and_knows_how_it_was_seen(sigma_m):
    voxels = look_from((1, 0, 0), sigma_m=sigma_m)
    surface = PossibleSurface.of(voxels)
    good = surface.cosine > 0.5
    distance = np.linalg.norm(surface.centres[good], axis=1) - RADIUS_M
    assert np.abs(distance).max() < 0.5 * voxels.grid.voxel_m + 2 * sigma_m
    outward = surface.centres[good] / np.linalg.norm(surface.centres[good], axis=1, keepdims=True)
    towards = np.array([FAR_M, 0, 0]) - surface.centres[good]
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    expected = np.einsum("ij,ij->i", outward, towards)
    assert np.median(np.abs(surface.cosine[good] - expected)) < (0.06 if sigma_m else 0.03)
    # the part of a ball that is seen within 60 deg from a finite distance
    cap = 2 * np.pi * RADIUS_M**2 * (1 - np.cos(np.radians(60) - np.arcsin(RADIUS_M / FAR_M * np.sqrt(0.75))))
    assert surface.areas[good].sum() == pytest.approx(cap, rel=0.06)


def test_what_nobody_saw_is_solid_until_a_beam_goes_through():
    one, two = (PossibleSurface.of(look_from(*AROUND[:k])) for k in (1, 2))
    ball = 4 / 3 * np.pi * RADIUS_M**3
    wide = (FAR_M + RADIUS_M) / FAR_M  # the shadow's radius at its end, in radii of the ball
    half_and_shadow = ball / 2 + np.pi * RADIUS_M**3 * (1 + wide + wide**2) / 3
    assert volume_of(one) == pytest.approx(half_and_shadow, rel=0.08)
    assert one.is_unknown.any()
    before_limb = one.is_unknown & (one.centres[:, 0] > 0.03)
    assert one.areas[before_limb].sum() < 0.05 * one.areas[one.is_unknown].sum()
    assert volume_of(two) == pytest.approx(ball, rel=0.06)
    unknown = [surface.areas[surface.is_unknown].sum() for surface in (one, two)]
    assert unknown[1] < 0.4 * unknown[0]  # a band of some voxels around the limb


def test_after_six_views_a_ball_is_left_of_which_all_was_seen_well():
    surface = PossibleSurface.of(look_from(*AROUND))
    assert volume_of(surface) == pytest.approx(4 / 3 * np.pi * RADIUS_M**3, rel=0.04)
    assert surface.areas[surface.cosine >= 0.5].sum() > 0.97 * surface.areas.sum()


def test_around_a_room_everything_is_solid():
    voxels = seen_once(squares((2.5, 4.0)))
    surface = PossibleSurface.of(voxels)
    assert volume_of(surface) < 0  # the empty space is within
    on_wall = surface.cosine > 0.5
    off = np.abs(surface.centres[on_wall, 0] - 2.5)
    assert off.max() <= 2 * voxels.grid.voxel_m  # where the aperture ends, beside what was met
    assert np.median(off) < 0.1 * voxels.grid.voxel_m
    assert (surface.normals[on_wall] @ [-1.0, 0, 0] > 0.99).mean() > 0.8


def test_without_empty_space_there_is_no_surface():
    nothing = PossibleSurface.of(VoxelMap.unknown(VOLUME, voxel_m=0.2))
    assert len(nothing.faces) == 0
    assert not nothing.is_unknown.any()
