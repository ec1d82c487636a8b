# SPDX-License-Identifier: MIT
"""STEP on one page: from fitted regions to trimmed faces, and to a solid where they close."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from completion.exchange.step.brep import EdgeMaker
from completion.exchange.step.curves.corners import corners_of
from completion.exchange.step.curves.folds import FoldFinder
from completion.exchange.step.curves.kernel import kernel, kernel_errors, kernel_surface
from completion.exchange.step.faces import MEASURED, FaceMaker
from completion.exchange.step.loops import Nearby, loops_of
from completion.exchange.step.model import FaceOutcome, StepModel
from completion.exchange.step.open_ends import OpenEnds
from completion.exchange.step.pieces import chosen, pieces_of
from completion.exchange.step.regions import MM, PartRegions, in_millimetres, joined, without
from completion.exchange.step.seams import Seams
from completion.exchange.step.shells import sewn
from completion.exchange.step.step_file import NamedFace, step_bytes
from scenes.checks import InputError
from scenes.scan.colour import surface_bytes

_MOST_TOLD = 3
_SMALL, _SMALL_SHARE = (12, 30, 100), 0.02  # points, and share of all, of a region that may be left out
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
    whole, left_out = joined(parts), list[FaceOutcome]()
    best = _attempt(whole)
    for most in _SMALL:
        small = _small_failures(whole, best.outcomes, most)
        if not small:
            continue
        fewer = without(whole, small)
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
        return sum(bool(one.reason) for one in self.outcomes)


def _attempt(parts: PartRegions) -> _Attempt:
    """Trim the surfaces of all regions."""
    # 1. Regions: all in millimetres from here on.
    surfaces = [in_millimetres(one.surface) for one in parts.regions]
    points = [parts.points[parts.region == k] * MM for k in range(len(surfaces))]
    spacing, contacts = parts.spacing_m * MM, parts.contacts * MM

    # 2. Folds: the curves in which neighbours cross, or touch where they are tangent.
    finder = FoldFinder(surfaces, [kernel_surface(one) for one in surfaces], spacing, parts.noise_m * MM)
    curves = [
        curve
        for pair in np.unique(parts.between, axis=0).tolist()
        for curve in finder.between((pair[0], pair[1]), contacts[(parts.between == pair).all(axis=1)])
    ]

    # 3. Corners: where the folds of one surface meet.
    corners = corners_of(curves, spacing)

    # 4. Pieces between corners, and the choice of those that close around regions along their contacts.
    pieces = pieces_of(curves, corners, contacts, parts.between, spacing)
    kept = chosen(pieces, curves, corners, spacing)

    # 5. Loops: pieces in order around each region, which lies on their left; open ends close as measured.
    near = [Nearby(own, spacing) for own in points]
    loops = [loops_of(k, kept, curves, one, near[k]) for k, one in enumerate(surfaces)]

    ends = OpenEnds(kept, curves, corners, surfaces, spacing)
    is_open = [False] * len(surfaces)
    for k, own in enumerate(points):
        loops[k], is_open[k] = ends.closed(k, loops[k], own)

    # 6. Seams: where surfaces that return to themselves are cut open.
    seams = Seams(kept, curves, surfaces)
    for surface, own in zip(surfaces, loops, strict=True):
        seams.begin_on_tubes(surface, own.closed)
    shapes = [
        seams.shape(one, own, found.closed) for one, own, found in zip(surfaces, points, loops, strict=True)
    ]

    # 7. Faces: each surface within its loops; what does not hold its region's points is none.
    make = EdgeMaker(seams.pieces, curves, corners, surfaces)
    maker = FaceMaker(parts, make, spacing)
    trimmed = [
        maker.faces(surface, shape, found, own)
        for surface, shape, found, own in zip(surfaces, shapes, loops, points, strict=True)
    ]
    outcomes = tuple(
        FaceOutcome(
            region.number, region.surface.kind, one.reason, one.measured, sd_m=region.sd_m, is_open=ends_open
        )
        for region, one, ends_open in zip(parts.regions, trimmed, is_open, strict=True)
    )
    gap = max((make.off(one) for one in seams.pieces), default=0.0)
    faces = [(face, k) for k, one in enumerate(trimmed) for face in one.faces]
    held = sum(len(own) for own, one in zip(points, trimmed, strict=True) if one.faces)
    return _Attempt(
        [face for face, _ in faces], [k for _, k in faces], outcomes, gap=gap, spacing=spacing, n_held=held
    )


def _small_failures(parts: PartRegions, outcomes: Sequence[FaceOutcome], most: int) -> list[int]:
    """Places of regions without a face that are so small that their neighbours may be extended across."""
    size = np.bincount(parts.region, minlength=len(parts.regions))
    least = min(most, _SMALL_SHARE * size.sum())
    return [k for k, one in enumerate(outcomes) if one.reason and size[k] <= least]


def _model(best: _Attempt, left_out: tuple[FaceOutcome, ...], name: str) -> StepModel:
    """Sew the faces, and write the file."""
    # 8. Shells and solids, and the file.
    n = len(best.outcomes)
    reason = _told(best.outcomes, n)
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


def _told(outcomes: Sequence[FaceOutcome], n: int) -> str:
    """Which surfaces have no face, and why, in one sentence."""
    failed = [one for one in outcomes if one.reason]
    free = [str(one.number) for one in outcomes if one.is_open and not one.reason]
    if not failed and free:
        whose = f"surface {free[0]} ends" if len(free) == 1 else f"surfaces {', '.join(free)} end"
        return f"{whose} where the measurement does, without a neighbour"
    if not failed:
        return ""
    told = "; ".join(f"surface {one.number} ({one.kind}): {one.reason}" for one in failed[:_MOST_TOLD])
    more = f"; and {len(failed) - _MOST_TOLD} more" if len(failed) > _MOST_TOLD else ""
    return f"{len(failed)} of {n} surfaces could not be trimmed: {told}{more}"


def _name(one: FaceOutcome) -> str:
    sd = f"sd {1e6 * one.sd_m:.3g} um"
    end = ", open end" if one.is_open else ""
    return f"surface {one.number} {one.kind}, {100 * one.measured_share:.0f} % measured, {sd}{end}"


def _layer(one: FaceOutcome) -> str:
    return "MEASURED" if one.measured_share >= MEASURED else "PARTLY-INFERRED"


def _colour(place: int) -> tuple[int, int, int]:
    red, green, blue = surface_bytes(np.array([place + 1]))[0].tolist()
    return red, green, blue
