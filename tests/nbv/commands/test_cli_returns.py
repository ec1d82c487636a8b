# SPDX-License-Identifier: MIT
"""`unseen scan --returns`: what is reported of a beam with width, where it is written, what is refused."""

import json

import pytest

from scenes.io.scan_files import read_scan
from tests.nbv.commands.test_cli import assert_fails_in_one_line, run, succeed

PULSED = """kind = "spherical"
azimuth_span_deg = 40
elevation_min_deg = -20
elevation_max_deg = 20
width = 90
height = 80
max_range_m = 20
[footprint]
divergence_rad = 0.02
range_resolution_m = 0.3
"""
BASE = (
    "scan",
    "builtin:chair_before_wall",
    "--at",
    "0.3,-1.6,1.1",
    "--look",
    "0,1,0.8",
    "--noise",
    "profile",
)


@pytest.fixture(scope="module")
def sensor(tmp_path_factory):
    file = tmp_path_factory.mktemp("sensor") / "pulsed.toml"
    file.write_text(PULSED)
    return file


def test_each_kind_of_return_is_another_scan_and_recorded(tmp_path, sensor):
    ranges = {}
    for returns in ("first", "strongest", "last", "mean"):
        succeed(*BASE, "--sensor", sensor, "--returns", returns, "-o", tmp_path / f"{returns}.npz", "-q")
        ranges[returns] = read_scan(tmp_path / f"{returns}.npz").ranges.tobytes()
    assert len(set(ranges.values())) == 4
    said = json.loads(
        succeed(*BASE, "--sensor", sensor, "--returns", "all", "-o", tmp_path / "all.laz", "--json").stdout
    )
    scan = read_scan(tmp_path / "all.laz")
    assert said["further_returns"] == len(scan.echoes) > 0
    assert json.loads((tmp_path / "all.laz.manifest.json").read_text())["options"]["returns"] == "all"
    info = json.loads(succeed("info", tmp_path / "all.laz", "--json").stdout)["scans"][0]
    assert info["further_returns"] == len(scan.echoes)
    assert f"{len(scan.echoes)} further returns" in succeed(
        *BASE, "--sensor", sensor, "--returns", "all", "-o", tmp_path / "all.npz"
    ).stdout  # fmt: skip


def test_returns_that_cannot_be_had_or_held_are_refused(tmp_path, sensor):
    for file in ("a.ply", "a"):
        at = ("--sensor", sensor, "--returns", "all", "-o", tmp_path / file)
        assert_fails_in_one_line(run(*BASE, *at), "holds one return a beam; write all returns to .npz, .e57")
    assert_fails_in_one_line(
        run(*BASE, "--returns", "last", "-o", tmp_path / "a.npz"), "these effects have no footprint"
    )
    assert run(*BASE, "--returns", "second", "-o", tmp_path / "a.npz").exit_code == 2
