# SPDX-License-Identifier: MIT
"""Upright scans: scans without a model, turned into a world whose z is up, and how that was found.

Planners, rooms and voxels reckon with z up. Which way is up in the world of scans' poses is said by a person
or estimated (`find_up`), as for `complete`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from completion.room.pipeline import estimate_up
from nbv.online.limits import MOST_SCAN_PIXELS
from scenes.inclination import Up
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage

_TURNED = "coordinates here, also of --region, --keep-out and --candidates, are turned so that z is up: "


def find_up_of(scans: Sequence[RangeImage], n_threads: int | None = None) -> Up:
    """Estimate which way is up in the world of scans, by few of their pixels: as many tell the same."""
    return estimate_up([scan.thin(MOST_SCAN_PIXELS) for scan in scans], n_threads=n_threads)


@dataclass(frozen=True, slots=True, eq=False)
class UprightScans:
    """Scans in a world whose z is up.

    Attributes
    ----------
    scans : tuple of RangeImage
        The scans in that world.
    up : Up
        Which way is up in the world of the scans' own poses.
    """

    scans: tuple[RangeImage, ...]
    up: Up

    @classmethod
    def of(
        cls, scans: Sequence[RangeImage], said: Up | None = None, *, n_threads: int | None = None
    ) -> UprightScans:
        """Turn scans by what a person `said` is up, or by what they show themselves."""
        up = said or find_up_of(scans, n_threads)
        turn = up.drawing_from_world
        return cls(tuple(scans) if up.is_z else tuple(scan.transform(turn) for scan in scans), up)

    @property
    def world_from_scans(self) -> Pose:
        """The turn from the world of the scans' own poses."""
        return self.up.drawing_from_world

    def doubts(self, file: str) -> tuple[str, ...]:
        """Return what to tell of up; `file` holds the turn as `world_from_scans`."""
        stay = "coordinates stay as they are"
        told = self.up.describe(stay if self.up.is_z else f"{_TURNED}world_from_scans in {file}")
        return (told,) if told else ()

    def to_json(self) -> dict[str, Any]:
        """Return the entries of `plan.json` and `coverage.json`."""
        return {**self.up.to_json(), "world_from_scans": self.world_from_scans.matrix.tolist()}
