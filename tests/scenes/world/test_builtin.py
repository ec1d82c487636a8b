# SPDX-License-Identifier: MIT
"""Built-in scenes are what their true surfaces say, always the same, and of the published geometry."""

import numpy as np
import pytest

from scenes.checks import FloatArray, InputError
from scenes.surfaces.catalogue import Cylinder, Plane
from scenes.world.builtin import builtin_names, builtin_scene
from scenes.world.scene import Scene
from tests.helpers.data_paths import bench_path, requires_bench

SCENES = {name: builtin_scene(name) for name in builtin_names()}
every_scene = pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())


def test_the_papers_scenes_are_built_in() -> None:
    assert builtin_names()[0] == "two_occluders"
    figures = {"chair_before_wall", "two_cylinders", "textured_cylinder", "engaged_column", "pipe_rack"}
    assert figures | {"office", "drum_and_post"} <= set(builtin_names())


def test_an_unknown_scene_is_answered_with_the_known_ones() -> None:
    with pytest.raises(InputError) as error:
        builtin_scene("kitchen")
    assert str(error.value) == (
        f"no built-in scene is called 'kitchen'; there are {', '.join(builtin_names())}"
    )


@every_scene
def test_a_scene_knows_its_name_and_mode(scene: Scene) -> None:
    assert SCENES[scene.name] is scene
    assert scene.mode in ("room", "object")
    assert scene.warnings == ()
    assert len(set(scene.surface_names)) == len(scene.surface_names)
    assert np.unique(scene.mesh.face_surface).tolist() == list(range(len(scene.surfaces)))


@every_scene
def test_faces_lie_on_their_true_surfaces_and_face_as_they_do(scene: Scene) -> None:
    mesh = scene.mesh
    assert mesh.face_areas().min() > 0
    normals = mesh.face_normals()
    for index, surface in enumerate(scene.surfaces):
        faces = mesh.face_surface == index
        corners = mesh.corners[faces]
        assert isinstance(surface, (Plane, Cylinder))
        # Vertices are rounded to 1e-12 m so that parts share them.
        assert np.abs(surface.distance(corners.reshape(-1, 3))).max() < 2e-12
        agreement = np.einsum("ni,ni->n", surface.normal(corners.mean(axis=1)), normals[faces])
        assert agreement.min() > (1 - 1e-9 if isinstance(surface, Plane) else 0.999)


@every_scene
def test_scenes_stand_on_the_floor_with_z_up(scene: Scene) -> None:
    floor = scene.surfaces[scene.surface_names.index("floor")]
    assert isinstance(floor, Plane)
    assert floor.normal_direction.tolist() == [0, 0, 1]
    inside = [index for index, name in enumerate(scene.surface_names) if name != "outside"]
    assert scene.mesh.corners[np.isin(scene.mesh.face_surface, inside)][..., 2].min() == 0.0


