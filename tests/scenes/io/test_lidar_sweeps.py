# SPDX-License-Identifier: MIT
"""Sweeps of lidars with several beams, points of what carries a scanner, repeated points, clouds outdoors."""

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.describe import scan_warnings
from scenes.io.formats.station import scan_from_station
from scenes.io.scan_request import ScanRequest, read_request
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.lidar_sweeps import HDL32, HDL64, OUSTER128, VLP16, VLP32, sweep

LIDARS = {
    "16 even beams": (VLP16, {}),
    "32 beams at uneven elevations": (VLP32, {}),
    "32 beams over a car's roof": (HDL32, {"carrier": True, "step_deg": 0.8}),
    "128 beams": (OUSTER128, {"step_deg": 1.4}),
    "64 beams from two heads, one after the other": (HDL64, {"by": "beam", "offset_m": 0.2, "jitter": 0.1}),
}


def kept_of(scan):
    """How many points were kept, of how many."""
    kept, _, every, _ = scan.sensor.split(", ")[-1].split()
    return int(kept), int(every)


@pytest.mark.parametrize("kind", LIDARS)
def test_each_beam_is_a_row_and_hardly_a_point_is_lost(kind):
    elevations, how = LIDARS[kind]
    swept = sweep(elevations, **how)
    found = scan_from_station(swept.points, (0, 0, 0))
    n_seen = len(np.unique(swept.ring[~swept.on_carrier]))
    assert found.shape[0] == n_seen
    n_kept, n_all = kept_of(found)
    assert n_kept >= 0.95 * n_all
    assert n_all >= 0.95 * np.count_nonzero(~swept.on_carrier)
    assert not any("lie on no grid" in text for text in scan_warnings(found))
    if not how.get("offset_m"):  # else elevations depend on the range
        rows = np.degrees(np.sort(found.projection.elevations))
        np.testing.assert_allclose(rows, np.unique(elevations[swept.ring[~swept.on_carrier]]), atol=0.1)


def test_numbers_of_beams_make_rows_in_any_order_of_the_points():
    swept = sweep(HDL64, 0.8, offset_m=0.2)
    order = np.random.default_rng(0).permutation(len(swept.points))
    found = scan_from_station(swept.points[order], (0, 0, 0), beam=swept.ring[order])
    assert found.shape[0] == 64
    assert found.warnings == ()


def around(away_m, n=2000, share=1.0):
    """Points about the origin at a range, in a share of the full turn, below it."""
    rng = np.random.default_rng(n)
    turn, down = rng.uniform(0, 2 * np.pi * share, n), rng.uniform(0.5, 1.4, n)
    rays = np.column_stack([np.cos(down) * np.cos(turn), np.cos(down) * np.sin(turn), -np.sin(down)])
    return away_m * rays


def room(n=20_000):
    rays = np.random.default_rng(1).normal(size=(n, 3))
    return 3.0 * rays / np.abs(rays).max(axis=1, keepdims=True)


@pytest.mark.parametrize(
    ("own", "is_carrier"),
    [
        (around(0.12), True),  # the housing
        (np.concatenate([around(0.4), around(0.5, 500)]), True),  # a robot
        (around(1.6, 800), True),  # a roof
        (around(0.6, share=0.3), False),  # a desk beside the scanner
        (around(2.4), False),  # nothing is parted from the walls
        (around(0.5, 30), False),  # too few
    ],
)
def test_what_carries_the_scanner_is_left_out_with_a_count(own, is_carrier):
    found = scan_from_station(np.concatenate([room(), own]) + 5, (5, 5, 5))
    said = [text for text in found.warnings if "what carries it" in text]
    assert len(said) == is_carrier
    if is_carrier:
        assert said[0].startswith(f"{len(own)} of {20_000 + len(own)} returns lie within ")
    assert (found.ranges[found.valid].min() > 2.9) == is_carrier


