# SPDX-License-Identifier: MIT
"""STEP on one page: from fitted regions to trimmed faces, and to a solid where they close."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from completion.export.step.boundaries import OpenEnds, Seams
from completion.export.step.chains import RegionOutlines, directed_edges, outlines_of
from completion.export.step.faces import EdgeMaker, FaceMaker, RegionFaces, is_valid, volume_of
from completion.export.step.folds import FoldFinder
from completion.export.step.kernel import NamedFace, kernel, kernel_errors, kernel_surface, step_bytes
from completion.export.step.limits import MEASURED, SEWING_REACH, SMALL_SHARE
from completion.export.step.pieces import RegionPoints, choose_pieces, corners_of, loops_of, pieces_of
from completion.export.step.regions import MM, PartRegions, drop_regions, in_millimetres, join_regions
from scenes.checks import FloatArray, InputError
from scenes.scan.colour import surface_bytes


@dataclass(frozen=True, slots=True, eq=False)
class FaceOutcome:
    """What became of a region.

    Attributes
    ----------
    number, kind : int, str
        Its surface.
    reason : str
        Why it has no face; empty where it has.
    measured_share : float
        Share of the face's area that was measured.
    sd_m : float
        Standard deviation of the surface along its normal, metres.
    is_open : bool
        Whether the face ends where its measurement does, without a neighbour.
    """

    number: int
    kind: str
    reason: str
    measured_share: float
    sd_m: float
    is_open: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class StepModel:
    """A part as STEP.

    Attributes
    ----------
    data : bytes
        The file.
    shape : kernel shape
        What it holds, millimetres.
    faces : tuple of FaceOutcome
        One a region.
    n_solids, n_open : int
        Solids, and shells or faces that are open.
    volume_m3 : float
        Of the solids.
    is_valid : bool
        Whether the geometry kernel finds nothing wrong.
    gap_m : float
        By how much edges are off the surfaces that they part, at most: 0 where these cross.
    reason : str
        Why it is no solid, in one sentence; empty where it is.
    """

    data: bytes
    shape: Any
    faces: tuple[FaceOutcome, ...]
    n_solids: int
    n_open: int
    volume_m3: float
    is_valid: bool
    gap_m: float
    reason: str

    @property
    def is_solid(self) -> bool:
        """Whether all of it closes."""
        return self.n_solids > 0 and not self.reason

    def record(self) -> dict[str, Any]:
        """Return what summaries hold of it."""
        return {
            "solid": self.is_solid,
            "solids": self.n_solids,
            "open_shells": self.n_open,
            "faces": sum(not face.reason for face in self.faces),
            "regions": len(self.faces),
            "volume_m3": self.volume_m3 if self.n_solids else None,
            "valid": self.is_valid,
            "gap_m": self.gap_m,
            "reason": self.reason or None,
            "open_faces": [face.number for face in self.faces if face.is_open and not face.reason],
            "without_face": [
                {"surface": face.number, "kind": face.kind, "reason": face.reason}
                for face in self.faces
                if face.reason
            ],
        }


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
    """

    shape: Any
    faces: list[Any]
    n_solids: int
    n_open: int
    volume_mm3: float
    is_valid: bool


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
        *_sub_shapes(whole, "TopAbs_SHELL"),
        *map(_shell, _sub_shapes(whole, "TopAbs_FACE", "TopAbs_SHELL")),
    ]
    closed = [shell for shell in shells if modules.BRep.BRep_Tool.IsClosed_s(shell)]
    still_open = [shell for shell in shells if not modules.BRep.BRep_Tool.IsClosed_s(shell)]
    solids = _solids([modules.TopoDS.TopoDS.Shell(closed_shell) for closed_shell in closed])
    parts = [*solids, *still_open]
    shape = parts[0] if len(parts) == 1 else _compound(parts)
    volume = sum(volume_of(solid) for solid in solids)
    is_sound = bool(parts) and is_valid(shape)
    return SewnShape(shape, moved, len(solids), len(still_open), volume_mm3=volume, is_valid=is_sound)


def _sub_shapes(shape: Any, kind: str, without: str | None = None) -> list[Any]:
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


def _compound(parts: Sequence[Any]) -> Any:
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
        turned = _sub_shapes(alone, "TopAbs_SHELL")[0]
        build.Add(solid, turned if place == 0 else turned.Reversed())
    return solid


def _is_within(shell: Any, solid: Any) -> bool:
    modules = kernel()
    vertex = modules.TopoDS.TopoDS.Vertex(_sub_shapes(shell, "TopAbs_VERTEX")[0])
    point = modules.BRep.BRep_Tool.Pnt_s(vertex)
    asked = modules.BRepClass3d.BRepClass3d_SolidClassifier(solid, point, 1e-6)
    return bool(asked.State() == modules.TopAbs.TopAbs_State.TopAbs_IN)


