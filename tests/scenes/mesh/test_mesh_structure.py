# SPDX-License-Identifier: MIT
"""Structure of meshes: every number that a file states is held against what is there; sound files pass."""

import json
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.meshes.gltf import data_bytes
from scenes.io.meshes.obj import check_obj, plain_obj
from scenes.io.meshes.ply import check_ply
from scenes.io.scene_files import load_scene, mesh_doubts
from scenes.mesh.labelled_mesh import LabelledMesh
from tests.robustness.bad_files import meshes
from tests.robustness.bad_files.trial import ROOT


def changed(folder: Path, path: list[Any], value: Any) -> Path:
    """A glTF in which one entry of the JSON is another, or is taken away."""
    content = meshes.gltf(folder, meshes.SIDE, meshes.FACES)
    at: Any = content
    for step in path[:-1]:
        at = at[step]
    if value is None:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    (folder / "a.gltf").write_text(json.dumps(content))
    return folder / "a.gltf"


GLTF: list[tuple[list[Any], Any, str]] = [
    (["asset"], None, "is glTF of version None; 2.0 is known"),
    (["asset", "version"], "1.0", "is glTF of version '1.0'"),
    (["extensionsRequired"], ["EXT_meshopt_compression"], "needs the extension EXT_meshopt"),
    (["nodes"], {}, "its nodes are no list"),
    (["buffers"], {}, "its buffers are no list"),
    (["buffers", 0, "byteLength"], -1, "buffer 0 has the byteLength -1"),
    (["buffers", 0, "byteLength"], 10**6, "buffer 0 is cut short: 1,000,000 bytes announced, 120 present"),
    (["buffers", 0, "uri"], None, "buffer 0 has no bytes"),
    (["buffers", 0, "uri"], 5, "buffer 0 has a uri that is no text"),
    (["buffers", 0, "uri"], "data:text/plain,abc", "a data: address that is not in base 64"),
    (["buffers", 0, "uri"], "data:a;base64,%%%", "a data: address that is damaged"),
    (["bufferViews", 0], 5, "bufferView 0 is no object"),
    (["bufferViews", 0, "buffer"], 3, "bufferView 0 names buffer 3, but there are 1"),
    (["bufferViews", 0, "byteLength"], 999, "bufferView 0 ends at byte 999, its buffer has 120"),
    (["bufferViews", 0, "byteLength"], 1.5, "has the byteLength 1.5; an integer of 0 or more is needed"),
    (["bufferViews", 0, "byteStride"], 4, "accessor 0 of 6 entries ends at byte"),
    (["accessors", 0, "count"], 7, "accessor 0 of 7 entries ends at byte 84 of 72"),
    (["accessors", 0, "count"], True, "has the count True"),
    (["accessors", 0, "byteOffset"], 4, "ends at byte 76 of 72"),
    (["accessors", 0, "type"], "VEC9", "accessor 0 has the unknown type 5126 'VEC9'"),
    (["accessors", 0, "sparse"], {}, "accessor 0 is sparse"),
    (["accessors", 0, "bufferView"], None, "accessor 0 has no bytes"),
    (["accessors", 1, "componentType"], 5126, "indices that are no list of unsigned integers"),
    (["accessors", 1, "count"], 11, "11 corners, which make no whole number of triangles"),
    (["meshes", 0], [], "mesh 0 has no list of primitives"),
    (["meshes", 0, "primitives", 0], {}, "mesh 0, primitive 0 has no attributes"),
    (["meshes", 0, "primitives", 0, "attributes"], {"POSITION": 1}, "no POSITION of three coordinates"),
    (["meshes", 0, "primitives", 0, "attributes", "NORMAL"], 1, "6 positions and 12 of NORMAL"),
    (["meshes", 0, "primitives", 0, "mode"], 6, "is a fan of triangles"),
    (["scene"], 4, "it names scene 4, but there are 1"),
    (["scenes", 0], 5, "its scene has no list of nodes"),
    (["scenes", 0, "nodes"], [7], "its scene names nodes 7, but there are 1"),
    (["nodes", 0, "mesh"], 2, "node 0 names mesh 2, but there are 1"),
    (["nodes", 0, "children"], [0], "node 0 has two parents, or is its own ancestor"),
    (["nodes", 0], 3, "node 0 is no object"),
    (["nodes", 0, "matrix"], [1, 2], "node 0 has a matrix that is not 16 numbers"),
    (["nodes", 0, "scale"], ["a", 1, 1], "node 0 has a scale that is not 3 numbers"),
    (["images"], [5], "its images are no list of objects"),
    (["images"], [{"uri": "data:image/png;base64,AAAA"}], "image 0 is no image that is known"),
    (["images"], [{"bufferView": 0}], "image 0 is no image that is known"),
]


