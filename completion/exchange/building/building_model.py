# SPDX-License-Identifier: MIT
"""Building model: the light model in world coordinates, with what drawings say of its surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.exchange.building.elements import (
    CylinderElement,
    PlaneElement,
    cylinder_element,
    plane_element,
)
from completion.extension.patch import Patch
from completion.panels.model import PanelModel
from completion.uncertainty.joint_errors import JointErrors
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cylinder

REST = "rest"
"""What no surface explains, which is surface 0."""


@dataclass(frozen=True, slots=True, eq=False)
class FoldLine:
    """An edge that two surfaces share: polyline (n, 3), world coordinates, metres, as of `FoldEdge`."""

    surfaces: tuple[int, int]
    points: FloatArray
    measured_share: float
    sd_m: float
    dihedral_deg: float


@dataclass(frozen=True, slots=True, eq=False)
class OpeningOutline:
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


@dataclass(frozen=True, slots=True, eq=False)
class BuildingModel:
    """What is drawn, in world coordinates.

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
    errors : JointErrors
        How well the surfaces are known, jointly.
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
    errors: JointErrors

    @property
    def walls(self) -> tuple[PlaneElement, ...]:
        """The upright planes that enclose the room."""
        return tuple(one for one in self.planes if one.kind == "wall")

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
    world: Pose,
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
    world : Pose
        From the working frame to the world.
    """
    planes = [
        plane_element(int(one["id"]), one, patches[int(one["id"]) - 1], world) for one in polygons["surfaces"]
    ]
    cylinders = [
        cylinder_element(number, patch, patch.grid.surface, world)
        for number, patch in enumerate(patches, start=1)
        if isinstance(patch.grid.surface, Cylinder)
    ]
    kinds = [REST] + [patch.grid.surface.kind for patch in patches]
    for plane in planes:
        kinds[plane.number] = plane.kind
    n_rest = len(panels.rest.faces)
    corners = np.array([one.point for one in panels.corners]).reshape(-1, 3)
    spread = [float(np.sqrt(np.linalg.eigvalsh(one.covariance)[-1])) for one in panels.corners]
    return BuildingModel(
        vertices=world.apply(panels.vertices),
        faces=np.concatenate([panels.faces, panels.rest.faces]),
        surface=np.pad(panels.face_surface.astype(np.int64), (0, n_rest)),
        provenance=np.pad(panels.face_provenance.astype(np.int64), (0, n_rest)),
        kinds=tuple(kinds),
        folds=tuple(
            FoldLine(one.surfaces, world.apply(one.points), one.measured_share, one.sd_m, one.dihedral_deg)
            for one in panels.folds
        ),
        corners=world.apply(corners),
        corner_sd_m=np.array(spread),
        openings=tuple(
            OpeningOutline(
                surface=int(plane["id"]),
                kind=one["kind"],
                points=np.array(one["points"]),
                sides=one["sides"],
                width_m=one["width_m"],
                height_m=one["height_m"],
                seen_share=one["seen_share"],
            )
            for plane in polygons["surfaces"]
            for one in plane["openings"]
        ),
        planes=tuple(planes),
        cylinders=tuple(cylinders),
        floor_m=_lowest_floor(planes),
        errors=errors,
    )


def _lowest_floor(planes: Sequence[PlaneElement]) -> float | None:
    """Height of the lowest floor, in the middle of its outline's corners; None without a floor."""
    heights = [
        float(np.concatenate(plane.rings[: plane.n_outer])[:, 2].mean())
        for plane in planes
        if plane.kind == "floor" and plane.n_outer
    ]
    return min(heights, default=None)
