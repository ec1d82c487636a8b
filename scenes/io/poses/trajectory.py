# SPDX-License-Identifier: MIT
"""Trajectories: files of poses, one a frame: plain, TUM, Redwood, matrices, JSON and COLMAP."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scenes.checks import FloatArray, InputError, check_finite
from scenes.io.checks.documents import parse_json, read_text
from scenes.io.checks.guard import guard_reading
from scenes.io.formats.columns import in_seconds
from scenes.io.poses.colmap import is_images, read_images
from scenes.limits import FILE_ROTATION, TIME_GAP_S
from scenes.pose import Pose, quaternion_of, rotation_of
from scenes.run.atomic import write_text

_FORMS = (
    "known: lines of tx ty tz qx qy qz qw, TUM lines with a timestamp before them, Redwood .log blocks, "
    "4x4 matrices, four lines each, lines of their first 12 (KITTI) or all 16 numbers, JSON lists of 4x4 "
    "matrices, and images.txt of COLMAP"
)


def read_poses(path: Path) -> list[Pose]:
    """Return the poses of a file, `world_from_sensor`, in the file's order.

    Plain lines hold `tx ty tz qx qy qz qw`, TUM lines a timestamp before that; a Redwood .log holds blocks
    of one line of integers and four of a matrix; other files four lines a matrix, as of 7-Scenes, or one
    line, all of it or its first three rows, as of KITTI; JSON a list of 4x4 matrices, or a `plan.json`.
    `images.txt` of COLMAP is turned from sensor-from-world to world-from-sensor, its images in the natural
    order of their names.

    Raises InputError: none of these, or a pose that is not rigid; named with its number.
    """
    with guard_reading(path, "a file of poses"):
        text = read_text(path)
        if path.suffix.lower() == ".json":
            return _number_checked(_json_matrices(text))
        if is_images(text):
            images = read_images(text)
            return _number_checked([images[name].matrix for name in sorted(images, key=natural_key)])
        rows = _number_rows(text)
        if rows and {len(row) for row in rows} == {4}:
            return _number_checked(_square_matrices(rows))
        if rows and {len(row) for row in rows} in ({12}, {16}):
            return _number_checked([_filled_matrix(row) for row in rows])
        if rows and len(rows[0]) == 3 and len(rows) % 5 == 0:
            return _number_checked(_redwood_matrices(rows))
        return _number_checked([_matrix(row[-7:], k) for k, row in enumerate(_equal_rows(rows), start=1)])


def read_named_poses(path: Path) -> dict[str, Pose] | None:
    """Return the pose of each image that a file names, `world_from_sensor`; None of a file without names.

    Only COLMAP's `images.txt` names them. Raises InputError: as `read_poses`.
    """
    with guard_reading(path, "a file of poses"):
        text = read_text(path)
        if path.suffix.lower() == ".json" or not is_images(text):
            return None
        images = read_images(text)
        return dict(zip(images, _number_checked([image.matrix for image in images.values()]), strict=True))


def rounded_pose(matrix: FloatArray) -> Pose:
    """Return the rigid pose nearest to a matrix (4, 4), which may be off by rounding (1e-3) but no more."""
    mended = np.array(matrix, dtype=np.float64)
    if mended.shape == (4, 4) and np.isfinite(mended).all():
        rotation = mended[:3, :3]
        with np.errstate(over="ignore", invalid="ignore"):
            error = np.abs(rotation.T @ rotation - np.eye(3)).max()
        if error <= FILE_ROTATION:
            u, _, vt = np.linalg.svd(rotation)
            mended[:3, :3] = u @ vt
    return Pose(mended)


def read_timed_poses(path: Path) -> tuple[FloatArray, list[Pose]]:
    """Return the timestamps (n,) in seconds and the poses of a TUM trajectory.

    Raises InputError: no TUM trajectory, a time that is not finite, or a pose that is not rigid.
    """
    with guard_reading(path, "a TUM trajectory"):
        rows = _equal_rows(_number_rows(read_text(path)))
        if not rows or len(rows[0]) != 8:
            raise InputError("expected lines of timestamp tx ty tz qx qy qz qw")
        times = check_finite("timestamps", np.array([row[0] for row in rows]), "correct them first")
        times = in_seconds(times)
        return times, _number_checked([_matrix(row[1:], k) for k, row in enumerate(rows, start=1)])


def poses_at(path: Path, times: Sequence[float]) -> list[Pose]:
    """Return the poses of a TUM trajectory nearest to `times` in seconds, at most 20 ms away.

    Raises InputError: no TUM trajectory, or a time without a pose.
    """
    stamps, poses = read_timed_poses(path)
    near = [int(np.argmin(np.abs(stamps - time))) for time in times]
    far = [time for time, k in zip(times, near, strict=True) if abs(stamps[k] - time) > TIME_GAP_S]
    if far:
        raise InputError(
            f"{path}: {len(far)} of {len(times)} frames have no pose within {TIME_GAP_S:g} s, the first at "
            f"{far[0]:.6f}; pick frames with PATH#k, or give one pose a frame"
        )
    return [poses[k] for k in near]


def _number_rows(text: str) -> list[list[float]]:
    """The numbers of each line, without blank lines and comments."""
    lines = (line.split("#", 1)[0].replace(",", " ").split() for line in text.splitlines())
    return [[float(word) for word in words] for words in lines if words]


def _equal_rows(rows: list[list[float]]) -> list[list[float]]:
    wrong = [number for number, row in enumerate(rows, start=1) if len(row) not in (7, 8)]
    if wrong:
        raise InputError(f"line {wrong[0]} holds {len(rows[wrong[0] - 1])} numbers; {_FORMS}")
    return rows


def _matrix(numbers: Sequence[float], number: int) -> FloatArray:
    """4x4 matrix of tx ty tz qx qy qz qw of the pose `number`; the quaternion's length may be rounded."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_of(numbers[3:], f"pose {number}")
    matrix[:3, 3] = numbers[:3]
    return matrix


