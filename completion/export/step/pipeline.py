# SPDX-License-Identifier: MIT
"""STEP on one page: from fitted regions to trimmed faces, and to a solid where they close."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from completion.export.step.boundaries import OpenEnds, Seams
from completion.export.step.chains import RegionOutlines, directed_edges, outlines_of
from completion.export.step.faces import EdgeMaker, FaceMaker, RegionFaces
from completion.export.step.feature_tree import FaceGroup, feature_tree, names_by_surface
from completion.export.step.folds import FoldFinder
from completion.export.step.kernel import (
    NamedFace,
    NamedShape,
    kernel,
    kernel_errors,
    kernel_surface,
    step_bytes,
)
from completion.export.step.limits import MEASURED, SMALL_SHARE
from completion.export.step.pieces import RegionPoints, choose_pieces, corners_of, loops_of, pieces_of
from completion.export.step.regions import (
    MM,
    PartRegions,
    drop_regions,
    false_volume,
    in_millimetres,
    join_regions,
    place_text,
)
from completion.export.step.sewing import OpenEdge, SewnShape, sewn
from scenes.checks import FloatArray, InputError, Value


@dataclass(frozen=True, slots=True, eq=False)
class FaceOutcome(Value):
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
    open_at : (3,) float, optional
        Where the face ends without a neighbour, as its measurement does, millimetres.
    extended : tuple of int
        Numbers of surfaces without a face that this one was extended across.
    inferred : str
        What of it was not measured and why it is there, as of `FittedRegion`.
    """

    number: int
    kind: str
    reason: str
    measured_share: float
    sd_m: float
    open_at: FloatArray | None = None
    extended: tuple[int, ...] = ()
    inferred: str = ""

    @property
    def is_guessed(self) -> bool:
        """Whether it goes on where nothing was measured, but for gaps as between points."""
        return self.measured_share < MEASURED or bool(self.extended or self.inferred)

    @property
    def is_open(self) -> bool:
        """Whether it ends without a neighbour."""
        return self.open_at is not None


@dataclass(frozen=True, slots=True, eq=False)
class StepModel(Value):
    """A part as STEP.

    Attributes
    ----------
    data : bytes
        The file.
    feature_data : bytes, optional
        A second file with the tree of the features that were named; None where none of them has a face.
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
    open_edges : tuple of OpenEdge
        Where shells are open; faces are the numbers of their surfaces.
    """

    data: bytes
    feature_data: bytes | None
    shape: Any
    faces: tuple[FaceOutcome, ...]
    n_solids: int
    n_open: int
    volume_m3: float
    is_valid: bool
    gap_m: float
    reason: str
    open_edges: tuple[OpenEdge, ...] = ()

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
            "open_edges": [
                {"surface": edge.face, "at_m": (edge.middle / MM).tolist(), "length_m": edge.length / MM}
                for edge in self.open_edges
            ],
            "open_faces": [face.number for face in self.faces if face.is_open and not face.reason],
            "without_face": [
                {"surface": face.number, "kind": face.kind, "reason": face.reason}
                for face in self.faces
                if face.reason
            ],
            "inferred_faces": [face.number for face in self.faces if face.is_guessed and not face.reason],
        }


FILLED = "gap in the mesh inferred"
"""What a face says whose surface closed a hole of the mesh."""
_MOST_TOLD = 3
_SMALL = (12, 30, 100)  # points, and share of all, of a region that may be left out
_FAULTS = "the geometry kernel finds faults in the shape"
_CROSSED = "too small to be trimmed: its neighbours were extended across it"


