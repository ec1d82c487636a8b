# SPDX-License-Identifier: MIT
"""3DTK folders: scanNNN.3d and scanNNN.pose, centimetres, left-handed with y up, as metres with z up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.io.checks.documents import read_text
from scenes.io.checks.guard import check_file, guard_reading
from scenes.io.checks.limits import check_limit
from scenes.io.clouds.text import read_point_table
from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import Format, RawPoints, one_cloud, one_scan, points_of
from scenes.io.formats.station import scan_from_station
from scenes.io.poses.trajectory import natural_key
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage, without_saturated

SUFFIX = ".3d"
_METRES = 0.01
_TURN = np.array([[0.0, 0, 1], [-1, 0, 0], [0, 1, 0]])  # x right, y up, z forward to x forward, y left, z up


@dataclass(frozen=True, slots=True)
class UosFolder:
    """Scans of a 3DTK folder, or of one file of it, with the file of each one's pose where there is one."""

    scans: tuple[Path, ...]
    poses: tuple[Path | None, ...]

    @property
    def registered(self) -> bool:
        """Whether each scan has a pose."""
        return all(pose is not None for pose in self.poses)


def is_uos(path: Path) -> bool:
    """Tell whether a folder holds 3DTK's scans, or a file is one, by the suffix."""
    if path.is_dir():
        return any(inside.suffix.lower() == SUFFIX for inside in path.iterdir())
    return path.suffix.lower() == SUFFIX


def open_uos(path: Path) -> UosFolder:
    """Return the scans of a folder in natural order, or the one of a file.

    Raises InputError: a link that leads out of the folder, or too many files.
    """
    folder = path if path.is_dir() else path.parent
    paths: Sequence[Path] = [path]
    if path.is_dir():
        named = [inside for inside in path.iterdir() if inside.suffix.lower() == SUFFIX]
        paths = sorted(named, key=lambda inside: natural_key(inside.name))
    check_limit("entries", len(paths), "its scans")
    beside = [scan.with_suffix(".pose") for scan in paths]
    poses = [pose if pose.is_file() else None for pose in beside]
    for file in [*paths, *(pose for pose in poses if pose is not None)]:
        if not file.resolve().is_relative_to(folder.resolve()):
            raise InputError(f"{file}: lies outside the folder and is not opened; copy it into it")
    return UosFolder(tuple(paths), tuple(poses))


def read_uos(folder: UosFolder, index: int) -> RangeImage:
    """Return scan `index`, from 0: its points put back onto the scanner's own grid of angles.

    Columns x, y, z, then reflectance or colour, which is not used; points in the scanner's frame.

    Raises InputError: no points, too few for a scan, or a damaged pose.
    """
    file, pose = folder.scans[index], folder.poses[index]
    with guard_reading(check_file(file), "a 3DTK scan"):
        table = read_point_table(file)
        finite = np.asarray(np.isfinite(table.points).all(axis=1))
        points = table.points[finite] * _METRES @ _TURN.T
        scan = scan_from_station(points, np.zeros(3), file.stem)
    sentences = [*table.warnings, "read as 3DTK's: centimetres, left-handed, y up"]
    if not finite.all():
        sentences.append(f"{int((~finite).sum())} of {len(finite)} points are not finite and were left out")
    moved = scan if pose is None else scan.transform(read_uos_pose(pose))
    return moved.with_facts(sensor=f"3DTK's scanner, {scan.sensor}").add_warnings(sentences)


def read_uos_pose(path: Path) -> Pose:
    """Return the pose of a `.pose` file: x, y, z in centimetres, and turns about x, y and z in degrees.

    World from scan = translation, then R_x R_y R_z, in 3DTK's frame; that is turned into ours.

    Raises InputError: not six finite numbers.
    """
    with guard_reading(path, "a 3DTK pose"):
        numbers = [float(word) for word in read_text(path).split()]
        if len(numbers) != 6 or not np.isfinite(np.array(numbers)).all():
            raise InputError(
                f"expected six finite numbers (x y z in cm, three angles in degrees), got {len(numbers)}"
            )
        return Pose.from_parts(_TURN @ _rotation(*np.radians(numbers[3:])) @ _TURN.T, _in_metres(numbers[:3]))


def _in_metres(place: Sequence[float]) -> FloatArray:
    return np.asarray(_TURN @ np.array(place) * _METRES)


def _rotation(about_x: float, about_y: float, about_z: float) -> FloatArray:
    """R_x R_y R_z."""
    sines, cosines = np.sin([about_x, about_y, about_z]), np.cos([about_x, about_y, about_z])
    turned = np.eye(3)
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        step = np.eye(3)
        step[first, first] = step[second, second] = cosines[axis]
        step[second, first], step[first, second] = sines[axis], -sines[axis]
        turned = turned @ step
    return turned


def _scan(path: Path) -> RangeImage:
    return read_uos(open_uos(path), 0)


def _points(path: Path) -> RawPoints:
    return points_of([without_saturated(_scan(path))])


FORMAT = Format(
    name="3dtk",
    suffixes=(SUFFIX,),
    points=one_cloud(_points),
    scans=one_scan(_scan),
    unit="cm",
    facts=FormatFacts(
        title="3DTK: a folder of `.3d`",
        read="points, returned to the grid of angles of the scanner",
        lost="reflectance",
        poses="`.pose` beside each, left-handed with y up: turned into ours",
        units="centimetres",
    ),
)
