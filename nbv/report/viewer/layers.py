# SPDX-License-Identifier: MIT
"""Layers of the 3-D view: triangles, what is known of each of them, and how they are thinned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, InputError
from scenes.mesh.labelled_mesh import Appearance

Pattern = Literal["plain", "hatched", "dotted"]
Colour = tuple[float, float, float]
NOTHING = 65535  # index of a category: none applies


@dataclass(frozen=True, slots=True)
class Category:
    """A class of faces: its name, colour (sRGB, 0..1) and pattern."""

    label: str
    colour: Colour
    pattern: Pattern = "plain"


@dataclass(frozen=True, slots=True, eq=False)
class Classes:
    """A channel that says of which class each of n places is.

    `values` (n,) are indices into `categories`, `NOTHING` where none applies; `since` (n,) is the view from
    which on this holds, 0 for always, and `before` the category until then.
    """

    key: str
    label: str
    categories: tuple[Category, ...]
    values: NDArray[np.uint16]
    since: NDArray[np.int64] | None = None
    before: int = NOTHING
    can_hide: bool = False
    kind: ClassVar[str] = "classes"

    def __post_init__(self) -> None:
        if self.since is not None and len(self.since) != len(self.values):
            raise InputError(f"{self.key}: {len(self.values)} values, but {len(self.since)} views")
        used = self.values[self.values != NOTHING]
        if len(used) and int(used.max()) >= len(self.categories):
            raise InputError(f"{self.key}: category {int(used.max())} of {len(self.categories)}")


@dataclass(frozen=True, slots=True, eq=False)
class Numbers:
    """A channel of numbers (n,) in a unit, NaN where there is none, with a colour bar from low to high.

    `digits` are the decimals that are read out, `absent` says what it means that there is no number, `limit`
    up to which the requirement holds; where small is good the colour bar runs from bright to dark.
    """

    key: str
    label: str
    unit: str
    values: FloatArray
    low: float
    high: float
    digits: int = 0
    absent: str = "none"
    limit: float | None = None
    small_is_good: bool = True
    kind: ClassVar[str] = "numbers"

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise InputError(f"{self.key}: a colour bar from {self.low} to {self.high}")


def deviation_channel(sd_mm: FloatArray, most_mm: float) -> Numbers:
    """Return the channel of predicted deviations (n,), millimetres."""
    return Numbers("sd", "Standard deviation", "mm", sd_mm, 0, high=max(most_mm, 1e-3), digits=2)


def confidence_channel(likely: FloatArray) -> Numbers:
    """Return the channel of confidences (n,), 0..1."""
    return Numbers("confidence", "Confidence", "", likely, 0, high=1, digits=2, small_is_good=False)


def incidence_channel(degrees: FloatArray, absent: str, limit: float | None = None) -> Numbers:
    """Return the channel of best incidences (n,), NaN where there is none."""
    named = ("quality", "Best incidence", "\u00b0")
    return Numbers(*named, degrees, 0, high=90, digits=1, absent=absent, limit=limit)


def count_channel(label: str, counts: FloatArray, most: float, absent: str) -> Numbers:
    """Return the channel of how many views see each place (n,), NaN where none does."""
    return Numbers("views", label, "", counts, 1, high=most, absent=absent, small_is_good=False)


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Which views see each of n places, and at which incidence.

    Those of place k are `start[k]` to `start[k + 1]`, (n + 1,): number (m,) of the view from 1, ascending for
    each place, and degrees (m,).
    """

    start: NDArray[np.int64]
    view: NDArray[np.int64]
    incidence_deg: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """Triangles that are shown or hidden together.

    Attributes
    ----------
    key, label : str
        Its name in the program, and for people; "" for a layer that cannot be hidden.
    vertices, faces : (n, 3) float, (m, 3) int
        World, metres; counter-clockwise seen from the side that is to be seen.
    paint : Category
        What it looks like where a channel says nothing.
    place : (m,) int, optional
        The place whose values and sightings each face has; its own number when not given.
    skin : Appearance, optional
        Natural colours, of corners and from images.
    is_marked : bool
        Whether it can be marked by its paint among natural colours: what is inferred.
    facts : mapping
        What else is read out at a picked point, for the whole layer.
    """

    key: str
    label: str
    vertices: FloatArray
    faces: NDArray[Any]
    paint: Category
    place: NDArray[Any] | None = None
    channels: tuple[Classes | Numbers, ...] = ()
    sightings: Sightings | None = None
    skin: Appearance | None = None
    shown: bool = True
    is_marked: bool = False
    facts: Mapping[str, str] | None = None

    def __post_init__(self) -> None:
        n = len(self.faces) if self.place is None else int(np.max(self.place, initial=-1)) + 1
        for channel in self.channels:
            if len(channel.values) < n or (self.place is None and len(channel.values) != n):
                raise InputError(f"{channel.key}: {len(channel.values)} values for {n} places")
        if self.skin is not None and len(self.skin.corner_colour) != len(self.faces):
            raise InputError(f"colours of {len(self.skin.corner_colour)} faces for {len(self.faces)}")
