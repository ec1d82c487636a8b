# SPDX-License-Identifier: MIT
"""Mesh PLY: properties of every type survive, other software opens it, damage is named."""

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenes.checks import InputError
from scenes.io.describe import describe
from scenes.io.meshes.ply import PlyMesh, read_mesh_ply
from scenes.io.meshes.ply_writer import write_mesh_ply, write_meshes_ply
from scenes.io.point_files import read_points

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [np.pi, 1e-9, -7e5]], dtype=np.float64)
FACES = np.array([[0, 1, 2], [1, 3, 2]], dtype=np.int32)
PROPERTIES = {
    "red": np.array([1, 2, 3, 255], np.uint8),
    "green": np.zeros(4, np.uint8),
    "blue": np.full(4, 9, np.uint8),
    "surface": np.array([0, -1, 2, 70000], np.int64),
    "provenance": np.array([0, 1, 2, 3], np.int32),
    "sd": np.array([0.001, np.nan, np.inf, 1e-7], np.float32),
    "exact": np.array([0.1, 0.2, 0.3, 0.4]),
    "flag": np.array([True, False, True, True]),
}


@pytest.mark.parametrize("faces", [FACES, None, np.zeros((0, 3), np.int32)])
def test_mesh_reads_back(tmp_path: Path, faces: "np.ndarray | None") -> None:  # type: ignore[type-arg]
    write_mesh_ply(tmp_path / "m.ply", VERTICES, faces, PROPERTIES, ["one", "provenance 0 = measured"])
    back = read_mesh_ply(tmp_path / "m.ply")
    np.testing.assert_array_equal(back.vertices, VERTICES)
    np.testing.assert_array_equal(back.faces, FACES if faces is FACES else np.zeros((0, 3)))
    assert list(back.vertex_properties) == list(PROPERTIES)
    for name, values in PROPERTIES.items():
        np.testing.assert_array_equal(back.vertex_properties[name], values)
    assert back.vertex_properties["sd"].dtype == np.float32
    assert back.comments == ("one", "provenance 0 = measured")


def test_trimesh_opens_mesh_and_cloud(tmp_path: Path) -> None:
    write_mesh_ply(tmp_path / "m.ply", VERTICES, FACES, PROPERTIES)
    mesh = trimesh.load(tmp_path / "m.ply", process=False)
    np.testing.assert_array_equal(np.asarray(mesh.vertices), VERTICES)
    np.testing.assert_array_equal(np.asarray(mesh.faces), FACES)
    np.testing.assert_array_equal(mesh.visual.vertex_colors[:, 0], PROPERTIES["red"])
    write_mesh_ply(tmp_path / "c.ply", VERTICES, None, PROPERTIES)
    assert len(trimesh.load(tmp_path / "c.ply", process=False).vertices) == 4


def test_an_empty_mesh_is_a_valid_file(tmp_path: Path) -> None:
    write_mesh_ply(tmp_path / "m.ply", np.zeros((0, 3)), None, {"surface": np.zeros(0, np.int32)})
    assert len(read_mesh_ply(tmp_path / "m.ply").vertices) == 0


@pytest.mark.parametrize(
    ("properties", "message"),
    [
        ({"sd": np.zeros(3)}, r"expected vertex property sd with shape \(4,\), got \(3,\)"),
        ({"a b": np.zeros(4)}, "property name 'a b' has characters that PLY does not allow"),
        ({"big": np.full(4, 2**40)}, "property big exceeds 32 bits"),
        ({"c": np.zeros(4, complex)}, "property c has type complex128, which PLY does not know"),
    ],
)
def test_unusable_properties_are_named(
    tmp_path: Path, properties: "dict[str, np.ndarray]", message: str
) -> None:  # type: ignore[type-arg]
    with pytest.raises(InputError, match=message):
        write_mesh_ply(tmp_path / "m.ply", VERTICES, FACES, properties)
    assert not list(tmp_path.iterdir())


def test_a_comment_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a PLY comment is one line"):
        write_mesh_ply(tmp_path / "m.ply", VERTICES, FACES, comments=["two\nlines"])


def test_damage_is_named(tmp_path: Path) -> None:
    path = tmp_path / "m.ply"
    write_mesh_ply(path, VERTICES, FACES, PROPERTIES)
    whole = path.read_bytes()
    for broken, message in [
        (whole.replace(b"element vertex 4", b"element vertex -1"), "announces -1 of vertex"),
        (whole[:-5], "truncated: 2 of face take 26 bytes, 21 left"),
        (whole.replace(b"binary_little_endian", b"ascii"), "is in ascii format"),
        (whole.replace(b"element vertex 4", b"element vertex 4000000000"), "truncated: 4000000000 of vertex"),
        (b"hello", "not a PLY file"),
        (whole[: whole.index(b"end_header") + 10], "not a PLY file: no header"),
        (whole.replace(b"end_header\n", b"end_header\0").replace(b"\n", b" "), "not a PLY file: no header"),
        (whole.replace(b"property int surface", b"property half surface"), "of the unknown type 'half'"),
        (whole[:-4] + b"\x09\0\0\0", "face 1 is .*9.*, but there are 4 vertices"),
    ]:
        path.write_bytes(broken)
        with pytest.raises(InputError, match=f"m.ply.*{message}"):
            read_mesh_ply(path)