_MOST_TOLD = 3
_SMALL = (12, 30, 100)  # points, and share of all, of a region that may be left out
_FAULTS = "the geometry kernel finds faults in the shape"
_CROSSED = "too small to be trimmed: its neighbours were extended across it"


def step_of(parts: PartRegions, name: str = "part") -> StepModel:
    """Return a part as STEP: analytic faces trimmed where their surfaces meet, sewn, a solid if they close.

    After Benko, Martin & Varady (2001), Algorithms for reverse engineering boundary representation models,
    section 7: surfaces are trimmed by their intersections with their neighbours in the region adjacency.
    What no region measured is not closed.

    Parameters
    ----------
    parts : PartRegions
        Surfaces where their relations hold, their points and contacts; metres.
    name : str
        What the part is called in the file.

    Returns
    -------
    StepModel
        The file in millimetres, and what is to be known of it.

    Raises
    ------
    InputError
        OCP is not installed (the message names the cure), or no region can be trimmed.
    """
    kernel()
    whole, left_out = join_regions(parts), list[FaceOutcome]()
    best = _attempt(whole)
    for most in _SMALL:
        small = _small_failures(whole, best.outcomes, most)
        if not small:
            continue
        fewer = drop_regions(whole, small)
        again = _attempt(fewer)
        if again.n_held < best.n_held or again.n_failed + len(small) > best.n_failed:
            continue
        left_out += [replace(best.outcomes[k], reason=_CROSSED) for k in small]
        whole, best = fewer, again
    return _model(best, tuple(left_out), name)


class _Attempt(NamedTuple):
    """What an export comes to: faces, whose region each is, outcomes of all regions, the edges' gap (mm).

    And the sampling distance (mm), and how many points are of regions that have a face.
    """

    faces: list[Any]
    regions: list[int]
    outcomes: tuple[FaceOutcome, ...]
    gap: float
    spacing: float
    n_held: int

    @property
    def n_failed(self) -> int:
        """Regions without a face."""
        return sum(bool(outcome.reason) for outcome in self.outcomes)


def _attempt(parts: PartRegions) -> _Attempt:
    """Trim the surfaces of all regions."""
    # 1. Regions: all in millimetres from here on.
    surfaces = [in_millimetres(region.surface) for region in parts.regions]
    points = [parts.points[parts.region == k] * MM for k in range(len(surfaces))]
    spacing = parts.spacing_m * MM

    # 2.-5. Curves of folds, their pieces between corners, and the loops of these around regions.
    finder = FoldFinder(
        surfaces, [kernel_surface(surface) for surface in surfaces], spacing, parts.noise_m * MM
    )
    edges = None if parts.mesh is None else directed_edges(parts.mesh)
    if parts.mesh is None or edges is None:
        curves, kept, corners, loops, is_open, reasons = _from_contacts(parts, finder, points)
    else:
        mesh, numbers = (
            parts.mesh._replace(vertices=parts.mesh.vertices * MM),
            [r.number for r in parts.regions],
        )
        curves, kept, corners, loops, is_open, reasons = outlines_of(edges, mesh, finder, numbers)

    # 6. Seams: where surfaces that return to themselves are cut open.
    seams = Seams(kept, curves, surfaces)
    for surface, point in zip(surfaces, loops, strict=True):
        seams.begin_on_tubes(surface, point.closed)
    shapes = [
        seams.shape(surface, point, loop.closed)
        for surface, point, loop in zip(surfaces, points, loops, strict=True)
    ]

    # 7. Faces: each surface within its loops; what does not hold its region's points is none.
    make = EdgeMaker(seams.pieces, curves, corners, surfaces)
    maker = FaceMaker(parts, make, spacing)
    trimmed = [
        RegionFaces([], reason=reasons[k]) if k in reasons else maker.faces(surface, shape, loop, point)
        for k, (surface, shape, loop, point) in enumerate(zip(surfaces, shapes, loops, points, strict=True))
    ]
    outcomes = tuple(
        FaceOutcome(
            region.number,
            region.surface.kind,
            faces.reason,
            faces.measured,
            sd_m=region.sd_m,
            is_open=ends_open,
        )
        for region, faces, ends_open in zip(parts.regions, trimmed, is_open, strict=True)
    )
    gap = max((make.off(piece) for piece in seams.pieces), default=0.0)
    faces = [(face, k) for k, faces in enumerate(trimmed) for face in faces.faces]
    held = sum(len(point) for point, faces in zip(points, trimmed, strict=True) if faces.faces)
    return _Attempt(
        [face for face, _ in faces], [k for _, k in faces], outcomes, gap=gap, spacing=spacing, n_held=held
    )


