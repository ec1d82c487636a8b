# SPDX-License-Identifier: MIT
"""Shapes: extruded outlines, open faces, triangles and cylinders as IFC geometry, near the origin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from completion.exchange.building.areas import polygons, rings
from completion.exchange.building.faces import Frame
from completion.exchange.ifc.step_text import Ref, StepText, Word
from scenes.checks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """Geometry for one file.

    Attributes
    ----------
    file : StepText
        Where it is written.
    origin : (3,) float
        The place of the world that is the file's origin, metres.
    """

    file: StepText
    origin: FloatArray

    def point(self, place: FloatArray) -> Ref:
        """A point (2,) or (3,) in the file's coordinates."""
        return self.file.add("IfcCartesianPoint", [np.asarray(place, dtype=np.float64).tolist()])

    def direction(self, vector: FloatArray) -> Ref:
        """A direction (2,) or (3,)."""
        return self.file.add("IfcDirection", [np.asarray(vector, dtype=np.float64).tolist()])

    def axes(self, place: FloatArray, axis: FloatArray, right: FloatArray) -> Ref:
        """Axes at a place (3,) of the file: z along `axis` (3,), x along `right` (3,)."""
        values = [self.point(place), self.direction(axis), self.direction(right)]
        return self.file.add("IfcAxis2Placement3D", values)

    def placement(self, above: Ref | None, height_m: float = 0.0) -> Ref:
        """Where an object is: `height_m` above the placement that it belongs to."""
        place = self.file.add("IfcAxis2Placement3D", [self.point(np.array([0, 0, height_m])), None, None])
        return self.file.add("IfcLocalPlacement", [above, place], alone=True)

    def extruded(self, area: Any, frame: Frame, depth_m: float, low_m: float = 0.0) -> list[Ref]:
        """Solids that reach from `depth_m` behind the plane of a frame to `low_m` behind it, by polygon."""
        corner = np.array(area.bounds[:2] if not area.is_empty else (0.0, 0.0))  # where profiles begin
        axes = self.axes(frame.place(corner, -depth_m) - self.origin, frame.normal, frame.right)
        along = self.direction(np.array([0, 0, 1.0]))
        own = shapely.transform(area, lambda uv: uv - corner)
        return [
            self.file.add("IfcExtrudedAreaSolid", [self.profile(one), axes, along, depth_m - low_m])
            for one in polygons(own)
        ]

    def profile(self, polygon: Any) -> Ref:
        """An outline with its holes, for an extrusion."""
        outer, *holes = [self.loop_line(ring) for ring in rings(polygon)]
        if holes:
            return self.file.add("IfcArbitraryProfileDefWithVoids", [Word("AREA"), None, outer, holes])
        return self.file.add("IfcArbitraryClosedProfileDef", [Word("AREA"), None, outer])

    def loop_line(self, ring: FloatArray) -> Ref:
        """A closed polyline through points (n, 2) or (n, 3) of the file."""
        points = [self.point(place) for place in ring]
        return self.file.add("IfcPolyline", [[*points, points[0]]])

    def world_loop(self, points: FloatArray) -> Ref:
        """A closed polyline through points (n, 3) of the world."""
        return self.loop_line(np.asarray(points) - self.origin)

    def sheet(self, area: Any, frame: Frame) -> list[Ref]:
        """Flat faces with their holes, without thickness; none of an area that is empty."""
        faces = []
        for polygon in polygons(area):
            bounds = []
            for k, ring in enumerate(rings(polygon)):
                points = [self.point(place) for place in frame.place(ring) - self.origin]
                loop = self.file.add("IfcPolyLoop", [points])
                name = "IfcFaceBound" if k else "IfcFaceOuterBound"
                bounds.append(self.file.add(name, [loop, True]))
            faces.append(self.file.add("IfcFace", [bounds]))
        if not faces:
            return []
        together = self.file.add("IfcConnectedFaceSet", [faces])
        return [self.file.add("IfcFaceBasedSurfaceModel", [[together]])]

    def triangles(self, vertices: FloatArray, faces: NDArray[np.int64]) -> list[Ref]:
        """Triangles (m, 3) of vertices (n, 3) of the world; none of no triangles."""
        if not len(faces):
            return []
        used, index = np.unique(faces, return_inverse=True)
        places = self.file.add("IfcCartesianPointList3D", [(vertices[used] - self.origin).tolist()])
        numbers = (index.reshape(-1, 3) + 1).tolist()
        return [self.file.add("IfcTriangulatedFaceSet", [places, None, False, numbers, None])]

    def solid(self, vertices: FloatArray, faces: NDArray[np.int64]) -> list[Ref]:
        """The solid within closed triangles (m, 3) that face outwards."""
        found = []
        for corners in vertices[faces] - self.origin:
            loop = self.file.add("IfcPolyLoop", [[self.point(place) for place in corners]])
            bound = self.file.add("IfcFaceOuterBound", [loop, True])
            found.append(self.file.add("IfcFace", [[bound]]))
        return [self.file.add("IfcFacetedBrep", [self.file.add("IfcClosedShell", [found])])]

    def rod(self, ends: FloatArray, radius_m: float) -> list[Ref]:
        """A solid cylinder between the ends (2, 3) of its axis, world coordinates."""
        along = ends[1] - ends[0]
        length = float(np.linalg.norm(along))
        axis = along / length
        right = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        axes = self.axes(ends[0] - self.origin, axis, right / np.linalg.norm(right))
        profile = self.file.add("IfcCircleProfileDef", [Word("AREA"), None, None, radius_m])
        up = self.direction(np.array([0, 0, 1.0]))
        return [self.file.add("IfcExtrudedAreaSolid", [profile, axes, up, length])]


def outlines(area: Any) -> Sequence[FloatArray]:
    """Outer rings (n, 2) of an area's polygons."""
    return [rings(one)[0] for one in polygons(area)]