@pytest.mark.parametrize(("path", "value", "message"), GLTF, ids=[words for _, _, words in GLTF])
def test_numbers_of_gltf_that_lie_are_refused(
    tmp_path: Path, path: list[Any], value: Any, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        load_scene(changed(tmp_path, path, value))


def test_nodes_too_deep_are_refused_and_others_placed(tmp_path: Path) -> None:
    def chain(n: int) -> Path:
        nodes: list[Any] = [{"children": [k + 1]} for k in range(n)] + [{"mesh": 0}]
        return meshes.write_gltf(tmp_path, meshes.SIDE, meshes.FACES, nodes=nodes)

    assert len(load_scene(chain(200)).mesh.faces) == len(meshes.FACES)
    with pytest.raises(InputError, match="lie within each other more than 256 deep"):
        load_scene(chain(300))
    twice = meshes.write_gltf(
        tmp_path, meshes.SIDE, meshes.FACES,
        nodes=[{"mesh": 0}, {"mesh": 0, "translation": [9, 0, 0]}], scenes=[{"nodes": [0, 1]}],
    )  # fmt: skip
    assert len(load_scene(twice).mesh.faces) == 2 * len(meshes.FACES)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d[:4] + struct.pack("<I", 1) + d[8:], "is GLB of version 1; 2 is known"),
        (lambda d: d + b"\0" * 4, "truncated or damaged GLB: .* bytes announced"),
        (lambda d: d[:12] + struct.pack("<I", 10**6) + d[16:], "a chunk of 1,000,000 bytes at byte 12"),
        (lambda d: d[:16] + b"NOSJ" + d[20:], "is a GLB file without JSON"),
    ],
)
def test_chunks_of_glb_that_lie_are_refused(
    tmp_path: Path, change: Callable[[bytes], bytes], message: str
) -> None:
    path = meshes.write_glb(tmp_path, meshes.SIDE, meshes.FACES)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(InputError, match=message):
        load_scene(path)


def test_data_addresses_are_decoded() -> None:
    assert data_bytes("data:application/octet-stream;base64,aGVsbG8=") == b"hello"


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n"


