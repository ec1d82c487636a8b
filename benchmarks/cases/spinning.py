# SPDX-License-Identifier: MIT
"""A spinning lidar that is carried along a path: each firing from the place where it then is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scenes.checks import FloatArray

_BLOCK = 20_000  # firings that are cast at a time

Cast = Callable[[FloatArray, FloatArray], FloatArray]
"""Ranges (n,) of rays from origins (n, 3) along unit directions (n, 3), metres; inf for no hit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpinningLidar:
    """Beams one above the other that turn about the vertical."""

    beams_deg: tuple[float, ...] = tuple(float(angle) for angle in range(-15, 16, 2))
    turns_hz: float = 10.0
    n_firings: int = 1800  # in a turn
    sigma_m: float = 0.02
    max_range_m: float = 100.0


class TimedPoints(NamedTuple):
    """Points (n, 3) with times (n,), seconds, and the place (n, 3) that each was measured from, metres."""

    times: FloatArray
    points: FloatArray
    origins: FloatArray


def carry(
    lidar: SpinningLidar, cast: Cast, path: FloatArray, *, speed_m_s: float, seconds: float,
    rng: np.random.Generator,
) -> TimedPoints:  # fmt: skip
    """Return what a lidar measures that is carried level along a path (n, 3), metres, at a steady speed."""
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    up = np.radians(lidar.beams_deg)
    clock = np.arange(int(seconds * lidar.turns_hz * lidar.n_firings)) / (lidar.turns_hz * lidar.n_firings)
    parts = []
    for times in np.array_split(clock, max(len(clock) // _BLOCK, 1)):
        places = np.stack([np.interp(times * speed_m_s, length, axis) for axis in path.T], axis=-1)
        around = (2 * np.pi * lidar.turns_hz * times)[:, None]
        level = [np.cos(up) * np.cos(around), np.cos(up) * np.sin(around)]
        rays = np.stack([*level, np.broadcast_to(np.sin(up), level[0].shape)], axis=-1).reshape(-1, 3)
        origins, when = np.repeat(places, len(up), axis=0), np.repeat(times, len(up))
        ranges = cast(origins, rays)
        seen = ranges < lidar.max_range_m
        measured = ranges[seen] + lidar.sigma_m * rng.normal(size=int(seen.sum()))
        parts.append((when[seen], origins[seen] + measured[:, None] * rays[seen], origins[seen]))
    times, points, origins = (np.concatenate(part) for part in zip(*parts, strict=True))
    return TimedPoints(times, points, origins)
