# SPDX-License-Identifier: MIT
"""Length units that files state, and those that users give."""

import struct
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest

from completion import complete
from scenes.checks import InputError
from scenes.inclination import Up
from scenes.io.crs import unit_of_geokeys, unit_of_wkt
from scenes.io.point_files import read_points
from scenes.io.scan_request import ScanRequest, read_request
from scenes.scan.projection import SphericalProjection
from tests.helpers.completion_examples import PLAIN
from tests.helpers.data_paths import data_path, requires_data

US_FOOT = 1200 / 3937
FEET = "reported/las_us_survey_feet/l03_us_feet_wkt.las"
POINTS = np.array([[0.0, 0, 0], [10, 0, 0], [10, 20, 0], [0, 20, 30]])
PROJCS = (
    'PROJCS["x",GEOGCS["y",DATUM["d",SPHEROID["s",6378137,298.2]],UNIT["degree",0.0174]],{0}AXIS["E",EAST]]'
)
PROJCRS = (
    'PROJCRS["x",BASEGEOGCRS["y",DATUM["d",ELLIPSOID["s",6378137,298.2,LENGTHUNIT["metre",1]]]],'
    'CONVERSION["c",PARAMETER["False easting",1,LENGTHUNIT["metre",1]]],CS[Cartesian,2],'
    'AXIS["e (X)",east,LENGTHUNIT["foot",0.3048]],AXIS["n (Y)",north,LENGTHUNIT["foot",0.3048]]]'
)


def las_with(path: Path, record: int, data: bytes) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 0.001)
    header.vlrs.append(laspy.VLR("LASF_Projection", record, "", data))
    las = laspy.LasData(header)
    las.x, las.y, las.z = POINTS.T
    las.write(path)
    return path


def geokeys(keys: dict[int, int]) -> bytes:
    entries = b"".join(struct.pack("<4H", key, 0, 1, value) for key, value in keys.items())
    return struct.pack("<4H", 1, 1, 0, len(keys)) + entries


@requires_data
def test_a_room_in_us_survey_feet_comes_out_in_metres() -> None:
    origin = np.array([984_000.0, 210_000.0, 0.0]) + np.array([2.9, 1.3, 1.5]) / US_FOOT
    given = read_request(ScanRequest((str(data_path(FEET)),), origins=(tuple(origin),)))
    name = Path(FEET).name
    assert given.doubts == (f"{name}: the file states its unit, US survey foot: converted to metres",)
    completion = complete(given.scans, replace(PLAIN, up=Up.along("z")))
    value = {dimension.kind: dimension.value for dimension in completion.decisions().dimensions}
    assert value["room height"] == pytest.approx(2.7, abs=0.001)
    assert value["room area"] == pytest.approx(20.0, abs=0.01)


@pytest.mark.parametrize(
    ("wkt", "metres"),
    [
        (PROJCS.format('UNIT["US survey foot",0.304800609601219],'), (US_FOOT, US_FOOT, US_FOOT)),
        (PROJCS.format('UNIT["metre",1],'), (1, 1, 1)),
        (PROJCRS, (0.3048, 0.3048, 0.3048)),
        (f'COMPD_CS["c",{PROJCS.format("UNIT[#metre#,1],").replace("#", chr(34))},'
         'VERT_CS["v",VERT_DATUM["n",2005],UNIT["foot",0.3048]]]', (1, 1, 0.3048)),
        (f'COMPOUNDCRS["c",{PROJCRS},VERTCRS["v",CS[vertical,1],AXIS["h",up],LENGTHUNIT["metre",1]]]',
         (0.3048, 0.3048, 1)),
    ],
)  # fmt: skip
def test_the_unit_of_a_coordinate_system(wkt: str, metres: tuple[float, ...]) -> None:
    unit = unit_of_wkt(wkt)
    assert unit is not None
    assert unit.metres == pytest.approx(metres, rel=1e-12)


@pytest.mark.parametrize(
    "wkt",
    [
        'GEOGCS["WGS 84",UNIT["degree",0.0174]]',
        'COMPD_CS["c",GEOGCS["WGS 84",UNIT["degree",0.0174]],VERT_CS["v",UNIT["metre",1]]]',
        'GEOGCRS["WGS 84",CS[ellipsoidal,2],ANGLEUNIT["degree",0.0174]]',
    ],
)
def test_degrees_are_refused(tmp_path: Path, wkt: str) -> None:
    file = las_with(tmp_path / "a.las", 2112, wkt.encode() + b"\0")
    with pytest.raises(InputError, match=r"a\.las: its coordinates are degrees .*WGS 84.*project them"):
        read_points(file)
    with pytest.raises(InputError, match="degrees"):
        unit_of_geokeys({1024: 2})


