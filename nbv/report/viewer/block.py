# SPDX-License-Identifier: MIT
"""The 3-D view as a part of the page: layers, stations, lines, framing, and pictures for print."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from nbv.report.pictures.camera import Camera, best_side, overview_cameras
from nbv.report.pictures.picture import Picture
from nbv.report.viewer.layers import Colour, Layer
from scenes.checks import BoolArray, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Marker:
    """A station at `origin` (3,), world, metres; rows of `axes` (3, 3) are right, down, forward.

    Its name is the number of a view, or the letter of a scan that was given. `slope` holds the tangents of
    half its field of view across and down, None for one that looks around; `colour` is None for the page's
    ink; `is_step` tells views that are stepped through.
    """

    name: str
    origin: FloatArray
    axes: FloatArray
    slope: tuple[float, float] | None
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
    one : "view" or "scan"
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
    one: Literal["view", "scan"] = "view"
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
    shown = [layer for layer in layers if layer.shown]
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
