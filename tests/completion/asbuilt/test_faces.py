# SPDX-License-Identifier: MIT
"""Faces of a design: planes and cylinders of known size, wherever the design lies."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from completion.asbuilt.faces import find_faces, scale_of
from scenes.mesh.labelled_mesh import LabelledMesh, join_meshes
from scenes.pose import Pose
from tests.completion.asbuilt.designs import boxes, tube

BOX = boxes({"box": ((0, 0, 0), (2, 3, 4))}).mesh
TURNED = Pose.from_parts(Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([40.0, -7.0, 3.0]))


def test_a_box_has_six_planes() -> None:
    faces = find_faces(BOX, 1.0)
    assert len(faces) == 6
    for axis, area in enumerate((12.0, 8.0, 6.0)):
        for sign in (-1.0, 1.0):
            (own,) = np.flatnonzero(faces.normal @ (sign * np.eye(3)[axis]) > 0.999)
            assert faces.area[own] == pytest.approx(area)
            assert faces.centre[own, axis] == pytest.approx((0, 2, 3, 4)[axis + 1] if sign > 0 else 0)
            sides = np.delete([2.0, 3.0, 4.0], axis)
            assert np.sort(2 * faces.half[own]) == pytest.approx(sides)
    assert (faces.sign == 0).all()
    assert (np.bincount(faces.of_triangle) == 2).all()


def test_coplanar_parts_without_common_edges_are_one_plane() -> None:
    """A large triangle pair beside a finer one: their common side has a vertex on one of them alone."""
    vertices = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (4, 0, 0), (4, 1, 0), (4, 2, 0), (2, 1, 0)]
    triangles = [(0, 1, 2), (0, 2, 3), (1, 4, 5), (1, 5, 7), (7, 5, 6), (7, 6, 2)]
    faces = find_faces(LabelledMesh(np.array(vertices, float), np.array(triangles)), 1.0)
    assert faces.area.tolist() == pytest.approx([8.0])
    assert np.sort(faces.half[0]) == pytest.approx([1, 2])


@pytest.mark.parametrize("step_m", [0.001, 0.005])
def test_planes_a_step_apart_are_two(step_m: float) -> None:
    mesh = boxes({"box": ((0, 0, 0), (2, 2, 1))}).mesh
    top = mesh.some(mesh.face_normals()[:, 2] > 0.9)
    vertices = np.vstack([top.vertices, top.vertices + [3.0, 0, step_m]])
    both = LabelledMesh(vertices, np.vstack([top.faces, top.faces + len(top.vertices)]))
    assert len(find_faces(both, 1.0)) == (1 if step_m < 0.002 else 2)


@pytest.mark.parametrize("is_hole", [False, True])
def test_a_prism_of_24_facets_is_a_cylinder(is_hole: bool) -> None:
    faces = find_faces(tube(0.3, 2.0, is_hole=is_hole), 1.0)
    assert faces.sign.tolist() == [-1 if is_hole else 1]
    assert faces.radius[0] == pytest.approx(0.3, rel=1e-6)
    assert np.abs(faces.normal[0]) == pytest.approx([0, 0, 1])
    assert faces.centre[0] == pytest.approx([0, 0, 1])
    assert faces.half[0, 0] == pytest.approx(1.0)
    at = faces.places(np.zeros(2, np.int32), np.array([[0.31, 0, 1.5], [0, 0.29, 0.5]]))
    assert at.distance == pytest.approx([-0.01, 0.01] if is_hole else [0.01, -0.01])


def test_a_square_column_is_no_cylinder() -> None:
    faces = find_faces(tube(0.3, 2.0, n=4), 1.0)
    assert faces.sign.tolist() == [0, 0, 0, 0]


def test_faces_move_with_the_design() -> None:
    here = find_faces(BOX, 1.0)
    there = find_faces(BOX.transform(TURNED), 1.0)
    assert TURNED.rotate(here.normal)[here.of_triangle] == pytest.approx(
        there.normal[there.of_triangle], abs=1e-9
    )
    assert here.area[here.of_triangle] == pytest.approx(there.area[there.of_triangle])
    points = np.random.default_rng(1).normal(size=(12, 3))
    near, far = here.places(here.of_triangle, points), there.places(there.of_triangle, TURNED.apply(points))
    assert near.distance == pytest.approx(far.distance)


@pytest.mark.parametrize("is_round", [False, True])
def test_columns_are_the_derivative_of_the_distance(is_round: bool) -> None:
    """What is measured moves with the face: along u of a cylinder, along the normal of a plane."""
    mesh, step = tube(0.3, 2.0) if is_round else BOX, 1e-6
    faces = find_faces(mesh, 1.0)
    held, points = faces.of_triangle, mesh.corners.mean(axis=1)
    at = faces.places(held, points)
    ways = faces.u if is_round else faces.normal
    change = faces.places(held, points + step * ways[held]).distance - at.distance
    assert change == pytest.approx(step * at.columns[:, 0], abs=1e-4 * step)


def test_glass_and_slivers_have_no_face() -> None:
    rod = ((3, 0, 0), (3.03, 0.03, 2))
    solids = {"wall": ((0, 0, 0), (0.2, 3, 2)), "pane": ((1, 0, 0), (1.01, 3, 2)), "rod": rod}
    faces = find_faces(boxes(solids, glass=("pane",)).mesh, 1.0)
    assert set(faces.element.tolist()) == {0}


def test_small_parts_have_small_limits() -> None:
    part = BOX.at(BOX.vertices * 0.01)
    assert scale_of(part) == pytest.approx(np.sqrt(29) * 0.01 / 5)
    assert len(find_faces(part, scale_of(part))) == 6
    assert len(find_faces(part, 1.0)) == 0
    assert scale_of(BOX) == 1.0


def facets(n, rng, slope):
    """A sheet of n x n squares that undulates by steps of about so many degrees: patches beside patches."""
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.arange(n + 1.0)] * 2, indexing="ij"))
    z = np.cumsum(rng.normal(size=(n + 1, n + 1)) * np.radians(slope), axis=0).ravel()
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    triangles = np.concatenate([np.stack([a, a + n + 1, a + n + 2], 1), np.stack([a, a + n + 2, a + 1], 1)])
    return LabelledMesh(np.column_stack([x, y, z]), triangles)


@pytest.mark.parametrize("slope", [0.3, 0.8])
def test_elements_have_the_faces_that_each_has_alone(slope: float) -> None:
    parts = [facets(6, np.random.default_rng(k), slope) for k in range(5)]
    parts += [tube(0.3, 2.0), BOX, LabelledMesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))]
    numbered = [
        LabelledMesh(part.vertices + [k, 0, 0], part.faces, np.full(len(part.faces), k))
        for k, part in enumerate(parts)
    ]
    together = find_faces(join_meshes(numbered), 1.0)
    alone = [find_faces(part, 1.0) for part in parts]
    for k, own in enumerate(alone):
        mine = together.element == k
        order = [np.lexsort(np.round(f, 6).T) for f in (together.centre[mine] - [k, 0, 0], own.centre)]
        assert mine.sum() == len(own)
        assert together.area[mine][order[0]] == pytest.approx(own.area[order[1]])
        assert together.half[mine][order[0]] == pytest.approx(own.half[order[1]])


def test_corners_of_planes_are_near_them_and_no_other_patch_is() -> None:
    """Each plane holds all that lies in it of what larger planes left; what is in none is no plane."""
    mesh = facets(12, np.random.default_rng(3), 0.6)
    faces, normals = find_faces(mesh, 1.0), mesh.face_normals()
    assert 5 < len(faces) < 2 * 12 * 12
    free = np.ones(len(normals), np.bool_)
    for number in range(len(faces)):
        own = faces.of_triangle == number
        off = np.abs((mesh.corners - faces.centre[number]) @ faces.normal[number]).max(axis=1)
        assert off[own].max() < 0.004
        assert (normals[own] @ faces.normal[number]).min() > np.cos(np.radians(2.0))
        like = free & (normals @ faces.normal[number] > np.cos(np.radians(0.9))) & (off < 0.0005)
        assert (faces.of_triangle[like] == number).all()
        free[own] = False
