# SPDX-License-Identifier: MIT
"""Track of a moving scanner: files of times and places, interpolation, and the clocks that they count by."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.checks import ArrayValue, BoolArray, FloatArray, InputError
from scenes.io.checks.documents import read_text
from scenes.io.checks.guard import check_file, guard_reading
from scenes.io.clouds.text import read_point_table
from scenes.io.formats.columns import in_seconds, time_column
from scenes.limits import LONGEST_GAP_S

_FORMS = (
    "known: text whose first line names its columns (time, x, y, z among them), TUM lines of time tx ty tz "
    "qx qy qz qw, and KITTI lines of 12 numbers with times.txt beside"
)
_WEEK_S, _ADJUSTED_S = 604_800.0, 1e9  # seconds of GPS; LAS subtracts these from the seconds since 1980


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory(ArrayValue):
    """Where a moving scanner was, and when.

    Attributes
    ----------
    times : (n,) float
        Seconds, ascending.
    places : (n, 3) float
        In the file's unit, world coordinates.
    name : str
        The file's name.
    warnings : tuple of str
        What was left out.
    """

    times: FloatArray
    places: FloatArray
    name: str = "trajectory"
    warnings: tuple[str, ...] = ()

    def at(self, times: FloatArray) -> FloatArray:
        """Return the places (n, 3) at times (n,) on its clock, interpolated in straight lines."""
        return np.stack([np.interp(times, self.times, axis) for axis in self.places.T], axis=-1)

    def covers(self, times: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Tell which times (n,) lie within its span, and which of these in gaps of more than a second."""
        inside = (times >= self.times[0]) & (times <= self.times[-1])
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        is_gap = np.diff(self.times) > LONGEST_GAP_S
        return inside, inside & is_gap[after - 1] & (times != self.times[after])


def read_trajectory(path: str | os.PathLike[str]) -> Trajectory:
    """Return the trajectory of a file; only times and positions count.

    Text may name its columns, in any order, in a first line: GeoSLAM, Emesent and CSIRO (`%time x y z ...`,
    as raycloudtools writes it), NavVis (`#nsecs, x, y, z, ori_w, ...`), RTAB-Map (`#timestamp x y z qx qy qz
    qw id`), or CSV. Without names, 8 or 9 numbers a line are TUM's, and 12 or 16 a matrix (KITTI), whose
    times stand in `times.txt` beside the file.

    Raises InputError: none of these, poses without times, fewer than two times.
    """
    file = check_file(Path(path))
    with guard_reading(file, "a trajectory"):
        times, places = _rows(file)
        known = np.isfinite(times) & np.isfinite(places).all(axis=1)
        sentences = _counted(int((~known).sum()), len(times), "are not finite and were left out")
        times, places = times[known], places[known]
        if (np.diff(times) < 0).any():
            sentences.append(f"{file.name}: its times are not in order and were sorted")
        order = np.argsort(times, kind="stable")
        times, places = times[order], places[order]
        is_new = np.diff(times, prepend=-np.inf) > 0
        if not is_new.all():
            apart = float(np.linalg.norm(np.diff(places, axis=0), axis=1)[~is_new[1:]].max())
            text = f"repeat a time and were left out, up to {apart:.3g} (in the file's unit) from the first"
            sentences += _counted(int((~is_new).sum()), len(times), text)
        if is_new.sum() < 2:
            why = f"holds {int(is_new.sum())} poses with times; two are needed"
            raise InputError("; ".join([why, *sentences]))
        return Trajectory(times[is_new], places[is_new], file.name, tuple(sentences))


def _counted(n: int, n_all: int, what: str) -> list[str]:
    return [f"{n} of {n_all} poses of the trajectory {what}"] if n else []


def _rows(file: Path) -> tuple[FloatArray, FloatArray]:
    """Times (n,) and places (n, 3) of a file, as it has them."""
    refused: InputError | None = None
    try:
        table = read_point_table(file)
        if table.times is not None:
            return table.times, table.points
    except InputError as error:  # as whole seconds in a first column without a name, which count
        refused = error
    try:
        lines = (line.split("#", 1)[0].replace(",", " ").split() for line in read_text(file).splitlines())
        rows = [[float(word) for word in words] for words in lines if words]
    except (InputError, ValueError) as error:
        if refused is not None:
            raise InputError(f"is no trajectory: {refused}; {_FORMS}") from refused
        words = [line.replace(",", " ").split() for line in read_text(file).splitlines()[:2]]
        if time_column(words[0]) is not None and len(words) > 1:
            raise InputError(
                f"its times, as in the line {' '.join(words[1])[:60]!r}, are no numbers; write seconds"
            ) from error
        raise InputError(f"names no column of times, and {error}; {_FORMS}") from error
    lengths = {len(row) for row in rows}
    if lengths in ({8}, {9}):
        numbers = np.array(rows)
        return in_seconds(numbers[:, 0]), numbers[:, 1:4]
    if lengths in ({12}, {16}):
        return _times_beside(file, len(rows)), np.array(rows)[:, [3, 7, 11]]
    why = "holds no times of its poses" if refused is None else f"is no trajectory: {refused}"
    raise InputError(f"{why}; {_FORMS}")


def _times_beside(file: Path, n_poses: int) -> FloatArray:
    """Times (n,) of the poses of a KITTI file."""
    beside = file.with_name("times.txt")
    if not beside.exists():
        raise InputError("its poses have no times: put them into times.txt beside it, one a line, seconds")
    times = np.array(read_text(beside).split(), dtype=np.float64)
    if len(times) != n_poses:
        raise InputError(f"{len(times)} times in {beside.name} for {n_poses} poses")
    return times


def clock_offset(times: FloatArray, track: Trajectory) -> tuple[float, str]:
    """Return what is added to times (n,) of points to be on the clock of a trajectory, and a sentence for it.

    Points and trajectory may count GPS seconds since 1980, since 1980 less 1e9 (adjusted standard time of
    LAS), or of the week. An offset counts if it is the only one of these with which the spans overlap.

    Raises InputError: none, or several.
    """
    first, last = float(np.nanmin(times)), float(np.nanmax(times))
    start, end = float(track.times[0]), float(track.times[-1])
    names = {0.0: ""}
    for sign, whose in ((1.0, "points"), (-1.0, "trajectory")):
        names[sign * _ADJUSTED_S] = f"the {whose} count adjusted standard GPS time (less 1e9)"
        short, long = (last, start) if sign > 0 else (end, first)
        if short < _WEEK_S < long:
            for base, how in ((0.0, "GPS seconds"), (_ADJUSTED_S, "adjusted standard GPS time")):
                week = np.floor((long + base) / _WEEK_S) * _WEEK_S - base
                names[sign * float(week)] = f"the {whose} count seconds of the GPS week, the other has {how}"
    fit = [offset for offset in names if first + offset <= end and last + offset >= start]
    if 0.0 in fit:
        return 0.0, ""
    if len(fit) != 1:
        for unit, per_second in (("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)):
            if first <= end / per_second and last >= start / per_second:
                raise InputError(
                    f"the times of {track.name}, {start:.3f} to {end:.3f}, fit those of the points, "
                    f"{first:.3f} to {last:.3f} s, as {unit}: divide them by {per_second:.0f}"
                )
        raise InputError(
            f"points were measured from {first:.3f} to {last:.3f} s, and {track.name} is from {start:.3f} to "
            f"{end:.3f} s: these do not overlap, whether GPS seconds, adjusted or of the week; give the "
            "trajectory of these points, on their clock"
        )
    return fit[0], f"{names[fit[0]]}: {fit[0]:+.0f} s was added to the times of the points"
