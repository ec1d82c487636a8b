# SPDX-License-Identifier: MIT
"""Upright scans: scans without a model, turned into a world whose z is up, and how that was found.

Planners, rooms and voxels reckon with z up. Which way is up in the world of scans' poses is said by a person
or estimated by their completion (`find_up`), as for `complete`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from completion.result.completion import Completion
from nbv.coverage.surface_classes import KnownSurfaces
from scenes.inclination import Up
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage

_TURNED = "coordinates here, also of --region, --keep-out and --candidates, are turned so that z is up: "


@dataclass(frozen=True, slots=True, eq=False)
class UprightScans:
    """Scans and their completion in a world whose z is up.

    Attributes
    ----------
    scans : tuple of RangeImage
        The scans in that world.
    completed : KnownSurfaces
        Their completion in the same world.
    up : Up
        Which way is up in the world of the scans' own poses.
    """

    scans: tuple[RangeImage, ...]
    completed: KnownSurfaces
    up: Up

    @classmethod
    def of(cls, scans: Sequence[RangeImage], completed: KnownSurfaces) -> UprightScans:
        """Turn scans and their completion, which says what is up and has no edits."""
        up, turn = completed.completion.up, completed.completion.up.drawing_from_world
        if up.is_z:
            return cls(tuple(scans), completed, up)
        turned = replace(completed, completion=_turned(completed.completion, turn))
        return cls(tuple(scan.transform(turn) for scan in scans), turned, up)

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


def _turned(completion: Completion, turn: Pose) -> Completion:
    """The same completion in the turned world, in which z is up."""
    up = replace(completion.up, direction=np.array([0.0, 0.0, 1.0]))
    return replace(
        completion,
        completed=replace(completion.completed, up=up),
        world_from_reference=turn @ completion.world_from_reference,
    )
