# SPDX-License-Identifier: MIT
"""Moving scans: points of a sensor that is carried or driven, each beam from where it then was.

A turning scanner fires a column at a time, from the pose of that moment; cameras and line profilers take one
image at a time. The sensor really moves along its track, and says where it was by the track that it reports,
with errors of position, angle and clock (`nbv.scanning.motion`): points lie where that track puts them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from nbv.scanning.beam import Returns
from nbv.scanning.effects import Effects
from nbv.scanning.motion import Track, TrackErrors
from nbv.scanning.scanner import scan_world, with_returns
from nbv.scanning.sensor import Sensor, SphericalSensor, chosen_effects
from nbv.scanning.world import ColumnPoses, World
from scenes.checks import FloatArray, InputError, Value
from scenes.io.formats.returns import cloud_of
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.scan.timed_points import TimedPoints
from scenes.world.scene import Scene

EXACT = TrackErrors()
"""A track that is reported as it is."""
_MOST_POSES = 1_000_000  # of a track that is reported
_STEP_S = 0.1  # between the poses of tracks that are reported, at most


@dataclass(frozen=True, slots=True, eq=False)
class MovingScan(Value):
    """A scan along a track: what it scans with, its true and its reported track, and how often it turns.

    `rate_hz` are turns, or images, a second.
    """

    sensor: Sensor
    effects: Effects
    track: Track
    reported: Track
    rate_hz: float
    errors: TrackErrors = EXACT

    @property
    def n_turns(self) -> int:
        """How many whole turns or images there are."""
        return max(int(self.track.seconds * self.rate_hz + 1e-9), 1)


def moving_scan(
    sensor: Sensor,
    track: Track,
    *,
    rate_hz: float | None = None,
    noise: str = "none",
    returns: Returns | None = None,
    errors: TrackErrors = EXACT,
    rng: np.random.Generator | int | None = None,
) -> MovingScan:
    """Prepare a scan along a track.

    Parameters
    ----------
    sensor : Sensor
        Turning ones fire column by column, others take images.
    track : Track
        Where the sensor really is.
    rate_hz : float, optional
        Turns or images a second; by the sensor's points a second when not given.
    noise, returns : str
        As for `nbv.scan_scene`.
    errors : TrackErrors
        What is wrong with the track that is reported.
    rng : Generator, int or None
        Draws the errors of the track.

    Raises
    ------
    InputError
        A rate that is not positive or not known, a track of more than a million poses, unknown noise.
    """
    rate = rate_hz or (None if sensor.scan_time_s is None else 1 / sensor.scan_time_s)
    if rate is None or not rate > 0:
        raise InputError(
            f"how often {sensor.name} turns is not known: its profile has no points_per_s; give --rate"
        )
    step_s = min(_STEP_S, 1 / rate)
    if track.seconds / step_s > _MOST_POSES:
        raise InputError(
            f"the track lasts {track.seconds:.3g} s; at {rate:g} turns a second that is more than "
            f"{_MOST_POSES:,} poses: are its times in seconds? Else give a part of it, or a lower rate"
        )
    effects = with_returns(chosen_effects(sensor, noise), returns)
    track = track.denser(step_s)
    reported = errors.reported(track, np.random.default_rng(rng))
    return MovingScan(sensor, effects, track, reported=reported, rate_hz=rate, errors=errors)


def scan_turn(
    scene: Scene,
    scan: MovingScan,
    number: int,
    *,
    caster: RayCaster | None = None,
    rng: np.random.Generator | int | None = None,
    n_threads: int | None = None,
) -> TimedPoints:
    """Return the points of one turn (from 0) of a scan along a track."""
    rng = np.random.default_rng(rng)
    columns, turns = scan.sensor.projection.shape[1], isinstance(scan.sensor, SphericalSensor)
    start = scan.track.times[0] + number / scan.rate_hz
    fired = start + (np.arange(columns) / (columns * scan.rate_hz) if turns else np.zeros(columns))
    positions, rotations = scan.track.at(fired)
    middle = Pose.from_parts(rotations[columns // 2], positions[columns // 2])
    motion = ColumnPoses(positions, rotations) if turns else None
    caster = caster or scene.ray_caster(n_threads)
    world = World(scene, caster, middle, scan.sensor.partner, n_threads=n_threads, motion=motion)
    image = scan_world(world, scan.sensor, scan.effects, rng=rng.spawn(1)[0])
    clock = fired + scan.errors.clock_s
    if scan.errors.jitter_s:
        clock = clock + scan.errors.jitter_s * rng.normal(size=columns)
    return _timed(image, clock, scan.reported)


def scan_along(
    scene: Scene,
    scan: MovingScan,
    *,
    rng: np.random.Generator | int | None = None,
    n_threads: int | None = None,
) -> Iterator[TimedPoints]:
    """Yield the points of one turn after the other; each turn draws from a stream of its own."""
    caster = scene.ray_caster(n_threads)
    streams = np.random.default_rng(rng)
    for number in range(scan.n_turns):
        yield scan_turn(scene, scan, number, caster=caster, rng=streams.spawn(1)[0], n_threads=n_threads)


def _timed(image: RangeImage, clock: FloatArray, reported: Track) -> TimedPoints:
    """The points of an image whose columns were measured at the times `clock` (columns,)."""
    if not image.valid.any():
        return TimedPoints(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)))
    cloud = cloud_of(replace(image, world_from_sensor=Pose.identity()), all_returns=True)
    order = np.lexsort((cloud.row, cloud.column))  # stable: returns of a beam stay in their order
    row, column = cloud.row[order], cloud.column[order]
    places, turned = reported.at(clock)
    return TimedPoints(
        points=places[column] + np.einsum("nij,nj->ni", turned[column], cloud.points[order]),
        times=clock[column],
        origins=places[column],
        intensity=None if cloud.intensity is None else cloud.intensity[order],
        surface=None if image.truth is None else image.truth.surface[row, column],
        number=None if cloud.number is None else cloud.number[order],
        count=None if cloud.count is None else cloud.count[order],
    )
