# SPDX-License-Identifier: MIT
"""Profiles on one page: from a part's faces to what is swept, as loops of lines and arcs that are related."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, cast

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.parts.division.divided_part import RelatedPart, surface_points
from completion.parts.profiles import limits
from completion.parts.profiles.chain import Chain, Segment, turn_between
from completion.parts.profiles.outline import Outline, loops_of, outline_of
from completion.parts.profiles.profile import Loop, Profile
from completion.parts.profiles.refit import refitted, without_breaks
from completion.parts.profiles.sweep import Sweep, axes_of, directions_of
from completion.relations.graph import RelationGraph, is_settled
from completion.relations.options import RelationOptions
from completion.relations.pipeline import infer
from completion.relations.relation import Relation, RelationKind
from scenes.checks import FloatArray, InputError
from scenes.surfaces.catalogue import Cylinder, Plane

DRAWN = RelationOptions(
    kinds=("parallel", "perpendicular", "coplanar", "coaxial", "tangent", "equal_radius", "symmetric")
)
"""What lines and arcs of a profile may be to each other.

No angles of whole degrees: of lines at any angle some are such by chance; drawings give what was measured.
"""
_ACROSS = 1e-9  # sine of an angle, below which a line lies across the axis
AXIS_LINE = SurfaceFit(Plane((0, 0, 0), (0, 1, 0), (-1, 0, 0)), 0.0, np.diag([1e-18, 0.0, 0.0]), 0)
"""The axis of a revolution among its walls, exactly known: what lines may be parallel to, or across."""


def profiles_of(part: RelatedPart, options: RelationOptions = DRAWN) -> tuple[Profile, ...]:
    """Find what of a part is swept along a direction or about an axis, and its profiles.

    A profile's lines and arcs are fitted jointly where their relations hold, which are proposed, tested and
    rejected as those of surfaces are. After Fisher (2004), Applying knowledge to reverse engineering
    problems, sections 6 and 7: pockets are swept contours, and joins cross-sections of what sweeps them.

    Parameters
    ----------
    part : Part
        Divided into faces; metres.
    options : RelationOptions
        Which relations are looked for.

    Returns
    -------
    tuple of Profile
        Revolutions first, then extrusions, those that explain most of the part before others. Empty where
        nothing is swept.
    """
    extent = float(np.ptp(part.points, axis=0).max())
    part = replace(cast("Any", part), noise_m=max(part.noise_m, limits.EXACT * extent))
    points, label = surface_points(part)
    sample = [points[label == number] for number in part.labels]

    # 1. Sweep: directions and axes, and the faces that each may sweep.
    sweeps = axes_of(part, sample), directions_of(part, sample)

    # 2. Outline: what a sweep explains, in chains of walls; the most first, until nothing is left to explain.
    chosen = _chosen(part, sample, sweeps)

    # 3. Relate: walls of each outline jointly; neighbours whose corner is smooth may be tangent.
    profiles = [_profile(part, outline, n_alike, options) for outline, n_alike in chosen]
    return tuple(profile for profile in profiles if profile is not None)


def _chosen(
    part: RelatedPart,
    sample: Sequence[FloatArray],
    sweeps: Sequence[Sequence[tuple[Sweep, frozenset[int]]]],
) -> list[tuple[Outline, int]]:
    """Outlines that explain something new, revolutions first, and how many are alike.

    A turned hole has its section by its revolution, and its place by an extrusion that shows it as a circle:
    of revolutions only the largest explains its cylinders.
    """
    size = [len(points) for points in sample]
    straight = {number for number, fit in enumerate(part.fits) if isinstance(fit.surface, Plane | Cylinder)}
    left, unplaced, chosen = set(range(len(size))), set(range(len(size))), list[tuple[Outline, int]]()
    for kind in sweeps:
        todo: list[tuple[frozenset[int], Sweep, Outline | None]] = [
            (faces, sweep, None) for sweep, faces in kind
        ]
        while todo:
            gain = [sum(size[number] for number in faces & left) for faces, *_ in todo]
            faces, sweep, best = todo.pop(int(np.argmax(gain)))
            if not faces & left:
                break
            if best is None:  # it may explain less than this
                best = outline_of(
                    part, sample, sweep, sum(size[number] for number in faces) / max(sum(size), 1)
                )
                todo.append((best.explained, sweep, best))
                continue
            left -= best.explained
            unplaced -= best.explained - (straight if chosen else set())
            same = [
                k
                for k, (other, _) in enumerate(chosen)
                if sweep.kind == "revolved" and _is_alike(best, other)
            ]
            if same:
                chosen[same[0]] = (chosen[same[0]][0], chosen[same[0]][1] + 1)
            else:
                chosen.append((best, 1))
        left = unplaced
    return chosen


def _is_alike(outline: Outline, other: Outline) -> bool:
    """Whether two revolutions have the same sizes, within what is doubtful of them."""
    own, others = (sorted(_sizes(each)) for each in (outline, other))
    return [one[0] for one in own] == [one[0] for one in others] and all(
        abs(a[1] - b[1]) <= limits.FAR_SD * np.hypot(a[2], b[2]) for a, b in zip(own, others, strict=True)
    )


def _sizes(outline: Outline) -> list[tuple[str, float, float]]:
    """Kind, radius or distance from the axis, and its deviation of each wall that is no plane across."""
    found = []
    for wall in (outline.walls[number] for number in outline.used):
        sd, surface = np.sqrt(np.diag(wall.covariance)), wall.surface
        if isinstance(surface, Cylinder):
            found.append(("arc", surface.radius, float(sd[4])))
        elif isinstance(surface, Plane) and (slope := abs(float(surface.normal_direction[1]))) > _ACROSS:
            is_along = slope > 1 - _ACROSS
            value, at = (float(surface.point[1]), 0) if is_along else (slope, 1)
            found.append(("line" if is_along else "slope", value, float(sd[at])))
    return found


def _profile(part: RelatedPart, outline: Outline, n_alike: int, options: RelationOptions) -> Profile | None:
    """The profile of an outline: its walls where their relations hold, and its loops there.

    None where a wall has too few points to be fitted.
    """
    outline, places = _only_used(outline), outline.sweep.flatten(outline.own_points(part))
    for is_first in (True, False) if outline.is_divided else (False,):
        chains = [stretch.chain for stretch in outline.stretches]
        walls = refitted(outline.walls, chains, places, part.noise_m)
        if part.is_model:  # points on its triangles are off what bends; its corners are exact
            walls = [old if old.n else new for old, new in zip(outline.walls, walls, strict=True)]
        if is_first:
            simpler = [
                one._replace(chain=chain)
                for one in outline.stretches
                if (chain := without_breaks(one.chain, walls, outline.walls)) is not None
            ]
            outline = _only_used(outline._replace(walls=tuple(walls), stretches=tuple(simpler)))
    if not walls or any(wall.n == 0 for wall in walls):
        return None
    is_turned = outline.sweep.kind == "revolved"
    graph = relate_walls([*walls, AXIS_LINE] if is_turned else walls, chains, options)
    touching = {frozenset(relation.surfaces) for relation in graph.relations
                if relation.kind == "tangent" and relation.holds}  # fmt: skip
    surfaces = [fit.surface for fit in graph.fits]
    traced = [chain.trace(surfaces, touching) for chain in chains]
    if is_turned:
        loops = tuple(
            Loop(segments, "turned") if chain.is_closed else Loop(_shortened(segments), "open")
            for chain, segments in zip(chains, traced, strict=True)
        )
    else:
        loops = loops_of(outline, traced, surfaces)
    names = [tuple(part.labels[number] for number in numbers) for numbers in outline.faces]
    measured = (*walls, AXIS_LINE) if is_turned else tuple(walls)
    faces = (*names, ()) if is_turned else tuple(names)
    return Profile(outline.sweep, loops, faces, measured, graph, alike=n_alike)


def _only_used(outline: Outline) -> Outline:
    """The outline without walls that are in no chain."""
    used = outline.used
    among = {wall: k for k, wall in enumerate(used)}
    return outline._replace(
        walls=tuple(outline.walls[wall] for wall in used),
        faces=tuple(outline.faces[wall] for wall in used),
        sides=tuple(outline.sides[wall] for wall in used),
        stretches=tuple(one._replace(chain=one.chain.renumber(among)) for one in outline.stretches),
    )


def _shortened(segments: tuple[Segment, ...]) -> tuple[Segment, ...]:
    """An open chain with its loose lines no longer than all between them reach: they end somewhere else."""
    inner = np.concatenate([one.places() for one in segments[1:-1] or segments])
    reach, made = float(np.linalg.norm(np.ptp(inner, axis=0))), list(segments)
    for k, is_start in ((0, True), (len(segments) - 1, False)):
        one = made[k]
        if one.centre is None and one.length > reach > 0:
            kept, loose = (one.end, one.start) if is_start else (one.start, one.end)
            far = kept + reach * (loose - kept) / one.length
            made[k] = Segment.line(one.wall, *((far, kept) if is_start else (kept, far)))
    return tuple(made)


def relate_walls(
    walls: Sequence[SurfaceFit], chains: Sequence[Chain], options: RelationOptions
) -> RelationGraph:
    """Infer the relations of walls (k,): those that surfaces have, and tangency of neighbours in chains.

    Arcs have one direction from the start, and lines across an axis too, so that what is concentric and
    collinear among these is asked for.
    """
    flat = [isinstance(wall.surface, Plane) for wall in walls]
    held = [is_flat and not wall.covariance[1, 1] for wall, is_flat in zip(walls, flat, strict=True)]
    candidates = [
        Relation(kind="tangent", surfaces=pair)
        for chain in chains
        for pair, place in zip(chain.neighbours, chain.corners, strict=True)
        if not all(flat[k] for k in pair)
        and turn_between(walls[pair[0]].surface, walls[pair[1]].surface, place) <= limits.SMOOTH
    ]
    for pair in combinations(range(len(walls)), 2):
        if not any(flat[k] for k in pair):
            candidates.append(Relation(kind="coaxial", surfaces=pair))
        elif all(held[k] for k in pair):
            candidates.append(Relation(kind="coplanar", surfaces=pair))
    unsure = {number for number, wall in enumerate(walls) if not is_settled(wall)}
    wanted = [one for one in candidates if one.kind in options.kinds and not unsure & set(one.surfaces)]
    try:
        return infer(walls, options=options, candidates=wanted)
    except InputError:  # an arc so short that a relation would leave it no radius
        straight: tuple[RelationKind, ...] = ("parallel", "perpendicular", "coplanar")
        return infer(walls, options=replace(options, kinds=straight))