@every_scene
def test_a_scene_has_the_same_bytes_every_time(scene: Scene) -> None:
    again = builtin_scene(scene.name)
    assert again.mesh.vertices.tobytes() == scene.mesh.vertices.tobytes()
    assert again.mesh.faces.tobytes() == scene.mesh.faces.tobytes()
    assert again.mesh.face_surface.tobytes() == scene.mesh.face_surface.tobytes()
    first, second = scene.mesh.appearance, again.mesh.appearance
    assert first is not None
    assert second is not None
    assert [image.tobytes() for image in first.images] == [image.tobytes() for image in second.images]
    for name in ("corner_colour", "face_image", "corner_uv"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


@every_scene
def test_textures_have_structure_and_repeat_without_a_seam(scene: Scene) -> None:
    look = scene.mesh.appearance
    assert look is not None
    assert look.images
    for image in look.images:
        assert image.dtype == np.uint8
        levels = image.astype(float)
        assert levels.std() > 10
        for axis in (0, 1):
            ends = np.take(levels, 0, axis) - np.take(levels, -1, axis)
            assert (ends == 0).all()  # mirrored: the last row is the first


@every_scene
def test_colours_lie_between_0_and_1(scene: Scene) -> None:
    look = scene.mesh.appearance
    assert look is not None
    rng = np.random.default_rng(0)
    faces = rng.integers(0, len(scene.mesh.faces), 5000).astype(np.int32)
    colours = look.colour(faces, rng.dirichlet([1, 1, 1], 5000))
    assert colours.min() >= 0
    assert colours.max() <= 1
    assert colours.std() > 0.05


def triangle_set(corners: FloatArray) -> set[bytes]:
    """Triangles as their corner points, whatever their order."""
    return {np.array(sorted(triangle)).tobytes() for triangle in corners.round(9).tolist()}


def distance_to_box(points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Signed distance to the surface of a box, negative inside."""
    q = np.abs(points - (np.array(low) + high) / 2) - (np.array(high) - low) / 2
    outside = np.linalg.norm(np.maximum(q, 0), axis=-1)
    return np.asarray(outside + np.minimum(q.max(axis=-1), 0.0), np.float64)


BOXES = {
    "room": ((0, 0, 0), (6, 5, 2.7)),
    "low": ((1.5, 1.5, 0), (2.9, 2.5, 0.9)),
    "tall": ((4.0, 2.8, 0), (4.7, 3.5, 1.8)),
}


def free_points(n: int) -> FloatArray:
    """Points in the room's air."""
    points = np.random.default_rng(1).uniform([0, 0, 0], [6, 5, 2.7], (n, 3))
    air = [distance_to_box(points, *BOXES[name]) > 1e-3 for name in ("low", "tall")]
    return points[air[0] & air[1] & (distance_to_box(points, *BOXES["room"]) < -1e-3)]


def test_the_room_is_closed_and_its_rays_meet_boxes_and_walls() -> None:
    scene = SCENES["two_occluders"]
    origins = free_points(20_000)
    along = np.random.default_rng(2).normal(size=origins.shape)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    hits = scene.ray_caster().first_hit(origins, along)
    assert hits.hit.all()
    expected = np.full(len(origins), np.inf)
    for name, (low, high) in BOXES.items():
        with np.errstate(divide="ignore"):
            one, other = (np.array(low) - origins) / along, (np.array(high) - origins) / along
        enters, leaves = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
        met = leaves if name == "room" else np.where((enters < leaves) & (enters > 0), enters, np.inf)
        expected = np.minimum(expected, met)
    agrees = np.abs(hits.ranges - expected) < 1e-9
    assert agrees.mean() > 0.9995  # beside a silhouette float32 may decide otherwise


def test_the_room_is_seen_from_its_front_sides_only() -> None:
    scene = SCENES["two_occluders"]
    origins = free_points(5000)
    along = np.random.default_rng(3).normal(size=origins.shape)
    hits = scene.ray_caster().first_hit(origins, along)
    assert (np.einsum("ni,ni->n", along, scene.mesh.face_normals()[hits.face]) < 0).mean() > 0.9995


@requires_bench
def test_the_room_is_that_of_the_benchmark() -> None:
    bench = np.load(bench_path("room_candidates.npz"))
    scene = SCENES["two_occluders"]
    published = bench["vertices"][bench["faces"]]
    low, high = published.min(axis=(0, 1)), published.max(axis=(0, 1))
    assert scene.mesh.bounds().tolist() == [low.tolist(), high.tolist()]
    corners = {tuple(point) for point in published.reshape(-1, 3).round(9).tolist()}
    assert {tuple(point) for point in scene.mesh.vertices.round(9).tolist()} == corners
    areas = (
        np.linalg.norm(np.cross(published[:, 1] - published[:, 0], published[:, 2] - published[:, 0]), axis=1)
        / 2
    )
    np.testing.assert_allclose(scene.mesh.face_areas().sum(), areas.sum(), rtol=1e-12)
    ours, theirs = scene.ray_caster(), type(scene.ray_caster())(bench["vertices"], bench["faces"])
    origins = free_points(20_000)
    along = np.random.default_rng(4).normal(size=origins.shape)
    difference = np.abs(ours.first_hit(origins, along).ranges - theirs.first_hit(origins, along).ranges)
    assert (difference < 1e-9).mean() > 0.9995


@requires_bench
def test_the_benchmarks_patches_lie_on_the_room_and_face_the_air() -> None:
    bench = np.load(bench_path("room_candidates.npz"))
    scene = SCENES["two_occluders"]
    points, normals = bench["patch_points"], bench["patch_normals"]
    contact = [np.abs(distance_to_box(points, *BOXES[name])) < 1e-9 for name in ("low", "tall")]
    clear = ~((contact[0] | contact[1]) & (normals[:, 2] == 1) & (points[:, 2] == 0))
    points, normals = points[clear], normals[clear]  # where a box meets the floor, either may be named
    assert len(points) > 3000
    hits = scene.ray_caster().first_hit(points + 0.01 * normals, -normals)
    np.testing.assert_allclose(hits.ranges, 0.01, atol=1e-9)
    assert (np.einsum("ni,ni->n", scene.mesh.face_normals()[hits.face], normals) > 1 - 1e-12).all()
