# SPDX-License-Identifier: MIT
"""A dimension of a part: its value, the interval in which it lies, what it is of and what it follows from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from completion.relations.equations import Placement
from scenes.checks import FloatArray

LEVEL = 0.95
"""Probability with which a dimension lies in its interval."""
NORMAL_95 = 1.959963984540054
"""Half that interval in standard deviations."""

Kind = Literal[
    "overall size", "hole diameter", "outer diameter", "sphere diameter", "radius", "fillet radius",
    "ring diameter", "tube radius", "cone angle", "hole depth", "thickness", "length", "slot width", "step",
    "distance", "axis distance", "axis to plane", "angle", "pitch circle diameter", "start angle", "pitch",
    "volume", "area",
]  # fmt: skip
Unit = Literal["m", "rad", "m2", "m3"]
Basis = Literal["measured", "relations", "pattern", "bounds"]

Measure = Callable[[Sequence[Placement]], float]
"""A number, metres or radians, of surfaces where they are."""


@dataclass(frozen=True, slots=True)
class PreferredValue:
    """The hypothesis that a dimension was meant to be a preferred value.

    Attributes
    ----------
    value : float
        In the dimension's own unit, metres or radians.
    series : str
        "1 mm", "1/16 in", "M8 clearance, medium (ISO 273)" ...
    probability : float
        Of this value, after the measurement, against all others and against no preferred value.
    """

    value: float
    series: str
    probability: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PartDimension:
    """A dimension of a part.

    Attributes
    ----------
    kind : str
        What it is.
    value, low, high : float
        And its 95 % interval, in `unit`.
    sd, measured_sd : float
        Standard deviation, and what it would be without relations; NaN where an interval is no normal one.
    unit : "m", "rad", "m2" or "m3"
        Of all these.
    surfaces : tuple of int
        Labels of the surfaces that it is of; of alike ones, of all.
    count : int
        How many of these are alike.
    basis : str
        "measured": from the points of its own surfaces. "relations": known better, or exactly, by relations
        to others. "pattern": given that holes are at regular places. "bounds": where points end, no surface.
    note : str
        "through", "blind", "about surface 3" ...
    ends : (2, 3) float
        From where to where it is, metres, for drawings; equal where it has no extent.
    preferred : PreferredValue, optional
        The most probable preferred value.
    places : tuple of int
        Places of the surfaces, from 0, that `measure` is of.
    measure : callable, optional
        The value from placements of these surfaces.
    """

    kind: Kind
    value: float
    low: float
    high: float
    sd: float
    measured_sd: float
    unit: Unit
    surfaces: tuple[int, ...]
    ends: FloatArray
    count: int = 1
    basis: Basis = "measured"
    note: str = ""
    preferred: PreferredValue | None = None
    places: tuple[int, ...] = ()
    measure: Measure | None = None

    @property
    def half(self) -> float:
        """Half its interval, in `unit`."""
        return (self.high - self.low) / 2

    @property
    def is_determined(self) -> bool:
        """Whether relations leave nothing open of it."""
        return self.sd < 1e-3 * self.measured_sd


@dataclass(frozen=True, slots=True, eq=False)
class DatumFrame:
    """The frame of a part by its main planes and axes.

    Attributes
    ----------
    axes : (3, 3) float
        Rows x, y, z: unit vectors.
    note : str
        Which surfaces determine it.
    """

    axes: FloatArray
    note: str


@dataclass(frozen=True, slots=True, eq=False)
class PartDimensions:
    """The dimensions of a part, the frame of its overall sizes, and why what is missing is missing."""

    rows: tuple[PartDimension, ...]
    frame: DatumFrame
    doubts: tuple[str, ...] = ()

    def of_kind(self, kind: Kind) -> tuple[PartDimension, ...]:
        """Those of a kind, in order."""
        return tuple(row for row in self.rows if row.kind == kind)

    def __len__(self) -> int:
        return len(self.rows)


def unit_scale(unit: Unit) -> tuple[float, str]:
    """Factor to, and name of, the unit in which people read a number: mm, deg, mm2, mm3."""
    return {"m": (1e3, "mm"), "rad": (float(np.degrees(1.0)), "deg"), "m2": (1e6, "mm2"), "m3": (1e9, "mm3")}[
        unit
    ]
