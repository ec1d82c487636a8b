# SPDX-License-Identifier: MIT
"""Boundary representation: edges, trimmed faces, and shells of the kernel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from completion.exchange.step.curves.corners import Corner
from completion.exchange.step.curves.fold_curve import FoldCurve
from completion.exchange.step.curves.kernel import kernel, kernel_point
from completion.exchange.step.loops import Side
from completion.exchange.step.pieces import Piece
from completion.exchange.step.seam_edges import plain_seams
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Surface

_LEAST_TOLERANCE = 1e-6  # mm
_N_CHECKED = 23  # points of an edge at which its distance from the surfaces is taken


class EdgeMaker:
    """Makes each edge and each corner once, so that faces share them."""

    def __init__(
        self,
        pieces: Sequence[Piece],
        curves: Sequence[FoldCurve],
        corners: Sequence[Corner],
        surfaces: Sequence[Surface],
    ) -> None:
        self.pieces, self.curves, self.corners, self.surfaces = pieces, curves, corners, surfaces
        self._vertices: dict[int, Any] = {}
        self._edges: dict[int, Any] = {}

    def _vertex(self, corner: int, point: FloatArray, tolerance: float) -> Any:
        known = self._vertices.get(corner) if corner >= 0 else None
        if known is None:
            known = kernel().TopoDS.TopoDS_Vertex()
            kernel().BRep.BRep_Builder().MakeVertex(known, kernel_point(point), max(tolerance, 1e-6))
            if corner >= 0:
                self._vertices[corner] = known
        return known

    def off(self, piece: Piece) -> float:
        """How far a piece is off its surfaces, mm."""
        curve = self.curves[piece.curve]
        points = curve.at(np.linspace(piece.low, piece.high, _N_CHECKED))
        return max(float(np.abs(self.surfaces[one].distance(points)).max()) for one in curve.pair)

    def edge(self, place: int) -> Any:
        """The edge of a piece, running as its curve does."""
        if place not in self._edges:
            self._edges[place] = self._made(self.pieces[place])
        return self._edges[place]

    def _made(self, piece: Piece) -> Any:
        curve, build = self.curves[piece.curve], kernel().BRep.BRep_Builder()
        tolerance = max(1.5 * self.off(piece), _LEAST_TOLERANCE)
        edge = kernel().TopoDS.TopoDS_Edge()
        build.MakeEdge(edge, curve.geometry, tolerance)
        ends = curve.at(np.array([piece.low, piece.high]))
        vertices = list[Any]()
        for corner, point in zip(piece.ends, ends, strict=True):
            place = self.corners[corner].point if corner >= 0 else point
            off = max(1.05 * float(np.linalg.norm(place - point)), tolerance)
            if piece.is_loop and vertices:
                vertices.append(vertices[0])
                continue
            vertices.append(self._vertex(corner, place, off))
            build.UpdateVertex(vertices[-1], off)
        topabs = kernel().TopAbs.TopAbs_Orientation
        build.Add(edge, vertices[0].Oriented(topabs.TopAbs_FORWARD))
        build.Add(edge, vertices[1].Oriented(topabs.TopAbs_REVERSED))
        build.Range(edge, piece.low, piece.high)
        return edge


class TrimmedFace(NamedTuple):
    """A face, and why there is none."""

    face: Any | None
    reason: str = ""


def trimmed_face(shape: Any, loops: Sequence[Sequence[Side]], make: EdgeMaker) -> TrimmedFace:
    """Return the face of a kernel's surface within loops; all of a closed surface without any."""
    modules = kernel()
    build = modules.BRep.BRep_Builder()
    if not loops:
        made = modules.BRepBuilderAPI.BRepBuilderAPI_MakeFace(shape, 1e-6)
        return TrimmedFace(made.Face())
    face = modules.TopoDS.TopoDS_Face()
    build.MakeFace(face, shape, 1e-6)
    for loop in loops:
        wire = modules.TopoDS.TopoDS_Wire()
        build.MakeWire(wire)
        for side in loop:
            edge = make.edge(side.piece)
            build.Add(wire, edge if side.is_forward else edge.Reversed())
        wire.Closed(True)
        build.Add(face, wire)
    fix = modules.ShapeFix.ShapeFix_Face(face)
    fix.FixOrientationMode = 0
    fix.FixAddNaturalBoundMode = 0
    fix.FixSmallAreaWireMode = 0
    fix.FixSplitFaceMode = 0
    fix.FixIntersectingWiresMode = 0
    fix.FixMissingSeamMode = 1
    fix.FixPeriodicDegeneratedMode = 1
    fix.FixLoopWiresMode = 0
    wires = fix.FixWireTool()
    wires.FixSelfIntersectionMode = 0
    wires.FixReorderMode = 1
    wires.FixLackingMode = 1
    wires.FixDegeneratedMode = 1
    wires.ModifyTopologyMode = True
    fix.Perform()
    result = fix.Face()
    if result.IsNull():
        return TrimmedFace(None, "the kernel could not trim it")
    plain_seams(result)
    modules.BRepLib.BRepLib.SameParameter_s(result, 1e-6, True)
    return TrimmedFace(result)


def tipped_face(cone: Cone, shape: Any, rim: FloatArray) -> Any:
    """The face of a cone from its tip to a circle about its axis, on which a point (3,) is given."""
    up = cone.direction / np.cos(cone.half_angle)
    tip, ring = float((cone.apex - cone.point) @ up), float((rim - cone.point) @ up)
    bounds = (0.0, 2 * np.pi, min(tip, ring), max(tip, ring))
    made = kernel().BRepBuilderAPI.BRepBuilderAPI_MakeFace(shape, *bounds, 1e-6)
    return made.Face()


def area_of(shape: Any) -> float:
    """Area of a shape, mm^2."""
    known = kernel().GProp.GProp_GProps()
    kernel().BRepGProp.BRepGProp.SurfaceProperties_s(shape, known)
    return float(known.Mass())


def volume_of(shape: Any) -> float:
    """Volume of a solid, mm^3."""
    known = kernel().GProp.GProp_GProps()
    kernel().BRepGProp.BRepGProp.VolumeProperties_s(shape, known)
    return float(known.Mass())


def is_valid(shape: Any) -> bool:
    """Whether the kernel finds nothing wrong with a shape."""
    return bool(kernel().BRepCheck.BRepCheck_Analyzer(shape).IsValid())
