# SPDX-License-Identifier: MIT
"""Reading and writing scans by name: dispatch, PATH#k, poses, units, and what unusable input is told."""

import json
import os
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.scan_files import (
    in_metres,
    open_scans,
    read_scan,
    read_scans,
    split_index,
    write_scan,
    write_scans,
)
from scenes.pose import Pose
from scenes.run.atomic import atomic_path, json_text, write_bytes, write_json
from tests.helpers.scan_examples import POSE, PROJECTIONS, assert_same_scan, example_scan

SUFFIXES = (".npz", ".ply", ".pcd", ".ptx", ".e57")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nothing.npz", "nothing.npz: no such file or folder"),
        (
            "mesh.glb",
            r"mesh.glb: \.glb is a mesh, not a scan; say where scanners stood in it, --origin",
        ),
        ("cloud.las", r"cloud.las: not a LAS file: it does not begin with LASF"),
        ("cloud.pts", r"cloud.pts: holds points without a pixel grid or sensor position.*--origin X,Y,Z"),
        ("text.docx", r"text.docx: cannot read scans from \.docx; known: \.npz, \.ply"),
        ("plain", "cannot read scans from a file without suffix"),
        ("folder", "folder: is not an RGB-D folder: expected depth images in depth/"),
        ("plain#x", "plain#x: after # comes the number of a scan, from 1; got 'x'"),
    ],
)
def test_unusable_names_are_told_the_cure(tmp_path: Path, name: str, message: str) -> None:
    for file in ("mesh.glb", "cloud.las", "cloud.pts", "text.docx", "plain"):
        (tmp_path / file).write_text("something")
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=message):
        read_scan(f"{tmp_path}/{name}")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_empty_truncated_and_foreign_files_are_named(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"scan{suffix}"
    write_scan(example_scan(PROJECTIONS["panorama"]), path)
    whole = path.read_bytes()
    for broken in (b"", whole[: len(whole) // 2], whole[:20], b"hello world\n", os.urandom(300)):
        path.write_bytes(broken)
        with pytest.raises(InputError, match=f"scan{suffix}: ") as caught:
            read_scan(path)
        assert "\n" not in str(caught.value)


def test_the_reason_for_damage_is_said(tmp_path: Path) -> None:
    for suffix, message in [
        (".pcd", "truncated: [0-9]+ bytes of points announced, [0-9]+ present"),
        (".ply", "truncated: 1500 of vertex take"),
        (".ptx", "truncated: 1500 points announced, [0-9]+ present"),
    ]:
        path = tmp_path / f"scan{suffix}"
        write_scan(example_scan(PROJECTIONS["panorama"]), path)
        path.write_bytes(path.read_bytes()[:-400])
        with pytest.raises(InputError, match=message):
            read_scan(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_folder_with_a_scans_suffix_is_no_file(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"scan{suffix}").mkdir()
    with pytest.raises(InputError, match="is not an RGB-D folder"):
        read_scan(tmp_path / f"scan{suffix}")
    with pytest.raises(InputError, match="is a folder; name a file to write"):
        write_scan(example_scan(PROJECTIONS["pinhole"]), tmp_path / f"scan{suffix}")


def test_a_plain_point_cloud_is_refused(tmp_path: Path) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
    (tmp_path / "cloud.ply").write_text(header + "end_header\n1 2 3\n")
    with pytest.raises(InputError, match=r"PLY without sensor position and pixel grid; a scan needs .*\.e57"):
        read_scan(tmp_path / "cloud.ply")


PCD = """VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {w}\nHEIGHT {h}
VIEWPOINT 0 0 0 {q}\nPOINTS {n}\nDATA ascii\n"""


def test_pcd_refusals(tmp_path: Path) -> None:
    path, row = tmp_path / "a.pcd", "1 2 3\n"
    for text, message in [
        (
            PCD.format(w=3, h=1, n=3, q="1 0 0 0") + row * 3,
            r"the cloud is unorganised \(HEIGHT 1, 3 points\)",
        ),
        (PCD.format(w=2, h=2, n=4, q="2 0 0 0") + row * 4, "VIEWPOINT has the quaternion .* no rotation"),
        (
            PCD.format(w=99999999, h=99, n=4, q="1 0 0 0") + row * 4,
            "its points: 9,899,999,901 exceed the limit points",
        ),
        (PCD.format(w=2, h=2, n=4, q="1 0 0 0") + row * 3, "23 bytes of points at least announced, 18 pre"),
        (PCD.format(w=2, h=2, n=3, q="1 0 0 0") + row * 3, "announces 3 points in 2 x 2"),
        (PCD.format(w=2, h=2, n=4, q="1 0 0 0").replace("COUNT 1", "COUNT 9999") + row, "values; expected"),
        (
            PCD.format(w=2, h=2, n=4, q="1 0 0 0").replace("x y z", "a b c") + row * 4,
            "has the fields a, b, c; x, y, z are needed",
        ),
        (
            PCD.format(w=2, h=2, n=4, q="1 0 0 0") + "nan nan nan\n" * 4,
            "no point in it is finite; give --intr",
        ),
        ("VERSION 0.7\nFIELDS x\n", "not a PCD file: there is no DATA line"),
    ]:
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            read_scan(path)


@pytest.mark.parametrize("encoding", ["ascii", "binary_compressed"])
def test_pcd_of_other_encodings(tmp_path: Path, encoding: str) -> None:
    from pypcd4 import Encoding, PointCloud

    scan = example_scan(PROJECTIONS["pinhole"])
    write_scan(scan, tmp_path / "ours.pcd")
    cloud = PointCloud.from_path(tmp_path / "ours.pcd")
    cloud.save(tmp_path / "theirs.pcd", Encoding(encoding))
    back = read_scan(tmp_path / "theirs.pcd")
    np.testing.assert_allclose(back.points(), scan.points(), atol=1e-6)
    assert abs(back.projection.pixel_angle / scan.projection.pixel_angle - 1) < 1e-6


def test_pcd_in_world_coordinates_is_recognised(tmp_path: Path) -> None:
    scan = example_scan(PROJECTIONS["pinhole"], colour=False)
    qx, qy, qz, qw = _quaternion(POSE)
    viewpoint = " ".join(map(str, [*POSE.translation, qw, qx, qy, qz]))
    header = PCD.format(w=31, h=23, n=23 * 31, q="").replace("VIEWPOINT 0 0 0 ", f"VIEWPOINT {viewpoint}")
    rows = "\n".join(" ".join(f"{value:.7f}" for value in point) for point in scan.points().reshape(-1, 3))
    (tmp_path / "world.pcd").write_text(header.replace("SIZE 4 4 4", "SIZE 8 8 8") + rows + "\n")
    np.testing.assert_allclose(read_scan(tmp_path / "world.pcd").points(), scan.points(), atol=1e-6)


def _quaternion(pose: Pose) -> list[float]:
    from scipy.spatial.transform import Rotation

    return [float(part) for part in Rotation.from_matrix(pose.rotation).as_quat()]


def test_an_npz_that_is_no_scan_lists_its_keys(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", depth=np.zeros(3), camera=np.zeros(4))
    with pytest.raises(InputError, match="holds camera, depth, which is no scan; expected header and ranges"):
        read_scan(tmp_path / "a.npz")


def test_a_pickle_in_an_npz_is_never_opened(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", header=np.array([{"x": 1}], dtype=object), ranges=np.zeros((2, 2)))
    with pytest.raises(
        InputError, match=r"its 'header' holds Python objects \(a pickle\), which are never opened"
    ):
        read_scan(tmp_path / "a.npz")


def test_a_zip_bomb_is_not_unpacked(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("ranges.npy", b"x")
    data = bytearray((tmp_path / "a.npz").read_bytes())
    at = data.rfind(b"PK\x01\x02") + 24  # unpacked size in the central directory
    data[at : at + 4] = (0xFFFFFFF0).to_bytes(4, "little")
    (tmp_path / "a.npz").write_bytes(data)
    with pytest.raises(
        InputError, match="unpacked bytes of it for each packed one: 4,294,967,280 exceed the limit ratio=200"
    ):
        read_scan(tmp_path / "a.npz")


@pytest.mark.parametrize(("module", "suffix", "extra"), [("pye57", ".e57", "e57"), ("pypcd4", ".pcd", "pcd")])
def test_a_missing_extra_names_the_cure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, suffix: str, extra: str
) -> None:
    scan = example_scan(PROJECTIONS["pinhole"])
    write_scan(scan, tmp_path / f"a{suffix}")
    monkeypatch.setitem(sys.modules, module, None)
    cure = rf'{module} is not installed; the cure: pip install "unseen\[{extra}\]"'
    if suffix != ".pcd":  # is read without
        with pytest.raises(InputError, match=cure):
            read_scan(tmp_path / f"a{suffix}")
    with pytest.raises(InputError, match=cure):
        write_scan(scan, tmp_path / f"b{suffix}")


def test_split_index_heeds_files_whose_name_has_a_hash(tmp_path: Path) -> None:
    scan = example_scan(PROJECTIONS["pinhole"])
    write_scan(scan, tmp_path / "a#2.npz")
    assert_same_scan(read_scan(tmp_path / "a#2.npz"), scan)
    assert split_index("a.e57#12") == (Path("a.e57"), 12)
    for number in (0, 2):
        with pytest.raises(InputError, match=rf"npz#{number}: there are 1 scans, counted from 1"):
            read_scan(f"{tmp_path}/a#2.npz#{number}")


def test_units_scale_everything(tmp_path: Path) -> None:
    scan = example_scan(PROJECTIONS["pinhole"], off_rays_m=0.01, truth=True)
    write_scan(scan, tmp_path / "a.npz")
    small = read_scan(tmp_path / "a.npz", units="mm")
    np.testing.assert_allclose(small.points(), scan.points() / 1000, rtol=1e-12)
    np.testing.assert_allclose(small.ranges, scan.ranges / 1000)
    assert small.sigma_m == pytest.approx(2e-6)
    assert small.truth is not None
    np.testing.assert_allclose(small.truth.ranges, small.ranges)
    assert in_metres(scan, "m") is scan
    with pytest.raises(InputError, match="unknown units 'yd'; known: mm, cm, m, in, ft, us-ft"):
        read_scan(tmp_path / "a.npz", units="yd")  # type: ignore[arg-type]


def test_poses_from_a_file_replace_those_of_the_scans(tmp_path: Path) -> None:
    write_scans([example_scan(PROJECTIONS["pinhole"], seed=k) for k in range(3)], tmp_path / "a.e57")
    poses = [Pose.looking_at((k, 0, 1), (k, 5, 1)) for k in range(3)]
    lines = [" ".join(map(repr, [*map(float, p.translation), *_quaternion(p)])) for p in poses]
    (tmp_path / "plain.txt").write_text("# tx ty tz qx qy qz qw\n" + "\n".join(lines) + "\n")
    (tmp_path / "tum.txt").write_text("".join(f"{k}.5 {line}\n" for k, line in enumerate(lines)))
    blocks = ["\n".join(" ".join(map(str, row)) for row in pose.matrix) for pose in poses]
    (tmp_path / "redwood.log").write_text("".join(f"{k} {k} {k + 1}\n{b}\n" for k, b in enumerate(blocks)))
    write_json(tmp_path / "list.json", [pose.matrix for pose in poses])
    write_json(tmp_path / "plan.json", {"views": [{"world_from_sensor": pose.matrix} for pose in poses]})
    for name in ("plain.txt", "tum.txt", "redwood.log", "list.json", "plan.json"):
        for scan, pose in zip(read_scans(tmp_path / "a.e57", poses=tmp_path / name), poses, strict=True):
            np.testing.assert_allclose(scan.world_from_sensor.matrix, pose.matrix, atol=1e-12)
    second = read_scan(f"{tmp_path}/a.e57#2", poses=tmp_path / "plain.txt")
    np.testing.assert_allclose(second.origin, [1, 0, 1])
    with pytest.raises(InputError, match="2 poses for 3 scans; give one pose a scan"):
        read_scans(tmp_path / "a.e57", poses=poses[:2])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3\n", "line 1 holds 3 numbers; known: lines of tx ty tz qx qy qz qw"),
        ("0 0 0 0 0 0 1\n0 0 0 0 0 0 0\n", "pose 2 has the quaternion .* of length 0, which is no rotation"),
        ("a b c\n", "cannot be read as a file of poses: could not convert string to float"),
        ("0 0 1\n2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n", "pose 1 is not usable: pose is not rigid"),
        ("0 0 1\n1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n", "pose 1 is not usable: pose is left-handed"),
    ],
)
def test_unusable_poses_are_named(tmp_path: Path, text: str, message: str) -> None:
    write_scan(example_scan(PROJECTIONS["pinhole"]), tmp_path / "a.npz")
    (tmp_path / "poses.txt").write_text(text)
    with pytest.raises(InputError, match=message):
        read_scans(tmp_path / "a.npz", poses=tmp_path / "poses.txt")


def test_the_kind_of_a_source_is_told(tmp_path: Path) -> None:
    write_scan(example_scan(PROJECTIONS["pinhole"]), tmp_path / "a.npz")
    source = open_scans(tmp_path / "a.npz")
    assert (source.kind, len(source.readers), source.registered) == ("npz", 1, True)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.abc", r"a\.abc: cannot write scans to \.abc; known: \.npz, \.ply"),
        ("a", "cannot write scans to a name without suffix"),
        ("none/a.npz", "a.npz: cannot write, there is no folder .*none"),
    ],
)
def test_unusable_outputs_are_told_the_cure(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        write_scan(example_scan(PROJECTIONS["pinhole"]), tmp_path / name)


def test_several_scans_need_a_file_that_holds_them(tmp_path: Path) -> None:
    scans = [example_scan(PROJECTIONS["pinhole"])] * 2
    with pytest.raises(InputError, match=r"a\.npz: holds one scan, not 2; write an \.e57 file or a folder"):
        write_scans(scans, tmp_path / "a.npz")
    with pytest.raises(InputError, match="there is no scan to write"):
        write_scans([], tmp_path / "a.e57")
    write_scans(scans[:1], tmp_path / "a.npz")
    assert (tmp_path / "a.npz").exists()


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_bytes(path, b"old")
    with pytest.raises(ZeroDivisionError), atomic_path(path) as temporary:
        temporary.write_bytes(bytes([1 // len(b"")]))
    assert path.read_bytes() == b"old"
    with pytest.raises(InputError, match=r"a\.txt: nothing was written"), atomic_path(path):
        pass
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_is_reported_and_the_old_file_survives(tmp_path: Path) -> None:
    write_bytes(tmp_path / "a.txt", b"old")
    with (
        pytest.raises(InputError, match=r"a\.txt: cannot write: No space left on device"),
        atomic_path(tmp_path / "a.txt"),
    ):
        raise OSError(28, "No space left on device")
    assert (tmp_path / "a.txt").read_bytes() == b"old"


def test_json_is_strict_and_keeps_its_order(tmp_path: Path) -> None:
    value = {"b": np.float32(0.5), "a": (np.nan, np.inf, 0.1), "p": Path("x"), "t": np.bool_(True), 3: None}
    write_json(tmp_path / "a.json", value)
    text = (tmp_path / "a.json").read_text()
    assert json.loads(text) == {"b": 0.5, "a": [None, None, 0.1], "p": "x", "t": True, "3": None}
    assert text.index('"b"') < text.index('"a"')
    with pytest.raises(TypeError, match="object has no JSON form"):
        json_text(object())
