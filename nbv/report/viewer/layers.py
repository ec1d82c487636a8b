# SPDX-License-Identifier: MIT
"""The 3-D view as a part of the page: layers of triangles, stations, lines, framing, pictures for print.

A layer says what is known of each of its triangles, and is thinned where there are too many.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from nbv.report.figures.picture import Camera, Picture, best_side, overview_cameras
from scenes.checks import BoolArray, FloatArray, InputError
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
    is_framed : bool
        Whether it is to fill the picture at first; others are seen as far as they lie in it.
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
    is_framed: bool = True

    def __post_init__(self) -> None:
        n = len(self.faces) if self.place is None else int(np.max(self.place, initial=-1)) + 1
        for channel in self.channels:
            if len(channel.values) < n or (self.place is None and len(channel.values) != n):
                raise InputError(f"{channel.key}: {len(channel.values)} values for {n} places")
        if self.skin is not None and len(self.skin.corner_colour) != len(self.faces):
            raise InputError(f"colours of {len(self.skin.corner_colour)} faces for {len(self.faces)}")


@dataclass(frozen=True, slots=True, eq=False)
class Marker:
    """A station at `origin` (3,), world, metres; rows of `axes` (3, 3) are right, down, forward.

    Its name is the number of a view, or the letter of a scan that was given. `slope` holds the tangents of
    half its field of view across and down, None for one that looks around; `is_cone` tells a cone from a
    pyramid; `colour` is None for the page's ink; `is_step` tells views that are stepped through.
    """

    name: str
    origin: FloatArray
    axes: FloatArray
    slope: tuple[float, float] | None
    is_cone: bool = False
    colour: Colour | None = None
    is_step: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Lines with `ends` (n, 2, 3), world, metres, that are shown or hidden together.

    `key` is their name in the program, `label` that for people.
    """

    key: str
    label: str
    ends: FloatArray
    colour: Colour
    shown: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Viewer:
    """The 3-D view.

    Attributes
    ----------
    label : str
        What it shows, for those who cannot see it.
    mode : str
        Key of the channel by which it is coloured at first; "skin" for natural colours, "marked" for these
        with what is inferred marked.
    is_room : bool
        Whether it is looked into from outside: faces that look away are left out at first.
    met : tuple of float
        Share of the area that is measured before the first view and after each; empty without steps.
    pictures : tuple of Picture
        Instead of it, in print and where it cannot be drawn.
    camera : Camera, optional
        From which side it is seen at first; from above and the side that shows most when not given.
    noun : "view" or "scan"
        What a station is called.
    cut_m : float, optional
        Height above which nothing is shown at first, metres.
    """

    label: str
    layers: tuple[Layer, ...]
    mode: str = "state"
    markers: tuple[Marker, ...] = ()
    lines: tuple[Lines, ...] = ()
    is_room: bool = True
    met: tuple[float, ...] = ()
    pictures: tuple[Picture, ...] = field(default=())
    camera: Camera | None = None
    noun: Literal["view", "scan"] = "view"
    cut_m: float | None = None
    kind: ClassVar[str] = "viewer"

    def bounds(self) -> FloatArray:
        """Smallest and largest coordinates (2, 3) of all surface, metres; zeros without any."""
        columns = [_coordinates(self.layers, axis) for axis in range(3)]
        if not len(columns[0]):
            return np.zeros((2, 3))
        return np.array([[end(column) for column in columns] for end in (np.min, np.max)])


_REMOTE = 0.005  # share of the faces at each end that need not be in the picture


def best_camera(bounds: FloatArray, layers: Sequence[Layer]) -> Camera:
    """Return from which side layers are best looked into; they lie within `bounds` (2, 3)."""
    cameras = overview_cameras(bounds)
    return cameras[best_side(cameras, _corners(layers))]


def focus(layers: Sequence[Layer], forward: FloatArray, *, is_room: bool) -> FloatArray:
    """Return the bounds (2, 3) of what is to fill the picture, metres: what is shown, without what is remote.

    Of a room it is what turns its front to an eye that looks `forward` (3,).
    """
    shown = [layer for layer in layers if layer.shown and layer.is_framed]
    seen = [layer.faces[_faces_the_eye(layer, forward)] for layer in shown] if is_room else []
    faces = seen if any(map(len, seen)) else None
    columns = [_coordinates(shown, axis, faces) for axis in range(3)]
    if not len(columns[0]):
        return np.zeros((2, 3))
    return np.stack([np.quantile(column, [_REMOTE, 1 - _REMOTE]) for column in columns], axis=1)


def _faces_the_eye(layer: Layer, forward: FloatArray) -> BoolArray:
    """Which faces (m,) turn their front to an eye that looks `forward` (3,)."""
    a, b, c = (layer.vertices[layer.faces[:, k]] for k in range(3))
    return np.asarray(np.cross(b - a, c - a) @ forward < 0, dtype=np.bool_)


def _coordinates(
    layers: Sequence[Layer], axis: int, faces: Sequence[NDArray[Any]] | None = None
) -> FloatArray:
    """One coordinate (3 * m,) of the corners of all faces, or of those given for each layer."""
    chosen = [layer.faces for layer in layers] if faces is None else faces
    parts = [
        layer.vertices[:, axis][is_chosen].ravel() for layer, is_chosen in zip(layers, chosen, strict=True)
    ]
    return np.concatenate([np.zeros(0), *parts])


def _corners(layers: Sequence[Layer]) -> FloatArray:
    """Corners (m, 3, 3) of all faces that are shown at first."""
    return np.concatenate(
        [np.zeros((0, 3, 3)), *(layer.vertices[layer.faces] for layer in layers if layer.shown)]
    )
