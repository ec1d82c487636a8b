# SPDX-License-Identifier: MIT
"""A hole of a part, and what ends it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from scenes.card import shown
from scenes.checks import Value

OPEN, FLOOR, CONE = "open", "floor", "cone"


@shown
class HoleEnd(NamedTuple):
    """What ends a hole: nothing behind it, a floor, or a cone; and the place of that face, -1 for none.

    Where it is open, that is the plane in which it opens, or the cone by which it widens.
    """

    kind: str
    place: int


@dataclass(frozen=True, slots=True, eq=False)
class Hole(Value):
    """A hole: the place of its wall, and its ends, the lower first along its axis."""

    place: int
    ends: tuple[HoleEnd, HoleEnd]

    @property
    def note(self) -> str:
        """Whether it goes through."""
        kinds = sorted(end.kind for end in self.ends)
        if kinds == [OPEN, OPEN]:
            return "through" if all(end.place >= 0 for end in self.ends) else ""
        return "blind" if OPEN in kinds else ""