def step_of(parts: PartRegions, name: str = "part", features: Sequence[FaceGroup] = ()) -> StepModel:
    """Return a part as STEP: analytic faces trimmed where their surfaces meet, sewn, a solid if they close.

    After Benko, Martin & Varady (2001), Algorithms for reverse engineering boundary representation models,
    section 7: surfaces are trimmed by their intersections with their neighbours in the region adjacency.
    What no region measured is not closed, but for gaps in a model's mesh that its surfaces determine.

    Parameters
    ----------
    parts : PartRegions
        Surfaces where their relations hold, their points and contacts; metres.
    name : str
        What the part is called in the file.
    features : sequence of FaceGroup
        Features by the numbers of their surfaces: named in the faces, and a tree in a second file.

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
    torn = [outcome.number for outcome in best.outcomes if outcome.is_open]
    if whole.mesh is not None and torn and (whole.mesh.region >= 0).all():
        whole, best = _mended(whole, best, torn)
    for most in () if whole.mesh is not None else _SMALL:
        small = _small_failures(whole, best.outcomes, most)
        if not small:
            continue
        fewer = drop_regions(whole, small)
        again = _attempt(fewer)
        if again.n_held < best.n_held or again.n_failed + len(small) > best.n_failed:
            continue
        left_out += [replace(best.outcomes[k], reason=_CROSSED) for k in small]
        across = {n: _beside(whole, small, n) for n in (region.number for region in fewer.regions)}
        kept = {outcome.number: outcome.extended for outcome in best.outcomes}
        told = [replace(one, extended=(*kept[one.number], *across[one.number])) for one in again.outcomes]
        whole, best = fewer, again._replace(outcomes=tuple(told))
    return _model(best, tuple(left_out), whole, NamedShape(name), features)


def _mended(parts: PartRegions, best: _Attempt, torn: Sequence[int]) -> tuple[PartRegions, _Attempt]:
    """Regions of a model without its mesh, which tore some, where their points close all; else as given."""
    apart = drop_regions(parts, ())
    again = _attempt(apart)
    if any(outcome.reason or outcome.is_open for outcome in again.outcomes):
        return parts, best
    told = [
        replace(one, inferred=one.inferred or FILLED) if one.number in torn else one for one in again.outcomes
    ]
    return apart, again._replace(outcomes=tuple(told))


def _beside(parts: PartRegions, small: Sequence[int], number: int) -> tuple[int, ...]:
    """Numbers of some regions, by place, that touch the one of a number."""
    place = next(k for k, region in enumerate(parts.regions) if region.number == number)
    beside = set(parts.between[(parts.between == place).any(axis=1)].ravel().tolist())
    return tuple(parts.regions[k].number for k in small if k in beside)


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
        curves, kept, corners, loops, open_at, reasons = _from_contacts(parts, finder, points)
    else:
        mesh, numbers = (
            parts.mesh._replace(vertices=parts.mesh.vertices * MM),
            [r.number for r in parts.regions],
        )
        curves, kept, corners, loops, open_at, reasons = outlines_of(edges, mesh, finder, numbers)

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
            faces.measured * region.measured_share,
            sd_m=region.sd_m,
            open_at=ends_at,
            inferred=region.inferred,
        )
        for region, faces, ends_at in zip(parts.regions, trimmed, open_at, strict=True)
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
    open_at: list[FloatArray | None] = [None] * len(surfaces)
    for k, point in enumerate(points):
        loops[k], open_at[k] = ends.close_loops(k, loops[k], point)
    return RegionOutlines(curves, kept, corners, loops, open_at=open_at, reasons={})


def _small_failures(parts: PartRegions, outcomes: Sequence[FaceOutcome], most: int) -> list[int]:
    """Places of regions without a face that are so small that their neighbours may be extended across."""
    size = np.bincount(parts.region, minlength=len(parts.regions))
    least = min(most, SMALL_SHARE * size.sum())
    return [k for k, outcome in enumerate(outcomes) if outcome.reason and size[k] <= least]


def _model(
    best: _Attempt,
    left_out: tuple[FaceOutcome, ...],
    parts: PartRegions,
    product: NamedShape,
    features: Sequence[FaceGroup],
) -> StepModel:
    """Sew the faces, and write the file, and that of the features."""
    # 8. Shells and solids, and the files.
    if not best.faces:
        raise InputError(f"no surface could be trimmed for STEP: {_failure_text(best.outcomes)}")
    try:
        whole = sewn(best.faces, best.spacing, best.gap)
    except kernel_errors() as error:
        raise InputError(f"the geometry kernel could not sew the part: {error}") from None
    is_free = {best.regions[edge.face] for edge in whole.open_edges}
    closed = [one if k in is_free else replace(one, open_at=None) for k, one in enumerate(best.outcomes)]
    best = best._replace(outcomes=tuple(closed))  # ends that two faces share are no open ones
    reason = _failure_text(best.outcomes)
    numbers = [best.outcomes[k].number for k in best.regions]
    open_edges = tuple(edge._replace(face=numbers[edge.face]) for edge in whole.open_edges)
    if whole.n_open and not any(one.is_open for one in best.outcomes if not one.reason):
        reason = f"{reason}; {_open_text(open_edges)}" if reason else _open_text(open_edges)
    reason = reason or false_volume(parts, whole.volume_mm3 / MM**3)
    if not whole.is_valid:
        reason = f"{reason}; {_FAULTS}" if reason else _FAULTS
    body = product._replace(shape=whole.shape, faces=_named_faces(whole, best, names_by_surface(features)))
    tree = feature_tree(body, numbers, features, product.name)
    return StepModel(
        data=step_bytes(body),
        feature_data=None if tree is None else step_bytes(tree),
        shape=whole.shape,
        faces=(*best.outcomes, *left_out),
        n_solids=whole.n_solids,
        n_open=whole.n_open,
        volume_m3=whole.volume_mm3 / MM**3,
        is_valid=whole.is_valid,
        gap_m=round(best.gap / MM, 12),
        reason=reason,
        open_edges=open_edges,
    )


def _named_faces(whole: SewnShape, best: _Attempt, named: Mapping[int, str]) -> list[NamedFace]:
    """The faces of a part with their names, layers and colours; `named` are their features by surface."""
    outcomes = [best.outcomes[k] for k in best.regions]
    return [
        NamedFace(face, _name(one, named.get(one.number, "")), *_LAYERS[one.is_guessed])
        for face, one in zip(whole.faces, outcomes, strict=True)
    ]


def _open_text(edges: Sequence[OpenEdge]) -> str:
    """At which edges the faces do not meet, the longest first."""
    longest = sorted(edges, key=lambda edge: -edge.length)[:_MOST_TOLD]
    told = ", ".join(f"{edge.face} near {place_text(edge.middle)} ({edge.length:.3g} mm)" for edge in longest)
    more = f", and {len(edges) - _MOST_TOLD} more" if len(edges) > _MOST_TOLD else ""
    return f"faces have open edges: of surface {told}{more}"


def _failure_text(outcomes: Sequence[FaceOutcome]) -> str:
    """Which surfaces have no face, and why, in one sentence."""
    failed = [outcome for outcome in outcomes if outcome.reason]
    free = [(one.number, one.open_at) for one in outcomes if one.open_at is not None and not one.reason]
    if not failed and free:
        whose = ", ".join(str(number) for number, _ in free)
        whose = f"surface {whose} ends" if len(free) == 1 else f"surfaces {whose} end"
        places = ", ".join(f"{number} at {place_text(place)}" for number, place in free[:_MOST_TOLD])
        return f"{whose} where the measurement does, without a neighbour: {places}"
    if not failed:
        return ""
    sentence = "; ".join(
        f"surface {outcome.number} ({outcome.kind}): {outcome.reason}" for outcome in failed[:_MOST_TOLD]
    )
    more = f"; and {len(failed) - _MOST_TOLD} more" if len(failed) > _MOST_TOLD else ""
    return f"{len(failed)} of {len(outcomes)} surfaces could not be trimmed: {sentence}{more}"


def _name(outcome: FaceOutcome, features: str) -> str:
    sd = f"sd {1e6 * outcome.sd_m:.3g} um"
    end = ", open end" if outcome.is_open else ""
    guess = ", rest inferred" if outcome.measured_share < MEASURED else ""
    if outcome.extended:
        guess += f", extended across surface {', '.join(map(str, outcome.extended))}"
    if outcome.inferred:
        guess += f", {outcome.inferred}"
    measured = f"{100 * outcome.measured_share:.0f} % measured"
    of = f", {features}" if features else ""
    return f"surface {outcome.number} {outcome.kind}{of}, {measured}{guess}, {sd}{end}"


_LAYERS = {False: ("MEASURED", (158, 163, 163)), True: ("PARTLY-INFERRED", (46, 122, 204))}
"""Layer and colour of faces that were measured, and of those of which a part was not: as in reports."""
