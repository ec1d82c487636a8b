# SPDX-License-Identifier: MIT
"""View: a sensor at a pose, one station of a plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from nbv.scanning.sensor import Sensor
from scenes.pose import Pose


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class View:
    """One station.

    Parameters
    ----------
    world_from_sensor : Pose
        Where the sensor stands and looks (z forward, y down).
    sensor : Sensor
        What stands there.
    gain_m2 : float, optional
        Area that meets the requirement since this view and did not before, square metres.
    met_fraction : float, optional
        Share of the scene's area that meets the requirement after this view.
    predicted_gain_m2 : float, optional
        Where the scene is not known: weighted area of unknown faces and of badly seen surface that the view
        should settle by what the voxels say, square metres.
    """

    world_from_sensor: Pose
    sensor: Sensor
    gain_m2: float | None = None
    met_fraction: float | None = None
    predicted_gain_m2: float | None = None

    def __repr__(self) -> str:
        met = "" if self.met_fraction is None else f", met {self.met_fraction:.4f}"
        x, y, z = self.world_from_sensor.translation.tolist()
        return f"View({self.sensor.name} at {x:.3f}, {y:.3f}, {z:.3f}{met})"

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`."""
        entry = {
            "world_from_sensor": self.world_from_sensor.matrix.tolist(),
            "gain_m2": self.gain_m2,
            "met_fraction": self.met_fraction,
        }
        if self.predicted_gain_m2 is not None:
            entry["predicted_gain_m2"] = self.predicted_gain_m2
        return entry