def test_repeated_points_are_counted_and_uneven_stops_keep_every_point():
    rng = np.random.default_rng(0)
    stops = np.cumsum(rng.uniform(1.0, 1.4, 290))  # degrees, of a turning table
    azimuth, elevation = (
        part.ravel() for part in np.meshgrid(np.radians(stops), np.radians(np.arange(-40.0, 60.0, 1.0)))
    )
    rays = np.column_stack([
        np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    ])  # fmt: skip
    points = 3.0 * rays / np.abs(rays).max(axis=1, keepdims=True)
    found = scan_from_station(np.concatenate([points, points[::2]]), (0, 0, 0))
    assert found.valid.sum() == len(points)
    assert found.warnings == (
        f"{len(points) // 2} of {3 * len(points) // 2} points repeat others and were left out",
    )


def test_sweeps_that_follow_each_other_in_a_file_are_not_one():
    first = sweep(HDL64, 0.8, by="beam").points
    away = first[first[:, 2] > -1.6] + [0.0, 0.0, 1.0]  # of a lidar that was lower there
    with pytest.raises(InputError, match="behind each other"):
        scan_from_station(np.concatenate([first, 1.5 * first, 2.5 * away]), (0, 0, 0))


def test_trees_before_the_sky_are_a_scan_and_merged_scans_are_not():
    rng = np.random.default_rng(2)
    turn, up = np.meshgrid(np.arange(-180.0, 180.0, 2.0), np.arange(-50.0, 80.0, 2.0))
    turn, up = (np.radians(angle.ravel() + rng.uniform(-1.0, 1.0, angle.size)) for angle in (turn, up))
    rays = np.column_stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])
    cell = np.floor(rays * 9).astype(np.int64) @ [1, 37, 1409]  # a branch that several beams meet
    ranges = np.where(up < 0.0, 4.0, 5 + 10 * ((cell * 2654435761) % 97) / 97)
    seen = rng.random(len(rays)) < np.where(up < 0.0, 1.0, 0.6)
    points = rng.permutation((rays * ranges[:, None])[seen])
    found = scan_from_station(points, (0, 0, 0))
    assert kept_of(found)[0] > 0.3 * len(points)
    assert "points were kept" in found.warnings[0]
    with pytest.raises(InputError, match="behind each other"):
        scan_from_station(np.concatenate([points, 2.0 * points, 3.1 * points]), (0, 0, 0))


@requires_data
@pytest.mark.parametrize(
    ("file", "least", "told"),
    [
        ("pcl_room/room_scan1.pcd", 0.98, ["56427 of 112586 points repeat", "11871 of 56159 returns"]),
        ("pcl_room/room_scan2.pcd", 0.98, ["56433 of 112624 points repeat", "11931 of 56191 returns"]),
        ("libpointmatcher/eth_cloud0.xyz", 0.5, ["of 24989 points were kept"]),
        ("libpointmatcher/eth_cloud1.xyz", 0.5, ["of 25193 points were kept"]),
    ],
)
def test_public_clouds_without_a_grid_are_scans(file, least, told):
    given = read_request(ScanRequest((str(data_path(f"range/{file}")),), origins=((0, 0, 0),)))
    n_kept, n_all = kept_of(given.scans[0])
    assert n_kept >= least * n_all
    for text in told:
        assert sum(text in doubt for doubt in given.doubts) == 1


def test_clouds_about_their_own_origins_are_not_joined_without_poses(tmp_path):
    paths = [tmp_path / "a.xyz", tmp_path / "b.xyz"]
    for seed, path in enumerate(paths):
        np.savetxt(path, np.random.default_rng(seed).permutation(room(4000)), fmt="%.4f")
    request = ScanRequest(tuple(map(str, paths)), origins=((0, 0, 0), (0, 0, 0)))
    assert len(read_request(request, posed=False).scans) == 2
    with pytest.raises(InputError, match=r"2 scans without poses .*`unseen register`"):
        read_request(request)
