# SPDX-License-Identifier: MIT
"""E57 as other programs write it: colours, empty scans, surplus columns, returns, poses."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.io.describe import describe
from scenes.io.point_files import read_points
from scenes.io.scan_files import open_scans, read_scan, read_scans
from scenes.io.scan_request import ScanRequest, read_request
from scenes.scan.projection import SphericalProjection
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.e57_fields import SIZE, STATION, Record, grid_fields, room_points, write_records

pytest.importorskip("pye57")
CHANNELS = ("Red", "Green", "Blue")
AZIMUTHS, ELEVATIONS = np.arange(-178.5, 180, 3.0), np.arange(59.0, -60, -2.0)
SURPLUS = "its columns go round more than once: the last {} were left out"


def room(columns: Any = AZIMUTHS, rows: Any = ELEVATIONS, **record: Any) -> Record:
    return Record(grid_fields(room_points(columns, rows)), **record)


def with_colour(record: Record, value: Any, bounds: Any = None, **limits: float) -> Record:
    n_points = len(record.fields["cartesianX"])
    for channel in CHANNELS:
        record.fields[f"color{channel}"] = np.full(n_points, value)
        record.bounds[f"color{channel}"] = bounds
        record.limits |= {f"color{channel}{end}": limit for end, limit in limits.items()}
    return record


def colours(path: Path) -> set[int]:
    """Values of the colours of all returns, as scan and as points."""
    scan, cloud = read_scan(path), read_points(path)
    assert scan.colour is not None
    assert cloud.colour is not None
    return {*scan.colour[scan.valid].ravel().tolist(), *cloud.colour.ravel().tolist()}


def reported(name: str) -> Path:
    return data_path(f"reported/e57_{name}")


def off_walls(points: np.ndarray) -> np.ndarray:
    """Distance of points (n, 3) from the nearest side of the room."""
    return np.asarray(np.abs(np.concatenate([points, points - SIZE], axis=1)).min(axis=1))


@requires_data
def test_reported_invalid_colours_are_no_colour() -> None:
    path = reported("colour_invalid/c09_colour_invalid.e57")
    assert colours(path) == {200}
    sentence = "3556 of 7200 points have no valid colour: they take that of the nearest that has one"
    assert read_scan(path).warnings == read_points(path).warnings == (sentence,)


@pytest.mark.parametrize("value", [np.uint8(90), np.float32(90 / 255)])
def test_an_invalid_colour_is_never_black(tmp_path: Path, value: Any) -> None:
    bounds = (0, 255) if value > 1 else (0.0, 1.0)
    record = with_colour(room(np.arange(-60.0, 61), np.arange(40.0, -41, -1)), value, bounds)
    invalid = np.random.default_rng(0).random(len(record.fields["colorRed"])) < 0.3
    for channel in CHANNELS:
        record.fields[f"color{channel}"][invalid] = 0
    record.fields["isColorInvalid"] = invalid.astype(np.int8)
    assert colours(write_records(tmp_path / "a.e57", [record])) == {90}
    record.fields["isColorInvalid"][:] = 1
    scan = read_scan(write_records(tmp_path / "none.e57", [record]))
    assert scan.colour is None
    assert "have no valid colour: colour was left out" in scan.warnings[0]


@requires_data
def test_reported_colours_of_two_bytes_are_scaled() -> None:
    assert colours(reported("colour_16bit/c08_colour16.e57")) == {156}


@pytest.mark.parametrize(
    ("value", "bounds", "limits", "expected"),
    [
        (np.uint8(156), (0, 255), {"Minimum": 0, "Maximum": 255}, 156),
        (np.uint8(156), (12, 200), {}, 156),
        (np.uint16(40000), (0, 65535), {}, 156),
        (np.uint16(2500), (0, 65535), {"Minimum": 0, "Maximum": 4095}, 156),
        (np.uint16(156), (0, 65535), {"Minimum": 0, "Maximum": 255}, 156),
        (np.float32(0.6), None, {"Minimum": 0.0, "Maximum": 1.0}, 153),
        (np.float32(0.6), None, {}, 153),
        (np.float64(153.0), None, {}, 153),
        (np.float32(6.0), (0.0, 10.0), {}, 153),
        (np.float32(70.0), (0.0, 1e9), {"Minimum": 50.0, "Maximum": 90.0}, 128),
    ],
)
def test_colours_are_scaled_by_limits_or_else_by_bounds(
    tmp_path: Path, value: Any, bounds: Any, limits: dict[str, float], expected: int
) -> None:
    record = with_colour(room(), value, bounds, **limits)
    assert colours(write_records(tmp_path / "a.e57", [record])) == {expected}


@requires_data
def test_reported_empty_scan_is_left_out() -> None:
    path = reported("empty_scan/c06_empty_first.e57")
    (scan,) = read_scans(path)
    assert int(scan.valid.sum()) == 7200
    assert scan.warnings == ("scan 1 of 2 in the file has no points and was left out",)
    assert read_scan(path).shape == read_scan(f"{path}#2").shape == (60, 120)
    assert read_scan(f"{path}#2").warnings == ()
    given = read_request(ScanRequest((str(path),)))
    assert (len(given.scans), len(given.paths)) == (1, 1)
    assert [text for text in given.doubts if "left out" in text] == [f"{scan.name}: {scan.warnings[0]}"]
    assert scan.warnings[0] in describe(path)["warnings"]
    assert len(read_points(path).points) == 7200


def test_empty_scans_keep_the_numbers_of_the_others(tmp_path: Path) -> None:
    full, empty = room(), Record({name: values[:0] for name, values in room().fields.items()})
    path = write_records(tmp_path / "a.e57", [full, empty, room(AZIMUTHS[:50]), empty])
    scans = read_scans(path)
    assert [scan.shape for scan in scans] == [(60, 120), (60, 50)]
    assert scans[0].warnings == ("scans 2, 4 of 4 in the file have no points and were left out",)
    assert scans[1].warnings == ()
    assert read_scan(f"{path}#3").shape == (60, 50)
    assert [entry["number"] for entry in describe(path)["scans"]] == [1, 3]
    with pytest.raises(
        InputError, match=r"a.e57#2: no scan with points has that number; those that have: #1, #3"
    ):
        read_scan(f"{path}#2")
    with pytest.raises(InputError, match="none of its 2 scans has a point; export them again, with points"):
        open_scans(write_records(tmp_path / "none.e57", [empty, empty]))


def test_an_empty_scan_in_ptx_is_left_out(tmp_path: Path) -> None:
    from scenes.io.scan_files import write_scan

    write_scan(read_scan(write_records(tmp_path / "a.e57", [room()])), tmp_path / "a.ptx")
    header = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    (tmp_path / "b.ptx").write_text(f"0\n0\n{header}{(tmp_path / 'a.ptx').read_text()}")
    (scan,) = read_scans(tmp_path / "b.ptx")
    assert scan.shape == (60, 120)
    assert scan.warnings == ("scan 1 of 2 in the file has no points and was left out",)


@requires_data
def test_reported_surplus_columns_are_left_out() -> None:
    scan = read_scan(reported("panorama_over_360/o_366.0.e57"))
    assert (scan.shape, scan.warnings) == ((60, 120), (SURPLUS.format(2),))
    assert isinstance(scan.projection, SphericalProjection)


@pytest.mark.parametrize(
    ("turn", "step", "n_columns"), [(400.0, 4.0, 90), (363.0, 3.0, 120), (725.0, 2.5, 144)]
)
@pytest.mark.parametrize("direction", [1, -1])
def test_columns_beyond_a_turn_are_kept_once(
    tmp_path: Path, turn: float, step: float, n_columns: int, direction: int
) -> None:
    columns = direction * np.arange(-170.0, turn - 170 - 1e-6, step)
    record = with_colour(room(columns), np.uint8(70), (0, 255))
    scan = read_scan(write_records(tmp_path / "a.e57", [record]))
    assert scan.shape == (60, n_columns)
    assert scan.warnings == (SURPLUS.format(len(columns) - n_columns),)
    assert off_walls(scan.points()[scan.valid]).max() < 1e-9
    assert scan.colour is not None
    assert (scan.colour == 70).all()


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize(
    ("last_deg", "share", "n_rows"),
    [(240, 1.0, 75), (240, 0.7, 75), (151, 1.0, 75), (101, 1.0, 75), (233, 1.0, 75)],
)
def test_rows_over_the_zenith_are_put_beside_the_others(
    tmp_path: Path, way: int, last_deg: float, share: float, n_rows: int
) -> None:
    points = room_points(np.arange(1.5, 180, 3.0)[::way], np.arange(-59.0, last_deg, 2.0)[::way])
    fields = grid_fields(points)
    is_kept = np.random.default_rng(0).random(len(fields["rowIndex"])) < share
    record = Record({name: values[is_kept] for name, values in fields.items()})
    record.fields["intensity"] = np.full(is_kept.sum(), np.float32(7))
    scan = read_scan(write_records(tmp_path / "a.e57", [with_colour(record, np.uint8(70), (0, 255))]))
    assert (scan.shape, int(scan.valid.sum())) == ((n_rows, 120), int(is_kept.sum()))
    assert scan.warnings == (
        "its rows pass over the zenith or nadir: those beyond were put beside the others",
    )
    assert off_walls(scan.points()[scan.valid]).max() < 1e-9
    pixels = scan.projection.pixels(scan.points_in_sensor()[scan.valid])
    off = np.abs(pixels - np.argwhere(scan.valid))[np.isfinite(pixels).all(axis=1)]
    assert np.minimum(off, [np.inf, 120] - off).max() < 0.01
    assert scan.colour is not None
    assert scan.intensity is not None
    assert (scan.colour[scan.valid] == 70).all()
    assert (scan.intensity[scan.valid] == 7).all()


@requires_data
def test_reported_first_returns_are_kept() -> None:
    scan = read_scan(reported("return_index/c13_returns_last_first.e57"))
    assert scan.warnings == ("7200 further returns of pixels with several were left out",)
    points = scan.points()[scan.valid]
    on_box = (np.abs(points - [1.6, 2.9, 0.55]) < [0.42, 0.32, 0.57]).all(axis=1)
    assert (off_walls(points)[~on_box] < 0.01).all()


@pytest.mark.parametrize("size", [7, 100_000])
@pytest.mark.parametrize("is_structured", [True, False])
def test_first_returns_are_kept_wherever_they_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int, is_structured: bool
) -> None:
    monkeypatch.setattr("scenes.io.clouds.e57_points._CHUNK", size)
    near = room_points(np.arange(-30.0, 31, 2), np.arange(20.0, -21, -2))
    parts = [grid_fields(near * (1 + 0.2 * number)) for number in range(3)]
    for number, part in enumerate(parts):
        part["returnIndex"] = np.full(near[..., 0].size, number)
    fields = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.random.default_rng(1).permutation(len(fields["returnIndex"]))
    fields = {
        name: values[order]
        for name, values in fields.items()
        if is_structured or "Index" not in name or name == "returnIndex"
    }
    scan = read_scan(write_records(tmp_path / "a.e57", [Record(fields)]))
    assert int(scan.valid.sum()) == near[..., 0].size
    assert off_walls(scan.points()[scan.valid]).max() < 1e-9
    assert any("returns" in text and str(2 * near[..., 0].size) in text for text in scan.warnings)


def test_a_quaternion_of_zeros_is_upright(tmp_path: Path) -> None:
    scan = read_scan(write_records(tmp_path / "a.e57", [room(pose=((0, 0, 0, 0), tuple(STATION)))]))
    assert scan.warnings == (
        "its pose has the quaternion 0, 0, 0, 0, which is no rotation: it was taken as upright",
    )
    assert off_walls(scan.points()[scan.valid]).max() < 1e-9
    assert read_points(tmp_path / "a.e57").warnings == scan.warnings


@pytest.mark.parametrize("first", [65_500, 70_000, 3_000_000_000])
def test_rows_and_columns_may_have_any_number(tmp_path: Path, first: int) -> None:
    points = room_points(AZIMUTHS, ELEVATIONS)
    scan = read_scan(write_records(tmp_path / "a.e57", [Record(grid_fields(points, first))]))
    assert (scan.shape, scan.warnings) == ((60, 120), ())
    np.testing.assert_allclose(scan.points(), points + STATION, atol=1e-9)


@pytest.mark.parametrize("turn_deg", [0.0, 40.0])
def test_world_coordinates_under_a_pose_are_taken_as_such(tmp_path: Path, turn_deg: float) -> None:
    half = np.radians(turn_deg) / 2
    pose = ((np.cos(half), 0, 0, np.sin(half)), tuple(STATION))
    world = room_points(AZIMUTHS, ELEVATIONS) + STATION
    scan = read_scan(write_records(tmp_path / "a.e57", [Record(grid_fields(world), pose=pose)]))
    np.testing.assert_allclose(scan.points(), world, atol=1e-9)
    assert scan.warnings == (
        "its points fit a pixel grid only as world coordinates: they were taken as such",
    )


@requires_data
def test_reported_projected_points_are_counted() -> None:
    path = reported("unstructured_warning_lost/c04_phantom_zero.e57")
    scan = read_scan(path)
    assert (
        "3644 of 3644 kept" in scan.sensor
    )  # each in the pixel of the grid that half of the points still show
    filled = int(scan.valid.sum()) - 3644
    (said,) = scan.warnings
    assert said.startswith(f"3644 of 3644 points were kept, one a pixel, and {filled} single empty pixels")
    assert f"scan 1: {said}" in describe(path)["warnings"]
    request = ScanRequest((str(reported("unstructured_warning_lost/half.xyz")),), origins=(tuple(STATION),))
    (half,) = read_request(request).scans
    n_points = len(read_points(request.paths[0]).points)
    assert f"{n_points} of {n_points} kept" in half.sensor or any(
        "were kept" in text for text in half.warnings
    )


def scattered_points(seed: int) -> NDArray[Any]:
    """Points (2000, 3) of the room's inside in directions that lie on no grid."""
    rng = np.random.default_rng(seed)
    at = rng.uniform((-180, -59), (180, 59), (2000, 2))
    return np.concatenate([room_points(around, up).reshape(-1, 3) for around, up in at[:, :, None]])


