# SPDX-License-Identifier: MIT
"""Dimension: a number that people order by, the interval in which it lies, and on what it rests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from completion.export.building.model import BuildingElement, PlaneElement
from completion.uncertainty.joint_errors import JointErrors
from scenes.checks import FloatArray, Value

Kind = Literal[
    "room width", "room height", "room area", "room volume", "wall thickness", "slab thickness",
    "opening width", "opening height", "pipe radius", "pipe length",
    "column radius", "column height", "column spacing", "thing width", "thing depth", "thing height",
]  # fmt: skip

LEVEL = 0.95
"""Probability with which a dimension lies in its interval."""


@dataclass(frozen=True, slots=True, eq=False)
class Support(Value):
    """A place on a surface that a dimension rests on.

    Attributes
    ----------
    element : Element
        The surface.
    place : (3,) float
        On it, world coordinates, metres.
    weight : float
        How fast the dimension grows as the place's signed distance from the surface does: 1 for either end of
        a width between walls whose normals point into the room, -1 where they point out of what is measured.
    """

    element: BuildingElement
    place: FloatArray
    weight: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Dimension(Value):
    """A number that people order by.

    Attributes
    ----------
    kind : str
        What it is of.
    value : float
        In `unit`.
    low, high : float
        Its 95 % interval, in `unit`.
    supports : tuple of Support
        What it rests on.
    ends : (2, 3) float
        From where to where it was taken, world coordinates, metres; twice a place within where it has none.
    measured_share : float
        Share of what it rests on that was measured; the rest was inferred.
    existence : float
        Probability that its least certain end is there.
    unit : "m", "m2" or "m3"
        Of both numbers.
    across_m : float
        By how much the number changes where all its bounds move outwards by a metre, over 2: 1 of lengths,
        half the perimeter of an area (m), half the surface of a volume (m2).
    thing : int, optional
        Of which thing it is, from 1; it then rests on no surfaces.
    """

    kind: Kind
    value: float
    low: float
    high: float
    supports: tuple[Support, ...]
    ends: FloatArray
    measured_share: float
    existence: float
    unit: Literal["m", "m2", "m3"] = "m"
    across_m: float = 1.0
    thing: int | None = None

    @property
    def half(self) -> float:
        """Half its interval, in `unit`."""
        return (self.high - self.low) / 2

    @property
    def surfaces(self) -> tuple[int, ...]:
        """Numbers of the surfaces it rests on, in their order along it."""
        return tuple(dict.fromkeys(support.element.number for support in self.supports))

    @property
    def name(self) -> str:
        """What it is, and of which surfaces."""
        if self.thing is not None:
            return f"{self.kind}, thing {self.thing}"
        several = len(self.surfaces) > 1
        return f"{self.kind}, surface{'s' * several} {' '.join(map(str, self.surfaces))}"


def half_interval(supports: Sequence[Support], errors: JointErrors, *, more_sd: float = 0.0) -> float:
    """Half the 95 % interval of a number that rests on some places, with what their surfaces share.

    Parameters
    ----------
    supports : sequence of Support
        What it rests on.
    errors : JointErrors
        How well the surfaces are known.
    more_sd : float
        Standard deviation of what it rests on beside surfaces, such as borders in them.
    """
    contrast: dict[int, FloatArray] = {}
    shifts: dict[int, FloatArray] = {}
    for support in supports:
        number = support.element.number - 1
        contrast[number] = contrast.get(number, 0.0) + support.weight * support.element.gradient(
            support.place
        )
        shifts[number] = shifts.get(number, np.zeros(3)) + support.weight * support.element.normal_at(
            support.place
        )
    return errors.half_interval(contrast, shifts, more_sd=more_sd, level=LEVEL)


def length_between(
    kind: Kind, ends: FloatArray, elements: tuple[PlaneElement, PlaneElement], errors: JointErrors
) -> Dimension:
    """Return the length from a place on a plane to a place on another, `ends` (2, 3), world, metres."""
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    supports = tuple(
        Support(element, end, 1.0 / float(element.normal @ inwards))
        for element, end, inwards in zip(elements, ends, (along, -along), strict=True)
    )
    value, half = float(np.linalg.norm(ends[1] - ends[0])), half_interval(supports, errors)
    return Dimension(
        kind=kind,
        value=value,
        low=max(value - half, 0.0),
        high=value + half,
        supports=supports,
        ends=ends,
        measured_share=float(
            np.mean([support.element.provenance(support.place) == 0 for support in supports])
        ),
        existence=min(support.element.confidence(support.place) for support in supports),
    )


UNKNOWN = (
    "Where no interval stands, neither the file nor its points tell the noise; a mesh never does. "
    "--sigma M says it."
)