def test_what_states_no_unit_has_none(tmp_path: Path) -> None:
    for wkt in ("", "PROJCS[", 'PROJCS["x"]', "]]]"):
        assert unit_of_wkt(wkt) is None
    with pytest.raises(InputError, match="damaged: its unit 'foot' has -1 m"):
        unit_of_wkt('PROJCS["x",UNIT["foot",-1]]')
    cloud = read_points(las_with(tmp_path / "a.las", 34735, geokeys({1024: 1, 3072: 2263})))
    np.testing.assert_allclose(cloud.points, POINTS)


@pytest.mark.parametrize(
    ("keys", "metres"),
    [
        ({1024: 1, 3076: 9003}, (US_FOOT, US_FOOT, US_FOOT)),
        ({1024: 1, 3076: 9002, 4099: 9001}, (0.3048, 0.3048, 1.0)),
        ({1024: 1, 3076: 9001}, (1.0, 1.0, 1.0)),
    ],
)
def test_geokeys_win_over_the_default_and_are_reported(
    tmp_path: Path, keys: dict[int, int], metres: tuple[float, ...]
) -> None:
    cloud = read_points(las_with(tmp_path / "a.las", 34735, geokeys(keys)))
    np.testing.assert_allclose(cloud.points, POINTS * metres, rtol=1e-12)
    assert len(cloud.warnings) == (metres != (1.0, 1.0, 1.0))


def test_the_units_of_the_file_win_over_those_given_and_a_contradiction_is_reported(tmp_path: Path) -> None:
    file = las_with(tmp_path / "a.las", 34735, geokeys({3076: 9003}))
    same, other = read_points(file, "us-ft"), read_points(file, "ft")
    for cloud in (same, other):
        np.testing.assert_allclose(cloud.points, POINTS * US_FOOT, rtol=1e-12)
    assert same.warnings == ()
    text = "the file states its unit, US survey foot: converted to metres; --units ft was not applied"
    assert other.warnings == (text,)


@pytest.mark.parametrize(
    ("keys", "code"),
    [
        ({1024: 1, 3072: 2263}, 2263),
        ({1024: 1, 3076: 9036}, 9036),
        ({1024: 1, 3072: 6440, 4099: 9003}, 6440),
        ({1024: 1, 3072: 32632}, 0),
        ({1024: 1, 3072: 32767}, 0),
        ({1024: 1, 3072: 2263, 3076: 9001}, 0),
    ],
)
def test_a_code_alone_states_no_unit_and_is_named(tmp_path: Path, keys: dict[int, int], code: int) -> None:
    file = las_with(tmp_path / "a.las", 34735, geokeys(keys))
    cloud = read_points(file)
    np.testing.assert_allclose(cloud.points, POINTS)
    assert len(cloud.warnings) == bool(code)
    assert all(
        f"names EPSG:{code} without the length of its unit: read as metres" in text for text in cloud.warnings
    )
    feet = read_points(file, "ft")
    assert code == 0 or feet.warnings == ()


def test_a_place_is_in_the_units_of_the_file(tmp_path: Path) -> None:
    around = SphericalProjection.regular(60, 30, 360.0, (-60.0, 60.0)).directions()
    np.savetxt(tmp_path / "a.xyz", 2000.0 * around.reshape(-1, 3) + [5000.0, 0.0, 0.0], fmt="%.6f")
    request = ScanRequest((str(tmp_path / "a.xyz"),), units="mm", origins=((5000.0, 0.0, 0.0),))
    (scan,) = read_request(request).scans
    assert scan.origin == pytest.approx([5.0, 0.0, 0.0])
    assert np.median(scan.ranges[scan.valid]) == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize("number", [7, 18])
@pytest.mark.parametrize("form", [1, 6])
def test_noise_by_class_is_left_out(tmp_path: Path, number: int, form: int) -> None:
    points = np.random.default_rng(0).random((400, 3)) * [5, 4, 2.7]
    points[:25, 2] += 50
    cloud = laspy.LasData(laspy.LasHeader(point_format=form, version="1.4"))
    cloud.header.scales = np.full(3, 1e-4)
    cloud.x, cloud.y, cloud.z = points.T
    cloud.classification = np.where(np.arange(400) < 25, number, 6)
    cloud.write(str(tmp_path / "a.las"))
    held = read_points(tmp_path / "a.las")
    assert held.points[:, 2].max() < 3
    assert "25 of 400 points are classified as noise and were left out" in held.warnings
