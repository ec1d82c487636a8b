# SPDX-License-Identifier: MIT
"""Plan files: stations as CSV for people who set up a scanner, and as a TUM trajectory for programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nbv.run.csv_table import csv_text
from nbv.scanning.view import View
from scenes.io.trajectory import write_timed_poses
from scenes.pose import Pose
from scenes.run.atomic import write_text

CSV_NAME, TRAJECTORY_NAME = "plan.csv", "trajectory.txt"
_STEEP = 1e-6  # length of a level part below which a direction has no heading
COLUMNS = (
    "number", "x_m", "y_m", "z_m", "heading_deg", "pitch_deg", "roll_deg", "visit", "gain_m2", "met_fraction",
    "predicted_gain_m2",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Aim:
    """How a sensor is turned, degrees.

    Attributes
    ----------
    heading_deg : float
        Of the direction of view on the map, clockwise from the world's +y axis (north), 0 to 360.
    pitch_deg : float
        Of the direction of view above the level, -90 to 90.
    roll_deg : float
        Of the image about the direction of view, clockwise as the sensor sees it; 0 when it stands upright.
    """

    heading_deg: float
    pitch_deg: float
    roll_deg: float


def aim_of(pose: Pose) -> Aim:
    """Return how the sensor of a pose is turned.

    Where it looks straight up or down, the heading is that of the image's upper edge, or lower edge, and the
    roll 0.

    Examples
    --------
    >>> aim_of(Pose.looking_at((0, 0, 1), (5, 0, 1)))
    Aim(heading_deg=90.0, pitch_deg=0.0, roll_deg=0.0)
    """
    right, down, forward = pose.rotation.T
    pitch = float(np.degrees(np.arcsin(np.clip(forward[2], -1, 1))))
    if np.hypot(forward[0], forward[1]) < _STEEP:
        edge = np.sign(forward[2]) * down
        return Aim(_heading(edge), pitch, 0.0)
    level = np.cross(forward, [0.0, 0, 1])
    level /= np.linalg.norm(level)
    roll = float(np.degrees(np.arctan2(right @ np.cross(forward, level), right @ level)))
    return Aim(_heading(forward), pitch, roll + 0.0)


def _heading(direction: Any) -> float:
    return float(np.degrees(np.arctan2(direction[0], direction[1])) % 360.0)


def write_plan_files(
    views: Sequence[View], order: Sequence[int] | None, csv_file: Path, trajectory_file: Path
) -> None:
    """Write stations as CSV, and their poses as a TUM trajectory whose time stamps are their numbers.

    `order` tells from 0 in which to visit them, where that is known.
    """
    write_text(csv_file, stations_csv(views, order))
    poses = [view.world_from_sensor for view in views]
    write_timed_poses(trajectory_file, np.arange(1.0, len(poses) + 1), poses)


def stations_csv(views: Sequence[View], order: Sequence[int] | None = None) -> str:
    """Return a line for each station, numbered from 1.

    `order` tells from 0 in which to visit them; `visit` is a station's place in it, from 1, and empty
    without.
    """
    place = {} if order is None else {station: k for k, station in enumerate(order, start=1)}
    rows: list[list[object]] = []
    for number, view in enumerate(views, start=1):
        pose, aim = view.world_from_sensor, aim_of(view.world_from_sensor)
        where = [f"{value:.4f}" for value in pose.translation]
        turned = [f"{value + 0.0:.4f}" for value in (aim.heading_deg, aim.pitch_deg, aim.roll_deg)]
        gains = (view.gain_m2, view.met_fraction, view.predicted_gain_m2)
        rows.append([number, *where, *turned, place.get(number - 1, ""), *gains])
    return csv_text(COLUMNS, rows)
