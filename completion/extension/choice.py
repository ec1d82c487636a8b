# SPDX-License-Identifier: MIT
"""Choice: which surfaces are numbered and continued; the others stay as they were measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.extension.patch import Patch
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

KINDS = ("walls", "floors", "ceilings", "pipes", "planes", "cylinders")
"""What may be chosen: roles of planes that enclose the room, cylinders seen from outside, shapes."""

_LEVEL, _UPRIGHT = float(np.cos(np.radians(10.0))), float(np.sin(np.radians(10.0)))


@dataclass(frozen=True, slots=True)
class Choice:
    """Which surfaces are numbered and continued.

    Attributes
    ----------
    only : tuple of str
        Kinds, of `KINDS`; all, when empty.
    min_area_m2 : float
        Surfaces of which less was measured are left out, square metres.
    n_left_out : int
        How many were.
    """

    only: tuple[str, ...] = ()
    min_area_m2: float = 0.0
    n_left_out: int = 0


def role_of(normal: FloatArray, *, encloses: bool) -> str:
    """Return "wall", "floor", "ceiling" or "surface": what a plane is to the room.

    By its normal (3,), which points inwards, z up, and by whether it encloses the room.
    """
    if not encloses:
        return "surface"
    if abs(normal[2]) >= _LEVEL:
        return "floor" if normal[2] > 0 else "ceiling"
    return "wall" if abs(normal[2]) <= _UPRIGHT else "surface"


def is_chosen(surface: Surface, only: Sequence[str], *, encloses: bool, up: FloatArray) -> bool:
    """Tell whether a surface is of one of some kinds; of none, where all are wanted.

    `up` (3,) is the direction that is up in its frame.
    """
    if not only:
        return True
    if isinstance(surface, Plane):
        level = float(surface.normal_direction @ up)
        upright = np.array([np.sqrt(max(1 - level**2, 0.0)), 0.0, level])
        return "planes" in only or f"{role_of(upright, encloses=encloses)}s" in only
    if not isinstance(surface, Cylinder):
        return False
    return "cylinders" in only or ("pipes" in only and not surface.concave)


def numbered_anew(
    patches: Sequence[Patch | None], owners: Sequence[NDArray[np.int32]], keep: Callable[[Any], Any]
) -> tuple[list[Patch], tuple[NDArray[np.int32], ...]]:
    """Return the patches that there are, and the owners of pixels by their numbers.

    `owners`, (rows, columns) for each scan, number the surfaces from 1 with those that are None. What is said
    to hide a patch goes by the new numbers, too. `keep` puts what is made where arrays of its size are kept.
    """
    kept = np.array([patch is not None for patch in patches], dtype=np.bool_)
    if kept.all():
        return [patch for patch in patches if patch is not None], tuple(owners)
    numbers = np.append(0, np.where(kept, np.cumsum(kept), 0)).astype(np.int32)
    left = [
        keep(replace(patch, evidence=replace(patch.evidence, occluder=numbers[patch.evidence.occluder])))
        for patch in patches
        if patch is not None
    ]
    return left, tuple(keep(numbers[owner]) for owner in owners)
