# SPDX-License-Identifier: MIT
"""Thing records: what things.json holds of each thing, and what bounds one: support and walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from completion.backs import separation_limits as limits
from completion.backs.thing import Thing
from completion.extension.patch import Patch
from completion.room.roles import Room
from scenes.checks import ArrayValue, FloatArray, Value
from scenes.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class WallBehind(ArrayValue):
    """A wall before which a thing stands.

    Attributes
    ----------
    surface : int
        Its number, from 0.
    normal : (3,) float
        Unit normal into the room, world coordinates.
    offset_m : float
        normal . x of its points, metres.
    sd_m : float
        Standard deviation of its place behind the thing, metres.
    gap_m : float
        From the box of the thing to the wall, metres; negative where the box goes past it.
    """

    surface: int
    normal: FloatArray
    offset_m: float
    sd_m: float
    gap_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings(Value):
    """What bounds a thing: height and deviation of its support along up, metres; walls, nearest first."""

    support_m: float | None
    support_sd_m: float | None
    walls: tuple[WallBehind, ...]


def surroundings(
    thing: Thing, patches: Sequence[Patch], room: Room, world_from_reference: Pose
) -> Surroundings:
    """Return what bounds a thing: the surface below it, and the walls within `limits.BEHIND_M` beside it.

    Parameters
    ----------
    thing : Thing
        From `find_things`, world coordinates.
    patches : sequence of Patch
        The completed surfaces, working frame.
    room : Room
        The room, working frame.
    world_from_reference : Pose
        From the working frame to the world.
    """
    corners = np.array(list(product(*zip(thing.box.low, thing.box.high, strict=True)))) @ thing.box.axes
    here = world_from_reference.inverse().apply(corners)
    middle = here.mean(axis=0)
    number = {patch.limits.index: k for k, patch in enumerate(patches) if patch.limits.index >= 0}
    walls = []
    for wall in room.walls:
        away = wall.plane.distance(here)
        along = float(wall.places(middle[None])[0, 0])
        if wall.number not in number or not wall.low[0] < along < wall.high[0]:
            continue
        if away.max() > 0 and away.min() < limits.BEHIND_M:
            foot = middle - wall.plane.distance(middle[None])[0] * wall.plane.normal_direction
            normal = world_from_reference.rotate(wall.plane.normal_direction[None])[0]
            walls.append(
                WallBehind(
                    surface=number[wall.number],
                    normal=normal,
                    offset_m=float(normal @ world_from_reference.apply(foot[None])[0]),
                    sd_m=_deviation(patches[number[wall.number]], foot),
                    gap_m=float(away.min()),
                )
            )
    walls.sort(key=lambda one: (one.gap_m, one.surface))
    below = None if thing.stands_on is None else _deviation(patches[thing.stands_on], middle)
    return Surroundings(thing.support_m, below, tuple(walls))


def thing_record(thing: Thing, around: Surroundings) -> dict[str, Any]:
    """Return what things.json holds of a thing as it was seen; things, surfaces, scans are numbered from 1.

    Lengths are in metres, world coordinates. `behind` is the nearest wall, null where there is none.
    """
    return {
        "thing": thing.index + 1,
        "stands_on": _from_one(thing.stands_on),
        "stands_on_thing": _from_one(thing.stands_on_thing),
        "support_m": thing.support_m,
        "behind": around.walls[0].surface + 1 if around.walls else None,
        "leans_at": [number + 1 for number in thing.leans_at],
        "touches": [other + 1 for other in thing.touches],
        "occluded_by": [other + 1 for other in thing.occluded_by],
        "hides": [other + 1 for other in thing.hides],
        "cut": [{"scan": cut.scan + 1, "border": cut.border, "occluder": cut.occluder} for cut in thing.cuts],
        "box": {name: getattr(thing.box, name).tolist() for name in ("axes", "low", "high")},
        "surfaces": [number + 1 for number in thing.surfaces],
        "measured_m2": thing.measured_m2,
    }


def _from_one(number: int | None) -> int | None:
    return None if number is None else number + 1


def _deviation(patch: Patch, place: FloatArray) -> float:
    """Standard deviation of a surface at a place (3,), metres."""
    return float(patch.stated.standard_deviation(place[None])[0])