@pytest.mark.parametrize("suffix", [".xyz", ".csv", ".ply", ".las"])
def test_projected_points_are_counted_in_every_format(tmp_path: Path, suffix: str) -> None:
    points = scattered_points(0) + STATION
    path = tmp_path / f"a{suffix}"
    if suffix == ".las":
        laspy = pytest.importorskip("laspy")
        cloud = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
        cloud.header.scales = np.full(3, 1e-5)
        cloud.x, cloud.y, cloud.z = points.T
        cloud.write(str(path))
    else:
        fields = "".join(f"property double {axis}\n" for axis in "xyz")
        header = {
            ".csv": "x,y,z\n",
            ".ply": f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{fields}end_header\n",
        }.get(suffix, "")
        separator = "," if suffix == ".csv" else " "
        path.write_text(header + "".join(separator.join(map(repr, row)) + "\n" for row in points.tolist()))
    doubts = read_request(ScanRequest((str(path),), origins=(tuple(STATION),))).doubts
    assert any(f"of {len(points)} points were kept" in text for text in doubts)


def test_projected_points_are_counted_once_for_all_scans(tmp_path: Path) -> None:
    records = []
    for seed in range(3):
        points = scattered_points(seed)
        fields = {f"cartesian{axis}": points[:, k] for k, axis in enumerate("XYZ")}
        records.append(Record(fields, name=f"scan {seed}"))
    path = write_records(tmp_path / "a.e57", records)
    kept = [text for text in read_request(ScanRequest((str(path),))).doubts if "points were kept" in text]
    assert len(kept) == 1
    assert kept[0].startswith("3 of 3 scans, as scan 0: ")
