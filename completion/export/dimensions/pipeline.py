# SPDX-License-Identifier: MIT
"""Dimensions on one page: from a building to a sheet of numbers that people order by."""

from __future__ import annotations

import csv
import io
from collections import Counter
from dataclasses import dataclass

import numpy as np

from completion.export.building.parts import BuildingParts
from completion.export.dimensions.cylinders import cylinder_sizes
from completion.export.dimensions.dimension import TOLERANCE_M, UNKNOWN, Advice, Dimension, advice
from completion.export.dimensions.rooms import opening_sizes, room_heights, room_sizes, thicknesses, widths_of

COLUMNS = ("dimension", "kind", "value_m", "low_m", "high_m", "measured_share", "advice", "unit")


@dataclass(frozen=True, slots=True, eq=False)
class DecisionSheet:
    """Dimensions with advice.

    Attributes
    ----------
    dimensions : tuple of Dimension
        By kind, the greatest first.
    tolerance_m : float
        Half an interval up to which they are relied on, metres.
    """

    dimensions: tuple[Dimension, ...]
    tolerance_m: float

    @property
    def advice(self) -> tuple[Advice, ...]:
        """What is said of each."""
        return tuple(advice(one, self.tolerance_m) for one in self.dimensions)

    @property
    def told_doubt(self) -> str:
        """What is said where intervals are not known, as of a mesh; nothing else."""
        return "" if all(np.isfinite(one.half) for one in self.dimensions) else UNKNOWN

    def counts(self) -> dict[str, int]:
        """How many of them there are of each word."""
        said = Counter(self.advice)
        return {word: said[word] for word in ("rely", "check", "do not build")}

    def to_csv(self) -> str:
        """What `decisions.csv` holds: lengths in metres, areas in m2, volumes in m3, as `unit` says.

        An interval that is not known ends at inf.
        """
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(COLUMNS)
        for one, word in zip(self.dimensions, self.advice, strict=True):
            numbers = [f"{number:.4f}" for number in (one.value, one.low, one.high)]
            rows.writerow([one.name, one.kind, *numbers, f"{one.measured_share:.2f}", word, one.unit])
        return text.getvalue()


def decision_sheet(building: BuildingParts, tolerance_m: float = TOLERANCE_M) -> DecisionSheet:
    """Return what people order by, each with the interval in which it lies and a word on relying on it.

    Parameters
    ----------
    building : BuildingParts
        What was completed.
    tolerance_m : float
        Half an interval up to which a dimension may be relied on, metres.
    """
    model = building.model

    # 1. Rooms: widths between walls, heights between floors and ceilings; areas and volumes of closed ones.
    heights = [one for storey in building.storeys for one in room_heights(storey, model.errors)]
    rooms = (*widths_of(building), *heights, *room_sizes(building))

    # 2. Walls and slabs that were seen from both sides.
    bodies = thicknesses(building)

    # 3. Openings in walls.
    openings = opening_sizes(building)

    # 4. Columns and pipes.
    cylinders = cylinder_sizes(building)
    return DecisionSheet((*rooms, *bodies, *openings, *cylinders), tolerance_m)
