# SPDX-License-Identifier: MIT
"""Layers of the 3-D view: triangles, what is known of each of them, and how they are thinned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from completion.extension.patch import Provenance
from completion.result.labelled_points import PROVENANCE_NAMES
from nbv.coverage.measurement import measured_samples
from nbv.coverage.visibility_history import VisibilityHistory
from nbv.report.pictures import picture
from nbv.scans.scan_map import with_known_noise
from nbv.visibility.samples import SurfaceSamples
from scenes.checks import FloatArray, InputError
from scenes.mesh.labelled_mesh import Appearance
from scenes.run.mapping import trim
from scenes.scan.colour import surface_rgb
from scenes.scan.range_image import RangeImage

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


MEASURED = Category("measured", picture.MEASURED)
INFERRED = Category("inferred", picture.INFERRED)
_BLOCK = 1 << 16  # faces whose sightings are found together
_PROVENANCE_COLOURS = (0, 1, 14, 5, 3, 13, 6, 10, 9)  # of `Provenance`, numbers in the palette of surfaces


def provenance_categories() -> tuple[Category, ...]:
    """How a place came to be in the model, each with its colour."""
    colours = (picture.MEASURED, *(surface_rgb(k) for k in _PROVENANCE_COLOURS[1:]))
    return tuple(Category(PROVENANCE_NAMES[str(why.value)], colours[int(why)]) for why in Provenance)


def scan_sightings(scans: Sequence[RangeImage], vertices: FloatArray, faces: NDArray[Any]) -> Sightings:
    """Which scans measured the middles of faces (m, 3), and at which incidence.

    Faces of the vertices (n, 3) are asked for a block at a time.
    """
    known = [with_known_noise(scan) for scan in scans]
    blocks = [faces[start : start + _BLOCK] for start in range(0, len(faces), _BLOCK)]
    found = [_sightings_of(known, vertices[block]) for block in blocks]
    counts = [np.diff(one.start) for one in found]
    return Sightings(
        np.concatenate([[0], np.cumsum(np.concatenate([np.zeros(0, np.int64), *counts]))]),
        np.concatenate([np.zeros(0, np.int64), *(one.view for one in found)]),
        np.concatenate([np.zeros(0), *(one.incidence_deg for one in found)]),
    )


def _sightings_of(scans: Sequence[RangeImage], corners: FloatArray) -> Sightings:
    """Which scans measured the middles of faces (m, 3, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    unit = np.divide(normals, length[:, None], out=np.zeros_like(normals), where=length[:, None] > 0)
    zero = np.zeros(len(corners), np.int32)
    samples = SurfaceSamples(corners.mean(axis=1), unit, length / 2, zero, zero)
    numbered = []
    for number, scan in enumerate(scans, start=1):
        numbered.append((number, *measured_samples(scan, samples)))
        trim()
    seen = VisibilityHistory.of(numbered, np.zeros(len(corners), np.int64), ())
    return Sightings(seen.start, seen.view, np.degrees(np.arccos(np.clip(seen.cosine, 0, 1))))


def quality_channels(sightings: Sightings, n_scans: int) -> tuple[Numbers, Numbers]:
    """Best incidence and number of scans of each place."""
    counts = np.diff(sightings.start)
    best = np.full(len(counts), np.inf)
    np.minimum.at(best, np.repeat(np.arange(len(counts)), counts), sightings.incidence_deg)
    angle, many = np.where(counts > 0, best, np.nan), np.where(counts > 0, counts, np.nan)
    absent = "not at the middle of a pixel"
    counted = count_channel("Scans that see it", many, max(n_scans, 2), absent)
    return incidence_channel(angle, absent), counted