def _square_matrices(rows: list[list[float]]) -> list[FloatArray]:
    """Blocks of four lines of four numbers."""
    if len(rows) % 4:
        raise InputError(f"{len(rows)} lines of four numbers are no whole number of 4x4 matrices")
    return [np.array(rows[start : start + 4]) for start in range(0, len(rows), 4)]


def _filled_matrix(row: list[float]) -> FloatArray:
    """A matrix of its 12 or 16 numbers, row by row."""
    numbers = row if len(row) == 16 else [*row, 0.0, 0.0, 0.0, 1.0]
    return np.array(numbers).reshape(4, 4)


def _redwood_matrices(rows: list[list[float]]) -> list[FloatArray]:
    for start in range(0, len(rows), 5):
        if any(len(row) != 4 for row in rows[start + 1 : start + 5]):
            raise InputError(f"pose {start // 5 + 1} of this .log is no four lines of four numbers")
    return [np.array(rows[start + 1 : start + 5]) for start in range(0, len(rows), 5)]


def _json_matrices(text: str) -> list[FloatArray]:
    """Matrices of a list, or of the views of a plan."""
    if text.lstrip().startswith("{"):
        views = parse_json(text, dict).get("views")
        if not isinstance(views, list):
            raise InputError(f'its object has no list "views"; {_FORMS}')
        return [np.array(view["world_from_sensor"], dtype=np.float64) for view in views]
    return [np.array(matrix, dtype=np.float64) for matrix in parse_json(text, list)]


def _number_checked(matrices: Sequence[FloatArray]) -> list[Pose]:
    if not matrices:
        raise InputError(f"holds no poses; {_FORMS}")
    poses = []
    for number, matrix in enumerate(matrices, start=1):
        try:
            poses.append(rounded_pose(matrix))
        except InputError as error:
            raise InputError(f"pose {number} is not usable: {error}") from error
    return poses


def write_poses(path: Path, poses: Sequence[Pose]) -> None:
    """Write plain lines `tx ty tz qx qy qz qw`, world from sensor, one a pose."""
    write_text(path, "".join(f"{_line(pose)}\n" for pose in poses))


def write_timed_poses(path: Path, times: Sequence[float] | FloatArray, poses: Sequence[Pose]) -> None:
    """Write a TUM trajectory, `timestamp tx ty tz qx qy qz qw` a line: times (n,), s; world from sensor."""
    lines = [f"{float(time)!r} {_line(pose)}\n" for time, pose in zip(times, poses, strict=True)]
    write_text(path, "".join(["# timestamp tx ty tz qx qy qz qw (world from sensor, metres)\n", *lines]))


def _line(pose: Pose) -> str:
    return " ".join(repr(float(number)) for number in [*pose.translation, *quaternion_of(pose.rotation)])


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Return the key under which names are in natural order.

    Examples
    --------
    >>> sorted(["10.png", "9.png", "a2.png"], key=natural_key)
    ['9.png', '10.png', 'a2.png']
    """
    parts = re.split(r"(\d+)", name)
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]
