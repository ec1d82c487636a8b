# SPDX-License-Identifier: MIT
"""Meshes: areas, normals, bounds, what faces look like, and which arrays make no mesh."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given

from scenes.checks import FloatArray, InputError
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.pose import Pose
from tests.helpers.strategies import EPS, ROUNDING_M, law, poses, seeds

VERTICES = np.array([[0, 0, 0], [3, 0, 0], [3, 4, 0], [0, 0, 2]], float)
FACES = np.array([[0, 1, 2], [0, 3, 1], [2, 2, 3]])


def test_areas_and_normals_of_known_triangles() -> None:
    mesh = LabelledMesh(VERTICES, FACES)
    assert mesh.face_areas().tolist() == [6, 3, 0]
    assert mesh.face_normals().tolist() == [[0, 0, 1], [0, 1, 0], [0, 0, 0]]
    assert mesh.bounds().tolist() == [[0, 0, 0], [3, 4, 2]]
    assert mesh.corners.shape == (3, 3, 3)
    assert mesh.corners[1].tolist() == [[0, 0, 0], [0, 0, 2], [3, 0, 0]]
    assert mesh.face_surface.tolist() == [0, 0, 0]


@law
@given(poses(), seeds)
def test_moving_a_mesh_keeps_areas_and_turns_normals(pose: Pose, seed: int) -> None:
    rng = np.random.default_rng(seed)
    labels = rng.integers(0, 5, 10)
    mesh = LabelledMesh(rng.uniform(-9, 9, (20, 3)), rng.integers(0, 20, (10, 3)), labels)
    moved = mesh.transform(pose)
    np.testing.assert_allclose(moved.vertices, pose.apply(mesh.vertices), atol=0, rtol=0)
    np.testing.assert_allclose(moved.face_areas(), mesh.face_areas(), atol=40 * ROUNDING_M, rtol=0)
    solid = mesh.face_areas() > 1
    expected = pose.rotate(mesh.face_normals())[solid]
    np.testing.assert_allclose(moved.face_normals()[solid], expected, atol=40 * ROUNDING_M, rtol=0)
    assert (moved.faces == mesh.faces).all()
    assert (moved.face_surface == labels).all()


@law
@given(seeds)
def test_turning_faces_around_turns_their_normals(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, faces = rng.uniform(-9, 9, (20, 3)), rng.integers(0, 20, (10, 3))
    normals = LabelledMesh(vertices, faces).face_normals()
    around = LabelledMesh(vertices, faces[:, ::-1]).face_normals()
    np.testing.assert_allclose(around, -normals, atol=1e-12)
    lengths = np.linalg.norm(normals, axis=1)
    assert (np.isclose(lengths, 1, atol=4 * EPS) | (lengths == 0)).all()


def test_a_mesh_is_a_frozen_copy() -> None:
    vertices, faces, labels = VERTICES.copy(), FACES.copy(), np.array([1, 2, 3])
    mesh = LabelledMesh(vertices, faces, labels)
    vertices[0], faces[0], labels[0] = 9, 0, 9
    assert mesh.bounds().tolist() == [[0, 0, 0], [3, 4, 2]]
    assert mesh.faces[0].tolist() == [0, 1, 2]
    assert mesh.face_surface.tolist() == [1, 2, 3]
    for array in (mesh.vertices, mesh.faces, mesh.face_surface):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(FrozenInstanceError):
        mesh.vertices = vertices  # type: ignore[misc]


def test_a_mesh_may_be_empty_but_has_no_bounds_then() -> None:
    empty = LabelledMesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    assert empty.face_areas().shape == (0,)
    assert empty.face_normals().shape == (0, 3)
    with pytest.raises(InputError, match="a mesh without vertices has no bounds"):
        empty.bounds()


def test_what_makes_no_mesh_is_refused() -> None:
    broken = VERTICES.copy()
    broken[[1, 3], 0] = np.nan
    with pytest.raises(InputError, match=r"2 of 4 vertices are not finite \(first at row 1\)"):
        LabelledMesh(broken, FACES)
    with pytest.raises(InputError, match=r"face 1 is \[0, 4, 1\], but there are 4 vertices \(1 such faces\)"):
        LabelledMesh(VERTICES, np.array([[0, 1, 2], [0, 4, 1]]))
    with pytest.raises(InputError, match=r"expected face_surface with shape \(3,\), got \(2,\)"):
        LabelledMesh(VERTICES, FACES, np.array([0, 1]))
    with pytest.raises(InputError, match=r"expected face_surface with shape \(3,\), got \(3, 1\)"):
        LabelledMesh(VERTICES, FACES, np.zeros((3, 1), int))
    grey = Appearance(np.full((2, 3, 3), 0.5, np.float32))
    with pytest.raises(InputError, match="2 faces have colours, but there are 3"):
        LabelledMesh(VERTICES, FACES, appearance=grey)


COLOUR = 1.2e-7  # colours are float32
CORNER_WEIGHTS = np.eye(3)
ONE_FACE = np.zeros(3, np.int32)


def test_corner_colours_are_interpolated() -> None:
    colours = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0.5, 0.5, 0.5]] * 3], np.float32)
    look = Appearance(colours)
    assert (look.colour(ONE_FACE, CORNER_WEIGHTS) == colours[0]).all()
    weights = np.array([[0.5, 0.25, 0.25], [0.2, 0.3, 0.5]])
    np.testing.assert_allclose(
        look.colour(np.array([0, 1], np.int32), weights), [[0.5, 0.25, 0.25], [0.5, 0.5, 0.5]], atol=COLOUR
    )
    assert look.colour(np.zeros(0, np.int32), np.zeros((0, 3))).shape == (0, 3)


def textured(image: FloatArray, uv: FloatArray, tint: float = 1.0) -> FloatArray:
    """Colours of a texture at coordinates (n, 2): the first corner of n faces each."""
    n = len(uv)
    corner_uv = np.repeat(np.asarray(uv, np.float32)[:, None], 3, axis=1)
    look = Appearance(
        np.full((n, 3, 3), tint, np.float32),
        (np.asarray(image, np.uint8),),
        np.zeros(n, np.int32),
        corner_uv,
    )
    return look.colour(np.arange(n, dtype=np.int32), np.tile([1.0, 0, 0], (n, 1)))


IMAGE = np.arange(2 * 4 * 3).reshape(2, 4, 3) * 10  # 2 rows, 4 columns


def test_pixel_centres_have_their_pixels_colours_and_v_runs_upwards() -> None:
    row, column = np.mgrid[:2, :4].reshape(2, -1)
    uv = np.column_stack([(column + 0.5) / 4, 1 - (row + 0.5) / 2])
    np.testing.assert_allclose(textured(IMAGE, uv), IMAGE.reshape(-1, 3) / 255, atol=COLOUR)


@law
@given(seeds)
def test_textures_repeat(seed: int) -> None:
    rng = np.random.default_rng(seed)
    uv = rng.integers(0, 64, (50, 2)) / 64  # exact in float32, also some turns on
    turns = rng.integers(-5, 6, (50, 2))
    np.testing.assert_allclose(textured(IMAGE, uv + turns), textured(IMAGE, uv), atol=COLOUR)


def test_between_pixels_colours_are_bilinear_also_across_the_seam() -> None:
    between_columns = textured(IMAGE, np.array([[0.25, 0.75], [0.0, 0.75], [1.0, 0.75]]))
    seam = (IMAGE[0, 3] + IMAGE[0, 0]) / 2
    np.testing.assert_allclose(
        between_columns * 255, [(IMAGE[0, 0] + IMAGE[0, 1]) / 2, seam, seam], atol=255 * COLOUR
    )
    between_rows = textured(IMAGE, np.array([[0.125, 0.5], [0.125, 0.0]]))
    np.testing.assert_allclose(between_rows * 255, [(IMAGE[0, 0] + IMAGE[1, 0]) / 2] * 2, atol=255 * COLOUR)


def test_a_tint_multiplies_the_texture() -> None:
    uv = np.array([[0.3, 0.4], [0.9, 0.1]])
    np.testing.assert_allclose(textured(IMAGE, uv, tint=0.5), textured(IMAGE, uv) / 2, atol=4 * EPS)


def test_each_face_has_its_own_texture_or_none() -> None:
    black, white = np.zeros((1, 1, 3), np.uint8), np.full((1, 1, 3), 255, np.uint8)
    face_image = np.array([1, -1, 0], np.int32)
    look = Appearance(
        np.full((3, 3, 3), 0.25, np.float32), (black, white), face_image, np.zeros((3, 3, 2), np.float32)
    )
    colours = look.colour(np.arange(3, dtype=np.int32), np.full((3, 3), 1 / 3))
    np.testing.assert_allclose(colours, [[0.25] * 3, [0.25] * 3, [0.0] * 3], atol=4 * EPS)


def test_an_appearance_is_a_frozen_copy() -> None:
    colour, image = np.zeros((1, 3, 3), np.float32), np.zeros((2, 2, 3), np.uint8)
    look = Appearance(colour, (image,), np.zeros(1, np.int32), np.zeros((1, 3, 2), np.float32))
    colour[:], image[:] = 1, 255
    assert look.corner_colour.max() == 0
    assert look.images[0].max() == 0
    for array in (look.corner_colour, look.images[0], look.face_image, look.corner_uv):
        assert array is not None
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_what_makes_no_appearance_is_refused() -> None:
    colour, image = np.zeros((2, 3, 3), np.float32), np.zeros((2, 2, 3), np.uint8)
    uv = np.zeros((2, 3, 2), np.float32)
    with pytest.raises(InputError, match=r"expected corner_colour with shape \(2, 3, 3\), got \(2, 3\)"):
        Appearance(colour[:, 0])
    with pytest.raises(InputError, match=r"expected face_image with shape \(2,\), got \(3,\)"):
        Appearance(colour, (image,), np.zeros(3, np.int32), uv)
    with pytest.raises(InputError, match=r"expected corner_uv with shape \(2, 3, 2\), got \(2, 2\)"):
        Appearance(colour, (image,), np.zeros(2, np.int32), uv[:, 0])
    with pytest.raises(InputError, match="faces name image 1, but there are 1 images"):
        Appearance(colour, (image,), np.array([-1, 1], np.int32), uv)
    for bad in (image[..., 0], image.astype(np.float32), np.zeros((2, 2, 4), np.uint8), image[:0]):
        with pytest.raises(InputError, match=r"expected image 1 as \(h, w, 3\) uint8, got"):
            Appearance(colour, (image, bad))  # type: ignore[arg-type]
