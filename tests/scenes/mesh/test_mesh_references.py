# SPDX-License-Identifier: MIT
"""Files that meshes name: read within the folder, refused outside it, said to be missing; OFF and STL."""

import base64
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from scenes.checks import InputError
from scenes.io.checks.documents import check_references, within_folder
from scenes.io.checks.limits import limits
from scenes.io.scene_files import load_scene

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
OUTSIDE = ["../secret.png", "/secret.png", "C:\\secret.png", "http://host/secret.png", "a/../../secret.png"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a texture, and another texture beside it that must not be opened."""
    (tmp_path / "inside").mkdir()
    Image.new("RGB", (3, 3), (9, 9, 9)).save(tmp_path / "secret.png")
    Image.new("RGB", (2, 4), (200, 0, 0)).save(tmp_path / "inside" / "tex.png")
    return tmp_path / "inside"


@pytest.fixture
def opened() -> Iterator[list[str]]:
    """Names of the files that are opened while the test runs."""
    names: list[str] = []
    watching = [True]

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if watching and event == "open" and isinstance(arguments[0], str):
            names.append(arguments[0])

    sys.addaudithook(hook)
    yield names
    watching.clear()  # hooks cannot be taken away


def write_obj(folder: Path, texture: str, library: str = "m.mtl") -> Path:
    (folder / "m.mtl").write_text(f"newmtl m\nmap_Kd {texture}\n")
    (folder / "a.obj").write_text(f"mtllib {library}\n{TRIANGLE}")
    return folder / "a.obj"


def write_gltf(folder: Path, *, buffer: str = "b.bin", image: str | None = None, **more: Any) -> Path:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    uv = np.array([[0, 1], [1, 1], [0, 0]], "<f4").tobytes()
    data = corners + np.array([0, 1, 2], "<u4").tobytes() + uv
    (folder / "b.bin").write_bytes(data)
    uri = (
        buffer
        if buffer != "data"
        else f"data:application/octet-stream;base64,{base64.b64encode(data).decode()}"
    )
    primitive: dict[str, Any] = {"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1}
    content: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "wall"}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"uri": uri, "byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 12},
            {"buffer": 0, "byteOffset": 48, "byteLength": 24},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
    }
    if image is not None:
        content |= {"images": [{"uri": image}], "textures": [{"source": 0}]}
        content["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        primitive["material"] = 0
    (folder / "a.gltf").write_text(json.dumps(content | more))
    return folder / "a.gltf"


@pytest.mark.parametrize("name", OUTSIDE)
def test_nothing_outside_the_folder_is_opened(folder: Path, opened: list[str], name: str) -> None:
    ply = folder / "a.ply"
    ply.write_text(f"ply\nformat ascii 1.0\ncomment TextureFile {name}\nelement vertex 0\nend_header\n")
    (folder / "a.obj").write_text(f"mtllib {name}\n{TRIANGLE}")
    with pytest.raises(InputError, match=r"a\.obj: names .* which lies outside its folder and is not opened"):
        load_scene(folder / "a.obj")
    for file in (
        write_obj(folder, name),
        ply,
        write_gltf(folder, image=name),
    ):
        with pytest.raises(InputError, match=f"{file.name}: names .*, which lies outside its folder"):
            load_scene(file)
    with pytest.raises(InputError, match=r"a\.gltf: names .*, which lies outside its folder"):
        load_scene(write_gltf(folder, buffer=name))
    assert not [path for path in opened if "secret" in path]


def test_a_link_out_of_the_folder_is_not_followed(folder: Path) -> None:
    (folder / "link.png").symlink_to(folder.parent / "secret.png")
    with pytest.raises(InputError, match=r"names 'link\.png', which lies outside"):
        load_scene(write_obj(folder, "link.png"))


@pytest.mark.parametrize("name", ["tex.png", "./tex.png", "../inside/tex.png"])
def test_what_lies_in_the_folder_is_read(folder: Path, name: str) -> None:
    for file in (write_obj(folder, name), write_gltf(folder, image=name), write_gltf(folder, buffer="data")):
        scene = load_scene(file)
        assert scene.warnings == ()
        assert len(scene.mesh.faces) == 1
    assert within_folder(folder, "a%20b.png") == folder / "a b.png"


def test_missing_files_and_materials_are_warned_of(folder: Path) -> None:
    (missing,) = check_references(write_obj(folder, "gone.png")).warnings
    assert missing == "1 texture is missing beside a.obj, the first is 'gone.png': what it covers is grey"
    (options,) = check_references(write_obj(folder, "-s 1 1 1 tex.png")).warnings
    assert options.startswith("the texture '-s 1 1 1 tex.png' is left out")
    (library,) = check_references(write_obj(folder, "tex.png", "gone.mtl")).warnings
    assert library == "its material file 'gone.mtl' is missing: colours and textures are lost"
    file = write_obj(folder, "tex.png")
    file.write_text(file.read_text() + "v 0 0 1\nusemtl other\nf 2/1 1/2 4/3\n")
    assert load_scene(file).warnings == (
        "materials used but not defined: 1 (first 'other'); what they cover is grey",
    )
    (image,) = load_scene(write_gltf(folder, image="gone.png")).warnings
    assert image.startswith("1 texture is missing beside a.gltf")


def test_unusable_gltf_is_refused(folder: Path) -> None:
    with pytest.raises(
        InputError, match=r"a\.gltf: its buffer 'gone\.bin' is missing; put it beside the file"
    ):
        load_scene(write_gltf(folder, buffer="gone.bin"))
    with pytest.raises(
        InputError, match="needs the extension KHR_draco_mesh_compression, which is not known"
    ):
        load_scene(write_gltf(folder, extensionsRequired=["KHR_draco_mesh_compression"]))
    (folder / "a.gltf").write_text("[1, 2, 3, 4, 5, 6, 7]")
    with pytest.raises(InputError, match="is JSON, but not an object"):
        load_scene(folder / "a.gltf")


def test_objects_of_an_obj_become_surfaces(tmp_path: Path) -> None:
    corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    (tmp_path / "a.obj").write_text(f"{corners}o table\nf 1 2 3\no chair\nf 1 3 4\n")
    assert sorted(load_scene(tmp_path / "a.obj").surface_names) == ["chair", "table"]
    (tmp_path / "b.obj").write_text(f"{corners}f -4 -3 -2 -1\n")  # counted from the end, four corners
    assert len(load_scene(tmp_path / "b.obj").mesh.faces) == 2


SQUARE = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


@pytest.mark.parametrize(
    ("text", "n_faces", "colour"),
    [
        (f"OFF\n4 1 0\n{SQUARE}4 0 1 2 3\n", 2, None),
        (f"OFF 4 1 0\n# a comment\n{SQUARE}\n4 0 1 2 3 255 0 0\n", 2, [255, 0, 0]),
        (f"OFF\n4 2 0\n{SQUARE}3 0 1 2 1.0 0.0 0.0 0.5\n3 0 2 3 1.0 0.0 0.0 0.5\n", 2, [255, 0, 0]),
        ("COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 255 0 0 255\n0 1 0 255 0 0 255\n3 0 1 2\n", 1, [255, 0, 0]),
        (
            "CNOFF\n3 1 0\n0 0 0 0 0 1 1. 0 0\n1 0 0 0 0 1 1. 0 0\n0 1 0 0 0 1 1. 0 0\n3 0 1 2\n",
            1,
            [255, 0, 0],
        ),
    ],
)
def test_off_and_its_colours(tmp_path: Path, text: str, n_faces: int, colour: list[int] | None) -> None:
    (tmp_path / "a.off").write_text(text)
    mesh = load_scene(tmp_path / "a.off").mesh
    assert len(mesh.faces) == n_faces
    assert (mesh.face_normals() == [0, 0, 1]).all()
    if colour is None:
        assert mesh.appearance is None
    else:
        assert mesh.appearance is not None
        np.testing.assert_allclose(mesh.appearance.corner_colour, np.full((n_faces, 3, 3), colour) / 255)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("PFF\n1 1 0\n", "not a text OFF file"),
        ("OFF BINARY\n1 1 0\n", "not a text OFF file"),
        ("4OFF\n1 1 0\n", "more than three coordinates"),
        (
            f"OFF\n4 3 0\n{SQUARE}3 0 1 2\n",
            "truncated or edited: 4 vertices and 3 faces announced, 5 lines present",
        ),
        (f"COFF\n4 1 0\n{SQUARE}3 0 1 2\n", "line 3 has 3 numbers, a vertex here has 6 or more"),
        (f"OFF\n4 1 0\n{SQUARE}3 0 1\n", "line 7 announces a face of 3 corners and has 2 numbers"),
        (f"OFF\n4 1 0\n{SQUARE}3 0 1 9\n", r"face 0 is \[0, 1, 9\], but there are 4 vertices"),
    ],
)
def test_damaged_off_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.off").write_text(text)
    with pytest.raises(InputError, match=rf"a\.off: .*{message}"):
        load_scene(tmp_path / "a.off")


def test_a_huge_off_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.off").write_text(f"OFF\n4 1 0\n{SQUARE}4 0 1 2 3\n")
    with limits(file_bytes=10), pytest.raises(InputError, match="exceed the limit file_bytes=10"):
        load_scene(tmp_path / "a.off")


def test_a_text_stl_that_stops_is_refused(tmp_path: Path) -> None:
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    (tmp_path / "whole.stl").write_text(f"solid a\n{facet}{facet}endsolid a\n")
    assert len(load_scene(tmp_path / "whole.stl").mesh.faces) == 2
    (tmp_path / "cut.stl").write_text(f"solid a\n{facet}{facet[:60]}")
    with pytest.raises(
        InputError, match=r"cut\.stl: truncated STL: 2 facets begin, 1 end, then the text stops"
    ):
        load_scene(tmp_path / "cut.stl")
