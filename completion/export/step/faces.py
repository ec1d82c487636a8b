# SPDX-License-Identifier: MIT
"""Faces: a region's surface within its loops, kept where it holds the region's points and little else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from completion.export.step import limits
from completion.export.step.folds import ContactCurve
from completion.export.step.kernel import kernel, kernel_errors, kernel_point, winding_number
from completion.export.step.pieces import (
    CurveCorner,
    CurvePiece,
    LoopSide,
    RegionLoops,
    loop_points,
    nest_loops,
)
from completion.export.step.regions import PartRegions, place_text
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Cone, Sphere, Surface, Torus

_MOST_SAMPLES = 20_000
_TURN = 0.3  # radians between triangles


class FaceShares(NamedTuple):
    """Share of a face's area near its region's points, and share of the points near the face."""

    measured: float
    held: float


def shares_of(face: Any, points: FloatArray, spacing: float) -> FaceShares:
    """Return what of a face was measured by the points (n, 3) of its region, mm."""
    corners, triangles = triangles_of(face, 0.2 * spacing)
    if not len(triangles):
        return FaceShares(0.0, 0.0)
    samples = _sample_triangles(corners[triangles], spacing)
    near = cKDTree(points).query(samples)[0] <= limits.MEASURED_REACH * spacing
    held = cKDTree(samples).query(points)[0] <= limits.MEASURED_REACH * spacing
    return FaceShares(float(near.mean()), float(held.mean()))


def triangles_of(shape: Any, sag: float) -> tuple[FloatArray, IntArray]:
    """Corners (n, 3) and triangles (m, 3) of a shape, off it by at most `sag`, mm."""
    modules = kernel()
    modules.BRepMesh.BRepMesh_IncrementalMesh(shape, sag, False, _TURN, False)
    corners, triangles, first = list[tuple[float, float, float]](), list[tuple[int, int, int]](), 0
    walk = modules.TopExp.TopExp_Explorer(shape, modules.TopAbs.TopAbs_ShapeEnum.TopAbs_FACE)
    while walk.More():
        face = modules.TopoDS.TopoDS.Face(walk.Current())
        net = modules.BRep.BRep_Tool.Triangulation_s(face, modules.TopLoc.TopLoc_Location())
        walk.Next()
        if net is None:
            continue
        corners += [net.Node(k).Coord() for k in range(1, net.NbNodes() + 1)]
        is_turned = face.Orientation() == modules.TopAbs.TopAbs_Orientation.TopAbs_REVERSED
        for k in range(1, net.NbTriangles() + 1):
            a, b, c = (first + net.Triangle(k).Value(n) - 1 for n in (1, 2, 3))
            triangles.append((a, c, b) if is_turned else (a, b, c))
        first = len(corners)
    return np.array(corners).reshape(-1, 3), np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _sample_triangles(corners: FloatArray, spacing: float) -> FloatArray:
    """Points (k, 3) spread over triangles (m, 3, 3), about a sampling distance apart."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.cumsum(np.linalg.norm(across, axis=1) / 2)
    n = int(np.clip(total[-1] / spacing**2, 200, _MOST_SAMPLES))
    triangle = np.minimum(np.searchsorted(total, (np.arange(n) + 0.5) / n * total[-1]), len(corners) - 1)
    index = np.arange(1, n + 1)
    a, b = (0.5 + index / 1.324717957244746) % 1.0, (0.5 + index / 1.324717957244746**2) % 1.0
    over = a + b > 1
    a, b = np.where(over, 1 - a, a)[:, None], np.where(over, 1 - b, b)[:, None]
    sample = corners[triangle]
    return np.asarray(sample[:, 0] + a * (sample[:, 1] - sample[:, 0]) + b * (sample[:, 2] - sample[:, 0]))


def edges_of(shape: Any, n: int = 30) -> list[FloatArray]:
    """Points (n, 3) along each edge of a shape, mm."""
    modules, edges = kernel(), list[FloatArray]()
    walk = modules.TopExp.TopExp_Explorer(shape, modules.TopAbs.TopAbs_ShapeEnum.TopAbs_EDGE)
    while walk.More():
        edge = modules.TopoDS.TopoDS.Edge(walk.Current())
        walk.Next()
        if not modules.BRep.BRep_Tool.Degenerated_s(edge):
            edges.append(edge_points(edge, n))
    return edges


