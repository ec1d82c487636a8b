# SPDX-License-Identifier: MIT
"""Elements: completed planes and cylinders in world coordinates, and what is known at a place on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from completion.extension.patch import Patch
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cylinder


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """A completed surface.

    Attributes
    ----------
    number : int
        Of its surface, from 1.
    kind : str
        "wall", "floor" or "ceiling" of planes that enclose the room, else "plane" or "cylinder".
    patch : Patch
        Its cells, working frame.
    world : Pose
        From the working frame to the world.
    """

    number: int
    kind: str
    patch: Patch
    world: Pose

    def gradient(self, place: FloatArray) -> FloatArray:
        """Derivative (k,) of the signed distance of a place (3,) of the world by the surface's parameters."""
        return np.asarray(self.patch.stated.gradient(self._local(place))[0])

    def normal_at(self, place: FloatArray) -> FloatArray:
        """Unit normal (3,) at a place (3,), both of the world."""
        return np.asarray(self.world.rotate(self.patch.grid.surface.normal(self._local(place)))[0])

    def sd_m(self, place: FloatArray) -> float:
        """Standard deviation of the surface along its normal at a place (3,) of the world, metres."""
        return float(self.patch.stated.standard_deviation(self._local(place))[0])

    def provenance(self, place: FloatArray) -> int:
        """Return the `Provenance` of the cell at a place (3,) of the world; -1 where the surface is not."""
        return int(self._cell(self.patch.provenance, place, -1))

    def confidence(self, place: FloatArray) -> float:
        """Probability that the surface is at a place (3,) of the world; 1 where it was measured."""
        return float(self._cell(self.patch.confidence, place, 0.0))

    @property
    def measured_share(self) -> float:
        """Share of its area that was measured."""
        whole = self.patch.observed_m2 + self.patch.hypothesised_m2
        return self.patch.observed_m2 / whole if whole else 0.0

    def _local(self, place: FloatArray) -> FloatArray:
        return self.world.inverse().apply(np.asarray(place)[None])

    def _cell(self, cells: Any, place: FloatArray, beyond: float) -> float:
        """What the cell holds that a place (3,) lies in, `beyond` outside the grid."""
        grid = self.patch.grid
        column, row = np.floor((grid.surface.to_uv(self._local(place))[0] - grid.corner) / grid.cell)
        column = column % grid.shape[1] if grid.wraps else column
        inside = 0 <= row < grid.shape[0] and 0 <= column < grid.shape[1]
        return float(cells[int(row), int(column)]) if inside else beyond


@dataclass(frozen=True, slots=True, eq=False)
class PlaneElement(Element):
    """A completed plane.

    Attributes
    ----------
    point, normal : (3,) float
        World coordinates, metres; the normal points to where it was seen from, of walls into the room.
    area_m2 : float
        Of its outline, less its openings.
    rings : tuple of (n, 3) float
        Outlines of its parts, then of their holes, world coordinates, metres.
    n_outer : int
        How many of the rings are outlines of parts.
    """

    point: FloatArray
    normal: FloatArray
    area_m2: float
    rings: tuple[FloatArray, ...]
    n_outer: int

    def covers(self, place: FloatArray) -> bool:
        """Whether a place (3,) on it lies within its outline; holes count as covered."""
        frame = np.linalg.svd(self.normal[None])[2][1:]
        outer = [shapely.Polygon((ring - self.point) @ frame.T) for ring in self.rings[: self.n_outer]]
        point = shapely.Point((place - self.point) @ frame.T)
        return any(polygon.intersects(point) for polygon in outer)


@dataclass(frozen=True, slots=True, eq=False)
class CylinderElement(Element):
    """A completed cylinder.

    Attributes
    ----------
    ends : (2, 3) float
        Where its axis begins and ends, by its measured and inferred cells; world coordinates, metres.
    surface : Cylinder
        Its surface, working frame.
    radius_m, radius_sd_m : float
        Its radius, and the standard deviation of it.
    is_solid : bool
        Whether it was seen from outside, as a pipe or a column; else it is a hollow round wall.
    """

    ends: FloatArray
    surface: Cylinder
    radius_m: float
    radius_sd_m: float
    is_solid: bool

    @property
    def length_m(self) -> float:
        """Of its axis."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))


def plane_element(number: int, record: dict[str, Any], patch: Patch, world: Pose) -> PlaneElement:
    """Return a completed plane by its record in `polygons.json`."""
    outer = [np.array(one["outer"]["points"]) for one in record["polygons"]]
    holes = [np.array(hole["points"]) for one in record["polygons"] for hole in one["holes"]]
    return PlaneElement(
        number=number,
        kind="plane" if record["role"] == "surface" else record["role"],
        patch=patch,
        world=world,
        point=np.array(record["plane"]["point"]),
        normal=np.array(record["plane"]["normal"]),
        area_m2=float(record["area_m2"]),
        rings=(*outer, *holes),
        n_outer=len(outer),
    )


def cylinder_element(number: int, patch: Patch, surface: Cylinder, world: Pose) -> CylinderElement:
    """Return a completed cylinder, the surface of its patch, from end to end of its cells."""
    grid = patch.grid
    rows = np.flatnonzero((patch.observed | patch.hypothesised).any(axis=1))
    along = grid.corner[1] + grid.cell[1] * np.array([rows.min(), rows.max() + 1.0] if len(rows) else [0, 0])
    return CylinderElement(
        number=number,
        kind="cylinder",
        patch=patch,
        world=world,
        ends=world.apply(surface.point + along[:, None] * surface.direction),
        surface=surface,
        radius_m=float(surface.radius),
        radius_sd_m=float(np.sqrt(patch.stated.covariance[-1, -1])),
        is_solid=not surface.concave,
    )
