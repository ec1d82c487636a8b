# SPDX-License-Identifier: MIT
"""Zones: the part of the world that is to be measured, and the parts where no scanner may stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scenes.checks import BoolArray, FloatArray, InputError, Value, frozen_copy


@dataclass(frozen=True, slots=True, eq=False)
class Box(Value):
    """A box along the world's axes.

    Parameters
    ----------
    low, high : (3,) float
        Its smallest and largest coordinates, metres.

    Raises
    ------
    InputError
        Coordinates that are not three finite numbers each, or do not rise.

    Examples
    --------
    >>> box = Box((0, 0, 0), (2, 1, 1))
    >>> box.holds(np.array([[1.0, 1.0, 0.5], [2.5, 0.5, 0.5]])).tolist()
    [True, False]
    >>> box.distance(np.array([[1.0, 1.0, 0.5], [5.0, 5.0, 1.0]])).tolist()
    [0.0, 5.0]
    """

    low: FloatArray
    high: FloatArray

    def __post_init__(self) -> None:
        low, high = (np.asarray(end, dtype=np.float64) for end in (self.low, self.high))
        if low.shape != (3,) or high.shape != (3,) or not np.isfinite([low, high]).all():
            raise InputError(f"a box needs X0,Y0,Z0,X1,Y1,Z1, six finite numbers, got {low}, {high}")
        if not (low < high).all():
            raise InputError(
                f"a box goes from its smallest to its largest coordinates, got {low.tolist()} to "
                f"{high.tolist()}; give X0,Y0,Z0,X1,Y1,Z1 with X0 < X1, Y0 < Y1, Z0 < Z1"
            )
        object.__setattr__(self, "low", frozen_copy(low))
        object.__setattr__(self, "high", frozen_copy(high))

    def holds(self, points: FloatArray) -> BoolArray:
        """Tell which points (n, 3) lie in the box, its faces included."""
        return np.asarray(((points >= self.low) & (points <= self.high)).all(axis=1))

    def distance(self, points: FloatArray, n_axes: int = 3) -> FloatArray:
        """Distance (n,) of points (n, 2 or 3) to the box along the first axes, 0 within it, metres."""
        low, high = self.low[:n_axes], self.high[:n_axes]
        off = np.maximum(np.maximum(low - points, points - high), 0.0)
        return np.asarray(np.linalg.norm(off, axis=1), dtype=np.float64)

    def to_json(self) -> list[list[float]]:
        """Return the smallest and the largest coordinates."""
        return [self.low.tolist(), self.high.tolist()]


@dataclass(frozen=True, slots=True, eq=False)
class Zones(Value):
    """Where to measure, and where not to stand.

    Parameters
    ----------
    region : Box, optional
        Surface outside is no concern; everywhere when not given.
    keep_out : sequence of Box
        No station lies in them, and no way leads through them.
    """

    region: Box | None = None
    keep_out: Sequence[Box] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "keep_out", tuple(self.keep_out))

    @property
    def is_everywhere(self) -> bool:
        """Whether all surface is to be measured and stations may be anywhere."""
        return self.region is None and not self.keep_out

    def of_interest(self, points: FloatArray, tolerance_m: float = 0.0) -> BoolArray:
        """Tell which points (n, 3) are to be measured: those in the region, or within `tolerance_m` of it."""
        if self.region is None:
            return np.ones(len(points), np.bool_)
        return np.asarray(self.region.distance(points) <= tolerance_m)

    def allow(self, positions: FloatArray) -> BoolArray:
        """Tell at which positions (n, 3) a scanner may stand."""
        allowed = np.ones(len(positions), np.bool_)
        for box in self.keep_out:
            allowed &= ~box.holds(positions)
        return allowed

    def to_json(self) -> dict[str, list[list[float]] | list[list[list[float]]] | None]:
        """Return the entries `region` and `keep_out` of `plan.json`."""
        region = None if self.region is None else self.region.to_json()
        return {"region": region, "keep_out": [box.to_json() for box in self.keep_out]}


EVERYWHERE = Zones()


def zones_from_json(region: Any, keep_out: Sequence[Any]) -> Zones:
    """Return the zones of the entries `region` and `keep_out` of a `plan.json`.

    Raises
    ------
    InputError
        Entries that are no boxes.
    """
    return Zones(None if region is None else Box(*region), tuple(Box(*corners) for corners in keep_out))
