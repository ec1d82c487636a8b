# SPDX-License-Identifier: MIT
"""Scenes: labels name surfaces, and everything moves together."""

import numpy as np
import pytest
from hypothesis import given

from scenes.checks import InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.surfaces.catalogue import Plane, surfaces_close
from scenes.surfaces.surface import Opening
from scenes.world.scene import Scene
from tests.helpers.strategies import ROUNDING_M, law, poses

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
FLOOR = Plane((0, 0, 0), (0, 0, 1))


def scene_of(labels: list[int]) -> Scene:
    mesh = LabelledMesh(VERTICES, FACES, np.array(labels))
    return Scene(mesh, (FLOOR, None), ("floor", "clutter"), "square", "object", ("mended",))


@law
@given(poses())
def test_mesh_and_surfaces_move_together(pose: Pose) -> None:
    moved = scene_of([0, 1]).transform(pose)
    floor = moved.surfaces[0]
    assert isinstance(floor, Plane)
    assert moved.surfaces[1] is None
    np.testing.assert_allclose(floor.distance(moved.mesh.vertices), 0, atol=ROUNDING_M)
    assert surfaces_close(floor, FLOOR.transform(pose), angle=1e-12, length=1e-12)
    assert (moved.name, moved.mode, moved.warnings) == ("square", "object", ("mended",))
    assert moved.surface_names == ("floor", "clutter")


def test_a_scene_prepares_its_mesh_for_rays() -> None:
    caster = scene_of([0, 1]).ray_caster(n_threads=1)
    assert caster.n_faces == 2
    assert caster.first_hit([[0.2, 0.7, 3.0]], [[0, 0, -1]]).ranges.tolist() == [3.0]
    with pytest.raises(InputError, match="n_threads must be at least 1"):
        scene_of([0, 1]).ray_caster(n_threads=0)


@pytest.mark.parametrize("bad", [-1, 2, 7])
def test_a_face_names_a_surface_that_there_is(bad: int) -> None:
    with pytest.raises(InputError, match=f"^faces name surface {bad}, but there are 2 surfaces$"):
        scene_of([1, bad])


def test_every_surface_has_a_name() -> None:
    with pytest.raises(InputError, match="1 surfaces but 2 names"):
        Scene(LabelledMesh(VERTICES, FACES), (FLOOR,), ("floor", "wall"), "square")


def test_a_scene_without_faces_is_a_scene() -> None:
    nothing = Scene(LabelledMesh(np.zeros((0, 3)), np.zeros((0, 3), int)), (), (), "nothing")
    assert nothing.ray_caster().n_faces == 0
    assert nothing.mode == "room"


def test_openings_move_with_their_wall_and_name_a_surface() -> None:
    mesh = LabelledMesh(VERTICES, FACES)
    hatch = Opening(0, VERTICES / 2)
    scene = Scene(mesh, (FLOOR,), ("floor",), "square", openings=(hatch,))
    pose = Pose.looking_at((1, 2, 3), (3, 1, 0))
    np.testing.assert_allclose(scene.transform(pose).openings[0].outline, pose.apply(VERTICES / 2))
    with pytest.raises(InputError, match="an opening names surface 3, but there are 1 surfaces"):
        Scene(mesh, (FLOOR,), ("floor",), "square", openings=(Opening(3, VERTICES),))
