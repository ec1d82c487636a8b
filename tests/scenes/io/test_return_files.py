# SPDX-License-Identifier: MIT
"""Files of all returns: by the names of each standard, read back, refused where they do not fit."""

from dataclasses import replace

import laspy
import numpy as np
import pye57
import pytest

from nbv.scanning.beam import Footprint
from nbv.scanning.effects import Effects, PointingNoise
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.checks import InputError
from scenes.io.clouds import e57_points
from scenes.io.formats.format import all_return_suffixes
from scenes.io.formats.header import scan_header
from scenes.io.formats.returns import FurtherReturns, cloud_of, scan_of
from scenes.io.point_files import read_points
from scenes.io.scan_files import read_scan, write_scan
from scenes.pose import Pose
from scenes.scan.echoes import Echoes
from tests.helpers.sheet_scenes import EAST, sheets

TOLERANCE_M = {".npz": 0.0, ".e57": 1e-12, ".las": 2e-5, ".laz": 2e-5}


@pytest.fixture(scope="module", params=["on rays", "off rays"])
def scan(request):
    """Three sheets with steps, where some beams have three returns, from a pose that is turned."""
    scene = sheets(
        (2.0, -1, 0.02, -1, 0.01), (2.6, -1, 0.1, -0.1, 1), (3.2, -9, 9, -9, 9), colours=(0.2, 0.6, 0.9)
    )
    beam = Footprint(divergence_rad=0.05, returns="all", range_resolution_m=0.3)
    pointing = PointingNoise(sd_deg=0.01) if request.param == "off rays" else None
    camera = PinholeSensor(fov_deg=30, width=40, height=32)
    taken = scan_scene(scene, EAST, camera, effects=Effects(footprint=beam, pointing=pointing), rng=3)
    return taken.transform(Pose.looking_at((10, 4, 2), (11, 5, 2.5)))


@pytest.mark.parametrize("suffix", TOLERANCE_M)
def test_all_returns_are_read_back(scan, tmp_path, suffix, monkeypatch):
    monkeypatch.setattr(e57_points, "_CHUNK", 500)
    file, most = tmp_path / f"a{suffix}", TOLERANCE_M[suffix]
    write_scan(scan, file)
    held = read_scan(file)
    assert np.array_equal(held.valid, scan.valid)
    assert np.array_equal(held.echoes.pixel, scan.echoes.pixel)
    assert np.abs(held.ranges - scan.ranges)[scan.valid].max() <= most
    assert np.abs(held.echoes.ranges - scan.echoes.ranges).max() <= most
    assert np.abs(held.echo_points() - scan.echo_points()).max() <= 2 * most
    assert held.echoes.intensity == pytest.approx(
        scan.echoes.intensity, abs=float(scan.intensity.max()) / 65535
    )
    assert held.warnings == ()
    assert len(read_points(file).points) == scan.valid.sum() + len(scan.echoes)


def test_files_of_all_returns_are_those_that_say_so():
    assert set(all_return_suffixes()) == set(TOLERANCE_M)


@pytest.mark.parametrize("suffix", [".ply", ".csv", ".ptx", ".pcd"])
def test_other_formats_keep_the_first(scan, tmp_path, suffix):
    write_scan(scan, tmp_path / f"a{suffix}")
    held = read_scan(tmp_path / f"a{suffix}")
    assert held.echoes is None
    assert np.array_equal(held.valid, scan.valid)


def test_las_has_the_returns_of_a_beam_one_after_the_other(scan, tmp_path):
    write_scan(scan, tmp_path / "a.las")
    points = laspy.read(tmp_path / "a.las")
    number, count = np.asarray(points.return_number, int), np.asarray(points.number_of_returns, int)
    assert number.max() == count.max() == 3
    assert (number <= count).all()
    follows = np.flatnonzero(number > 1)
    assert np.array_equal(number[follows], number[follows - 1] + 1)
    assert np.array_equal(count[follows], count[follows - 1])
    assert (count == 1).sum() + (count == 2).sum() / 2 + (count == 3).sum() / 3 == scan.valid.sum()
    by_return = np.asarray(points.header.number_of_points_by_return)
    assert by_return[:4].tolist() == [*np.bincount(number)[1:4], 0]
    assert (np.asarray(points.intensity)[follows] > 0).all()


