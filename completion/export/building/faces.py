# SPDX-License-Identifier: MIT
"""Faces: the area that a completed plane covers, as polygons, measured and inferred apart."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from completion.export.building.model import BuildingModel, OpeningOutline, PlaneElement
from scenes.checks import BoolArray, FloatArray, Value
from scenes.inclination import LEVEL_COSINE, Inclination

_LEAST_M2 = 1e-6  # of a polygon; what is smaller came of rounding
_MITRE = 1.5
_APART_M = 2e-5  # half the least distance of sides from each other
_STRAIGHT_M, _ROUNDING_M, _LEAST_SMOOTH_M2 = 5e-4, 1e-6, 1e-4


def polygons(area: Any, least_m2: float = _LEAST_M2) -> list[Any]:
    """Return the polygons of an area that are not smaller than `least_m2`, largest first."""
    parts = shapely.get_parts(shapely.get_parts(area))  # of collections too
    return sorted(
        (part for part in parts.tolist() if part.geom_type == "Polygon" and part.area >= least_m2),
        key=lambda polygon: (-polygon.area, *polygon.bounds),
    )


def union(areas: Iterable[Any]) -> Any:
    """The union of areas."""
    return _clean(shapely.union_all([shapely.make_valid(area) for area in areas]))


def common(first: Any, second: Any) -> Any:
    """What two areas have in common."""
    return _clean(shapely.intersection(first, second))


def less(area: Any, others: Iterable[Any]) -> Any:
    """An area without others."""
    return _clean(shapely.difference(area, union(others)))


def grow(area: Any, reach_m: float) -> Any:
    """An area grown by a reach, or shrunk, with its corners as corners."""
    with np.errstate(divide="ignore", invalid="ignore"):  # flags that GEOS leaves behind are no faults
        return shapely.buffer(area, reach_m, join_style="mitre")


def wide(area: Any, least_m: float) -> Any:
    """What is at least so wide of an area, with its corners as they are."""
    core = grow(area, -least_m / 2)
    return common(area, grow(core, _MITRE * least_m / 2))


def fill_holes(area: Any) -> Any:
    """An area without its holes."""
    return union(shapely.Polygon(polygon.exterior) for polygon in polygons(area))


def straighten_sides(area: Any) -> Any:
    """An area without the corners that are within half a millimetre of a straight side."""
    return _clean(shapely.simplify(area, _STRAIGHT_M))


def smooth(area: Any, slit_m: float) -> Any:
    """An area without slits and splinters narrower than `slit_m`, and holes that touch its outline."""
    area = straighten_sides(area)
    for step in (slit_m / 2, -slit_m, slit_m / 2 - _APART_M):  # so that sides come near, but never touch
        area = grow(area, step)
    return shapely.MultiPolygon(polygons(shapely.simplify(area, _ROUNDING_M), _LEAST_SMOOTH_M2))


def inside(area: Any) -> FloatArray:
    """A place (2,) as far inside an area as there is, by the largest of its polygons."""
    line = shapely.maximum_inscribed_circle(polygons(area)[0], tolerance=0.01)
    return np.asarray(shapely.get_coordinates(line)[0])


def rings(polygon: Any) -> Sequence[FloatArray]:
    """Outline anticlockwise, then holes clockwise, (n, 2) each, the first point not repeated."""
    turned = shapely.geometry.polygon.orient(polygon)
    return [np.asarray(ring.coords)[:-1] for ring in (turned.exterior, *turned.interiors)]


def _clean(area: Any) -> Any:
    return shapely.MultiPolygon(polygons(area))


@dataclass(frozen=True, slots=True)
class FaceFrame(Value):
    """Coordinates on a plane: u to the right seen from the normal's side, v upwards, w along the normal.

    Of upright planes u is level; of level ones u and v are +x and +y of the world, or -x seen from below.
    """

    origin: FloatArray
    right: FloatArray
    up: FloatArray
    normal: FloatArray

    @classmethod
    def on(cls, point: FloatArray, normal: FloatArray) -> FaceFrame:
        """Return the frame of the plane through a point (3,) with a unit normal (3,), world coordinates."""
        upwards = np.array([0.0, 0.0, 1.0] if abs(normal[2]) < LEVEL_COSINE else [0.0, 1.0, 0.0])
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
class PlaneFace(Value):
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
    inclination : Inclination
        Angle with the horizontal.
    """

    element: PlaneElement
    frame: FaceFrame
    measured: Any
    inferred: Any
    area: Any
    openings: tuple[OpeningOutline, ...]
    inclination: Inclination

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
        """Whether it stands upright."""
        return self.inclination.is_upright

    @property
    def is_level(self) -> bool:
        """Whether it lies level."""
        return self.inclination.is_level

    def laid_on(self, frame: FaceFrame) -> tuple[Any, Any]:
        """Measured and inferred area seen along another frame's normal, in its coordinates."""
        return project_area(self.measured, self.frame, frame), project_area(self.inferred, self.frame, frame)

    def plan(self) -> Any:
        """Its area seen from above, world x and y."""
        return union([shapely.transform(self.area, lambda uv: self.frame.place(uv)[:, :2])])


def faces_of(model: BuildingModel) -> tuple[PlaneFace, ...]:
    """Return the planes of a model that have facets, in their order."""
    faces = []
    for element in model.planes:
        is_member = model.surface == element.number
        if is_member.any():
            frame = FaceFrame.on(element.point, element.normal)
            openings = tuple(opening for opening in model.openings if opening.surface == element.number)
            seen = model.is_measured
            measured, inferred, area = (
                _covered_area(model, frame, is_member & chosen)
                for chosen in (seen, ~seen, np.ones_like(seen))
            )
            faces.append(
                PlaneFace(
                    element,
                    frame,
                    measured,
                    inferred,
                    area=area,
                    openings=openings,
                    inclination=element.inclination,
                )
            )
    return tuple(faces)


def project_area(area: Any, frame: FaceFrame, other: FaceFrame) -> Any:
    """Area of one frame seen along the normal of another, in its coordinates."""
    return union([shapely.transform(area, lambda uv: other.flat(frame.place(uv)))])


def _covered_area(model: BuildingModel, frame: FaceFrame, chosen: BoolArray) -> Any:
    corners = frame.flat(model.vertices[model.faces[chosen]])
    return union(shapely.polygons(corners).tolist())