def _from_contacts(parts: PartRegions, finder: FoldFinder, points: Sequence[FloatArray]) -> RegionOutlines:
    """Loops of regions whose neighbours are known by near points alone."""
    # 2. Folds: the curves in which neighbours cross, or touch where they are tangent.
    surfaces, spacing, contacts = finder.surfaces, finder.spacing, parts.contacts * MM
    curves = [
        curve
        for pair in np.unique(parts.between, axis=0).tolist()
        for curve in finder.curves_between((pair[0], pair[1]), contacts[(parts.between == pair).all(axis=1)])
    ]

    # 3. Corners: where the folds of one surface meet.
    corners = corners_of(curves, spacing)

    # 4. Pieces between corners, and the choice of those that close around regions along their contacts.
    pieces = pieces_of(curves, corners, contacts, parts.between, spacing)
    kept = choose_pieces(pieces, curves, corners, spacing)

    # 5. Loops: pieces in order around each region, which lies on their left; open ends close as measured.
    near = [RegionPoints(point, spacing) for point in points]
    loops = [loops_of(k, kept, curves, surface, near[k]) for k, surface in enumerate(surfaces)]

    ends = OpenEnds(kept, curves, corners, surfaces, spacing)
    is_open = [False] * len(surfaces)
    for k, point in enumerate(points):
        loops[k], is_open[k] = ends.close_loops(k, loops[k], point)
    return RegionOutlines(curves, kept, corners, loops, is_open, {})


def _small_failures(parts: PartRegions, outcomes: Sequence[FaceOutcome], most: int) -> list[int]:
    """Places of regions without a face that are so small that their neighbours may be extended across."""
    size = np.bincount(parts.region, minlength=len(parts.regions))
    least = min(most, SMALL_SHARE * size.sum())
    return [k for k, outcome in enumerate(outcomes) if outcome.reason and size[k] <= least]


def _model(best: _Attempt, left_out: tuple[FaceOutcome, ...], name: str) -> StepModel:
    """Sew the faces, and write the file."""
    # 8. Shells and solids, and the file.
    n = len(best.outcomes)
    reason = _failure_text(best.outcomes, n)
    if not best.faces:
        raise InputError(f"no surface could be trimmed for STEP: {reason}")
    try:
        whole = sewn(best.faces, best.spacing, best.gap)
    except kernel_errors() as error:
        raise InputError(f"the geometry kernel could not sew the part: {error}") from None
    named = [
        NamedFace(face, _name(best.outcomes[k]), _layer(best.outcomes[k]), _colour(k))
        for face, k in zip(whole.faces, best.regions, strict=True)
    ]
    if not reason and whole.n_open:
        reason = "the faces do not meet along all of their edges"
    if not whole.is_valid:
        reason = f"{reason}; {_FAULTS}" if reason else _FAULTS
    return StepModel(
        data=step_bytes(whole.shape, named, name),
        shape=whole.shape,
        faces=(*best.outcomes, *left_out),
        n_solids=whole.n_solids,
        n_open=whole.n_open,
        volume_m3=whole.volume_mm3 / MM**3,
        is_valid=whole.is_valid,
        gap_m=round(best.gap / MM, 12),
        reason=reason,
    )


def _failure_text(outcomes: Sequence[FaceOutcome], n: int) -> str:
    """Which surfaces have no face, and why, in one sentence."""
    failed = [outcome for outcome in outcomes if outcome.reason]
    free = [str(outcome.number) for outcome in outcomes if outcome.is_open and not outcome.reason]
    if not failed and free:
        whose = f"surface {free[0]} ends" if len(free) == 1 else f"surfaces {', '.join(free)} end"
        return f"{whose} where the measurement does, without a neighbour"
    if not failed:
        return ""
    sentence = "; ".join(
        f"surface {outcome.number} ({outcome.kind}): {outcome.reason}" for outcome in failed[:_MOST_TOLD]
    )
    more = f"; and {len(failed) - _MOST_TOLD} more" if len(failed) > _MOST_TOLD else ""
    return f"{len(failed)} of {n} surfaces could not be trimmed: {sentence}{more}"


def _name(outcome: FaceOutcome) -> str:
    sd = f"sd {1e6 * outcome.sd_m:.3g} um"
    end = ", open end" if outcome.is_open else ""
    return (
        f"surface {outcome.number} {outcome.kind}, {100 * outcome.measured_share:.0f} % measured, {sd}{end}"
    )


def _layer(outcome: FaceOutcome) -> str:
    return "MEASURED" if outcome.measured_share >= MEASURED else "PARTLY-INFERRED"


def _colour(place: int) -> tuple[int, int, int]:
    red, green, blue = surface_bytes(np.array([place + 1]))[0].tolist()
    return red, green, blue
