# SPDX-License-Identifier: MIT
"""Readers and sensors that other packages offer by entry points."""

import pytest

from nbv import load_sensor, sensor_names
from scenes import InputError, read_points, read_scan, read_scans, write_scan
from scenes.io.formats.format import formats
from tests.helpers.completion_examples import example

POINTS = """
[unseen.readers]
two = strange_scanner:read_two
ONE = strange_scanner:read_one
npz = strange_scanner:nothing

[unseen.sensors]
strange = strange_scanner:PROFILE
"""
MODULE = """
from pathlib import Path
from tests.helpers.completion_examples import example

PROFILE = Path(__file__).with_name("strange.toml")

def read_one(path):
    if path.read_text() != "one":
        raise IndexError("no frame")
    return example("two_occluders", pixels=60)

def read_two(path):
    return [example("two_occluders", pixels=60), example("chair_before_wall", pixels=60)]
"""
PROFILE = 'kind = "pinhole"\nfov_deg = 70.0\nwidth = 48\nheight = 40\n'


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package that is installed, as far as its metadata go."""
    folder = tmp_path / "site"
    facts = folder / "strange_scanner-1.0.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Name: strange-scanner\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(POINTS)
    (folder / "strange_scanner.py").write_text(MODULE)
    (folder / "strange.toml").write_text(PROFILE)
    monkeypatch.syspath_prepend(folder)
    formats.cache_clear()
    yield tmp_path
    formats.cache_clear()


def test_readers_of_other_packages_are_used_by_suffix(package) -> None:
    (package / "scan.one").write_text("one")
    (package / "scan.two").write_text("two")
    one = read_scan(package / "scan.one")
    assert (one.ranges == example("two_occluders", pixels=60).ranges).all()
    assert len(read_scans(package / "scan.two")) == 2
    second = example("chair_before_wall", pixels=60)
    assert (read_scan(f"{package / 'scan.two'}#2").ranges == second.ranges).all()
    assert len(read_points(f"{package / 'scan.two'}#2").points) == second.valid.sum()
    assert len(read_points(package / "scan.two").points) == second.valid.sum() + one.valid.sum()


def test_their_errors_name_the_file(package) -> None:
    (package / "scan.one").write_text("none")
    with pytest.raises(InputError, match=r"scan.one: cannot be read as ONE scan: no frame"):
        read_scan(package / "scan.one")


def test_formats_of_ours_come_first(package) -> None:
    scan = example("two_occluders", pixels=60)
    write_scan(scan, package / "scan.npz")
    assert (read_scan(package / "scan.npz").ranges == scan.ranges).all()


def test_sensors_of_other_packages_have_names(package) -> None:
    assert "strange" in sensor_names()
    assert load_sensor("strange").projection.shape == (40, 48)


def test_without_them_there_are_none() -> None:
    assert "strange" not in sensor_names()
    with pytest.raises(InputError, match="no sensor named 'strange'"):
        load_sensor("strange")
