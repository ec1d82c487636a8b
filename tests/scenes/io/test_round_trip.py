# SPDX-License-Identifier: MIT
"""Every format gives back the scan that was written: all projections, with and without colour, posed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenes.checks import InputError
from scenes.io.scan_files import open_scans, read_scan, read_scans, write_scan, write_scans
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import TRUTH_CHANNELS, RangeImage
from tests.helpers.scan_examples import POSE, PROJECTIONS, assert_same_scan, example_scan

FLOAT32_M = 5.5 * 6e-8 * 2  # PCD keeps float32: 6e-8 of a 5.5 m coordinate, twice for the sum over axes
EXACT = {".npz": 0.0, ".ply": 0.0, ".e57": 1e-14, ".pcd": FLOAT32_M, ".ptx": 2e-9}
LOSSLESS_HEADER = {".npz", ".ply", ".e57", ".pcd"}


def same_geometry(first: RangeImage, second: RangeImage) -> bool:
    difference = first.projection.directions() - second.projection.directions()
    return bool(np.abs(difference).max() < 1e-6)


@pytest.mark.parametrize("kind", PROJECTIONS)
@pytest.mark.parametrize("suffix", EXACT)
@pytest.mark.parametrize("colour", [True, False])
def test_written_scan_reads_back(tmp_path: Path, suffix: str, kind: str, colour: bool) -> None:
    scan = example_scan(PROJECTIONS[kind], colour=colour)
    path = tmp_path / f"scan{suffix}"
    write_scan(scan, path)
    back = read_scan(path)
    assert_same_scan(scan, back, EXACT[suffix])
    assert same_geometry(scan, back)
    if suffix in LOSSLESS_HEADER:
        assert (back.name, back.sigma_m, back.noise) == (scan.name, scan.sigma_m, scan.noise)
        assert back.sensor == scan.sensor == "a scanner"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("kind", PROJECTIONS)
@pytest.mark.parametrize("suffix", EXACT)
def test_measured_points_off_their_rays_are_kept(tmp_path: Path, suffix: str, kind: str) -> None:
    scan = example_scan(PROJECTIONS[kind], off_rays_m=0.004)
    path = tmp_path / f"scan{suffix}"
    write_scan(scan, path)
    back = read_scan(path)
    assert back.sensor_points is not None
    assert_same_scan(scan, back, EXACT[suffix])


@pytest.mark.parametrize("suffix", EXACT)
def test_same_scan_gives_same_bytes(tmp_path: Path, suffix: str) -> None:
    scan = example_scan(PROJECTIONS["pinhole"])
    for name in ("a", "b"):
        write_scan(scan, tmp_path / f"{name}{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_npz_keeps_truth_bit_by_bit(tmp_path: Path) -> None:
    scan = example_scan(PROJECTIONS["panorama"], truth=True, off_rays_m=0.01)
    write_scan(scan, tmp_path / "scan.npz")
    back = read_scan(tmp_path / "scan.npz")
    assert scan.truth is not None
    assert back.truth is not None
    for name in TRUTH_CHANNELS:
        np.testing.assert_array_equal(getattr(scan.truth, name), getattr(back.truth, name))
    np.testing.assert_array_equal(scan.ranges, back.ranges)
    np.testing.assert_array_equal(scan.sensor_points, back.sensor_points)
    np.testing.assert_array_equal(scan.projection.directions(), back.projection.directions())


def test_npz_holds_true_points_and_range_errors_for_other_readers(tmp_path: Path) -> None:
    scan = example_scan(PROJECTIONS["pinhole"], truth=True)
    write_scan(scan, tmp_path / "scan.npz")
    with np.load(tmp_path / "scan.npz") as arrays:
        np.testing.assert_array_equal(arrays["truth_points"], scan.true_points())
        np.testing.assert_array_equal(arrays["truth_range_error"], scan.range_error())
    assert (scan.range_error()[scan.valid] == 0).all()
    np.testing.assert_allclose(scan.true_points(), scan.points(), atol=1e-12)


def test_npz_keeps_the_intensity(tmp_path: Path) -> None:
    scan = example_scan(PROJECTIONS["pinhole"])
    light = np.random.default_rng(0).random(scan.shape).astype(np.float32)
    write_scan(replace(scan, intensity=light), tmp_path / "scan.npz")
    np.testing.assert_array_equal(read_scan(tmp_path / "scan.npz").intensity, light)


def test_npz_of_older_versions_still_reads(tmp_path: Path) -> None:
    scan = example_scan(PROJECTIONS["panorama"], truth=True)
    write_scan(scan, tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as arrays:
        older = {name: arrays[name] for name in arrays.files if name != "truth_n_rays"}
    header = json.loads(str(older["header"]))
    del header["sensor"], older["truth_points"], older["truth_range_error"]
    older["header"] = np.array(json.dumps(header))
    np.savez(tmp_path / "old.npz", **older)
    back = read_scan(tmp_path / "old.npz")
    assert_same_scan(scan, back)
    assert back.truth is not None
    assert back.truth.n_rays is None
    assert back.sensor == ""


@pytest.mark.parametrize("suffix", [".npz", ".ply", ".pcd"])
def test_empty_scan_reads_back_empty(tmp_path: Path, suffix: str) -> None:
    scan = RangeImage(np.full((23, 31), np.inf), PROJECTIONS["pinhole"], POSE)
    write_scan(scan, tmp_path / f"scan{suffix}")
    assert not read_scan(tmp_path / f"scan{suffix}").valid.any()


def test_empty_scan_does_not_fit_into_e57(tmp_path: Path) -> None:
    scan = RangeImage(np.full((23, 31), np.inf), PROJECTIONS["pinhole"], POSE)
    with pytest.raises(InputError, match=r"has no return; E57 cannot hold an empty grid, use \.npz"):
        write_scan(scan, tmp_path / "scan.e57")
    assert not list(tmp_path.iterdir())


def test_e57_holds_several_scans(tmp_path: Path) -> None:
    scans = [example_scan(projection, seed=k) for k, projection in enumerate(PROJECTIONS.values())]
    write_scans(scans, tmp_path / "all.e57")
    for scan, back in zip(scans, read_scans(tmp_path / "all.e57"), strict=True):
        assert_same_scan(scan, back, 1e-14)
    assert_same_scan(scans[2], read_scan(f"{tmp_path}/all.e57#3"), 1e-14)
    with pytest.raises(InputError, match=r"all\.e57: holds 4 scans; pick one with .*all\.e57#1 to "):
        read_scan(tmp_path / "all.e57")


@pytest.mark.parametrize("kind", ["pinhole", "negative fy"])
def test_rgbd_folder_reads_back_to_its_depth_step(tmp_path: Path, kind: str) -> None:
    scans = [example_scan(PROJECTIONS[kind], seed=k, pose=POSE @ POSE) for k in range(11)]
    write_scans(scans, tmp_path / "folder")
    backs = read_scans(tmp_path / "folder")
    assert len(backs) == 11
    half_step_m = 0.5 / 10000 * 1.5  # z-depth is rounded to 0.1 mm; the corner rays are 1.3 times longer
    for scan, back in zip(scans, backs, strict=True):
        assert_same_scan(scan, back, half_step_m)
    assert backs[10].name == "folder#11"
    assert_same_scan(scans[9], read_scan(f"{tmp_path / 'folder'}#10"), half_step_m)


@pytest.mark.parametrize("shift", [(0, 0, 0), (5e5, 5e6, 100)], ids=["origin", "UTM"])
@pytest.mark.parametrize(("layout", "scale"), [("tum", 5000), ("redwood", 1000)])
def test_rgbd_folders_of_others_read_back_to_their_depth_step(tmp_path, layout, scale, shift) -> None:
    poses = [
        Pose.from_parts(np.eye(3), shift) @ POSE @ Pose.looking_at((k, 0, 0), (k, 5, 1)) for k in range(3)
    ]
    scans = [example_scan(PROJECTIONS["pinhole"], seed=k, pose=pose) for k, pose in enumerate(poses)]
    write_scans(scans, tmp_path / "folder", layout=layout)
    opened = open_scans(tmp_path / "folder")
    assert opened.kind == f"rgbd ({layout})"
    assert opened.registered
    for scan, back in zip(scans, read_scans(tmp_path / "folder"), strict=True):
        assert_same_scan(scan, back, 0.5 / scale * 1.5)
        np.testing.assert_allclose(
            back.world_from_sensor.translation, scan.world_from_sensor.translation, rtol=0, atol=1e-9
        )


def test_rgbd_folders_of_others_hold_what_theirs_do(tmp_path: Path) -> None:
    far = [RangeImage(np.full((3, 4), 40.0), PinholeProjection(4, 3, 3.0, 3.0, 1.5, 1.0), POSE)]
    with pytest.raises(InputError, match="16 bits at 5000 values a metre; write it plain"):
        write_scans(far, tmp_path / "tum", layout="tum")
    near = [RangeImage(np.full((3, 4), 4.0), PinholeProjection(4, 3, 3.0, 3.0, 1.5, 1.0), POSE)]
    with pytest.raises(InputError, match="a TUM folder holds colours"):
        write_scans(near, tmp_path / "tum", layout="tum")
    with pytest.raises(InputError, match="layout must be one of plain, tum, redwood, got 'kitti'"):
        write_scans(near, tmp_path / "kitti", layout="kitti")
    assert not list(tmp_path.iterdir())
    write_scans(near, tmp_path / "redwood", layout="redwood")
    assert read_scan(tmp_path / "redwood").ranges.max() > 4


def test_far_depths_get_a_coarser_scale(tmp_path: Path) -> None:
    camera = PinholeProjection(4, 3, 3.0, 3.0, 1.5, 1.0)
    write_scans([RangeImage(np.full((3, 4), 40.0), camera, POSE)], tmp_path / "far")
    back = read_scan(tmp_path / "far")
    np.testing.assert_allclose(back.ranges, 40.0, atol=0.5 / 1000 * 1.3)
    with pytest.raises(InputError, match=r"depths up to 4.* m do not fit into 16 bits"):
        write_scans([RangeImage(np.full((3, 4), 5000.0), camera, POSE)], tmp_path / "further")


def test_rgbd_folder_refuses_panoramas(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds scans of one pinhole camera"):
        write_scans([example_scan(PROJECTIONS["panorama"])], tmp_path / "folder")


def test_scan_ply_opens_in_other_software(tmp_path: Path) -> None:
    scan = example_scan(PROJECTIONS["panorama"])
    write_scan(scan, tmp_path / "scan.ply")
    cloud = trimesh.load(tmp_path / "scan.ply", process=False)
    np.testing.assert_array_equal(np.asarray(cloud.vertices), scan.points().reshape(-1, 3))


def test_pcd_points_are_in_the_sensor_frame_and_viewpoint_is_the_pose(tmp_path: Path) -> None:
    scan = example_scan(PROJECTIONS["pinhole"], pose=Pose.looking_at((1, 2, 3), (1, 9, 3)))
    write_scan(scan, tmp_path / "scan.pcd")
    text = (tmp_path / "scan.pcd").read_bytes().decode("latin1")
    words = text.split("VIEWPOINT ")[1].split("\n")[0].split()
    np.testing.assert_allclose([float(word) for word in words[:3]], [1, 2, 3])
    assert max(len(line) for line in text.split("DATA")[0].splitlines()) < 250
