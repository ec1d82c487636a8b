# SPDX-License-Identifier: MIT
"""Sewing: faces joined along the edges that they share, shells that close as solids with their cavities."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from completion.export.step.faces import edge_points, is_valid, volume_of
from completion.export.step.kernel import kernel
from completion.export.step.limits import SEWING_REACH
from scenes.card import shown
from scenes.checks import FloatArray


@shown
class OpenEdge(NamedTuple):
    """An edge at which a shell is open: the place of its face, its middle (3,) and its length, mm."""

    face: int
    middle: FloatArray
    length: float


@dataclass(frozen=True, slots=True, eq=False)
class SewnShape:
    """A part's shape: solids where it closes, else open shells, mm.

    Attributes
    ----------
    shape : kernel shape
        A solid, a shell, a face, or a compound of these.
    faces : list of kernel faces
        What became of each face that was given.
    n_solids, n_open : int
        Solids, and shells or faces that are open.
    volume_mm3 : float
        Of all solids.
    is_valid : bool
        Whether the kernel finds nothing wrong with it.
    open_edges : list of OpenEdge
        Edges of one face only, in the order of the faces.
    """

    shape: Any
    faces: list[Any]
    n_solids: int
    n_open: int
    volume_mm3: float
    is_valid: bool
    open_edges: list[OpenEdge]


def sewn(faces: Sequence[Any], spacing: float, gap: float) -> SewnShape:
    """Sew faces along the edges that they share, and make solids of the shells that close.

    Edges may be `gap` off their surfaces, mm. A shell within another one is a cavity of that.
    """
    modules = kernel()
    sewing = modules.BRepBuilderAPI.BRepBuilderAPI_Sewing(max(SEWING_REACH * spacing, 4 * gap))
    for face in faces:
        sewing.Add(face)
    sewing.Perform()
    whole = sewing.SewedShape()
    moved = [sewing.ModifiedSubShape(face) if sewing.IsModifiedSubShape(face) else face for face in faces]
    shells = [
        *sub_shapes(whole, "TopAbs_SHELL"),
        *map(_shell, sub_shapes(whole, "TopAbs_FACE", "TopAbs_SHELL")),
    ]
    closed = [shell for shell in shells if modules.BRep.BRep_Tool.IsClosed_s(shell)]
    still_open = [shell for shell in shells if not modules.BRep.BRep_Tool.IsClosed_s(shell)]
    solids = _solids([modules.TopoDS.TopoDS.Shell(closed_shell) for closed_shell in closed])
    parts = [*solids, *still_open]
    shape = parts[0] if len(parts) == 1 else compound(parts)
    volume = sum(volume_of(solid) for solid in solids)
    is_sound = bool(parts) and is_valid(shape)
    return SewnShape(
        shape,
        moved,
        len(solids),
        len(still_open),
        volume_mm3=volume,
        is_valid=is_sound,
        open_edges=_open_edges(moved) if still_open else [],
    )


def numbered_edges(faces: Sequence[Any]) -> list[list[tuple[int, Any]]]:
    """The edges of each face that have a length, each with its number: faces that meet have one in common."""
    known = kernel().collections.IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher()
    return [
        [
            (known.Add(edge), edge)
            for edge in map(kernel().TopoDS.TopoDS.Edge, sub_shapes(face, "TopAbs_EDGE"))
            if not kernel().BRep.BRep_Tool.Degenerated_s(edge)
        ]
        for face in faces
    ]


def _open_edges(faces: Sequence[Any]) -> list[OpenEdge]:
    """The edges that faces share neither with others nor, as seams, with themselves."""
    edges = numbered_edges(faces)
    times = Counter(number for own in edges for number, _ in own)
    return [
        OpenEdge(place, *_middle(edge))
        for place, own in enumerate(edges)
        for number, edge in own
        if times[number] == 1
    ]


def _middle(edge: Any) -> tuple[FloatArray, float]:
    """The place (3,) halfway along an edge, and its length, mm."""
    points = edge_points(edge)
    return points[len(points) // 2], float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def sub_shapes(shape: Any, kind: str, without: str | None = None) -> list[Any]:
    """The sub-shapes of a kind, those within others of a second kind left out."""
    modules, kinds = kernel(), kernel().TopAbs.TopAbs_ShapeEnum
    walk = (
        modules.TopExp.TopExp_Explorer(shape, getattr(kinds, kind))
        if without is None
        else modules.TopExp.TopExp_Explorer(shape, getattr(kinds, kind), getattr(kinds, without))
    )
    shapes = list[Any]()
    while walk.More():
        shapes.append(walk.Current())
        walk.Next()
    return shapes


def _shell(face: Any) -> Any:
    """A shell of one face."""
    made, build = kernel().TopoDS.TopoDS_Shell(), kernel().BRep.BRep_Builder()
    build.MakeShell(made)
    build.Add(made, face)
    return made


def compound(parts: Sequence[Any]) -> Any:
    """A compound of shapes."""
    made, build = kernel().TopoDS.TopoDS_Compound(), kernel().BRep.BRep_Builder()
    build.MakeCompound(made)
    for part in parts:
        build.Add(made, part)
    return made


def _solids(shells: Sequence[Any]) -> list[Any]:
    """A solid of each closed shell; shells within it are its cavities."""
    alone = [_solid([shell]) for shell in shells]
    order = sorted(range(len(alone)), key=lambda k: -volume_of(alone[k]))
    cavities = dict[int, list[int]]()
    outer = list[int]()
    for k in order:
        around = [n for n in outer if _is_within(shells[k], alone[n])]
        if around:
            cavities.setdefault(around[-1], []).append(k)
        else:
            outer.append(k)
    return [_solid([shells[k], *(shells[n] for n in cavities.get(k, ()))]) for k in sorted(outer)]


def _solid(shells: Sequence[Any]) -> Any:
    """A solid of an outer shell and its cavities."""
    modules = kernel()
    if len(shells) == 1:
        solid = modules.BRepBuilderAPI.BRepBuilderAPI_MakeSolid(shells[0]).Solid()
        modules.BRepLib.BRepLib.OrientClosedSolid_s(solid)
        return solid
    solid = modules.TopoDS.TopoDS_Solid()
    build = modules.BRep.BRep_Builder()
    build.MakeSolid(solid)
    for place, shell in enumerate(shells):
        alone = _solid([shell])
        turned = sub_shapes(alone, "TopAbs_SHELL")[0]
        build.Add(solid, turned if place == 0 else turned.Reversed())
    return solid


def _is_within(shell: Any, solid: Any) -> bool:
    modules = kernel()
    vertex = modules.TopoDS.TopoDS.Vertex(sub_shapes(shell, "TopAbs_VERTEX")[0])
    point = modules.BRep.BRep_Tool.Pnt_s(vertex)
    asked = modules.BRepClass3d.BRepClass3d_SolidClassifier(solid, point, 1e-6)
    return bool(asked.State() == modules.TopAbs.TopAbs_State.TopAbs_IN)
