# SPDX-License-Identifier: MIT
"""Seam edges as lines and circles: the kernel makes splines of them where it cuts a surface open."""

from __future__ import annotations

from typing import Any

import numpy as np

from completion.exchange.step.curves.kernel import kernel

_STRAIGHT = 1e-9  # radians or mm that a seam may leave its parameter


def plain_seams(face: Any) -> None:
    """Give the seam edges of a face the surface's own lines and circles, in place."""
    modules = kernel()
    tool = modules.BRep.BRep_Tool
    walk = modules.TopExp.TopExp_Explorer(face, modules.TopAbs.TopAbs_ShapeEnum.TopAbs_EDGE)
    done = list[Any]()
    while walk.More():
        edge = modules.TopoDS.TopoDS.Edge(walk.Current())
        walk.Next()
        if any(edge.IsSame(one) for one in done):
            continue
        done.append(edge)
        if not tool.Degenerated_s(edge) and tool.IsClosed_s(edge, face):
            _straighten(edge, face)


def _straighten(edge: Any, face: Any) -> None:
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
    still = np.flatnonzero(np.abs(end - begin) < _STRAIGHT)
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