def edge_points(edge: Any, n: int = 101) -> FloatArray:
    """Points (n, 3) along an edge, mm."""
    curve = kernel().BRepAdaptor.BRepAdaptor_Curve(edge)
    t = np.linspace(curve.FirstParameter(), curve.LastParameter(), n)
    return np.array([curve.Value(float(parameter)).Coord() for parameter in t])


def plain_seams(face: Any) -> None:
    """Give the seam edges of a face the surface's own lines and circles, in place."""
    modules = kernel()
    tool = modules.BRep.BRep_Tool
    walk = modules.TopExp.TopExp_Explorer(face, modules.TopAbs.TopAbs_ShapeEnum.TopAbs_EDGE)
    done = list[Any]()
    while walk.More():
        edge = modules.TopoDS.TopoDS.Edge(walk.Current())
        walk.Next()
        if any(edge.IsSame(known_edge) for known_edge in done):
            continue
        done.append(edge)
        if not tool.Degenerated_s(edge) and tool.IsClosed_s(edge, face):
            _straighten_edge(edge, face)


def _straighten_edge(edge: Any, face: Any) -> None:
    modules = kernel()
    tool, flags = modules.BRep.BRep_Tool, modules.TopAbs.TopAbs_Orientation
    surface = tool.Surface_s(face)
    first, last = _range(edge)
    sides = [
        tool.CurveOnSurface_s(modules.TopoDS.TopoDS.Edge(edge.Oriented(flag)), face, 0.0, 0.0)
        for flag in (flags.TopAbs_FORWARD, flags.TopAbs_REVERSED)
    ]
    if any(side is None for side in sides):
        return
    begin, end = (np.array(sides[0].Value(at).Coord()) for at in (first, last))
    other = np.array(sides[1].Value(first).Coord())
    still = np.flatnonzero(np.abs(end - begin) < limits.TRACING_EXACT)
    if len(still) != 1:
        return
    held, runs = int(still[0]), 1 - int(still[0])
    iso = surface.UIso(float(begin[0])) if held == 0 else surface.VIso(float(begin[1]))
    while isinstance(iso, modules.Geom.Geom_TrimmedCurve):
        iso = iso.BasisCurve()
    origin, sense = 0.0, 1.0
    low, high = float(begin[runs]), float(end[runs])
    if low > high:
        origin, sense = iso.ReversedParameter(0.0), -1.0
        low, high = origin - low, origin - high
        iso = iso.Reversed()
    lines = [_line(held, value, origin, sense) for value in (float(begin[held]), float(other[held]))]
    build = modules.BRep.BRep_Builder()
    tolerance = tool.Tolerance_s(edge)
    build.UpdateEdge(edge, iso, tolerance)
    build.UpdateEdge(edge, *lines, face, tolerance)
    build.Range(edge, low, high)


def _range(edge: Any) -> tuple[float, float]:
    """The range of an edge's parameter."""
    known = kernel().BRepAdaptor.BRepAdaptor_Curve(edge)
    return float(known.FirstParameter()), float(known.LastParameter())


def _line(held: int, value: float, origin: float, sense: float) -> Any:
    """The line in a surface's parameters on which one of them is held."""
    gp, place, along = kernel().gp, [0.0, 0.0], [0.0, 0.0]
    place[held], place[1 - held], along[1 - held] = value, origin, sense
    return kernel().Geom2d.Geom2d_Line(gp.gp_Pnt2d(*place), gp.gp_Dir2d(*along))


_N_CHECKED = 23  # points of an edge at which its distance from the surfaces is taken


