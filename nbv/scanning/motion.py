# SPDX-License-Identifier: MIT
"""Motion: the track of a sensor that moves while it scans, and what is wrong with the track that it reports.

Between its poses a track is straight, and turns evenly about one axis (Shoemake 1985, Animating rotation with
quaternion curves). Errors of position and angle are those of a filter that drifts and is pulled back: a
stationary process of Ornstein and Uhlenbeck, drawn at the track's own times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from scenes.checks import FloatArray, InputError, Value, frozen_copy
from scenes.io.poses.trajectory import read_timed_poses
from scenes.io.track import read_trajectory
from scenes.pose import Pose

_STILL_M = 1e-6  # a shorter step has no direction


@dataclass(frozen=True, slots=True, eq=False)
class Track(Value):
    """Where a sensor is, and how it is turned, at n times.

    Parameters
    ----------
    times : (n,) float
        Seconds, ascending.
    positions : (n, 3) float
        World, metres.
    rotations : (n, 3, 3) float
        World from sensor; its frame has z forward and y down.

    Raises
    ------
    InputError
        Fewer than two times, or times that do not ascend.
    """

    times: FloatArray
    positions: FloatArray
    rotations: FloatArray

    def __post_init__(self) -> None:
        for name in ("times", "positions", "rotations"):
            object.__setattr__(self, name, frozen_copy(getattr(self, name), np.float64))
        n = len(self.times)
        if n < 2 or self.positions.shape != (n, 3) or self.rotations.shape != (n, 3, 3):
            raise InputError(f"a track needs poses at two times or more, each with its own; got {n} times")
        if not (np.diff(self.times) > 0).all():
            at = int(np.argmin(np.diff(self.times))) + 1
            raise InputError(f"the times of a track must ascend; {self.times[at]:g} s follows a later time")

    @classmethod
    def of(cls, times: Sequence[float] | FloatArray, poses: Sequence[Pose]) -> Track:
        """Return the track of n poses `world_from_sensor` at times (n,), seconds."""
        return cls(
            np.asarray(times, np.float64),
            np.array([pose.translation for pose in poses]),
            np.array([pose.rotation for pose in poses]),
        )

    @classmethod
    def level(cls, times: FloatArray, positions: FloatArray) -> Track:
        """Return the track through positions (n, 3) at times (n,), upright and looking where it goes."""
        ahead = np.gradient(positions, times, axis=0)
        ahead[:, 2] = 0.0
        goes = np.linalg.norm(ahead, axis=1) > _STILL_M
        if not goes.any():
            ahead[:], goes[:] = (1.0, 0.0, 0.0), True
        last = np.maximum.accumulate(np.where(goes, np.arange(len(goes)), int(np.argmax(goes))))
        ahead = ahead[last] / np.linalg.norm(ahead[last], axis=1, keepdims=True)
        down = np.broadcast_to([0.0, 0.0, -1.0], ahead.shape)
        return cls(times, positions, np.stack([np.cross(down, ahead), down, ahead], axis=-1))

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return float(self.times[-1] - self.times[0])

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions (m, 3) and rotations (m, 3, 3) at times (m,); before and after it stands still."""
        clock = np.clip(times, self.times[0], self.times[-1])
        places = np.stack([np.interp(clock, self.times, axis) for axis in self.positions.T], axis=-1)
        return places, Slerp(self.times, Rotation.from_matrix(self.rotations))(clock).as_matrix()

    def denser(self, step_s: float) -> Track:
        """Return the same track with poses at most `step_s` apart, its own among them."""
        parts = np.maximum(np.ceil(np.diff(self.times) / step_s).astype(np.int64), 1)
        starts = [np.linspace(a, b, n, endpoint=False) for a, b, n in
                  zip(self.times[:-1], self.times[1:], parts, strict=True)]  # fmt: skip
        times = np.append(np.concatenate(starts), self.times[-1])
        return Track(times, *self.at(times))

    def poses(self) -> list[Pose]:
        """Return the poses at its times."""
        parts = zip(self.rotations, self.positions, strict=True)
        return [Pose.from_parts(rotation, place) for rotation, place in parts]


def read_track(path: Path) -> Track:
    """Return the track of a file: TUM lines with poses world from sensor, or any times and positions.

    Of the latter (`scenes.io.track.read_trajectory`) the sensor is level, and looks where it goes.

    Raises InputError: no such file, no times, fewer than two poses, times twice.
    """
    try:
        return Track.of(*read_timed_poses(path))
    except InputError:
        found = read_trajectory(path)  # knows TUM lines too, and says what is wrong
        return Track.level(found.times, found.places)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackErrors(Value):
    """What is wrong with the track that a moving sensor reports.

    Parameters
    ----------
    position_sd_m, angle_sd_deg : float
        Standard deviation of each coordinate, and of the turn about each axis.
    drift_s : float
        Time in which an error forgets itself: its correlation falls to 1 / e.
    clock_s : float
        By how much the scanner's clock is ahead of the track's.
    jitter_s : float
        Standard deviation of single times of the scanner.

    Raises
    ------
    InputError
        Negative deviations, or a time to forget that is not positive.
    """

    position_sd_m: float = 0.0
    angle_sd_deg: float = 0.0
    drift_s: float = 10.0
    clock_s: float = 0.0
    jitter_s: float = 0.0

    def __post_init__(self) -> None:
        if min(self.position_sd_m, self.angle_sd_deg, self.jitter_s) < 0 or not self.drift_s > 0:
            raise InputError("deviations of a track must not be negative, and drift_s must be positive")

    def reported(self, track: Track, rng: np.random.Generator) -> Track:
        """Return the track as it is reported; without errors as it is."""
        if not (self.position_sd_m or self.angle_sd_deg):
            return track
        fresh = rng.normal(size=(2, len(track.times), 3))
        kept = np.exp(-np.diff(track.times) / self.drift_s)
        drift = fresh.copy()
        for k, part in enumerate(kept, start=1):
            drift[:, k] = part * drift[:, k - 1] + np.sqrt(1 - part**2) * fresh[:, k]
        turned = Rotation.from_rotvec(np.radians(self.angle_sd_deg) * drift[1]).as_matrix()
        return Track(track.times, track.positions + self.position_sd_m * drift[0], track.rotations @ turned)
