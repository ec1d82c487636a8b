# SPDX-License-Identifier: MIT
"""Parts are closed, face outwards (or inwards), lie on their surfaces and carry their textures to scale."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenes.checks import FloatArray, InputError
from scenes.surfaces.catalogue import Cylinder, Plane
from scenes.world.builtin import Finish, SceneBuilder
from scenes.world.scene import Scene
from tests.helpers.strategies import EPS, directions, law, vectors

GREY = Finish((0.5, 0.5, 0.5))


def box(*, inward: bool = False) -> Scene:
    build = SceneBuilder("box", "object")
    build.add_box("crate", (1, 2, 3), (2, 4, 6), GREY, inward=inward)
    return build.finish()


def column(caps: bool = True) -> Scene:
    build = SceneBuilder("column", "object")
    build.add_cylinder("column", (1, 2, 3), (0, 0, 2), 0.5, GREY, caps=caps)
    return build.finish()


def signed_volume(scene: Scene) -> float:
    a, b, c = np.moveaxis(scene.mesh.corners, 1, 0)
    return float(np.einsum("ni,ni->", np.cross(a, b), c) / 6)


def open_edges(scene: Scene) -> int:
    """Edges that are not used as often in one direction as in the other."""
    faces = scene.mesh.faces
    used: dict[tuple[int, int], int] = {}
    for a, b in np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).tolist():
        used[(min(a, b), max(a, b))] = used.get((min(a, b), max(a, b)), 0) + (1 if a < b else -1)
    return sum(balance != 0 for balance in used.values())


def test_a_box_is_closed_and_faces_outwards_or_inwards() -> None:
    for inward, sign in ((False, 1), (True, -1)):
        scene = box(inward=inward)
        assert open_edges(scene) == 0
        np.testing.assert_allclose(signed_volume(scene), sign * 6.0, rtol=1e-12)
        assert scene.mesh.bounds().tolist() == [[1, 2, 3], [2, 4, 6]]
        assert len(scene.mesh.vertices) == 8


def test_the_sides_of_a_box_have_names_that_fit() -> None:
    scene = box()
    expected = {
        "west": (-1, 0, 0), "east": (1, 0, 0), "south": (0, -1, 0),
        "north": (0, 1, 0), "bottom": (0, 0, -1), "top": (0, 0, 1),
    }  # fmt: skip
    for name, surface in zip(scene.surface_names, scene.surfaces, strict=True):
        assert isinstance(surface, Plane)
        np.testing.assert_allclose(surface.normal_direction, expected[name.removeprefix("crate ")], atol=EPS)


def test_a_cylinder_with_caps_is_closed_and_faces_outwards() -> None:
    scene = column()
    assert open_edges(scene) == 0
    full = np.pi * 0.5**2 * 2
    assert 0 < full - signed_volume(scene) < full * 2e-4  # 256 facets: (2 pi / 256)^2 / 6 = 1e-4
    assert scene.surface_names == ("column", "column foot", "column head")
    bare = column(caps=False)
    assert bare.surface_names == ("column",)
    assert open_edges(bare) == 512


@law
@given(vectors, directions, st.floats(0.05, 2.0))
def test_a_cylinder_in_any_direction_is_closed_and_true(
    foot: FloatArray, axis: FloatArray, radius: float
) -> None:
    build = SceneBuilder("post", "object")
    build.add_cylinder("post", foot, axis, radius, GREY)
    scene = build.finish()
    mesh = scene.mesh
    for index, surface in enumerate(scene.surfaces):
        assert isinstance(surface, (Plane, Cylinder))
        faces = mesh.face_surface == index
        corners = mesh.corners[faces]
        # Vertices are rounded to 1e-12 m so that parts share them.
        assert np.abs(surface.distance(corners.reshape(-1, 3))).max() < 2e-12
        normals = surface.normal(corners.mean(axis=1))
        assert np.einsum("ni,ni->n", normals, mesh.face_normals()[faces]).min() > 0.999
    np.testing.assert_allclose(
        signed_volume(scene), np.pi * radius**2 * np.linalg.norm(axis), rtol=3e-4, atol=1e-9
    )


def test_a_textures_repetition_measures_its_size_on_the_surface() -> None:
    image = np.zeros((10, 20, 3), np.uint8)
    build = SceneBuilder("wall", "object")
    build.add_rectangle("wall", (1, 0, 0), (4, 0, 0), (0, 0, 3), Finish((1, 0.5, 0.25), image, size_m=2.0))
    build.add_rectangle("floor", (1, 0, 0), (0, -4, 0), (4, 0, 0), GREY)
    look = build.finish().mesh.appearance
    assert look is not None
    assert look.face_image is not None
    assert look.corner_uv is not None
    assert look.face_image.tolist() == [0, 0, -1, -1]
    # 2 m wide, and 1 m high since the image is twice as wide as high: 4 x 3 m hold 2 x 3 repetitions.
    assert look.corner_uv[0].tolist() == [[0, 0], [2, 0], [2, 3]]
    assert look.corner_uv[1].tolist() == [[0, 0], [2, 3], [0, 3]]
    assert look.corner_colour[0].tolist() == [[1, 0.5, 0.25]] * 3
    assert look.corner_colour[2].tolist() == [[0.5, 0.5, 0.5]] * 3


def test_parts_with_one_image_share_it() -> None:
    image = np.zeros((10, 20, 3), np.uint8)
    build = SceneBuilder("walls", "object")
    for x in range(3):
        build.add_rectangle(f"wall {x}", (x, 0, 0), (0, 1, 0), (0, 0, 1), Finish((1, 1, 1), image))
    look = build.finish().mesh.appearance
    assert look is not None
    assert len(look.images) == 1


def test_a_texture_around_a_cylinder_follows_its_chart() -> None:
    image = np.zeros((8, 8, 3), np.uint8)
    build = SceneBuilder("post", "object")
    build.add_cylinder("post", (0, 0, 0), (0, 0, 3), 0.5, Finish((1, 1, 1), image, size_m=0.5), caps=False)
    scene = build.finish()
    look, surface = scene.mesh.appearance, scene.surfaces[0]
    assert look is not None
    assert look.corner_uv is not None
    assert isinstance(surface, Cylinder)
    placed = surface.from_uv(look.corner_uv.reshape(-1, 2).astype(np.float64) * 0.5)
    # float32 texture coordinates of up to 6 repetitions of 0.5 m
    np.testing.assert_allclose(placed, scene.mesh.corners.reshape(-1, 3), atol=1e-6)
    assert np.ptp(look.corner_uv[:, :, 0], axis=1).max() < 0.1  # no face spans the seam


def test_a_turned_box_is_the_box_turned_about_its_middle() -> None:
    build = SceneBuilder("box", "object")
    build.add_box("crate", (1, 2, 3), (2, 4, 6), GREY, yaw=0.3)
    scene, straight = build.finish(), box()
    np.testing.assert_allclose(signed_volume(scene), 6.0, rtol=1e-12)
    assert open_edges(scene) == 0
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]])
    middle = np.array([1.5, 3.0, 3.0])
    expected = (straight.mesh.corners - middle) @ turn.T + middle
    np.testing.assert_allclose(scene.mesh.corners, expected, atol=2e-12)  # vertices are rounded


def test_a_panel_is_a_rectangle_less_its_openings() -> None:
    build = SceneBuilder("wall", "object")
    holes = [(0.5, 0.0, 1.5, 2.0), (2.0, 1.0, 3.0, 2.2)]
    build.add_panel("wall", (1, 0, 0), (4, 0, 0), (0, 0, 3), GREY, holes)
    scene = build.finish()
    np.testing.assert_allclose(scene.mesh.face_areas().sum(), 12 - 2 - 1.2, rtol=1e-12)
    assert [opening.surface for opening in scene.openings] == [0, 0]
    np.testing.assert_allclose(
        scene.openings[1].outline, [[3, 0, 1], [4, 0, 1], [4, 0, 2.2], [3, 0, 2.2]], atol=1e-12
    )
    through = [[1.0 + (u0 + u1) / 2, -1.0, (v0 + v1) / 2] for u0, v0, u1, v1 in holes]
    assert not scene.ray_caster().first_hit(through, [[0, 1.0, 0]] * 2).hit.any()
    beside = scene.ray_caster().first_hit([[1.2, -1.0, 1.0], [4.5, -1, 2.5]], [[0, 1.0, 0]] * 2)
    assert beside.hit.all()


def test_what_fills_a_hole_makes_it_no_opening() -> None:
    build = SceneBuilder("wall", "object")
    build.add_panel("wall", (0, 0, 0), (4, 0, 0), (0, 0, 3), GREY, [(1, 0, 2, 3)], are_openings=False)
    scene = build.finish()
    assert scene.openings == ()
    np.testing.assert_allclose(scene.mesh.face_areas().sum(), 9, rtol=1e-12)


def test_half_a_column_looks_the_way_it_faces() -> None:
    build = SceneBuilder("column", "object")
    build.add_cylinder("column", (1, 2, 0), (0, 0, 2), 0.5, GREY, facing=(0, -1, 0))
    scene = build.finish()
    assert scene.mesh.bounds()[:, 1].tolist() == pytest.approx([1.5, 2.0])
    side = scene.mesh.face_surface == 0
    np.testing.assert_allclose(scene.mesh.face_areas()[side].sum(), np.pi * 0.5 * 2, rtol=1e-4)
    np.testing.assert_allclose(scene.mesh.face_areas()[~side].sum(), np.pi * 0.5**2, rtol=2e-4)
    assert (scene.mesh.face_normals()[side][:, 1] < 0.01).all()


def test_parts_without_area_are_refused() -> None:
    build = SceneBuilder("nothing", "object")
    with pytest.raises(InputError, match=r"normal has length 0\.0"):
        build.add_rectangle("line", (0, 0, 0), (1, 0, 0), (2, 0, 0), GREY)
    with pytest.raises(InputError, match=r"direction has length 0\.0"):
        build.add_cylinder("disc", (0, 0, 0), (0, 0, 0), 1.0, GREY)
    with pytest.raises(InputError, match="radius must be a positive number"):
        build.add_cylinder("thread", (0, 0, 0), (0, 0, 1), 0.0, GREY)