class EdgeMaker:
    """Makes each edge and each corner once, so that faces share them."""

    def __init__(
        self,
        pieces: Sequence[CurvePiece],
        curves: Sequence[ContactCurve],
        corners: Sequence[CurveCorner],
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

    def off(self, piece: CurvePiece) -> float:
        """How far a piece is off its surfaces, mm."""
        curve = self.curves[piece.curve]
        points = curve.at(np.linspace(piece.low, piece.high, _N_CHECKED))
        return max(float(np.abs(self.surfaces[number].distance(points)).max()) for number in curve.pair)

    def edge(self, place: int) -> Any:
        """The edge of a piece, running as its curve does."""
        if place not in self._edges:
            self._edges[place] = self._make_edge(self.pieces[place])
        return self._edges[place]

    def _make_edge(self, piece: CurvePiece) -> Any:
        curve, build = self.curves[piece.curve], kernel().BRep.BRep_Builder()
        tolerance = max(1.5 * self.off(piece), limits.TOLERANCE)
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


def trimmed_face(shape: Any, loops: Sequence[Sequence[LoopSide]], make: EdgeMaker) -> TrimmedFace:
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


class RegionFaces(NamedTuple):
    """The faces of a region, the share of them that was measured, and why there are none."""

    faces: list[Any]
    measured: float = 0.0
    reason: str = ""


class FaceMaker:
    """Makes the faces of regions; lengths of surfaces, shapes and points in millimetres."""

    def __init__(self, parts: PartRegions, make: EdgeMaker, spacing: float) -> None:
        self.parts, self.make, self.spacing = parts, make, spacing

    def faces(self, surface: Surface, shape: Any, loops: RegionLoops, points: FloatArray) -> RegionFaces:
        """The faces of a region of points (n, 3), or why there are none."""
        if loops.open_chains:
            return RegionFaces([], reason=self._open_between(loops.open_chains))
        try:
            made = self._make_faces(surface, shape, loops, points)
            return made if made.reason else self._check_faces(made, points, is_bounded=bool(loops.closed))
        except kernel_errors():
            return RegionFaces([], reason="the kernel could not trim it")

    def _open_between(self, chains: Sequence[Sequence[LoopSide]]) -> str:
        """Between which surfaces a boundary is open."""
        ends = [side for chain in chains for side in (chain[0], chain[-1])]
        curves, pieces = self.make.curves, self.make.pieces
        places = {place for side in ends for place in curves[pieces[side.piece].curve].pair}
        numbers = ", ".join(
            str(number) for number in sorted(self.parts.regions[place].number for place in places)
        )
        corner = pieces[ends[0].piece].ends[0 if ends[0].is_forward else 1]
        place = f" near {place_text(self.make.corners[corner].point)}" if corner >= 0 else ""
        return f"its boundary is open where surfaces {numbers} should meet{place}"

    def _make_faces(
        self, surface: Surface, shape: Any, loops: RegionLoops, points: FloatArray
    ) -> RegionFaces:
        make = self.make
        if not loops.closed:
            size = getattr(surface, "tube_radius", getattr(surface, "radius", 0.0))
            if not isinstance(surface, Sphere | Torus) or size < limits.FAR_REACH * self.spacing:
                return RegionFaces([], reason="no fold with a neighbour bounds it")
            return RegionFaces([trimmed_face(shape, [], make).face])
        if isinstance(surface, Cone) and len(loops.closed) == 1:
            rim = self._rim(surface, loops.closed[0])
            if rim is not None:
                return RegionFaces([tipped_face(surface, shape, rim)])
        groups = nest_loops(surface, loops.closed, make.pieces, make.curves, points)
        faces = [trimmed_face(shape, group, make) for group in groups]
        failed = [face.reason for face in faces if face.face is None]
        if failed or not faces:
            return RegionFaces([], reason=failed[0] if failed else "its loops enclose none of its points")
        return RegionFaces([face.face for face in faces])

    def _rim(self, cone: Cone, loop: Sequence[LoopSide]) -> FloatArray | None:
        """A point (3,) of a loop round a cone's axis that all lies at one height; None of others."""
        points = loop_points(loop, self.make.pieces, self.make.curves)
        height = (points - cone.point) @ cone.direction
        if np.ptp(height) > 1e-6 or not winding_number(cone.point, cone.direction, points):
            return None
        first: FloatArray = points[0]
        return first

    def _check_faces(self, made: RegionFaces, points: FloatArray, *, is_bounded: bool) -> RegionFaces:
        """The faces, if they hold their points, and were measured."""
        if not all(is_valid(face) for face in made.faces):
            return RegionFaces([], reason="the kernel finds its trimmed face invalid")
        shares = [shares_of(face, points, self.spacing) for face in made.faces]
        held = sum(share.held for share in shares)
        if held < limits.MAJORITY:
            return RegionFaces([], reason=f"its loops enclose only {100 * held:.0f} % of its points")
        areas = [area_of(face) for face in made.faces]
        measured = float(np.average([share.measured for share in shares], weights=areas))
        if measured < (limits.MAJORITY if is_bounded else limits.MEASURED):
            where = "within its loops" if is_bounded else "of it, which no neighbour bounds,"
            return RegionFaces([], reason=f"only {100 * measured:.0f} % {where} was measured")
        return RegionFaces(made.faces, measured)
