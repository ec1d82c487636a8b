# SPDX-License-Identifier: MIT
"""Conditions of neighbouring tools' files, second look: docs/results/conditions-second-look.md lists them."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
import trimesh

from scenes.checks import InputError
from scenes.io.point_files import PointCloud, read_points
from scenes.io.scan_files import read_scan, read_scans
from scenes.io.scan_request import ScanRequest, read_request
from scenes.io.scene_files import load_scene
from tests.helpers import lidar_sweeps
from tests.helpers.e57_fields import STATION, Record, grid_fields, room_points, write_records
from tests.helpers.rgbd_rooms import CAMERA, quaternion, save, see_room
from tests.helpers.rgbd_rooms import off_walls as furthest
from tests.helpers.walks import walk_through_box, write_timed_las, write_tum

ROOM = room_points(np.arange(-178.5, 180, 6.0), np.arange(59.0, -60, -4.0))  # rows, columns, 3
ROWS, COLUMNS = ROOM.shape[:2]
WORLD = ROOM.reshape(-1, 3) + STATION
IN_ORDER = "its rows and columns are not in the format's order: they were put in order"
FRAMES = see_room(n_frames=4)


def text(points: Any, form: str = "%.6f") -> str:
    return "\n".join(" ".join(form % value for value in row) for row in points) + "\n"


def is_room(cloud: PointCloud) -> bool:
    return len(cloud.points) == len(WORLD) and furthest(cloud.points) < 1e-3


# E57


def written(path: Path, fields: dict[str, Any], **record: Any) -> Path:
    pytest.importorskip("pye57")
    return write_records(path / "a.e57", [Record(fields, **record)])


def test_e57_with_rows_as_columns_is_put_in_order(tmp_path: Path) -> None:
    fields = grid_fields(ROOM)
    fields["rowIndex"], fields["columnIndex"] = fields["columnIndex"], fields["rowIndex"]
    scan = read_scan(written(tmp_path, fields))
    assert scan.shape == (ROWS, COLUMNS)
    assert scan.warnings == (IN_ORDER,)
    assert furthest(scan.points()[scan.valid]) < 1e-9


@pytest.mark.parametrize("per_turn", [360.0, 400.0])
@pytest.mark.parametrize("has_grid", [True, False])
def test_e57_angles_that_are_no_radians_are_refused(tmp_path: Path, per_turn: float, has_grid: bool) -> None:
    x, y, z = ROOM.reshape(-1, 3).T
    reach, turn = np.linalg.norm(ROOM.reshape(-1, 3), axis=1), per_turn / (2 * np.pi)
    fields = {"sphericalRange": reach, "sphericalAzimuth": np.arctan2(y, x) * turn}
    fields["sphericalElevation"] = np.arcsin(z / reach) * turn
    if has_grid:
        fields |= {name: values for name, values in grid_fields(ROOM).items() if "Index" in name}
    with pytest.raises(InputError, match=r"its azimuths reach .* which are no radians"):
        read_points(written(tmp_path, fields))


@pytest.mark.parametrize(("along", "across"), [(10, 10), (3, 1), (1, 2)])
def test_e57_of_every_kth_row_and_column_has_no_empty_ones(tmp_path: Path, along: int, across: int) -> None:
    fields = grid_fields(ROOM, first=7)
    fields["rowIndex"], fields["columnIndex"] = along * fields["rowIndex"], across * fields["columnIndex"]
    scan = read_scan(written(tmp_path, fields))
    assert scan.valid.all()
    assert scan.shape == (ROWS, COLUMNS)


def test_e57_directions_without_range_are_no_points(tmp_path: Path) -> None:
    fields, aside = grid_fields(ROOM), np.arange(len(WORLD)) % 5 == 0
    for axis in "XYZ":
        values = fields[f"cartesian{axis}"]
        fields[f"cartesian{axis}"] = np.where(aside, values / 10, values)
    fields["cartesianInvalidState"] = aside.astype(np.int8)
    cloud = read_points(written(tmp_path, fields))
    assert len(cloud.points) == np.count_nonzero(~aside)
    assert furthest(cloud.points) < 1e-9


def test_e57_world_coordinates_without_a_grid_are_taken_as_such(tmp_path: Path) -> None:
    fields = grid_fields(ROOM + STATION)
    fields = {name: values for name, values in fields.items() if "Index" not in name}
    scan = read_scan(written(tmp_path, fields))
    assert "only as world coordinates" in scan.warnings[-1]
    assert furthest(scan.points()[scan.valid]) < 1e-9


def test_e57_quaternions_of_another_length_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="of length 2, which is no rotation"):
        read_scan(written(tmp_path, grid_fields(ROOM), pose=((2, 0, 0, 0), tuple(STATION))))


def test_scans_that_repeat_others_count_once(tmp_path: Path) -> None:
    pytest.importorskip("pye57")
    record = Record(grid_fields(ROOM))
    moved = Record(grid_fields(ROOM), pose=((1, 0, 0, 0), (9.0, 9.0, 1.5)))
    path = write_records(tmp_path / "a.e57", [record, record, moved])
    given = read_request(ScanRequest((str(path),)))
    assert len(given.scans) == len(given.names) == len(given.paths) == 2
    assert given.doubts[0] == f"1 of 3 scans, as {path}#2, repeat others with their poses and were left out"


# LAS


def write_las(path: Path, points: Any = WORLD, **fields: Any) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 1e-4)
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    for name, values in fields.items():
        setattr(data, name, values)
    data.write(str(path))
    return path


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_las_synthetic_points_are_left_out_unless_all_are(tmp_path: Path, suffix: str) -> None:
    made = np.arange(len(WORLD)) < 100
    path = write_las(tmp_path / f"a{suffix}", WORLD + 0.3 * made[:, None], synthetic=made)
    cloud = read_points(path)
    assert cloud.warnings == (f"100 of {len(WORLD)} points are marked synthetic and were left out",)
    assert furthest(cloud.points) < 1e-3
    assert is_room(read_points(write_las(tmp_path / f"all{suffix}", synthetic=made | True)))


def test_las_with_too_small_a_count_is_told(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.las")
    data = bytearray(path.read_bytes())
    data[107:111] = bytes(4)  # the old count
    data[247:255] = struct.pack("<Q", 100)
    path.write_bytes(data)
    assert f"{len(WORLD) - 100} points more than its header announces" in read_points(path).warnings[0]
    data[247:255] = bytes(8)
    path.write_bytes(data)
    with pytest.raises(InputError, match=rf"announces no points, {len(WORLD)} follow: its writer did not"):
        read_points(path)


def test_las_negative_scales_are_scales(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.las", WORLD * [1, -1, 1])
    data = bytearray(path.read_bytes())
    data[139:147] = struct.pack("<d", -1e-4)  # the scale of y
    path.write_bytes(data)
    assert is_room(read_points(path))


# PTX, PTS


def write_ptx(path: Path, flat: Any, rows: int, columns: int, scale: float = 1.0) -> Path:
    pose = np.vstack([scale * np.eye(3), STATION])
    lines = text(np.column_stack([pose, [0, 0, 0, 1]])) + text(
        np.column_stack([flat, np.full(len(flat), 0.3)])
    )
    path.write_text(f"{columns}\n{rows}\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n{lines}")
    return path


@pytest.mark.parametrize("by_column", [True, False])
@pytest.mark.parametrize("is_exchanged", [True, False])
def test_ptx_in_another_order_is_put_in_order(tmp_path: Path, by_column: bool, is_exchanged: bool) -> None:
    flat = (ROOM.swapaxes(0, 1) if by_column else ROOM).reshape(-1, 3)
    shape = (COLUMNS, ROWS) if is_exchanged else (ROWS, COLUMNS)
    scan = read_scan(write_ptx(tmp_path / "a.ptx", flat, *shape))
    assert scan.shape == (ROWS, COLUMNS)
    assert scan.warnings == (() if by_column and not is_exchanged else (IN_ORDER,))
    assert furthest(scan.points()[scan.valid]) < 1e-5


def test_ptx_decimal_commas_and_scales(tmp_path: Path) -> None:
    path = write_ptx(tmp_path / "a.ptx", ROOM.swapaxes(0, 1).reshape(-1, 3), ROWS, COLUMNS)
    path.write_text(path.read_text().replace(".", ","))
    scan = read_scan(path)
    assert scan.valid.all()
    assert furthest(scan.points()[scan.valid]) < 1e-5
    feet = write_ptx(tmp_path / "b.ptx", ROOM.reshape(-1, 3), ROWS, COLUMNS, scale=0.3048)
    with pytest.raises(InputError, match=r"scaled by 0\.3048; divide its rotation by that"):
        read_scan(feet)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("parts", [(500,), (10, 900), ()])
def test_pts_of_several_clouds(tmp_path: Path, end: str, parts: tuple[int, ...]) -> None:
    table = np.column_stack([WORLD, np.full(len(WORLD), -1200), np.tile([10, 200, 30], (len(WORLD), 1))])
    blocks = np.split(table, parts)
    lines = "".join(f"{len(block)}\n{text(block, '%.5f').replace('.00000', '')}" for block in blocks)
    path = tmp_path / "a.pts"
    path.write_bytes(lines.replace("\n", end).encode())
    cloud = read_points(path)
    assert is_room(cloud)
    assert cloud.colour is not None
    assert np.unique(cloud.colour, axis=0).tolist() == [[10, 200, 30]]
    path.write_bytes(lines.replace("\n", end).encode() + b"5\n1 1 1 0 0 0 0\n")
    with pytest.raises(InputError, match="announces"):
        read_points(path)


# PCD


def write_pcd(path: Path, fields: str, rows: str, width: int, height: int = 1, kinds: str = "F") -> Path:
    n, kind = len(fields.split()), " ".join(["F"] * (len(fields.split()) - 1) + [kinds])
    path.write_text(
        f"VERSION 0.7\nFIELDS {fields}\nSIZE {'4 ' * n}\nTYPE {kind}\nCOUNT {'1 ' * n}\nWIDTH {width}\n"
        f"HEIGHT {height}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {width * height}\nDATA ascii\n{rows}"
    )
    return path


PACKED = 0xC83214
AS_BITS = repr(float(np.array([PACKED], np.uint32).view(np.float32)[0]))


@pytest.mark.parametrize(
    ("word", "kind", "share"),
    [("nan", "F", 3), (AS_BITS, "F", 0), (str(PACKED), "F", 0), (str(PACKED), "U", 0), ("nan", "F", 1)],
)
def test_pcd_packed_colours(tmp_path: Path, word: str, kind: str, share: int) -> None:
    words = [word if not share or k % share == 0 else AS_BITS for k in range(len(WORLD))]
    rows = "".join(f"{x:.6f} {y:.6f} {z:.6f} {word}\n" for (x, y, z), word in zip(WORLD, words, strict=True))
    cloud = read_points(write_pcd(tmp_path / "a.pcd", "x y z rgb", rows, len(WORLD), kinds=kind))
    assert any("have no valid colour" in warning for warning in cloud.warnings) == bool(share)
    if share == 1:
        assert cloud.colour is None
    else:
        assert cloud.colour is not None
        assert np.unique(cloud.colour, axis=0).tolist() == [[200, 50, 20]]


def test_pcd_width_and_height_exchanged(tmp_path: Path) -> None:
    looks = CAMERA.directions()
    points = looks / looks[..., 2:] * FRAMES[0].depth[..., None]
    scan = read_scan(write_pcd(tmp_path / "a.pcd", "x y z", text(points.reshape(-1, 3)), *CAMERA.shape))
    assert scan.shape == CAMERA.shape
    assert scan.warnings == (IN_ORDER,)
    assert np.allclose(scan.points_in_sensor(), points, atol=1e-5)


# PLY, OBJ, OFF, GLB


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize("end", ["\r", "\r\n", "\n"])
def test_ply_line_ends(tmp_path: Path, encoding: str, end: str) -> None:
    head = f"ply\nformat {encoding} 1.0\nelement vertex {len(WORLD)}\n"
    head += "property float x\nproperty float y\nproperty float z\nend_header\n"
    body = text(WORLD).replace("\n", end).encode() if encoding == "ascii" else WORLD.astype("<f4").tobytes()
    path = tmp_path / "a.ply"
    path.write_bytes(head.replace("\n", end).encode() + body)
    assert is_room(read_points(path))


def test_ply_range_grids_are_points(tmp_path: Path) -> None:
    lines = "ply\nformat ascii 1.0\nobj_info num_cols 60\nobj_info num_rows 31\n"
    lines += f"element vertex {len(WORLD)}\nproperty float x\nproperty float y\nproperty float z\n"
    lines += f"element range_grid {len(WORLD) + 60}\nproperty list uchar int vertex_indices\nend_header\n"
    path = tmp_path / "a.ply"
    path.write_text(lines + text(WORLD) + "".join(f"1 {k}\n" for k in range(len(WORLD))) + "0\n" * 60)
    assert is_room(read_points(path))


L_FLOOR = [(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)]
U_FLOOR = [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]
WITH_HOLE = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]
ARROW = [(0, 0), (2, 1), (0, 2), (1, 1)]
SQUARE = [(0, 0), (2, 0), (2, 2), (0, 2)]


def polygon_obj(vertices: Any, corners: list[int]) -> bytes:
    face = " ".join(f"{corner + 1}" for corner in corners)
    return ("".join(f"v {x} {y} {z}\n" for x, y, z in vertices) + f"f {face}\n").encode()


def polygon_off(vertices: Any, corners: list[int]) -> bytes:
    face = " ".join(map(str, corners))
    return f"OFF\n{len(vertices)} 1 0\n{text(vertices)}{len(corners)} {face} 10 20 30\n".encode()


def polygon_ply(vertices: Any, corners: list[int], form: str = "ascii") -> bytes:
    head = f"ply\nformat {form} 1.0\nelement vertex {len(vertices)}\nproperty double x\nproperty double y\n"
    head += "property double z\nelement face 1\nproperty list uchar int vertex_indices\n"
    head += "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    if form == "ascii":
        face = " ".join(map(str, [len(corners), *corners, 10, 20, 30]))
        return (head + text(vertices) + face + "\n").encode()
    rows = struct.pack(f"<B{len(corners)}i3B", len(corners), *corners, 10, 20, 30)
    return head.encode() + np.asarray(vertices, "<f8").tobytes() + rows


def binary_ply(vertices: Any, corners: list[int]) -> bytes:
    return polygon_ply(vertices, corners, "binary_little_endian")


@pytest.mark.parametrize(
    ("suffix", "write"),
    [(".obj", polygon_obj), (".off", polygon_off), (".ply", polygon_ply), (".ply", binary_ply)],
)
@pytest.mark.parametrize(
    ("outline", "area"), [(L_FLOOR, 7), (U_FLOOR, 7), (WITH_HOLE, 12), (ARROW, 1), (SQUARE, 4)]
)
@pytest.mark.parametrize("first", [0, 1, 3])
def test_polygons_cover_their_own_area(
    tmp_path: Path,
    suffix: str,
    write: Callable[..., bytes],
    outline: list[tuple[int, int]],
    area: float,
    first: int,
) -> None:
    x, y = np.array(outline, np.float64).T
    vertices = np.column_stack([x + y, x - y, 0.5 * x + 1]) if first == 3 else np.column_stack([x, y, 0 * x])
    path = tmp_path / f"a{suffix}"
    path.write_bytes(write(vertices, np.roll(np.arange(len(x)), -first).tolist()))
    mesh = load_scene(path, up="z").mesh
    a, b, c = mesh.vertices[mesh.faces].swapaxes(0, 1)
    normals = np.cross(b - a, c - a) / 2
    assert len(mesh.faces) == len(outline) - 2
    stretch = np.linalg.norm(np.cross([1, 1, 0.5], [1, -1, 0])) if first == 3 else 1.0
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(area * stretch)
    assert np.linalg.norm(normals.sum(axis=0)) == pytest.approx(area * stretch)  # no face lies upside down


@pytest.mark.parametrize("corner", ["{0}//", "{0}/", "{0}"])
def test_obj_corners_with_bare_slashes(tmp_path: Path, corner: str) -> None:
    box = trimesh.creation.box((2, 1, 4))
    lines = [f"f {' '.join(corner.format(k + 1) for k in face)}" for face in box.faces]
    path = tmp_path / "a.obj"
    path.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in box.vertices) + "\n".join(lines))
    mesh = load_scene(path, up="z").mesh
    assert np.ptp(mesh.vertices, axis=0).tolist() == [2, 1, 4]


def test_obj_in_millimetres_without_its_materials(tmp_path: Path) -> None:
    box = trimesh.creation.box((2000, 1000, 4000))
    path = tmp_path / "a.obj"
    lines = "".join(f"v {x} {y} {z}\n" for x, y, z in box.vertices)
    path.write_text(
        f"mtllib gone.mtl\nusemtl nope\n{lines}" + "".join(f"f {a} {b} {c}\n" for a, b, c in box.faces + 1)
    )
    doubts = " ".join(load_scene(path).warnings)
    assert "'gone.mtl' is missing" in doubts
    assert "--units says the file's unit" in doubts
    assert np.allclose(np.ptp(load_scene(path, units="mm", up="z").mesh.vertices, axis=0), [2, 1, 4])


def write_glb(path: Path, vertices: Any, mode: int, rotation: list[float]) -> Path:
    body = np.asarray(vertices, "<f4").tobytes()
    content: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}
    content["nodes"] = [{"mesh": 0, "rotation": rotation}]
    content["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0}, "mode": mode}]}]
    ends = {"min": np.min(vertices, axis=0).tolist(), "max": np.max(vertices, axis=0).tolist()}
    content["accessors"] = [
        {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3", **ends}
    ]
    content["bufferViews"] = [{"buffer": 0, "byteLength": len(body)}]
    content["buffers"] = [{"byteLength": len(body)}]
    head = json.dumps(content).encode()
    head += b" " * (-len(head) % 4)
    path.write_bytes(
        struct.pack("<4sIIII", b"glTF", 2, 28 + len(head) + len(body), len(head), 0x4E4F534A)
        + head
        + struct.pack("<II", len(body), 0x004E4942)
        + body
    )
    return path


@pytest.mark.parametrize("rotation", [[0, 0, 0, 1.0], [0, 0, 0, 2.0], [0, 0, 3.0, 3.0]])
def test_glb_strips_under_quaternions_of_any_length(tmp_path: Path, rotation: list[float]) -> None:
    strip = [(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 0), (2, 0, 0), (2, 1, 0), (3, 0, 1), (3, 1, 1)]
    mesh = load_scene(write_glb(tmp_path / "a.glb", strip, 5, rotation), up="z").mesh
    a, b, c = mesh.vertices[mesh.faces].swapaxes(0, 1)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(2 + np.sqrt(2))
    with pytest.raises(InputError, match="is a fan of triangles, which is not known; save it as plain"):
        load_scene(write_glb(tmp_path / "fan.glb", strip[:3], 6, rotation))


# text


@pytest.mark.parametrize("separator", [";", "\t", " "])
@pytest.mark.parametrize("mark", ["'", "\u2019"])
def test_text_apostrophes_between_thousands(tmp_path: Path, separator: str, mark: str) -> None:
    far = np.array([2600000.0, 1200000.0, 1400.0])
    path = tmp_path / "a.txt"
    rows = [separator.join(f"{value:,.4f}".replace(",", mark) for value in row) for row in WORLD + far]
    path.write_text("\n".join(rows), encoding="utf-8")
    assert np.allclose(read_points(path).points, WORLD + far, atol=1e-3)


def test_text_fortran_exponents(tmp_path: Path) -> None:
    path = tmp_path / "a.xyz"
    path.write_text(text(WORLD, "%.8E").replace("E", "D"))
    assert is_room(read_points(path))


@pytest.mark.parametrize("names", ["range,azimuth,elevation", "Pt Hz V SD", "Theta;Phi;R", "id az dist h"])
def test_text_polar_columns_are_refused(tmp_path: Path, names: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(
        names
        + "\n"
        + text(np.column_stack([WORLD, WORLD])[:, : len(names.replace(";", " ").replace(",", " ").split())])
    )
    with pytest.raises(InputError, match=r"are angles and distances of an instrument; export x, y, z"):
        read_points(path)


@pytest.mark.parametrize("separator", [" ", ",", "\t"])
def test_text_names_of_points_without_a_header_are_refused_with_the_cure(
    tmp_path: Path, separator: str
) -> None:
    path = tmp_path / "a.txt"
    path.write_text("".join(separator.join([f"P{k}", *map(str, row)]) + "\n" for k, row in enumerate(WORLD)))
    with pytest.raises(InputError, match=r"begin with words, as 'P0'; name the columns in the first line"):
        read_points(path)


@pytest.mark.parametrize(("number", "others"), [(-9999, "0 0"), (-9999, "-9999 -9999"), (-32768, "1 2")])
def test_heights_that_say_no_data_are_left_out(tmp_path: Path, number: int, others: str) -> None:
    path = tmp_path / "a.xyz"
    path.write_text(text(WORLD) + f"{others} {number}\n" * 7)
    cloud = read_points(path)
    assert is_room(cloud)
    assert f"7 of {len(WORLD) + 7} points have the height {number}" in " ".join(cloud.warnings)
    path.write_text(text(WORLD - [0, 0, 40000]) + f"{others} {number}\n")  # not far below all others
    assert len(read_points(path).points) == len(WORLD) + 1


# RGB-D folders


def write_tum_folder(folder: Path, per_second: float, poses_per_second: float) -> Path:
    def stamp(seconds: float, unit: float) -> str:
        return f"{seconds:.4f}" if unit == 1 else f"{seconds * unit:.0f}"

    times, listed, poses = 1305031102.175 + np.arange(len(FRAMES)) / 30, list[str](), list[str]()
    for frame, time in zip(FRAMES, times.tolist(), strict=True):
        name = stamp(time, per_second)
        save(folder / "depth" / f"{name}.png", np.rint(5000 * frame.depth).astype(np.uint16))
        save(folder / "rgb" / f"{name}.png", frame.colour())
        listed.append(f"{name} KIND/{name}.png")
        numbers = [*frame.matrix[:3, 3].tolist(), *quaternion(frame.matrix)]
        poses.append(" ".join([stamp(time + 0.004, poses_per_second), *map(repr, numbers)]))
    for kind in ("depth", "rgb"):
        save(folder / f"{kind}.txt", "\n".join(listed).replace("KIND", kind))
    save(folder / "groundtruth.txt", "\n".join(poses))
    fx, fy, cx, cy = CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy
    save(folder / "camera.json", {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "depth_scale": 5000})
    return folder


@pytest.mark.parametrize(("frames", "poses"), [(1, 1), (1e3, 1e3), (1e9, 1e9), (1e3, 1), (1, 1e6)])
def test_tum_times_of_any_unit(tmp_path: Path, frames: float, poses: float) -> None:
    scans = read_scans(write_tum_folder(tmp_path, frames, poses))
    assert len(scans) == len(FRAMES)
    assert max(furthest(scan.points()[scan.valid]) for scan in scans) < 1e-3


def test_tum_poses_of_another_clock_are_told(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path, 1, 1)
    save(folder / "groundtruth.txt", "5.0 0 0 0 0 0 0 1\n6.0 0 0 0 0 0 0 1\n")
    with pytest.raises(
        InputError, match=r"none of its 4 frames, from 1305031102\.175 s on, has a pose within"
    ):
        read_scans(folder)


def write_plain(folder: Path, numbers: list[int], **camera: Any) -> Path:
    for k, number in enumerate(numbers):
        save(folder / "depth" / f"{k:04d}.png", FRAMES[number].mm)
        save(folder / "color" / f"{k:04d}.png", FRAMES[number].colour())
    matrices = [FRAMES[number].matrix for number in numbers]
    save(folder / "pose.txt", text([[*matrix[:3, 3], *quaternion(matrix)] for matrix in matrices], "%.9f"))
    of = {"fx": CAMERA.fx, "fy": CAMERA.fy, "cx": CAMERA.cx, "cy": CAMERA.cy, "depth_scale": 1000}
    save(folder / "camera.json", of | camera)
    return folder


def test_rgbd_frames_that_repeat_count_once(tmp_path: Path) -> None:
    given = read_request(ScanRequest((str(write_plain(tmp_path, [0, 0, 1, 1])),)))
    assert len(given.scans) == 2
    assert given.doubts[0].startswith("2 of 4 scans")


def test_rgbd_intrinsics_of_an_upright_image_are_doubted(tmp_path: Path) -> None:
    camera = {"fx": CAMERA.fy, "fy": CAMERA.fx, "cx": CAMERA.cy, "cy": CAMERA.cx}
    given = read_request(ScanRequest((str(write_plain(tmp_path / "a", [0, 1], **camera)),)))
    assert "are rows and columns swapped?" in " ".join(given.doubts)
    with pytest.raises(InputError, match=r"is 64 x 48, its camera file says \(48, 64\)"):
        read_scans(write_plain(tmp_path / "b", [0, 1], **camera, width=48, height=64))


def test_rgbd_with_a_missing_colour_is_refused(tmp_path: Path) -> None:
    folder = write_plain(tmp_path, [0, 1, 2])
    (folder / "color" / "0001.png").unlink()
    with pytest.raises(InputError, match="holds 2 colour and 3 depth images; give as many of both"):
        read_scans(folder)


@pytest.mark.parametrize("above", ["", "left/", "left\\", "C:\\scans\\left\\"])
def test_colmap_names_in_folders_of_either_slash(tmp_path: Path, above: str) -> None:
    folder, lines = write_plain(tmp_path / "a", [0, 1, 2]), list[str]()
    (folder / "pose.txt").unlink()
    for k, frame in enumerate(FRAMES[:3]):
        camera = np.linalg.inv(frame.matrix)
        x, y, z, w = quaternion(camera)
        numbers = " ".join(map(repr, [w, x, y, z, *camera[:3, 3].tolist()]))
        lines += [f"{k + 1} {numbers} 1 {above}{k:04d}.png", ""]
    poses = tmp_path / "images.txt"
    poses.write_bytes("\r\n".join([*lines, ""]).encode())
    given = read_request(ScanRequest((str(folder),), poses=str(poses)))
    assert max(furthest(scan.points()[scan.valid]) for scan in given.scans) < 2e-3


# trajectories, sweeps, VTK


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Path]:
    held = walk_through_box(seconds=0.4)
    path = tmp_path_factory.mktemp("walk") / "walk.las"
    return held, write_timed_las(path, held.points, held.times + 1000)


@pytest.mark.parametrize(
    ("start", "per_second", "unit"), [(1000, 1e3, "milli"), (999.9, 1e3, "milli"), (1000.2, 2e6, "")]
)
def test_trajectory_in_parts_of_seconds_is_told(
    tmp_path: Path, walk: tuple[Any, Path], start: float, per_second: float, unit: str
) -> None:
    held, points = walk
    write_tum(tmp_path / "t.txt", (held.track_times + start) * per_second, held.track_places)
    cause = (
        rf"fit those of the points, .* as {unit}seconds: divide them by" if unit else "these do not overlap"
    )
    with pytest.raises(InputError, match=cause):
        read_request(ScanRequest((str(points),), trajectory=str(tmp_path / "t.txt")))


def test_trajectory_in_other_coordinates_is_refused(tmp_path: Path, walk: tuple[Any, Path]) -> None:
    held, points = walk
    write_tum(tmp_path / "t.txt", held.track_times + 1000, held.track_places + [500000, 5000000, 300])
    with pytest.raises(InputError, match=r"or more from t\.txt: give both in one coordinate system and unit"):
        read_request(ScanRequest((str(points),), trajectory=str(tmp_path / "t.txt")))


@pytest.mark.parametrize("separator", [",", " "])
def test_trajectory_with_dates_is_refused_with_the_cure(
    tmp_path: Path, walk: tuple[Any, Path], separator: str
) -> None:
    rows = (
        ["time", "x", "y", "z"],
        ["2024-05-01T10:00:00.5", "1", "2", "3"],
        ["2024-05-01T10:00:01", "1", "2", "3"],
    )
    (tmp_path / "t.csv").write_text("\n".join(map(separator.join, rows)))
    with pytest.raises(InputError, match=r"its times, as in the line '2024.* are no numbers; write seconds"):
        read_request(ScanRequest((str(walk[1]),), trajectory=str(tmp_path / "t.csv")))


@pytest.mark.parametrize("is_of_camera", [True, False])
def test_sweeps_in_the_axes_of_a_camera_are_doubted(tmp_path: Path, is_of_camera: bool) -> None:
    points = lidar_sweeps.sweep(lidar_sweeps.HDL32, 1.0, by="beam").points
    if is_of_camera:
        points = np.column_stack([-points[:, 1], -points[:, 2], points[:, 0]])
    path = tmp_path / "a.bin"
    np.column_stack([points, np.full(len(points), 0.3)]).astype("<f4").tofile(path)
    assert ("its beams turn about y" in " ".join(read_scan(path).warnings)) == is_of_camera
    np.column_stack([points, np.full(len(points), 0.3)]).astype("<f8").tofile(path)
    with pytest.raises(InputError, match="are no sweep of KITTI"):
        read_scan(path)


@pytest.mark.parametrize("kind", ["float", "double"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_vtk_of_either_byte_order(tmp_path: Path, kind: str, order: str) -> None:
    number = order + ("f4" if kind == "float" else "f8")
    head = f"# vtk DataFile Version 3.0\nx\nBINARY\nDATASET POLYDATA\nPOINTS {len(WORLD)} {kind}\n"
    tail = (
        f"\nPOINT_DATA {len(WORLD)}\nNORMALS n {kind}\n".encode() + np.ones((len(WORLD), 3), number).tobytes()
    )
    path = tmp_path / "a.vtk"
    path.write_bytes(head.encode() + WORLD.astype(number).tobytes() + tail)
    cloud = read_points(path)
    assert is_room(cloud)
    assert ("little-endian" in " ".join(cloud.warnings)) == (order == "<")
    assert cloud.normals is not None
    assert (cloud.normals == 1).all()


def test_vtk_unstructured_grids_of_both_versions(tmp_path: Path) -> None:
    n = len(WORLD)
    points = f"ASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {n} float\n{text(WORLD)}"
    old = f"CELLS {n} {2 * n}\n" + "".join(f"1 {k}\n" for k in range(n)) + f"CELL_TYPES {n}\n" + "1\n" * n
    numbers = " ".join(map(str, range(n + 1)))
    new = f"METADATA\nINFORMATION 0\n\nCELLS {n + 1} {n}\nOFFSETS vtktypeint64\n{numbers}\n"
    new += f"CONNECTIVITY vtktypeint64\n{numbers[: numbers.rindex(' ')]}\n"
    path = tmp_path / "a.vtk"
    for version, cells in (("3.0", old), ("5.1", new)):
        path.write_text(f"# vtk DataFile Version {version}\nx\n{points}{cells}")
        assert is_room(read_points(path))
