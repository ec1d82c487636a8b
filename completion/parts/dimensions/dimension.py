# SPDX-License-Identifier: MIT
"""A dimension of a part: its value, the interval in which it lies, what it is of and what it follows from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from completion.parts.dimensions.hole import Hole
from completion.relations.equations import Placement
from scenes.checks import FloatArray, Value

NORMAL_95 = 1.959963984540054
"""Half an interval of 95 % in standard deviations."""
_BETTER = 0.98  # of the deviation without relations, below which these have made a number better known

Kind = Literal[
    "overall size", "hole diameter", "outer diameter", "sphere diameter", "radius", "fillet radius",
    "ring diameter", "tube radius", "cone angle", "countersink diameter", "hole depth", "thickness", "length",
    "slot width", "step", "distance", "axis distance", "axis to plane", "angle", "pitch circle diameter",
    "start angle", "pitch", "chamfer", "volume", "area",
]  # fmt: skip
Unit = Literal["m", "rad", "m2", "m3"]
Basis = Literal["measured", "relations", "pattern", "bounds"]
BlendKind = Literal["fillet", "round", "corner ball", "chamfer"]

Measure = Callable[[Sequence[Placement]], float]
"""A number, metres or radians, of surfaces where they are."""


@dataclass(frozen=True, slots=True)
class PreferredValue(Value):
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


def _nowhere() -> FloatArray:
    return np.zeros((2, 3))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PartDimension(Value):
    """A dimension of a part, in `unit`: metres, radians, m2 or m3.

    Attributes
    ----------
    kind : str
        What it is.
    value : float
        The estimate.
    sd, measured_sd : float
        Its standard deviation, and what that would be without relations; NaN where only bounds are known.
    surfaces : tuple of int
        Labels of the surfaces that it is of; of alike ones, of all.
    count : int
        How many of these are alike.
    note : str
        "through", "blind", "about surface 3" ...
    ends : (2, 3) float
        From where to where it is, metres, for drawings; equal where it has no extent.
    is_pattern : bool
        Whether it is known given that holes are at regular places.
    bounds : (float, float), optional
        Between which it lies, where points end and no surface does.
    preferred : PreferredValue, optional
        The most probable preferred value.
    places : tuple of int
        Places of the surfaces, from 0, that `measure` is of.
    measure : callable, optional
        The value from placements of these surfaces.
    """

    kind: Kind
    value: float
    sd: float
    measured_sd: float
    surfaces: tuple[int, ...]
    ends: FloatArray = field(default_factory=_nowhere)
    count: int = 1
    note: str = ""
    is_pattern: bool = False
    bounds: tuple[float, float] | None = None
    preferred: PreferredValue | None = None
    places: tuple[int, ...] = ()
    measure: Measure | None = None

    @property
    def low(self) -> float:
        """Lower end of the 95 % interval."""
        return self.value - NORMAL_95 * self.sd if self.bounds is None else self.bounds[0]

    @property
    def high(self) -> float:
        """Upper end of it."""
        return self.value + NORMAL_95 * self.sd if self.bounds is None else self.bounds[1]

    @property
    def unit(self) -> Unit:
        """Of the value and its interval."""
        if self.kind in ("volume", "area"):
            return "m3" if self.kind == "volume" else "m2"
        return "rad" if self.kind.endswith("angle") else "m"

    @property
    def basis(self) -> Basis:
        """What it is known from: its own surfaces, relations to others, regular places, outermost points."""
        if self.bounds is not None:
            return "bounds"
        return (
            "pattern"
            if self.is_pattern
            else "relations"
            if self.sd < _BETTER * self.measured_sd
            else "measured"
        )

    @property
    def is_determined(self) -> bool:
        """Whether relations leave nothing open of it."""
        return self.sd < 1e-3 * self.measured_sd


@dataclass(frozen=True, slots=True, eq=False)
class Blend(Value):
    """A face between two or three others: a ball's way along two, a ball in a corner, or a chamfer.

    Attributes
    ----------
    labels : tuple of int
        Of its surface, or of its pieces.
    supports : tuple of int
        Labels of the faces that it lies between.
    kind : str
        "fillet" where the ball lies outside the material, "round" where within; "corner ball" of three faces;
        "chamfer" of a narrow face that cuts an edge off.
    size_m, sd_m : float
        Its radius where it touches its faces exactly, of a chamfer the width that it takes of the first; and
        the standard deviation of that; metres.
    p : float
        Probability of a misfit at least so large, if it is a blend.
    edge : (n, 3) float
        Along the edge in which the faces meet behind it, as long as it; of a corner the one point. Metres.
    edge_covariance : (n, 3, 3) float
        Of these points across the edge, m2.
    angle : float
        Between a chamfer and the first of its faces, radians; of others 0.
    """

    labels: tuple[int, ...]
    supports: tuple[int, ...]
    kind: BlendKind
    size_m: float
    sd_m: float
    p: float
    edge: FloatArray
    edge_covariance: FloatArray
    angle: float = 0.0

    @property
    def interval_m(self) -> tuple[float, float]:
        """The 95 % interval of its size, metres."""
        return self.size_m - NORMAL_95 * self.sd_m, self.size_m + NORMAL_95 * self.sd_m

    @property
    def edge_sd_m(self) -> FloatArray:
        """Standard deviation (n,) of the edge's points, the worst way across; metres."""
        return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(self.edge_covariance)[:, -1], 0.0)))

    @property
    def note(self) -> str:
        """What it is, in words: "fillet between 3 and 7"."""
        *first, last = map(str, self.supports)
        turned = f" at {np.degrees(self.angle):.1f} deg" if self.angle else ""
        return f"{self.kind} between {', '.join(first)} and {last}{turned}"


@dataclass(frozen=True, slots=True, eq=False)
class DatumFrame(Value):
    """The frame of a part by its main planes and axes: unit vectors (3, 3), rows, and what they are from."""

    axes: FloatArray
    note: str


@dataclass(frozen=True, slots=True, eq=False)
class PartDimensions(Value):
    """The dimensions of a part, the frame of its overall sizes, and why what is missing is missing.

    `holes` are those of each place at which it is drilled: of a stepped one its cylinders together. `blends`
    are its fillets, rounds and chamfers.
    """

    rows: tuple[PartDimension, ...]
    frame: DatumFrame
    doubts: tuple[str, ...] = ()
    holes: tuple[tuple[Hole, ...], ...] = ()
    blends: tuple[Blend, ...] = ()

    def of_kind(self, kind: Kind) -> tuple[PartDimension, ...]:
        """Those of a kind, in order."""
        return tuple(row for row in self.rows if row.kind == kind)

    def __len__(self) -> int:
        return len(self.rows)


def unit_scale(unit: Unit) -> tuple[float, str]:
    """Factor to, and name of, the unit in which people read a number: mm, deg, mm2, mm3."""
    known = {"m": (1e3, "mm"), "rad": (float(np.degrees(1.0)), "deg"), "m2": (1e6, "mm2"), "m3": (1e9, "mm3")}
    return known[unit]
