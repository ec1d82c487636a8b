# SPDX-License-Identifier: MIT
"""PTX of other programs: blank lines, short lines for beams without return, points in the world."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.io.clouds import ptx
from scenes.io.point_files import read_points
from scenes.io.scan_files import read_scan, read_scans
from scenes.pose import Pose

STATIONS = (np.array([2.9, 1.3, 1.5]), np.array([4.2, 3.3, 1.45]))
UTM = np.array([691_234.5, 5_334_567.25, 512.0])
TILTED = Pose.looking_at(np.zeros(3), np.array([1.0, 0.4, 0.02]), np.array([0.03, 0.0, 1.0])).rotation


def room_points(station: NDArray[np.float64], rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (columns, rows, 3) on the walls of a room of 5 x 4 x 2.7 m, in the frame of a scanner in it."""
    azimuth, elevation = np.meshgrid(
        np.radians(np.arange(-179, 180, 4.0)), np.radians(np.arange(-58, 59, 4.0)), indexing="ij"
    )
    rays = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    )
    turned = rays @ rotation.T
    walls = np.where(turned > 0, np.array([5.0, 4.0, 2.7]) - station, -station)
    return np.asarray(rays * (walls / np.where(turned == 0, 1e-12, turned)).min(axis=-1)[..., None])


def station_text(
    points: NDArray[np.float64],
    place: NDArray[np.float64],
    axes: NDArray[np.float64],
    transform: Pose,
    *,
    colour: str = "",
    miss: str = "0 0 0 0.5",
    n_misses: int = 0,
) -> str:
    columns, rows = points.shape[:2]
    numbers = [place, *axes.T, *transform.matrix.T]
    lines = [str(columns), str(rows), *(" ".join(map(repr, row.tolist())) for row in numbers)]
    for k, point in enumerate(points.reshape(-1, 3)):
        lines.append(miss if k < n_misses else " ".join(f"{value:.6f}" for value in point) + " 0.4" + colour)
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("between", ["\n", "\n \t\n\n"])
def test_blank_lines_between_stations_are_skipped(tmp_path: Path, between: str) -> None:
    texts = [
        station_text(room_points(place, np.eye(3)), place, np.eye(3), Pose.from_parts(np.eye(3), place))
        for place in STATIONS
    ]
    (tmp_path / "a.ptx").write_text(between + between.join(texts) + between)
    scans = read_scans(tmp_path / "a.ptx")
    for scan, place in zip(scans, STATIONS, strict=True):
        np.testing.assert_allclose(scan.origin, place)
        points = scan.points()
        np.testing.assert_allclose(points.min(axis=(0, 1)), 0, atol=1e-5)
        np.testing.assert_allclose(points.max(axis=(0, 1)), [5, 4, 2.7], atol=1e-5)


@pytest.mark.parametrize("miss", ["0 0 0 0.5", "0 0 0", "0.0 0.0 0.0 0", "nan nan nan 0.5"])
@pytest.mark.parametrize("chunk", [100_000, 50])
def test_short_lines_are_beams_without_return(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, miss: str, chunk: int
) -> None:
    monkeypatch.setattr(ptx, "_CHUNK", chunk)
    place = STATIONS[0]
    transform = Pose.from_parts(np.eye(3), place)
    points = room_points(place, np.eye(3))
    text = station_text(points, place, np.eye(3), transform, colour=" 200 100 50", miss=miss, n_misses=130)
    (tmp_path / "a.ptx").write_text(text)
    scan = read_scan(tmp_path / "a.ptx")
    assert (~scan.valid).sum() == 130
    assert scan.colour is not None
    assert (scan.colour[scan.valid] == [200, 100, 50]).all()


@pytest.mark.parametrize("chunk", [100_000, 50])
def test_a_point_without_colour_among_coloured_ones_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunk: int
) -> None:
    monkeypatch.setattr(ptx, "_CHUNK", chunk)
    place = STATIONS[0]
    text = station_text(
        room_points(place, np.eye(3)), place, np.eye(3), Pose.identity(), colour=" 1 2 3", miss="1 2 3 0.5",
        n_misses=1,
    )  # fmt: skip
    (tmp_path / "a.ptx").write_text(text)
    with pytest.raises(InputError, match="point 1 has 4 numbers, 7 are needed") as caught:
        read_scan(tmp_path / "a.ptx")
    assert "a.ptx" in str(caught.value)


@pytest.mark.parametrize("shift", [np.zeros(3), UTM])
@pytest.mark.parametrize("axes", [np.eye(3), TILTED])
@pytest.mark.parametrize("n_misses", [0, 200])
def test_points_in_the_world_are_seen_from_the_stated_position(
    tmp_path: Path, shift: NDArray[np.float64], axes: NDArray[np.float64], n_misses: int
) -> None:
    place = STATIONS[0]
    world = room_points(place, axes) @ axes.T + place + shift
    text = station_text(world, place + shift, axes, Pose.identity(), n_misses=n_misses)
    (tmp_path / "a.ptx").write_text(text)
    scan = read_scan(tmp_path / "a.ptx")
    np.testing.assert_allclose(scan.origin, place + shift)
    assert "the scanner's position in the header" in scan.warnings[0]
    stored = np.moveaxis(world, 0, 1)[scan.valid]
    np.testing.assert_allclose(scan.points()[scan.valid], stored, atol=2e-6)
    cloud = read_points(tmp_path / "a.ptx")
    assert cloud.origins is not None
    np.testing.assert_allclose(cloud.origins[0], place + shift)


def test_a_stated_position_moves_no_points_in_the_scanners_frame(tmp_path: Path) -> None:
    place = STATIONS[0]
    text = station_text(room_points(place, np.eye(3)), place, np.eye(3), Pose.identity())
    (tmp_path / "a.ptx").write_text(text)
    scan = read_scan(tmp_path / "a.ptx")
    np.testing.assert_allclose(scan.origin, 0)
    assert scan.warnings == ()
