# SPDX-License-Identifier: MIT
"""Faces: what a completed plane covers, as polygons of a level-and-up frame, measured and inferred apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from completion.exchange.building.areas import joined
from completion.exchange.building.building_model import BuildingModel, OpeningOutline
from completion.exchange.building.elements import PlaneElement
from scenes.checks import BoolArray, FloatArray

LEVEL = float(np.cos(np.radians(10.0)))
UPRIGHT = float(np.sin(np.radians(10.0)))
"""Planes within 10 degrees of level or upright are called so, as in `completion.extension.choice`."""


@dataclass(frozen=True, slots=True)
class Frame:
    """Coordinates on a plane: u to the right seen from the normal's side, v upwards, w along the normal.

    Of upright planes u is level; of level ones u and v are +x and +y of the world, or -x seen from below.
    """

    origin: FloatArray
    right: FloatArray
    up: FloatArray
    normal: FloatArray

    @classmethod
    def on(cls, point: FloatArray, normal: FloatArray) -> Frame:
        """Return the frame of the plane through a point (3,) with a unit normal (3,), world coordinates."""
        upwards = np.array([0.0, 0.0, 1.0] if abs(normal[2]) < LEVEL else [0.0, 1.0, 0.0])
        right = np.cross(upwards, normal)
        right /= np.linalg.norm(right)
        return cls(np.array(point), right, np.cross(normal, right), np.array(normal))

    def flat(self, points: FloatArray) -> FloatArray:
        """Coordinates (n, 2) of points (n, 3)."""
        off = np.asarray(points) - self.origin
        return np.stack([off @ self.right, off @ self.up], axis=-1)

    def height(self, points: FloatArray) -> FloatArray:
        """How far (n,) points (n, 3) lie before the plane, metres."""
        return np.asarray((np.asarray(points) - self.origin) @ self.normal)

    def place(self, uv: FloatArray, w: float = 0.0) -> FloatArray:
        """Points (n, 3) at coordinates (n, 2), `w` metres before the plane."""
        uv = np.asarray(uv, dtype=np.float64)
        return self.origin + uv[..., :1] * self.right + uv[..., 1:] * self.up + w * self.normal


@dataclass(frozen=True, slots=True, eq=False)
class PlaneFace:
    """A completed plane as area.

    Attributes
    ----------
    element : PlaneElement
        The plane.
    frame : Frame
        On it.
    measured, inferred, area : shapely geometry
        What its facets cover, and all of it; coordinates of the frame, metres.
    openings : tuple of OpeningOutline
        Its openings.
    """

    element: PlaneElement
    frame: Frame
    measured: Any
    inferred: Any
    area: Any
    openings: tuple[OpeningOutline, ...]

    @property
    def number(self) -> int:
        """Of its surface, from 1."""
        return self.element.number

    @property
    def lowest_m(self) -> float:
        """Height of its lowest place."""
        return float(self.frame.place(shapely.get_coordinates(self.area))[:, 2].min())

    @property
    def highest_m(self) -> float:
        """Height of its highest place."""
        return float(self.frame.place(shapely.get_coordinates(self.area))[:, 2].max())

    @property
    def is_upright(self) -> bool:
        """Whether it is within 10 degrees of upright."""
        return bool(abs(self.frame.normal[2]) <= UPRIGHT)

    @property
    def is_level(self) -> bool:
        """Whether it is within 10 degrees of level."""
        return bool(abs(self.frame.normal[2]) >= LEVEL)

    def laid_on(self, frame: Frame) -> tuple[Any, Any]:
        """Measured and inferred area seen along another frame's normal, in its coordinates."""
        return moved(self.measured, self.frame, frame), moved(self.inferred, self.frame, frame)

    def plan(self) -> Any:
        """Its area seen from above, world x and y."""
        return joined([shapely.transform(self.area, lambda uv: self.frame.place(uv)[:, :2])])


def faces_of(model: BuildingModel) -> tuple[PlaneFace, ...]:
    """Return the planes of a model that have facets, in their order."""
    found = []
    for element in model.planes:
        own = model.surface == element.number
        if own.any():
            frame = Frame.on(element.point, element.normal)
            openings = tuple(one for one in model.openings if one.surface == element.number)
            seen = model.is_measured
            measured, inferred, area = (
                _covered(model, frame, own & chosen) for chosen in (seen, ~seen, np.ones_like(seen))
            )
            found.append(PlaneFace(element, frame, measured, inferred, area=area, openings=openings))
    return tuple(found)


def moved(area: Any, frame: Frame, other: Frame) -> Any:
    """Area of one frame seen along the normal of another, in its coordinates."""
    return joined([shapely.transform(area, lambda uv: other.flat(frame.place(uv)))])


def _covered(model: BuildingModel, frame: Frame, chosen: BoolArray) -> Any:
    corners = frame.flat(model.vertices[model.faces[chosen]])
    return joined(shapely.polygons(corners).tolist())
