# SPDX-License-Identifier: MIT
"""Room plans: the rooms of the layout in the plan, in coordinates of drawings, z up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from completion.extension.patch import Patch
from completion.room.roles import Room
from scenes.checks import FloatArray, Value
from scenes.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class RoomPlan(Value):
    """A room in the plan, as the layout has it.

    Attributes
    ----------
    outline : shapely polygon
        x and y, metres.
    floor_m : float
        Height of the floor of its storey.
    enclosed : float
        Share of its outline at which a wall stands.
    lines : (l, 3) float
        Lines of walls in the plan, a x + b y = c, unit (a, b).
    walls : (l,) int64
        Of which surface each is, from 1; 0 of none.
    """

    outline: Any
    floor_m: float
    enclosed: float
    lines: FloatArray
    walls: NDArray[np.int64]


def room_plans(room: Room, patches: Sequence[Patch], world: Pose) -> tuple[RoomPlan, ...]:
    """Return the rooms in the plan, `world` from the working frame to that of drawings, z up."""
    numbers = {patch.limits.index: number for number, patch in enumerate(patches, start=1)}
    plans = []
    for layout in room.layouts:
        turn = world.rotate(layout.axes)[:, :2]  # of unit vectors of the plan
        shift = world.apply(layout.floor_m * room.up if np.isfinite(layout.floor_m) else np.zeros(3))
        lines = np.column_stack([layout.lines[:, :2] @ turn, layout.lines[:, 2]])
        lines[:, 2] += lines[:, :2] @ shift[:2]
        walls = np.array([numbers.get(number, 0) for number in layout.walls.tolist()], dtype=np.int64)
        for area, enclosed in layout.outlines():
            outline = shapely.transform(area, lambda xy, turn=turn, shift=shift: xy @ turn + shift[:2])
            plans.append(RoomPlan(outline, float(shift[2]), enclosed, lines, walls))
    return tuple(plans)