@pytest.mark.parametrize(
    ("faces", "count"),
    [
        ("f 1 2 3\n", 1),
        ("\tf\t1 2 3 # the first\n", 1),
        ("f 1/1 2/1 3/1\nf 1//1 2//1 3//1 1//1\n", 3),
        ("f 1 2 \\\n3\r\nf -1 -2 -3\r\n", 2),
        ("f 1/1/1 2/1/1 3/1/1\n", 1),
    ],
)
def test_sound_faces_are_counted(faces: str, count: int) -> None:
    assert check_obj(plain_obj((OBJ + faces).encode())) == count


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        ("f 0 1 2\n", "line 6: its face names vertex 0, but they count from 1 to 3"),
        ("f 1 2 3\nf 1 2 9\n", "line 7: its face names vertex 9"),
        ("f 1/1 2/2 3/1\n", "names texture coordinate 2, but they count from 1 to 1"),
        ("f 1//1 2//1 3//4\n", "names normal 4"),
        ("f 1 2\n", "line 6 is a face of 2 corners"),
        ("f 1/1 2 3/1\n", "corners are written in different ways"),
        ("f 1/1 2/1 3/1\nf 1 2 3 1 2 3\n", "line 7 has a face in another notation"),
        ("f 1 2 x\n", "its faces cannot be read"),
        ("f-1 2 3\n", "line 6 begins with 'f-1', which is no face"),
        ("f -1 -2 -3\nv 9 9 9\n", "count from the end, and vertices after them"),
        ("v 1 2\nf 1 2 3\n", "has v lines of 2 to 3 numbers"),
        ("v 1 b 2\nf 1 2 3\n", "its v lines cannot be read"),
    ],
)
def test_faces_that_lie_are_refused(faces: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_obj(plain_obj((OBJ + faces).encode()))


def three_boxes(*heads: str) -> str:
    """An OBJ of three boxes apart, each behind its own lines."""
    text = ""
    for k, head in enumerate(heads):
        corners = 2 * k + np.array([*np.ndindex(2, 2, 2)])
        text += head + "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
        text += "".join(f"f {' '.join(str(8 * k + 1 + c) for c in side)}\n" for side in SIDES)
    return text


SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


@pytest.mark.parametrize(
    ("heads", "names", "n_same"),
    [
        (("o w\n", "o w\n", "o w\n"), {"w", "w #2", "w #3"}, 2),
        (("g w\n", "g w\n", "g w\n"), {"w", "w #2", "w #3"}, 2),
        (("g a\n", "g b\n", "g c\n"), {"a", "b", "c"}, 0),
        (("o w\n", "o w #2\n", "o w\n"), {"w", "w #2", "w #3"}, 1),
        (("o w\ng a\n", "g b\n", "g a\n"), {"w"}, 0),
        (("g default\ng a\n", "g default\ng b\n", "g default\ng a\n"), {"a", "b", "a #2"}, 1),
    ],
)
def test_objects_of_one_name_are_told_apart(tmp_path: Path, heads, names, n_same: int) -> None:
    (tmp_path / "a.obj").write_text(three_boxes(*heads))
    scene = load_scene(tmp_path / "a.obj", up="z")
    assert set(scene.surface_names) == {one.name for one in scene.element_mesh.elements} == names
    assert (scene.mesh.face_areas().sum(), len(scene.mesh.faces)) == (pytest.approx(18), 36)
    told = f"{n_same} of 3 objects have the name of another; a number behind it tells them apart"
    assert (told in scene.warnings) == bool(n_same)


def test_a_group_that_comes_again_goes_on(tmp_path: Path) -> None:
    text = three_boxes("g a\n", "g a\n", "g a\n").replace("g a\n", "").splitlines(keepends=True)
    text.sort(key=lambda line: line[0] != "v")
    (tmp_path / "a.obj").write_text(
        "".join([*text[:24], "g a\n", *text[24:30], "g b\n", *text[30:36], "g a\n", *text[36:]])
    )
    assert set(load_scene(tmp_path / "a.obj").surface_names) == {"a", "b"}


def ply(body: str, faces: int = 1, head: str = "") -> bytes:
    return (meshes.PLY.format("ascii", head, 3, faces) + body).encode()


ROWS = "0 0 0\n1 0 0\n0 1 0\n"


def test_sound_rows_are_counted() -> None:
    assert check_ply(ply(ROWS + "3 0 1 2\n")) == 1
    assert check_ply(ply(ROWS + "3 0 1 2\n4 0 1 2 0\n\n", 2)) == 3
    folder_free = meshes.PLY.format("binary_big_endian", "", 3, 1).encode()
    row = np.zeros(9, ">f4").tobytes() + b"\3" + np.arange(3, dtype=">i4").tobytes()
    assert check_ply(folder_free + row) == 1


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"plx\n", "not a PLY file"),
        (b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n", "need x, y, z"),
        (ply("", 0).replace(b"ascii", b"morse"), "unknown format 'morse'"),
        (ply("").replace(b"element vertex", b"element corner"), "has no vertices"),
        (ply("", head="element vertex many\n"), "announces no element"),
        (ply("", head="property float x\n"), "before any element"),
        (ply("").replace(b"property float y", b"property real y"), "which is no property"),
        (ply(ROWS), "announces 4 rows .3 of vertex, 1 of face., 3 follow"),
        (ply("0 0 x\n" + ROWS), "vertex rows cannot be read"),
        (ply("0 0\n0 0\n0 0\n3 0 1 2\n"), "row 1 after the header has 2 numbers, a vertex has 3"),
        (ply(ROWS + "3 0 1\n"), "row 4 after the header, '3 0 1', is no face"),
        (ply(ROWS + "2 0 1\n"), "row 4 after the header is a face of 2 corners"),
        (ply(ROWS + "3 0 1 2 5\n"), "row 4 after the header has 5 numbers, 4 were announced"),
        (
            ply("").replace(b"ascii", b"binary_little_endian"),
            "truncated: 3 of vertex take 36 bytes, 0 present",
        ),
    ],
)
def test_rows_that_lie_are_refused(data: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_ply(data)


def test_binary_lists_of_two_lengths_are_refused() -> None:
    head = meshes.PLY.format("binary_little_endian", "", 3, 2).encode()
    row = b"\3" + np.arange(3, dtype="<i4").tobytes()
    vertices = np.zeros(9, "<f4").tobytes()
    assert check_ply(head + vertices + row + row) == 2
    with pytest.raises(InputError, match="lists of different lengths"):
        check_ply(head + vertices + row + b"\4" + row[1:])
    with pytest.raises(InputError, match="has 3 bytes more than it announces"):
        check_ply(head + vertices + row + row + b"abc")


@pytest.mark.long
def test_decoders_print_nothing(tmp_path: Path) -> None:
    path = meshes.write_ply(tmp_path, meshes.SIDE, meshes.FACES, "comment TextureFile gone.png\n")
    code = f"from scenes.io.scene_files import load_scene; print(load_scene({str(path)!r}).warnings)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert "1 texture is missing" in done.stdout
    assert done.stderr == ""


def mesh(faces: Any, vertices: Any = meshes.SIDE) -> LabelledMesh:
    return LabelledMesh(np.asarray(vertices, float), np.asarray(faces))


def test_doubts_about_faces_and_coordinates() -> None:
    sound = meshes.FACES.tolist()
    assert mesh_doubts(mesh(sound)) == ()
    assert mesh_doubts(mesh(sound, meshes.SIDE + [4.5e5, 5.4e6, 100.1])) == ()  # float64 keeps them
    split = meshes.SIDE[meshes.FACES].reshape(-1, 3)  # every face with corners of its own
    assert mesh_doubts(mesh(np.arange(12).reshape(-1, 3), split)) == ()
    for faces, words in (
        ([*sound, [0, 0, 1]], "1 of 5 faces have no area; no ray can hit them"),
        ([*sound, sound[0][::-1]], "1 of 5 faces are there more than once"),
        ([*sound[:3], sound[3][::-1]], "1 edge has both its faces in one direction"),
        ([*sound, [0, 1, 3]], "1 edge is shared by three faces or more"),
    ):
        (doubt,) = mesh_doubts(mesh(faces))
        assert words in doubt
    far = (meshes.SIDE + [4.5e5, 5.4e6, 100]).astype(np.float32)
    (doubt,) = mesh_doubts(mesh(sound, far))
    assert "up to 5.4e+06 m are stored in 32 bits, so they are rounded to steps of 0.031 and 0.5 m" in doubt
    with pytest.raises(InputError, match="none of its 4 faces has an area"):
        mesh_doubts(mesh(sound, meshes.SIDE * [1, 0, 0]))
