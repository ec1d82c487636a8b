# SPDX-License-Identifier: MIT
"""Scene files: geometry, names, colours and textures survive; mode and up axis; damage is named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from scenes.checks import InputError
from scenes.io.scene_files import load_scene, open_scene, save_scene
from scenes.mesh.appearance import srgb_from_linear
from scenes.mesh.orientation import decide_mode, suggest_up, world_from_file_up
from tests.helpers.data_paths import data_path, requires_data


def box(extents: tuple[float, float, float] = (1.0, 2.0, 3.0)) -> Any:
    return trimesh.creation.box(extents=extents)


def room() -> Any:
    mesh = box((6.0, 5.0, 2.7))
    mesh.invert()
    return mesh


Z_UP = "the geometry shows that z is up, though glTF says y: z was taken; --up y says otherwise"


@pytest.mark.parametrize("suffix", ["glb", "obj", "ply", "stl", "off"])
def test_geometry_survives_every_suffix(tmp_path: Path, suffix: str) -> None:
    box().export(tmp_path / f"thing.{suffix}")
    scene = load_scene(tmp_path / f"thing.{suffix}", up="z")
    assert (scene.name, scene.mode, scene.surfaces) == ("thing", "object", (None,))
    np.testing.assert_allclose(scene.mesh.bounds(), [[-0.5, -1, -1.5], [0.5, 1, 1.5]], atol=1e-6)
    assert scene.mesh.face_areas().sum() == pytest.approx(22.0, rel=1e-5)
    outward = np.einsum("ij,ij->i", scene.mesh.face_normals(), scene.mesh.corners.mean(axis=1))
    assert (outward > 0).all()
    assert scene.warnings == ()


@pytest.mark.parametrize(
    ("up", "bounds"), [("x", [2, 3, 1]), ("y", [1, 3, 2]), ("z", [1, 2, 3])], ids=["x", "y", "z"]
)
def test_up_turns_without_mirroring(tmp_path: Path, up: Any, bounds: list[float]) -> None:
    box().export(tmp_path / "a.ply")
    scene = load_scene(tmp_path / "a.ply", up=up, units="cm")
    np.testing.assert_allclose(np.diff(scene.mesh.bounds(), axis=0)[0], np.array(bounds) / 100, rtol=1e-6)
    assert np.linalg.det(world_from_file_up(up).rotation) == pytest.approx(1)
    with pytest.raises(InputError, match="unknown up axis 'w'; known: x, y, z"):
        load_scene(tmp_path / "a.ply", up="w")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="unknown units 'yd'"):
        load_scene(tmp_path / "a.ply", units="yd")  # type: ignore[arg-type]


def test_scene_graphs_are_flattened_with_their_transforms_and_names(tmp_path: Path) -> None:
    graph = trimesh.Scene()
    graph.add_geometry(box(), node_name="table", geom_name="cube")
    mirrored = trimesh.transformations.translation_matrix([10, 0, 0])
    mirrored[0, 0] = -1
    graph.add_geometry(box(), node_name="mirrored", geom_name="other", transform=mirrored)
    graph.export(tmp_path / "a.glb")
    scene = load_scene(tmp_path / "a.glb")
    assert sorted(scene.surface_names) == ["mirrored", "table"]
    which = scene.surface_names.index("mirrored")
    corners = scene.mesh.corners[scene.mesh.face_surface == which]
    np.testing.assert_allclose(corners.reshape(-1, 3).mean(axis=0)[0], 10, atol=0.2)
    normals = scene.mesh.face_normals()[scene.mesh.face_surface == which]
    outward = np.einsum("ij,ij->i", normals, corners.mean(axis=1) - [10, 0, 0])
    assert (outward > 0).all()  # mirroring turned no face inside out


def test_textures_vertex_and_face_colours_are_kept(tmp_path: Path) -> None:
    image = Image.fromarray(np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8))
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    square = trimesh.Trimesh(vertices, [[0, 1, 2], [0, 2, 3]], process=False)
    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=image, baseColorFactor=[128, 255, 255, 255]
    )
    square.visual = trimesh.visual.TextureVisuals(uv=vertices[:, :2], material=material)
    painted = trimesh.Trimesh(vertices + [3, 0, 0], square.faces, process=False)
    painted.visual.vertex_colors = np.array([[0, 51, 102, 255]] * 4, np.uint8)
    trimesh.Scene({"square": square, "painted": painted}).export(tmp_path / "a.glb")
    scene = load_scene(tmp_path / "a.glb")
    appearance = scene.mesh.appearance
    assert appearance is not None
    assert len(appearance.images) == 1
    names = list(scene.surface_names)
    on_square = np.flatnonzero(scene.mesh.face_surface == names.index("square")).astype(np.int32)
    on_painted = np.flatnonzero(scene.mesh.face_surface == names.index("painted")).astype(np.int32)
    middle = np.full((1, 3), 1 / 3)
    np.testing.assert_allclose(appearance.colour(on_painted[:1], middle), [[0, 0.2, 0.4]], atol=1e-6)
    at_pixel = np.array([[0.25, 0.5, 0.25]])  # (0.75, 0.25) of the first face: the lower right, white pixel
    half = float(srgb_from_linear(np.array([128 / 255]))[0])
    np.testing.assert_allclose(appearance.colour(on_square[:1], at_pixel), [[half, 1, 1]], atol=1e-6)


def test_face_colours_are_kept(tmp_path: Path) -> None:
    mesh = box()
    mesh.visual.face_colors = np.array([[k * 20, 0, 255 - k, 255] for k in range(12)], np.uint8)
    mesh.export(tmp_path / "a.off")
    mesh.export(tmp_path / "a.ply")
    appearance = load_scene(tmp_path / "a.ply").mesh.appearance
    assert appearance is not None
    np.testing.assert_allclose(appearance.corner_colour[3, :, 0], 60 / 255, atol=1e-6)


def test_a_file_without_colour_has_no_appearance(tmp_path: Path) -> None:
    box().export(tmp_path / "a.stl")
    assert load_scene(tmp_path / "a.stl").mesh.appearance is None


@pytest.mark.parametrize(("linear", "encoded"), [(0.0, 0.0), (1.0, 1.0), (0.214, 0.5), (0.002, 0.02584)])
def test_gltf_factors_are_linear_light(linear: float, encoded: float) -> None:
    assert srgb_from_linear(np.array([linear]))[0] == pytest.approx(encoded, abs=5e-4)


def write_ply(path: Path, vertex: str = "1 1 0", n_vertices: int = 4) -> None:
    axes = "\n".join(f"property float {axis}" for axis in "xyz")
    header = f"ply\nformat ascii 1.0\nelement vertex {n_vertices}\n{axes}"
    faces = "element face 2\nproperty list uchar int vertex_indices\nend_header"
    path.write_text(f"{header}\n{faces}\n0 0 0\n1 0 0\n{vertex}\n0 1 0\n3 0 1 2\n3 0 1 3\n")


@pytest.mark.parametrize("vertex", ["nan 1 0", "1 inf 0"])
def test_vertices_that_are_not_finite_are_counted(tmp_path: Path, vertex: str) -> None:
    write_ply(tmp_path / "a.ply", vertex)
    (tmp_path / "a.obj").write_text(f"v 0 0 0\nv 1 0 0\nv {vertex}\nv 0 1 0\nf 1 2 3\nf 1 2 4\n")
    (tmp_path / "a.off").write_text(f"OFF\n4 2 0\n0 0 0\n1 0 0\n{vertex}\n0 1 0\n3 0 1 2\n3 0 1 3\n")
    for suffix in ("ply", "obj", "off"):
        with pytest.raises(InputError, match=f"a.{suffix}: 1 of 4 vertices are not finite; repair the file"):
            load_scene(tmp_path / f"a.{suffix}")


def test_damage_is_named(tmp_path: Path) -> None:
    box().export(tmp_path / "whole.stl")
    box().export(tmp_path / "whole.glb")
    stl, glb = (tmp_path / "whole.stl").read_bytes(), (tmp_path / "whole.glb").read_bytes()
    contents: dict[str, tuple[bytes, str]] = {
        "a.stl": (stl[:300], "truncated STL: 12 triangles need 684 bytes, 300 present"),
        "b.stl": (stl[:50], "truncated STL"),
        "c.glb": (glb[: len(glb) // 2], "c.glb: truncated or damaged GLB: 928 bytes announced, 464 present"),
        "d.glb": (b"hello", "d.glb: not a GLB file"),
        "e.obj": (b"hello\n", "holds no faces; a scene needs triangles"),
        "f.obj": (
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
            "line 4: its face names vertex 9, but they count from 1 to 3",
        ),
        "g.ply": (b"", r"g.ply: is empty \(0 bytes\)"),
        "h.zip": (b"PK", r"cannot read meshes from \.zip; known: glb, gltf, obj"),
        "i": (b"x", "cannot read meshes from a file without suffix"),
    }
    for name, (content, message) in contents.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=message):
            load_scene(tmp_path / name)
    write_ply(tmp_path / "lying.ply", n_vertices=6)
    with pytest.raises(InputError, match=r"lying.ply"):
        load_scene(tmp_path / "lying.ply")
    with pytest.raises(InputError, match=r"none\.glb: no such file"):
        load_scene(tmp_path / "none.glb")
    (tmp_path / "folder.glb").mkdir()
    with pytest.raises(InputError, match=r"folder.glb: is a folder, not a file"):
        load_scene(tmp_path / "folder.glb")


def test_faces_without_area_and_doubtful_units_are_warned_of(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 1 2 4\n")
    assert load_scene(tmp_path / "a.obj").warnings == ("1 of 2 faces have no area; no ray can hit them",)
    (warning,) = load_scene(tmp_path / "a.obj", units="mm").warnings[1:]
    assert warning == "the diagonal is 2.24 mm; if that is wrong, --units says the file's unit"


def test_rooms_and_objects(tmp_path: Path) -> None:
    room().export(tmp_path / "room.ply")
    assert load_scene(tmp_path / "room.ply").mode == "room"
    assert load_scene(tmp_path / "room.ply", mode="object").mode == "object"
    box((6.0, 5.0, 2.7)).export(tmp_path / "block.ply")  # the same walls seen from outside
    assert load_scene(tmp_path / "block.ply").mode == "object"
    flat = trimesh.Trimesh([[0, 0, 0], [9, 0, 0], [0, 9, 0]], [[0, 1, 2]])
    flat.export(tmp_path / "flat.ply")
    scene = load_scene(tmp_path / "flat.ply")
    assert scene.mode == "object"
    assert suggest_up(scene.mesh, "object") is None


def test_builtin_scenes_are_opened_by_name(tmp_path: Path) -> None:
    assert open_scene("builtin:two_occluders").mode == "room"
    box().export(tmp_path / "a.ply")
    assert open_scene(tmp_path / "a.ply").name == "a"


REAL = [
    ("habitat_simple_room.glb", "room", "z"),
    ("aws_small_house.glb", "room", "z"),
    ("objects/stanford-bunny.obj", "object", "y"),
    ("objects/fandisk.obj", "object", "z"),
    ("objects/CesiumMilkTruck.glb", "object", "y"),
    ("objects/spot.obj", "object", "y"),
    ("objects/teapot.obj", "object", "y"),
    ("furniture/blendswap-cc-0/oakChair/oakChair.obj", "object", "y"),
]


@requires_data
@pytest.mark.parametrize(("name", "mode", "up"), REAL, ids=[name.split("/")[-1] for name, _, _ in REAL])
def test_mode_and_up_axis_of_real_scenes(name: str, mode: str, up: str) -> None:
    scene = load_scene(data_path(f"scenes/{name}"), up="z")
    assert scene.mode == mode
    assert suggest_up(scene.mesh, scene.mode) == up


@requires_data
@pytest.mark.parametrize(("name", "mode", "up"), [entry for entry in REAL if entry[0].endswith(".glb")])
def test_gltf_is_y_up_unless_its_geometry_stands_on_z(name: str, mode: str, up: str) -> None:
    scene = load_scene(data_path(f"scenes/{name}"))
    assert (scene.mode, scene.file_up) == (mode, up)
    assert [text for text in scene.warnings if "z was taken" in text] == [Z_UP] * (up == "z")
    assert suggest_up(scene.mesh, scene.mode) == "z"


def yard() -> Any:
    post = box((0.2, 0.2, 2.0))
    post.apply_translation([1.0, 0.5, 1.05])
    return trimesh.util.concatenate([box((6.0, 5.0, 0.1)), post])


@pytest.mark.parametrize(
    ("make", "up", "doubts"),
    [
        (room, "y", ("the geometry suggests that z is up, not y; give --up z if so",)),
        (yard, "z", (Z_UP,)),
        (box, "y", ()),
    ],
)
def test_axes_of_gltf_files(tmp_path: Path, make: Any, up: str, doubts: tuple[str, ...]) -> None:
    make().export(tmp_path / "a.glb")
    scene = load_scene(tmp_path / "a.glb")
    assert (scene.file_up, scene.warnings) == (up, doubts)
    save_scene(scene, tmp_path / "ours.glb")
    again = load_scene(tmp_path / "ours.glb")
    assert again.file_up == "y"
    np.testing.assert_allclose(again.mesh.bounds(), scene.mesh.bounds(), atol=1e-6)
    assert load_scene(tmp_path / "a.glb", up="y").file_up == "y"


@requires_data
def test_a_turned_scene_keeps_its_mode() -> None:
    scene = load_scene(data_path("scenes/objects/CesiumMilkTruck.glb"), up="y")
    assert decide_mode(scene.mesh) == "object"
    assert suggest_up(scene.mesh, "object") == "z"


@requires_data
def test_real_textures_and_names() -> None:
    house = load_scene(data_path("scenes/aws_small_house.glb"))
    assert len(house.mesh.faces) == 145_844
    assert len(house.surfaces) == 108
    assert house.mesh.appearance is not None
    assert len(house.mesh.appearance.images) > 50
    truck = load_scene(data_path("scenes/objects/CesiumMilkTruck.glb"))
    assert truck.surface_names == (
        "Cesium_Milk_Truck", "Cesium_Milk_Truck_1", "Cesium_Milk_Truck_2", "Wheels", "Wheels 2",
    )  # fmt: skip
