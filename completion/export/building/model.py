# SPDX-License-Identifier: MIT
"""Building model: the light model in world coordinates, with what drawings say of its surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from completion.export.building.room_plans import RoomPlan, room_plans
from completion.export.building.things import BuildingThing
from completion.export.panels.model import PanelModel
from completion.extension.patch import Patch
from completion.room.roles import Room
from completion.uncertainty.joint_errors import JointErrors
from scenes.checks import BoolArray, FloatArray, Value
from scenes.inclination import Inclination
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cylinder


@dataclass(frozen=True, slots=True, eq=False)
class BuildingElement(Value):
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

    @property
    def inclination(self) -> Inclination:
        """Its angle with the horizontal."""
        return self.patch.source.fit.inclination(self.world.matrix[2, :3])

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
class PlaneElement(BuildingElement):
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
class CylinderElement(BuildingElement):
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
    outer = [np.array(polygon["outer"]["points"]) for polygon in record["polygons"]]
    holes = [np.array(hole["points"]) for polygon in record["polygons"] for hole in polygon["holes"]]
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


def matrix_text(drawing_from_world: Pose) -> str:
    """Return the sixteen numbers of a turn of drawings, row by row; "" of none."""
    matrix = drawing_from_world.matrix
    is_turned = not np.array_equal(matrix, np.eye(4))
    return " ".join(f"{number:.12g}" for number in matrix.ravel()) if is_turned else ""


def told_turn(drawing_from_world: Pose) -> str:
    """Return what a drawing says of its turn against the scans' world; "" of none."""
    text = matrix_text(drawing_from_world)
    return f"; z is up in the drawing: drawing_from_world {text}" if text else ""


REST = "rest"
"""What no surface explains, which is surface 0."""


@dataclass(frozen=True, slots=True, eq=False)
class FoldLine(Value):
    """An edge that two surfaces share: polyline (n, 3), world coordinates, metres, as of `FoldEdge`."""

    surfaces: tuple[int, int]
    points: FloatArray
    measured_share: float
    sd_m: float
    dihedral_deg: float


@dataclass(frozen=True, slots=True, eq=False)
class OpeningOutline(Value):
    """An opening.

    Attributes
    ----------
    surface : int
        The surface it is in, from 1.
    kind : "door", "window" or "opening"
        What it is by its place in a wall.
    points : (n, 3) float
        Its outline, world coordinates, metres.
    sides : sequence of mapping
        How well each side is known, from that point to the next, as in `polygons.json`.
    width_m, height_m : float
        Its size along the level and upwards.
    seen_share : float
        Share of it that beams went through; the rest is inferred to be open.
    """

    surface: int
    kind: str
    points: FloatArray
    sides: Sequence[Mapping[str, float]]
    width_m: float
    height_m: float
    seen_share: float

    @property
    def area_m2(self) -> float:
        """Within its outline, which is flat."""
        off = self.points - self.points[0]
        return float(np.linalg.norm(np.cross(off[:-1], off[1:]).sum(axis=0)) / 2)


