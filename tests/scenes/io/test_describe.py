# SPDX-License-Identifier: MIT
"""What `unseen info` says of scenes and scans, and what it warns of."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenes.checks import InputError
from scenes.io.describe import describe, describe_projection
from scenes.io.scan_files import write_scan, write_scans
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.scan_examples import POSE, PROJECTIONS, example_scan


def test_a_scene_is_described(tmp_path: Path) -> None:
    trimesh.creation.box(extents=(1, 2, 3)).export(tmp_path / "a.stl")
    told = describe(tmp_path / "a.stl")
    assert json.loads(json.dumps(told)) == told
    assert (told["kind"], told["mode"], told["triangles"], told["surfaces"]) == ("scene", "object", 12, 1)
    assert told["extent_m"] == [1, 2, 3]
    assert told["area_m2"] == pytest.approx(22)
    assert told["textures"] == []
    assert not told["has_colour"]
    tiny = describe(tmp_path / "a.stl", units="mm")
    assert any("--units says the file's unit" in warning for warning in tiny["warnings"])


def test_a_builtin_scene_is_described() -> None:
    told = describe("builtin:two_occluders")
    assert told["known_surfaces"]["plane"] >= 6
    assert told["has_colour"]
    assert told["suggested_up"] == describe("builtin:office")["suggested_up"] == "z"
    assert told["warnings"] == []


@pytest.mark.parametrize("suffix", [".npz", ".ply", ".pcd", ".ptx", ".e57"])
def test_a_scan_is_described(tmp_path: Path, suffix: str) -> None:
    scan = example_scan(PROJECTIONS["panorama"])
    write_scan(scan, tmp_path / f"a{suffix}")
    told = describe(tmp_path / f"a{suffix}")
    assert json.loads(json.dumps(told)) == told
    assert (told["kind"], told["format"], told["count"]) == ("scan", suffix[1:], 1)
    (one,) = told["scans"]
    assert (one["rows"], one["columns"]) == scan.shape
    assert one["valid_share"] == pytest.approx(scan.valid.mean())
    assert one["range_m"]["median"] == pytest.approx(np.median(scan.ranges[scan.valid]), rel=1e-6)
    assert one["projection"]["kind"] == "spherical"
    assert one["projection"]["fov_deg"] == pytest.approx([354, 100], rel=1e-5)
    assert one["grid_residual_px"] is None
    np.testing.assert_allclose(one["world_from_sensor"], POSE.matrix, atol=1e-12)
    assert told["warnings"] == []


def test_one_of_several_scans_is_described(tmp_path: Path) -> None:
    write_scans([example_scan(PROJECTIONS["pinhole"], seed=k) for k in range(3)], tmp_path / "a.e57")
    told = describe(tmp_path / "a.e57")
    assert (told["kind"], len(told["scans"])) == ("scans", 3)
    assert "all scans have the same pose" in told["warnings"][0]
    second = describe(f"{tmp_path}/a.e57#2")
    assert (second["kind"], second["scans"][0]["number"], second["count"]) == ("scan", 2, 3)
    with pytest.raises(InputError, match=r"a.e57#4: there are 3 scans, counted from 1"):
        describe(f"{tmp_path}/a.e57#4")


def test_suspicious_scans_are_warned_of(tmp_path: Path) -> None:
    camera = PinholeProjection(31, 23, 28.5, 29.25, 14.5, 10.75)
    far = RangeImage(np.full((23, 31), 2500.0), camera, Pose.identity())
    write_scan(far, tmp_path / "far.npz")
    assert (
        "scan 1: the median range is 2.5e+03 m; check --units"
        in describe(tmp_path / "far.npz")["warnings"][0]
    )
    assert describe(tmp_path / "far.npz", units="mm")["warnings"] == []
    few = np.full((23, 31), np.inf)
    few[0, :5] = 2.0
    write_scan(RangeImage(few, camera, Pose.identity()), tmp_path / "few.npz")
    assert describe(tmp_path / "few.npz")["warnings"] == ["scan 1: only 0.7% of the pixels came back"]
    write_scan(RangeImage(few * np.inf, camera, Pose.identity()), tmp_path / "empty.npz")
    told = describe(tmp_path / "empty.npz")
    assert told["warnings"] == ["scan 1: nothing came back in any pixel"]
    assert told["bounds_m"] is None
    assert told["scans"][0]["range_m"] == {"min": None, "median": None, "max": None}


def test_fields_of_view() -> None:
    camera = PinholeProjection.from_fov(641, 481, 60.0)
    assert describe_projection(camera)["fov_deg"][0] == pytest.approx(60.0)
    scanner = describe_projection(SphericalProjection.regular(100, 51, 90.0, (-20.0, 30.0)))
    assert scanner["fov_deg"] == pytest.approx([89.1, 50.0])
    assert scanner["first_row_elevation_deg"] == pytest.approx(30)


def test_a_mesh_ply_is_a_scene_and_a_missing_file_an_error(tmp_path: Path) -> None:
    trimesh.creation.box().export(tmp_path / "a.ply")
    assert describe(tmp_path / "a.ply")["kind"] == "scene"
    for name in ("b.ply", "b.npz", "b.glb"):
        with pytest.raises(InputError, match=f"{name}: no such file"):
            describe(tmp_path / name)


@requires_data
def test_real_files_are_described() -> None:
    pump = describe(data_path("range/e57/pumpA.e57"))["scans"][0]
    assert (pump["rows"], pump["columns"]) == (1074, 345)
    assert pump["grid_residual_px"] == pytest.approx(0.467, abs=0.01)
    truck = describe(data_path("scenes/objects/CesiumMilkTruck.glb"), up="z")
    assert truck["suggested_up"] == "y"
    assert truck["warnings"] == ["the geometry suggests that y is up, not z; give --up y if so"]
    assert describe(data_path("scenes/objects/CesiumMilkTruck.glb"))["warnings"] == []
    folder = describe(data_path("range/open3d_redwood"))
    assert (folder["format"], folder["count"], folder["registered"]) == ("rgbd (redwood)", 5, True)