def test_parts_make_the_file_of_the_whole(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    vertices, faces = rng.normal(size=(30, 3)), rng.integers(0, 30, (50, 3)).astype(np.int32)
    faces = faces[np.argsort(faces.min(axis=1), kind="stable")]
    surface = np.arange(30, dtype=np.int32)
    write_mesh_ply(tmp_path / "whole.ply", vertices, faces, {"surface": surface}, ["a comment"])
    first = faces.min(axis=1) < 12  # their corners lie in both parts
    parts = [
        PlyMesh(vertices[:12], faces[first], {"surface": surface[:12]}),
        PlyMesh(vertices[12:], faces[~first] - 12, {"surface": surface[12:]}),
    ]
    write_meshes_ply(tmp_path / "parts.ply", iter(parts), ["a comment"])
    assert (tmp_path / "parts.ply").read_bytes() == (tmp_path / "whole.ply").read_bytes()


@pytest.mark.parametrize("corner", [3, -1])
def test_a_corner_that_no_part_has_is_refused(tmp_path: Path, corner: int) -> None:
    parts = [PlyMesh(np.zeros((3, 3)), np.array([[0, 1, corner]], np.int32))]
    with pytest.raises(InputError, match=r"corner 3, but there are 3 vertices|face 0 is"):
        write_meshes_ply(tmp_path / "parts.ply", parts)
    assert not list(tmp_path.iterdir())


def test_parts_of_other_properties_are_refused(tmp_path: Path) -> None:
    none = np.zeros((0, 3), np.int32)
    parts = [PlyMesh(np.zeros((3, 3)), none), PlyMesh(np.zeros((3, 3)), none, {"a": np.zeros(3)})]
    with pytest.raises(InputError, match="parts of a PLY file have properties"):
        write_meshes_ply(tmp_path / "parts.ply", parts)


def test_faces_have_properties_too(tmp_path: Path) -> None:
    """Whatever they are called: the corners are no property."""
    known = {
        "surface": np.array([3, 1], np.int32),
        "n": np.array([0, 1], np.uint8),
        "corners": np.array([0.5, 2.0]),
    }
    write_mesh_ply(tmp_path / "m.ply", VERTICES, FACES, PROPERTIES, face_properties=known)
    back = read_mesh_ply(tmp_path / "m.ply")
    np.testing.assert_array_equal(back.faces, FACES)
    assert list(back.face_properties) == list(known)
    for name, values in known.items():
        np.testing.assert_array_equal(back.face_properties[name], values)
        assert back.face_properties[name].dtype == values.dtype
    assert list(back.vertex_properties) == list(PROPERTIES)
    whole = trimesh.load(tmp_path / "m.ply", process=False)  # another program's reader
    np.testing.assert_array_equal(whole.faces, FACES)


@pytest.mark.parametrize(
    ("properties", "message"),
    [
        ({"state": np.zeros(3)}, r"expected face property state with shape \(2,\), got \(3,\)"),
        ({"a b": np.zeros(2)}, "face property name 'a b' has characters that PLY does not allow"),
    ],
)
def test_unusable_properties_of_faces_are_named(
    tmp_path: Path, properties: "dict[str, np.ndarray]", message: str
) -> None:  # type: ignore[type-arg]
    with pytest.raises(InputError, match=message):
        write_mesh_ply(tmp_path / "m.ply", VERTICES, FACES, face_properties=properties)
    assert not list(tmp_path.iterdir())


def test_no_faces_keep_their_properties(tmp_path: Path) -> None:
    none = np.zeros((0, 3), np.int32)
    write_mesh_ply(tmp_path / "m.ply", VERTICES, none, face_properties={"state": np.zeros(0, np.uint8)})
    assert list(read_mesh_ply(tmp_path / "m.ply").face_properties) == ["state"]


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("lengths", [(2, 2, 2, 2), (0, 3, 1, 2)])
@pytest.mark.parametrize("faces", [0, 1])
def test_lists_of_vertices_are_skipped(
    tmp_path: Path, encoding: str, lengths: tuple[int, ...], faces: int
) -> None:
    head = (
        f"ply\nformat {encoding} 1.0\nelement vertex 4\nproperty float x\nproperty list uchar int view\n"
        "property float y\nproperty double z\nproperty list uint double weight\nproperty uchar label\n"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    points = np.arange(12.0).reshape(4, 3) ** 2
    order = "<" if "little" in encoding else ">"
    body = b""
    for number, ((x, y, z), n) in enumerate(zip(points.tolist(), lengths, strict=True)):
        views, weights = [7] * n, [0.5] * (n + 1)
        row: list[float] = [x, n, *views, y, z, n + 1, *weights, number]
        form = f"{order}fB{n}ifdI{n + 1}dB"
        body += f"{' '.join(map(str, row))}\n".encode() if encoding == "ascii" else struct.pack(form, *row)
    if faces:
        body += b"3 0 1 2\n" if encoding == "ascii" else struct.pack(f"{order}B3i", 3, 0, 1, 2)
    path = tmp_path / "a.ply"
    path.write_bytes(head.encode() + body)
    cloud = read_points(path)
    np.testing.assert_allclose(cloud.points, points)
    assert cloud.label is not None
    np.testing.assert_array_equal(cloud.label, range(4))
    assert describe(path)["kind"] == ("scene" if faces else "points")


def test_lists_of_vertices_that_lie_are_refused_by_info_and_by_complete(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    head = "element vertex 4\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    head += "property list char int view\nend_header\n"
    for encoding, body, message in (
        ("binary_little_endian", struct.pack("<3fb", 0, 0, 0, 0), "4 of vertex announced, 1 present"),
        ("binary_little_endian", struct.pack("<3fb", 0, 0, 0, -3), "has a list of -3 entries"),
        ("ascii", b"0 0 0 2 1\n" * 4, "row 1 after the header, '0 0 0 2 1', is no vertex"),
    ):
        path.write_bytes(f"ply\nformat {encoding} 1.0\n{head}".encode() + body)
        for read in (read_points, describe):
            with pytest.raises(InputError, match=message):
                read(path)
