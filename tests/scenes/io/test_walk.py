# SPDX-License-Identifier: MIT
"""Walks: points with times and a trajectory, in the forms of several writers, as scans of short stretches."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from nbv.cli import app
from scenes.checks import FloatArray, InputError
from scenes.io.describe import describe
from scenes.io.point_files import read_points
from scenes.io.scan_request import ScanRequest, read_request
from scenes.io.track import Trajectory, clock_offset, read_trajectory
from scenes.io.walk import open_walk
from tests.helpers.e57_fields import Record, write_records
from tests.helpers.walks import Walked, walk_through_box, write_timed_las, write_tum

SIGMA_M, SPEED_M_S = 0.02, 1.2


@pytest.fixture(scope="module")
def walked() -> Walked:
    return walk_through_box(seconds=2.0, speed_m_s=SPEED_M_S, sigma_m=SIGMA_M, rng=0)


def _tum(path: Path, times: FloatArray, places: FloatArray) -> None:
    write_tum(path, times, places)


def _geoslam(path: Path, times: FloatArray, places: FloatArray) -> None:
    rows = np.column_stack([times, places, np.tile([1.0, 0, 0, 0], (len(times), 1))])
    np.savetxt(path, rows, fmt="%.9f", header="%time x y z qw qx qy qz userfields", comments="")


def _navvis(path: Path, times: FloatArray, places: FloatArray) -> None:
    rows = [
        f"{int(t * 1e9)}, {x:.9g}, {y:.9g}, {z:.9g}, 1, 0, 0, 0"
        for t, (x, y, z) in zip(times, places, strict=True)
    ]
    path.write_text("\n".join(["#nsecs, x, y, z, ori_w, ori_x, ori_y, ori_z", *rows]) + "\n")


def _rtabmap(path: Path, times: FloatArray, places: FloatArray) -> None:
    numbers = np.arange(len(times))
    rows = np.column_stack([times, places, np.tile([0, 0, 0, 1.0], (len(times), 1)), numbers])
    np.savetxt(path, rows, fmt="%.9f", header="timestamp x y z qx qy qz qw id", comments="#")


def _csv(path: Path, times: FloatArray, places: FloatArray) -> None:
    rows = np.column_stack([places[:, ::-1], times, np.zeros((len(times), 3))])
    np.savetxt(path, rows, "%.9f", ",", header="z,y,x,GPS Time [s],roll,pitch,yaw", comments="")


def _kitti(path: Path, times: FloatArray, places: FloatArray) -> None:
    matrices = np.tile(np.eye(4)[:3], (len(times), 1, 1))
    matrices[:, :, 3] = places
    np.savetxt(path, matrices.reshape(-1, 12), fmt="%.9f")
    np.savetxt(path.with_name("times.txt"), times, fmt="%.9f")


@pytest.mark.parametrize("write", [_tum, _geoslam, _navvis, _rtabmap, _csv, _kitti])
def test_trajectories_of_several_writers_give_the_same_places(
    tmp_path: Path, write: Callable[[Path, FloatArray, FloatArray], None]
) -> None:
    times = 1.7e9 + np.arange(12.0)  # whole seconds, which count like numbers of points
    places = np.random.default_rng(0).normal(size=(12, 3))
    write(tmp_path / "track.txt", times, places)
    track = read_trajectory(tmp_path / "track.txt")
    np.testing.assert_allclose(track.times, times, atol=1e-6)
    np.testing.assert_allclose(track.places, places, atol=1e-8)
    middle = track.at(times[:-1] + 0.25)
    np.testing.assert_allclose(middle, 0.75 * places[:-1] + 0.25 * places[1:], atol=1e-5)


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3, "put them into times.txt"),
        ("0 0 0 0 0 0 1\n" * 3, "holds no times"),
        ("time x y z\n1 0 0 0\n1 0 0 0\n", "holds 1 poses with times"),
        ("time x y z\nnan 0 0 0\n2 0 0 0\n", "holds 1 poses with times"),
        ("[[1, 0]]", "known: "),
    ],
)
def test_trajectories_without_times_are_refused(tmp_path: Path, text: str, cause: str) -> None:
    (tmp_path / "track.txt").write_text(text)
    with pytest.raises(InputError, match=cause):
        read_trajectory(tmp_path / "track.txt")


def test_disorder_of_a_trajectory_is_mended_and_counted(tmp_path: Path) -> None:
    (tmp_path / "track.txt").write_text(
        "time x y z\n2 2 0 0\n1 1 0 0\n1 1.5 0 0\nnan 0 0 0\n3 nan 0 0\n4 4 0 0\n"
    )
    track = read_trajectory(tmp_path / "track.txt")
    assert track.times.tolist() == [1.0, 2.0, 4.0]
    assert track.places[:, 0].tolist() == [1.0, 2.0, 4.0]
    told = "; ".join(track.warnings)
    assert "2 of 6 poses of the trajectory are not finite" in told
    assert "1 of 4 poses of the trajectory repeat a time" in told
    assert "up to 0.5" in told
    assert "were sorted" in told


WEEK_S, ADJUSTED_S = 604_800.0, 1e9
GPS_S = 2300 * WEEK_S + 200_000.0


@pytest.mark.parametrize(
    ("points_s", "track_s", "offset_s"),
    [
        (5.0, 5.0, 0.0),
        (GPS_S - ADJUSTED_S, GPS_S, ADJUSTED_S),
        (GPS_S, GPS_S - ADJUSTED_S, -ADJUSTED_S),
        (200_000.0, GPS_S, 2300 * WEEK_S),
        (200_000.0, GPS_S - ADJUSTED_S, 2300 * WEEK_S - ADJUSTED_S),
        (GPS_S, 200_000.0, -2300 * WEEK_S),
    ],
)
def test_clocks_are_matched_by_the_one_offset_with_which_they_overlap(
    points_s: float, track_s: float, offset_s: float
) -> None:
    track = Trajectory(track_s + np.arange(61.0), np.zeros((61, 3)))
    offset, sentence = clock_offset(points_s + np.linspace(0, 60, 50), track)
    assert offset == offset_s
    assert bool(sentence) == (offset_s != 0)


def test_clocks_that_do_not_overlap_are_refused_with_both_spans() -> None:
    track = Trajectory(1e6 + np.arange(61.0), np.zeros((61, 3)))
    with pytest.raises(InputError, match=r"from 500000\.000 to 500060\.000 s.*1000000\.000 to 1000060\.000"):
        clock_offset(np.array([500_000.0, 500_060.0]), track)


def _las(path: Path, walked: Walked) -> Path:
    return write_timed_las(path.with_suffix(".las"), walked.points, walked.times)


def _text(path: Path, walked: Walked) -> Path:
    rows = np.column_stack([walked.times, walked.points])
    np.savetxt(path.with_suffix(".csv"), rows, "%.6f", ",", header="gps_time,x,y,z", comments="")
    return path.with_suffix(".csv")


def _ply(path: Path, walked: Walked) -> Path:
    names = ("x", "y", "z", "scalar_GpsTime")
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(walked.times)}"]
    head += [*(f"property double {name}" for name in names), "end_header\n"]
    rows = np.column_stack([walked.points, walked.times]).astype("<f8")
    path.with_suffix(".ply").write_bytes("\n".join(head).encode() + rows.tobytes())
    return path.with_suffix(".ply")


def _e57(path: Path, walked: Walked) -> Path:
    pytest.importorskip("pye57")
    columns = {f"cartesian{axis}": walked.points[:, k] for k, axis in enumerate("XYZ")}
    fields = {**columns, "timeStamp": walked.times}
    return write_records(path.with_suffix(".e57"), [Record(fields, pose=None)])


@pytest.mark.parametrize("write", [_las, _text, _ply, _e57])
def test_points_of_a_walk_become_scans_of_stretches(
    tmp_path: Path, walked: Walked, write: Callable[[Path, Walked], Path]
) -> None:
    some = walked.some(0.5)
    file = write(tmp_path / "walk", some)
    write_tum(tmp_path / "track.txt", walked.track_times, walked.track_places)
    cloud = read_points(file)
    assert cloud.times is not None
    np.testing.assert_allclose(cloud.times, some.times, atol=1e-6)
    source = open_walk(file, tmp_path / "track.txt")
    scans = [reader() for reader in source.readers]
    for scan in scans:  # within reach of the path, all points where they were measured
        assert np.linalg.norm(walked.track_places - scan.origin, axis=1).min() < 0.05
        held = scan.points()[scan.valid]
        assert len(held) > 0.9 * scan.ranges.size
        assert walked.box_distance(held).max() < 6 * SIGMA_M
    assert scans[0].shape[0] == 16
    assert "walk" in scans[0].sensor


def test_a_stretch_is_as_long_as_spacing_and_noise_allow(tmp_path: Path, walked: Walked) -> None:
    file = _las(tmp_path / "walk", walked)
    write_tum(tmp_path / "track.txt", walked.track_times, walked.track_places)
    source = open_walk(file, tmp_path / "track.txt")
    walk = source.readers[0].func.__self__  # type: ignore[attr-defined]  # of a partial
    ranges = np.linalg.norm(walked.points - walked.origins, axis=1)
    wanted = max(np.radians(2.0) * np.median(ranges) / 2, 2 * SIGMA_M)
    assert walk.reach_m == pytest.approx(wanted, rel=0.15)
    for first, end in walk.cuts:
        origins = walk.track.at(walk.times[first:end])
        assert np.linalg.norm(origins - origins.mean(axis=0), axis=1).max() < 1.1 * walk.reach_m


def test_points_outside_and_in_gaps_are_left_out_with_their_number(tmp_path: Path, walked: Walked) -> None:
    file = _las(tmp_path / "walk", walked)
    late = walked.times.max() + 1.5
    kept = (walked.track_times > 0.2) & (walked.track_times < 0.6)
    track = np.concatenate([walked.track_times[kept], [late, late + 1]])
    write_tum(tmp_path / "track.txt", track, np.concatenate([walked.track_places[kept], np.ones((2, 3))]))
    told = "; ".join(open_walk(file, tmp_path / "track.txt").warnings)
    start, end = track[0], track[kept.sum() - 1]
    n_before, n_after = int((walked.times < start).sum()), int((walked.times > end).sum())
    n = len(walked.times)
    assert f"{n_before} of {n} points lie outside of the time span of track.txt" in told
    assert f"{n_after} of {n} points lie in gaps of track.txt" in told


def test_the_order_of_points_in_the_file_does_not_matter(tmp_path: Path, walked: Walked) -> None:
    some = walked.some(0.2)
    order = np.random.default_rng(1).permutation(len(some.times))
    write_tum(tmp_path / "track.txt", walked.track_times, walked.track_places)
    one = open_walk(_las(tmp_path / "a", some), tmp_path / "track.txt")
    mixed = write_timed_las(tmp_path / "b.las", some.points[order], some.times[order])
    other = open_walk(mixed, tmp_path / "track.txt")
    for mine, its in zip(one.readers, other.readers, strict=True):
        assert mine().valid.sum() == pytest.approx(its().valid.sum(), rel=1e-3)


def test_a_request_with_a_trajectory_gives_stretches_and_lists_the_file(
    tmp_path: Path, walked: Walked
) -> None:
    file, track = _las(tmp_path / "walk", walked.some(0.3)), tmp_path / "track.txt"
    write_tum(track, walked.track_times, walked.track_places)
    request = ScanRequest((str(file),), trajectory=str(track))
    given = read_request(request)
    assert len(given.scans) > 1
    assert request.inputs == [str(file), str(track)]
    assert request.options()["trajectory"] == "track.txt"
    assert any("stretches of" in text for text in given.doubts)
    with pytest.raises(InputError, match="leave out --origin"):
        read_request(ScanRequest((str(file),), origins=((0.0, 0.0, 0.0),), trajectory=str(track)))
    with pytest.raises(InputError, match="leave out --poses"):
        read_request(ScanRequest((str(file),), poses=str(track), trajectory=str(track)))


def test_points_without_times_are_refused_with_the_cure(tmp_path: Path, walked: Walked) -> None:
    np.savetxt(tmp_path / "walk.xyz", walked.points[:500])
    write_tum(tmp_path / "track.txt", walked.track_times, walked.track_places)
    with pytest.raises(InputError, match=r"have no times.*export them with GPS time.*--origin"):
        open_walk(tmp_path / "walk.xyz", tmp_path / "track.txt")


def test_info_names_the_cure_for_points_with_times(tmp_path: Path, walked: Walked) -> None:
    file, track = _las(tmp_path / "walk", walked.some(0.2)), tmp_path / "track.txt"
    write_tum(track, walked.track_times, walked.track_places)
    assert any("its points have times" in text for text in describe(file)["warnings"])
    held = CliRunner().invoke(app, ["info", str(file), "--trajectory", str(track), "--json"])
    assert held.exit_code == 0, held.output
    assert json.loads(held.stdout)["kind"] == "scans"


def test_a_stretch_is_picked_by_its_number(tmp_path: Path, walked: Walked) -> None:
    file, track = _las(tmp_path / "walk", walked.some(0.3)), tmp_path / "track.txt"
    write_tum(track, walked.track_times, walked.track_places)
    source = open_walk(file, track)
    (one,) = read_request(ScanRequest((f"{file}#{source.number(1)}",), trajectory=str(track))).scans
    np.testing.assert_array_equal(one.ranges, source.readers[1]().ranges)
    with pytest.raises(InputError, match=r"no scan with points|there are"):
        read_request(ScanRequest((f"{file}#9999",), trajectory=str(track)))


def test_points_without_a_finite_time_are_left_out(tmp_path: Path, walked: Walked) -> None:
    some = walked.some(0.2)
    times = some.times.copy()
    times[::10] = np.nan
    file = _text(tmp_path / "walk", replace(some, times=times))
    write_tum(tmp_path / "track.txt", walked.track_times, walked.track_places)
    told = "; ".join(open_walk(file, tmp_path / "track.txt").warnings)
    assert f"{len(times[::10])} of {len(times)} points have no finite time and were left out" in told


@pytest.mark.parametrize("time_s", [0.0, 3e8])
def test_one_time_for_all_points_is_no_time(tmp_path: Path, walked: Walked, time_s: float) -> None:
    file = write_timed_las(tmp_path / "still.las", walked.points[:500], np.full(500, time_s))
    assert read_points(file).times is None
    with pytest.raises(InputError, match=r"moved \(--trajectory FILE\)"):
        read_request(ScanRequest((str(file),)))