@dataclass(frozen=True, slots=True, eq=False)
class BuildingModel(Value):
    """What is drawn, in coordinates whose z is up: the world's where its own is.

    Attributes
    ----------
    vertices : (n, 3) float
        Metres.
    faces : (m, 3) int
        Facets; the last ones are of no surface.
    surface : (m,) int
        Number of each facet's surface, from 1; 0 for none.
    provenance : (m,) int
        The `Provenance` of each facet.
    kinds : tuple of str
        For surface 0, 1, ...: "rest", then "wall", "floor", "ceiling", "plane" or "cylinder".
    folds : tuple of FoldLine
        Edges that two surfaces share.
    corners : (c, 3) float
        Points in which three meet.
    corner_sd_m : (c,) float
        Their standard deviations in the worst direction.
    openings : tuple of OpeningOutline
        Holes in planes.
    planes : tuple of PlaneElement
        Its completed planes.
    cylinders : tuple of CylinderElement
        Its completed cylinders.
    floor_m : float or None
        Height of the lowest floor; None where none was found.
    eye_m : float or None
        Height of the lowest scanner; None where what is up is not known.
    plans : tuple of RoomPlan
        The rooms that the scans show, in the plan.
    errors : JointErrors
        How well the surfaces are known, jointly.
    drawing_from_world : Pose
        The turn from the world of the scans to this one, in which z is up.
    things : tuple of BuildingThing
        What stands in it, closed; none where back sides were not asked for.
    title : str
        Of which scans it is.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    surface: NDArray[np.int64]
    provenance: NDArray[np.int64]
    kinds: tuple[str, ...]
    folds: tuple[FoldLine, ...]
    corners: FloatArray
    corner_sd_m: FloatArray
    openings: tuple[OpeningOutline, ...]
    planes: tuple[PlaneElement, ...]
    cylinders: tuple[CylinderElement, ...]
    floor_m: float | None
    eye_m: float | None
    plans: tuple[RoomPlan, ...]
    errors: JointErrors
    drawing_from_world: Pose = field(default_factory=Pose.identity)
    things: tuple[BuildingThing, ...] = ()
    title: str = ""

    @property
    def walls(self) -> tuple[PlaneElement, ...]:
        """The upright planes that enclose the room."""
        return tuple(plane for plane in self.planes if plane.kind == "wall")

    @property
    def is_measured(self) -> BoolArray:
        """Which facets (m,) were measured; the others were inferred."""
        return np.asarray(self.provenance == 0, dtype=np.bool_)

    @property
    def drawn(self) -> FloatArray:
        """The vertices (k, 3) that facets use."""
        return self.vertices[np.unique(self.faces)]


def building_model(
    panels: PanelModel,
    patches: Sequence[Patch],
    polygons: Mapping[str, Any],
    errors: JointErrors,
    *,
    room: Room,
    world: Pose,
    drawing_from_world: Pose,
) -> BuildingModel:
    """Return what drawings show of a completed model.

    Parameters
    ----------
    panels : PanelModel
        The light model, working frame.
    patches : sequence of Patch
        The completed surfaces, in their order.
    polygons : mapping
        What `polygons.json` holds.
    errors : JointErrors
        How well the surfaces are known.
    room : Room
        What scans show of the room, working frame.
    world : Pose
        From the working frame to that of drawings, z up; so are the polygons.
    drawing_from_world : Pose
        From the scans' world to it.
    """
    planes = [
        plane_element(int(surface["id"]), surface, patches[int(surface["id"]) - 1], world)
        for surface in polygons["surfaces"]
    ]
    cylinders = [
        cylinder_element(number, patch, patch.grid.surface, world)
        for number, patch in enumerate(patches, start=1)
        if isinstance(patch.grid.surface, Cylinder)
    ]
    kinds = [REST] + [patch.grid.surface.kind for patch in patches]
    for plane in planes:
        kinds[plane.number] = plane.kind
    n_rest = len(panels.remainder.faces)
    corners = np.array([corner.point for corner in panels.corners]).reshape(-1, 3)
    spread = [float(np.sqrt(np.linalg.eigvalsh(corner.covariance)[-1])) for corner in panels.corners]
    return BuildingModel(
        vertices=world.apply(panels.vertices),
        faces=np.concatenate([panels.faces, panels.remainder.faces]),
        surface=np.pad(panels.face_surface.astype(np.int64), (0, n_rest)),
        provenance=np.pad(panels.face_provenance.astype(np.int64), (0, n_rest)),
        kinds=tuple(kinds),
        folds=tuple(
            FoldLine(
                fold.surfaces, world.apply(fold.points), fold.measured_share, fold.sd_m, fold.dihedral_deg
            )
            for fold in panels.folds
        ),
        corners=world.apply(corners),
        corner_sd_m=np.array(spread),
        openings=tuple(
            OpeningOutline(
                surface=int(plane["id"]),
                kind=opening["kind"],
                points=np.array(opening["points"]),
                sides=opening["sides"],
                width_m=opening["width_m"],
                height_m=opening["height_m"],
                seen_share=opening["seen_share"],
            )
            for plane in polygons["surfaces"]
            for opening in plane["openings"]
        ),
        planes=tuple(planes),
        cylinders=tuple(cylinders),
        floor_m=_lowest_floor(planes),
        eye_m=min((float(world.apply(origin[None])[0, 2]) for origin in room.origins), default=None),
        plans=room_plans(room, patches, world),
        errors=errors,
        drawing_from_world=drawing_from_world,
    )


def _lowest_floor(planes: Sequence[PlaneElement]) -> float | None:
    """Height of the lowest floor, in the middle of its outline's corners; None without a floor."""
    heights = [
        float(np.concatenate(plane.rings[: plane.n_outer])[:, 2].mean())
        for plane in planes
        if plane.kind == "floor" and plane.n_outer
    ]
    return min(heights, default=None)