def test_e57_names_returns_as_its_standard_does(scan, tmp_path):
    write_scan(scan, tmp_path / "a.e57")
    file = pye57.E57(str(tmp_path / "a.e57"))
    header = file.get_header(0)
    assert {"returnIndex", "returnCount"} <= set(header.point_fields)
    assert [header["indexBounds"][f"return{end}"].value() for end in ("Minimum", "Maximum")] == [0, 2]
    points = next(e57_points.point_chunks(file, 0))
    assert np.bincount(points.returns).tolist() == [scan.valid.sum(), *np.bincount(scan.echoes.number)[2:]]


def test_scans_of_first_returns_have_no_fields_of_returns(scan, tmp_path):
    write_scan(scan.with_facts(echoes=None), tmp_path / "a.e57")
    fields = pye57.E57(str(tmp_path / "a.e57")).get_header(0).point_fields
    assert not {"returnIndex", "returnCount"} & set(fields)


def test_units_scale_further_returns(scan, tmp_path):
    write_scan(scan, tmp_path / "a.npz")
    held = read_scan(tmp_path / "a.npz", units="mm")
    assert held.echoes.ranges == pytest.approx(scan.echoes.ranges / 1000)
    assert held.echo_points() == pytest.approx(scan.echo_points() / 1000)


def test_las_refuses_more_returns_than_it_holds(scan, tmp_path):
    pixel = np.flatnonzero(scan.valid)[:1].repeat(15)
    many = scan.with_facts(echoes=Echoes(pixel, np.linspace(4, 9, 15)))
    with pytest.raises(InputError, match=r"a beam has 16 returns, LAS holds 15; use \.e57 or \.npz"):
        write_scan(many, tmp_path / "a.las")
    write_scan(many, tmp_path / "a.e57")
    assert len(read_scan(tmp_path / "a.e57").echoes) == 15


def test_further_returns_without_a_first_are_counted_or_become_it(scan):
    cloud = cloud_of(scan, all_returns=True)
    kept = cloud.number > 1
    names = ("points", "row", "column", "colour", "intensity", "number")
    later = replace(cloud, **{name: getattr(cloud, name)[kept] for name in names}, count=None)
    held = scan_of(scan_header(scan), len(later.points), [later])
    assert not held.valid.any()
    assert held.warnings == (
        f"{len(scan.echoes)} further returns of pixels without a first one were left out",
    )
    further, pixel = FurtherReturns(), np.flatnonzero(scan.valid)[:2]
    points = scan.points_in_sensor().reshape(-1, 3)[pixel]  # as a reader puts those that come first in a file
    further.gather(pixel, np.concatenate([points[:1], 2 * points[1:]]), np.array([2, 2]), None)
    assert further.put_in(scan, has_light=False)[0].echoes.pixel.tolist() == pixel[1:].tolist()


def test_echoes_belong_to_pixels_with_a_return(scan):
    first = scan.echoes.pixel[0]
    ranges = scan.ranges.copy().reshape(-1)
    ranges[first] = np.inf
    without = replace(scan, ranges=ranges.reshape(scan.shape), truth=None)
    assert not (without.echoes.pixel == first).any()
    assert scan.thin(100).echoes is None
    assert "further returns" in scan._repr_html_()


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (([1, 2], [2.0]), r"ranges of echoes has shape \(1,\), pixel \(2,\)"),
        (([2, 1], [2.0, 3.0]), "sorted by their pixels"),
        (([1, 2], [2.0, np.inf]), "ranges of echoes must be finite and above 0"),
        (([1, 2], [2.0, 3.0], [0.1, np.nan]), "intensities of echoes are not finite"),
        (([1, 5000], [2.0, 3.0]), "echoes refer to pixel 5000, but the image has 1280 pixels"),
    ],
)
def test_impossible_echoes_are_refused(scan, arrays, message):
    with pytest.raises(InputError, match=message):
        replace(scan, echoes=Echoes(*(np.array(array) for array in arrays)))
