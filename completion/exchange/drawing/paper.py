# SPDX-License-Identifier: MIT
"""Paper: a drawing to scale on a sheet of A4, and places for its text that nothing else has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely import affinity

from scenes.checks import FloatArray

_SCALES = (5, 10, 20, 25, 50, 100, 200, 250, 500, 1000, 2000, 2500, 5000)
_LONG_MM, _SHORT_MM = 297.0, 210.0
_MARGIN_MM, _BLOCK_MM, _AIR_MM = 10.0, 34.0, 10.0  # around; of the title block; between frame and drawing
_LETTER = 0.56  # mean width of a letter over its height
_PLACES = (0.5, 0.35, 0.65, 0.22, 0.78, 0.12, 0.88)  # along a dimension


@dataclass(frozen=True, slots=True, eq=False)
class Paper:
    """A sheet of A4 and where places of the world lie on it.

    Attributes
    ----------
    width_mm, height_mm : float
        Of the sheet.
    scale : int
        1 : scale.
    centre : (2,) float
        Place of the world in the middle of the frame, metres.
    """

    width_mm: float
    height_mm: float
    scale: int
    centre: FloatArray

    @classmethod
    def of(cls, places: FloatArray) -> Paper:
        """Return the sheet, lying or upright, on which places (n, 2) are largest, to a usual scale."""
        low, high = (places.min(axis=0), places.max(axis=0)) if len(places) else (np.zeros(2), np.ones(2))
        sheets = []
        for width, height in ((_LONG_MM, _SHORT_MM), (_SHORT_MM, _LONG_MM)):
            room = np.array([width, height - _BLOCK_MM]) - 2 * (_MARGIN_MM + _AIR_MM)
            least = float((1000 * (high - low) / room).max())
            scale = next((one for one in _SCALES if one >= least), int(np.ceil(least / 1000)) * 1000)
            sheets.append(cls(width, height, scale, (low + high) / 2))
        return min(sheets, key=lambda sheet: sheet.scale)

    @property
    def frame(self) -> tuple[float, float, float, float]:
        """Left, top, width and height of the frame around the drawing, millimetres."""
        wide = self.width_mm - 2 * _MARGIN_MM
        return _MARGIN_MM, _MARGIN_MM, wide, self.height_mm - 2 * _MARGIN_MM - _BLOCK_MM

    def place(self, points: FloatArray) -> FloatArray:
        """Millimetres (n, 2) from the sheet's upper left of places (n, 2 or 3) of the world."""
        left, top, wide, high = self.frame
        middle = np.array([left + wide / 2, top + high / 2])
        return np.asarray(middle + (points[:, :2] - self.centre) * np.array([1000.0, -1000.0]) / self.scale)


@dataclass(slots=True, eq=False)
class Lettering:
    """Text along lines, where no other text is."""

    taken: list[shapely.Geometry] = field(default_factory=list)

    def along(self, ends: FloatArray, text: str, size_mm: float) -> tuple[FloatArray, float] | None:
        """Return the middle of a text's foot on the line between two ends (2, 2), and its turn in degrees.

        All in millimetres of paper, y down. It reads from below or from the right. None where all is taken.
        """
        direction = ends[1] - ends[0]
        turn = float(np.degrees(np.arctan2(direction[1], direction[0])))
        turn = turn - 180 if turn > 89.9 else turn + 180 if turn <= -90.1 else turn
        wide = _LETTER * size_mm * len(text)
        for share in _PLACES:
            middle = ends[0] + share * direction
            box = affinity.rotate(
                shapely.box(-wide / 2, -1.5 * size_mm, wide / 2, 0.2 * size_mm), turn, origin=(0, 0)
            )
            box = affinity.translate(box, *middle)
            if not any(box.intersects(other) for other in self.taken):
                self.taken.append(box)
                return middle, turn
        return None

    def keep(self, ends: Sequence[FloatArray]) -> None:
        """Keep text off the lines between ends (2, 2)."""
        self.taken += [shapely.LineString(one).buffer(0.3) for one in ends]
