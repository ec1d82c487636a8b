# SPDX-License-Identifier: MIT
"""Placement on a design: one place found, several refused, the same wherever scans say that they stand."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from completion.asbuilt.placement import place_on_design
from scenes.checks import InputError
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage

HIGH_M, SIGMA_M = 2.7, 0.002
L_SHAPE = ((0, 0), (6.3, 0), (6.3, 2.6), (2.9, 2.6), (2.9, 5.2), (0, 5.2))
SQUARE = ((0, 0), (4, 0), (4, 4), (0, 4))
HALL = ((0, 0), (9, 0), (9, 4.4), (0, 4.4))
LEVEL = Pose.looking_at((0, 0, 0), (1, 0, 0)).rotation
LYING = Pose.from_parts(Rotation.from_euler("z", 2.1).as_matrix() @ LEVEL, np.array([310.0, -45.0, 7.0]))
FAR = np.array([512300.0, 5403200.0, 410.0])


def room(corners, shift=(0, 0, 0)):
    """A room as a prism that is seen from within; of an L the first and the last rectangle make the floor."""
    n = len(corners)
    vertices = [(*corner, z) for z in (0.0, HIGH_M) for corner in corners]
    walls = [f for k in range(n) for f in ((k, n + k, (k + 1) % n), ((k + 1) % n, n + k, n + (k + 1) % n))]
    flat = [(0, 1, 2), (0, 2, 3)] + [(0, 3, 4), (0, 4, 5)] * (n == 6)
    faces = walls + flat + [(n + c, n + b, n + a) for a, b, c in flat]
    mesh = LabelledMesh(np.array(vertices, float) + shift, np.array(faces))
    return ElementMesh(mesh, (Element("room"),), "room")


def crate(low, high):
    """Corners and faces of a box that stands in a room and not in its design."""
    corners = np.array(
        [
            [(low, high)[i][0], (low, high)[j][1], (low, high)[k][2]]
            for i in (0, 1)
            for j in (0, 1)
            for k in (0, 1)
        ]
    )
    faces = [
        (0, 1, 3),
        (0, 3, 2),
        (4, 6, 7),
        (4, 7, 5),
        (0, 4, 5),
        (0, 5, 1),
        (2, 3, 7),
        (2, 7, 6),
        (0, 2, 6),
        (0, 6, 4),
        (1, 5, 7),
        (1, 7, 3),
    ]
    return corners, np.array(faces)


CRATES = (((0.1, 1.0, 0.0), (0.6, 2.2, 1.9)), ((1.2, 0.05, 0.0), (2.6, 0.7, 0.9)))


def scan(design, eye, heading, seed, stated=LYING, tilt_deg=1.0):
    """A furnished scan of a design, and its true pose."""
    rng = np.random.default_rng(seed)
    vertices, faces = design.mesh.vertices, [design.mesh.faces]
    for box in CRATES:
        corners, sides = crate(*box)
        faces.append(sides + len(vertices))
        vertices = np.concatenate([vertices, corners + design.mesh.bounds()[0]])
    true = Pose.from_parts(
        Rotation.from_euler("zx", [heading, tilt_deg], degrees=True).as_matrix() @ LEVEL,
        np.array(eye) + design.mesh.bounds()[0],
    )
    projection = SphericalProjection.regular(240, 80, 360, (-55, 65))
    ways = true.rotate(projection.directions())
    ranges = RayCaster(vertices, np.concatenate(faces), 1).first_hit(true.translation[None], ways).ranges
    ranges = ranges + rng.normal(0, SIGMA_M, ranges.shape)
    return RangeImage(ranges, projection, stated, sigma_m=SIGMA_M, name=f"s{seed}"), true


@cache
def in_l():
    return scan(room(L_SHAPE), (1.9, 1.7, 1.5), 70.0, 1)


@cache
def placed_in_l():
    return place_on_design(room(L_SHAPE), [in_l()[0]], n_threads=1)


def assert_right(pose, true, off_m=0.01):
    apart = pose.inverse() @ true
    assert np.linalg.norm(apart.translation) < off_m
    assert np.degrees(Rotation.from_matrix(apart.rotation).magnitude()) < 0.1


def test_a_furnished_scan_is_placed_where_the_room_has_one_place_for_it():
    found = placed_in_l()
    assert found.is_placed, found.sentences
    assert_right(found.poses[0], in_l()[1])
    assert not found.alternatives
    assert 0.6 < found.agreeing < 0.95  # crates
    assert found.through < 0.005


def test_a_room_that_is_its_own_image_is_refused_with_all_its_places():
    square = room(SQUARE)
    found = place_on_design(square, [scan(square, (1.5, 1.2, 1.5), 10.0, 2)[0]], n_threads=1)
    assert not found.is_placed
    assert found.poses == (None,)
    eyes = np.array([each.poses[0].translation for each in found.alternatives])
    images = np.array([[1.5, 1.2, 1.5], [2.8, 1.5, 1.5], [2.5, 2.8, 1.5], [1.2, 2.5, 1.5]])
    assert len(eyes) == 4
    assert np.linalg.norm(eyes[:, None] - images, axis=2).min(axis=0).max() < 0.02
    assert found.sentences[0].startswith("s2: the design looks the same from 4 places")
    assert "name one with --poses" in found.sentences[0]


def test_poses_do_not_depend_on_where_scans_say_that_they_are():
    moved = Pose.from_parts(Rotation.from_euler("z", -0.7).as_matrix(), np.array([-220.0, 90.0, 4.0]))
    again = in_l()[0].with_facts(world_from_sensor=moved @ LYING)
    other = place_on_design(room(L_SHAPE), [again], n_threads=1)
    assert np.abs(other.poses[0].matrix - placed_in_l().poses[0].matrix).max() < 1e-6


def test_poses_move_with_the_design_to_a_national_grid():
    far = place_on_design(room(L_SHAPE, FAR), [in_l()[0]], n_threads=1)
    assert np.abs(far.poses[0].translation - FAR - placed_in_l().poses[0].translation).max() < 1e-6


def test_threads_do_not_change_a_byte():
    other = place_on_design(room(L_SHAPE), [in_l()[0]], n_threads=2)
    assert other.poses[0].matrix.tobytes() == placed_in_l().poses[0].matrix.tobytes()
    assert other.sentences == placed_in_l().sentences


def test_scans_of_another_building_are_refused():
    with pytest.raises(InputError, match=r"s1: fits nowhere in room; at the best place .* \(--up\)\?$"):
        place_on_design(room(HALL), [in_l()[0]], n_threads=1)


def test_scans_that_are_registered_are_placed_together():
    truth = [
        scan(room(L_SHAPE), eye, turn, k, tilt_deg=0.2)
        for k, (eye, turn) in enumerate([((1.0, 4.1, 1.5), 20.0), ((4.9, 1.3, 1.4), 200.0)])
    ]
    lying = [
        each.with_facts(world_from_sensor=LYING @ Pose.from_parts(LEVEL, np.zeros(3)).inverse() @ true)
        for each, true in truth
    ]
    found = place_on_design(room(L_SHAPE), lying, together=True, n_threads=1)
    assert found.is_placed, found.sentences
    for pose, (_, true) in zip(found.poses, truth, strict=True):
        assert_right(pose, true)


def test_up_of_the_scans_may_be_said():
    rolled = Pose.from_parts(Rotation.from_euler("x", 90, degrees=True).as_matrix(), np.zeros(3))
    lying = in_l()[0].with_facts(world_from_sensor=rolled @ LYING)
    found = place_on_design(room(L_SHAPE), [lying], up=rolled.rotation[:, 2], n_threads=1)
    assert_right(found.poses[0], in_l()[1])


def test_nothing_to_place_and_nowhere_to_place_it_are_refused():
    with pytest.raises(InputError, match="no scans to place"):
        place_on_design(room(SQUARE), [])
    empty = ElementMesh(LabelledMesh(np.zeros((0, 3)), np.zeros((0, 3), int)), (), "empty")
    with pytest.raises(InputError, match="empty has no surface"):
        place_on_design(empty, [in_l()[0]])
    blind = in_l()[0]
    blind = RangeImage(np.full(blind.ranges.shape, np.inf), blind.projection, LYING, name="blind")
    with pytest.raises(InputError, match="blind: no flat surface"):
        place_on_design(room(SQUARE), [blind])
