# SPDX-License-Identifier: MIT
"""Sensors that move: every beam from its own pose and time, errors of tracks and clocks, files read back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from nbv import PinholeSensor, SphericalSensor, scan_scene
from nbv.cli import app
from nbv.scanning.motion import Track, TrackErrors, read_track
from nbv.scanning.moving import moving_scan, scan_along
from scenes import Scene, builtin_scene, read_walk
from scenes.checks import InputError
from scenes.io.clouds.timed import write_timed
from scenes.io.poses.trajectory import write_timed_poses
from scenes.pose import Pose
from scenes.scan.timed_points import TimedPoints

LIDAR = SphericalSensor(
    elevation_min_deg=-30, elevation_max_deg=30, width=180, height=9, max_range_m=50, name="lidar"
)
ROOM = builtin_scene("two_occluders")
SPEED = 1.5


def straight(seconds: float = 2.0) -> Track:
    """Along x through the room, level."""
    times = np.array([0.0, seconds / 3, seconds])
    return Track.level(times, np.array([1.0, 2.5, 1.5]) + np.outer(SPEED * times, [1.0, 0, 0]))


def measured(track: Track, scene: Scene = ROOM, **options: object) -> TimedPoints:
    scan = moving_scan(LIDAR, track, rate_hz=10, **options)  # type: ignore[arg-type]
    parts = list(scan_along(scene, scan, rng=0))
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("points", "times", "origins", "surface")
    }
    return TimedPoints(**joined)


def test_a_sensor_that_stands_still_measures_what_a_scan_does() -> None:
    pose = straight().poses()[0]
    still = measured(Track.of([0.0, 0.1], [pose, pose]))
    scan = scan_scene(ROOM, pose, LIDAR)
    expected = scan.points()[scan.valid]
    assert len(still) == len(expected)
    assert np.abs(np.sort(still.points, axis=0) - np.sort(expected, axis=0)).max() < 1e-9


def test_each_beam_starts_where_the_sensor_is_at_its_time() -> None:
    """Origins move with the speed; beams are those of the columns that fire at their times."""
    found = measured(straight())
    assert found.times.min() == 0.0 and found.times.max() > 1.9  # noqa: PT018
    assert (np.diff(found.times) >= 0).all()
    assert np.abs(found.origins - straight().at(found.times)[0]).max() < 1e-12
    rays = found.points - found.origins
    around = np.arctan2(-rays[:, 1], rays[:, 0])  # to the right of where it goes
    azimuth = 2 * np.pi * 10 * found.times
    turned = np.angle(np.exp(1j * (around - azimuth)))
    step = 2 * np.pi / LIDAR.width
    assert np.ptp(np.angle(np.exp(1j * (turned - np.angle(np.mean(np.exp(1j * turned))))))) < step
    walls = ROOM.mesh.bounds()
    inside = (found.points > walls[0] - 1e-6) & (found.points < walls[1] + 1e-6)
    assert inside.all()


def test_a_clock_that_is_ahead_moves_points_along_the_way() -> None:
    exact = measured(straight())
    late = measured(straight(), errors=TrackErrors(clock_s=0.02))
    moved = late.points - exact.points
    inner = (exact.times > 0.05) & (exact.times < 1.9)
    assert np.abs(moved[inner] - [SPEED * 0.02, 0, 0]).max() < 1e-9
    assert np.allclose(late.times, exact.times + 0.02)


def test_errors_of_the_track_are_those_that_it_reports() -> None:
    """Points are off by the error of the position; its deviation over many drifts is the stated one."""
    times = np.arange(0, 4000.0, 20.0)
    track = Track.level(times, np.outer(times, [1.0, 0, 0]))
    errors = TrackErrors(position_sd_m=0.05, angle_sd_deg=0.2, drift_s=5)
    reported = errors.reported(track, np.random.default_rng(1))
    off = reported.positions - track.positions
    assert np.std(off) == pytest.approx(0.05, rel=0.1)
    turns = np.einsum("nji,njk->nik", track.rotations, reported.rotations)
    angle = np.degrees(np.arccos(np.clip((np.trace(turns, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    assert np.sqrt(np.mean(angle**2) / 3) == pytest.approx(0.2, rel=0.15)
    scan = moving_scan(LIDAR, straight(), rate_hz=10, errors=TrackErrors(position_sd_m=0.05), rng=2)
    noisy = next(iter(scan_along(ROOM, scan, rng=0)))
    exact = next(iter(scan_along(ROOM, replace(scan, reported=scan.track), rng=0)))
    shift = scan.reported.at(noisy.times)[0] - scan.track.at(noisy.times)[0]
    assert np.abs(noisy.points - exact.points - shift).max() < 1e-9
    assert np.abs(shift).max() > 0.01


def test_cameras_take_an_image_at_a_time() -> None:
    camera = PinholeSensor(width=40, height=30)
    scan = moving_scan(camera, straight(), rate_hz=2)
    parts = list(scan_along(ROOM, scan, rng=0))
    assert [float(np.ptp(part.times)) for part in parts] == [0.0] * 4
    with pytest.raises(InputError, match="give --rate"):
        moving_scan(camera, straight())


@pytest.mark.parametrize("suffix", [".las", ".csv"])
def test_points_and_track_are_read_back(tmp_path, suffix) -> None:
    if suffix == ".las":
        pytest.importorskip("laspy")
    scan = moving_scan(LIDAR, straight(), rate_hz=10)
    n = write_timed(
        scan_along(ROOM, scan, rng=0), tmp_path / f"walk{suffix}", about=np.zeros(3), full_light=1.0
    )
    write_timed_poses(tmp_path / "track.txt", scan.reported.times, scan.reported.poses())
    again = read_track(tmp_path / "track.txt")
    assert np.abs(again.positions - scan.reported.positions).max() < 1e-9
    scans = read_walk(tmp_path / f"walk{suffix}", tmp_path / "track.txt")
    assert n == sum(len(part) for part in scan_along(ROOM, scan, rng=0))
    points = np.concatenate([one.points()[one.valid] for one in scans])
    low, high = ROOM.mesh.bounds()
    assert ((points > low - 2e-4) & (points < high + 2e-4)).all()
    with pytest.raises(InputError, match=r"cannot write points with times to \.e57"):
        write_timed([], tmp_path / "walk.e57", about=np.zeros(3), full_light=1.0)


def test_tracks_that_make_no_sense_are_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="must ascend"):
        Track.of([0.0, 0.0], [Pose.identity()] * 2)
    with pytest.raises(InputError, match="two times or more"):
        Track.of([0.0], [Pose.identity()])
    ages = Track.level(np.array([0.0, 1e9]), np.array([[0.0, 0, 1], [1.0, 0, 1]]))
    for rate in (10.0, 1e-6):
        with pytest.raises(InputError, match="are its times in seconds"):
            moving_scan(LIDAR, ages, rate_hz=rate)
    (tmp_path / "no.txt").write_text("1 2\n")
    with pytest.raises(InputError, match=r"no\.txt"):
        read_track(tmp_path / "no.txt")


def test_the_command_writes_the_same_bytes_on_any_number_of_threads(tmp_path) -> None:
    (tmp_path / "way.txt").write_text("time x y z\n0 1 2.5 1.5\n1 3 2.5 1.5\n")
    files = []
    for threads in ("1", "2"):
        out = tmp_path / f"{threads}.csv"
        asked = ["scan", "builtin:two_occluders", "--trajectory", str(tmp_path / "way.txt"), "--quiet"]
        more = ["--sensor", "velodyne_vlp16", "--rate", "5", "--noise", "profile", "--position-sd", "0.01"]
        done = CliRunner().invoke(app, [*asked, *more, "--threads", threads, "-o", str(out)])
        assert done.exit_code == 0, done.output
        files.append((out.read_bytes(), (tmp_path / f"{threads}_trajectory.txt").read_bytes()))
    assert files[0] == files[1]
    wrong = CliRunner().invoke(
        app, ["scan", "builtin:two_occluders", "--at", "1,1,1", "--look", "2,2,1", "--rate", "5"]
    )
    assert wrong.exit_code == 2
