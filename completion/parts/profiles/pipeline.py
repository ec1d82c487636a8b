# SPDX-License-Identifier: MIT
"""Profiles on one page: from a part's faces to what is swept, as loops of lines and arcs that are related."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.parts.profiles import limits
from completion.parts.profiles.chain import Chain
from completion.parts.profiles.loops import loops_of
from completion.parts.profiles.outline import AXIS_LINE, Outline, outline_of
from completion.parts.profiles.profile import Loop, Profile
from completion.parts.profiles.refit import refitted, without_breaks
from completion.parts.profiles.sample import SweptPart, sample_of
from completion.parts.profiles.segment import Segment, turn_between
from completion.parts.profiles.sweeps import axes_of, directions_of
from completion.relations.graph import RelationGraph, is_settled
from completion.relations.options import RelationOptions
from completion.relations.pipeline import infer
from completion.relations.relation import Relation, RelationKind
from scenes.checks import InputError, IntArray
from scenes.surfaces.catalogue import Cylinder, Plane

DRAWN = RelationOptions(
    kinds=(
        "parallel",
        "perpendicular",
        "angle",
        "coplanar",
        "coaxial",
        "tangent",
        "equal_radius",
        "symmetric",
    )
)
"""What lines and arcs of a profile may be to each other."""


def profiles_of(part: SweptPart, options: RelationOptions = DRAWN) -> tuple[Profile, ...]:
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
    # 1. Outline: faces that each direction and axis sweeps, in chains by how their ends meet.
    points, place = sample_of(part)
    sample = [points[place == number] for number in range(len(part.fits))]
    turned, drawn = (
        [outline_of(part, sample, sweep, share) for sweep, share in sweeps]
        for sweeps in (axes_of(part, sample), directions_of(part, sample))
    )

    # 2. Choose: what explains most first, until nothing is left to explain; of holes that are alike one.
    chosen = _chosen(turned, drawn, np.array([len(each) for each in sample]))

    # 3. Relate: walls of each outline jointly; neighbours whose corner is smooth may be tangent.
    profiles = [_profile(part, outline, n_alike, options) for outline, n_alike in chosen]
    return tuple(profile for profile in profiles if profile is not None)


def _chosen(turned: Sequence[Outline], drawn: Sequence[Outline], size: IntArray) -> list[tuple[Outline, int]]:
    """Outlines that explain something new, revolutions first, and how many are alike.

    A turned hole has its section by its revolution, and its place by an extrusion that shows it as a circle:
    of revolutions only the largest explains its cylinders.
    """
    left, unplaced, chosen = set(range(len(size))), set(range(len(size))), list[tuple[Outline, int]]()
    for outlines in (list(turned), list(drawn)):
        while outlines:
            gain = [int(size[sorted(outline.explained & left)].sum()) for outline in outlines]
            best = outlines.pop(int(np.argmax(gain)))
            if not best.explained & left:
                break
            left -= best.explained
            unplaced -= best.explained if not chosen else best.explained - best.straight
            is_turned = best.sweep.kind == "revolved"
            same = [k for k, (other, _) in enumerate(chosen) if is_turned and _is_alike(best, other)]
            if same:
                chosen[same[0]] = (chosen[same[0]][0], chosen[same[0]][1] + 1)
            else:
                chosen.append((best, 1))
        left = unplaced
    return chosen


def _is_alike(outline: Outline, other: Outline) -> bool:
    """Whether two revolutions have the same sizes, within what is doubtful of them."""
    sizes = [sorted(_sizes(each)) for each in (outline, other)]
    if [one[0] for one in sizes[0]] != [one[0] for one in sizes[1]]:
        return False
    return all(abs(a[1] - b[1]) <= limits.FAR_SD * np.hypot(a[2], b[2]) for a, b in zip(*sizes, strict=True))


def _sizes(outline: Outline) -> list[tuple[str, float, float]]:
    """Kind, radius or distance from the axis, and its deviation of each wall that is no plane across."""
    used = {wall for stretch in outline.stretches for wall in stretch.chain.walls}
    found = []
    for wall in (outline.walls[number] for number in sorted(used)):
        sd = np.sqrt(np.diag(wall.covariance))
        if isinstance(wall.surface, Cylinder):
            found.append(("arc", wall.surface.radius, float(sd[4])))
        elif abs(wall.surface.normal_direction[1]) > 1 - 1e-9:  # type: ignore[attr-defined]
            found.append(("line", float(wall.surface.point[1]), float(sd[0])))  # type: ignore[attr-defined]
        elif abs(wall.surface.normal_direction[1]) > 1e-9:  # type: ignore[attr-defined]
            found.append(("slope", float(abs(wall.surface.normal_direction[1])), float(sd[1])))  # type: ignore[attr-defined]
    return found


def _profile(part: SweptPart, outline: Outline, n_alike: int, options: RelationOptions) -> Profile | None:
    """The profile of an outline: its walls where their relations hold, and its loops there.

    None where a wall has too few points to be fitted.
    """
    used = sorted({wall for stretch in outline.stretches for wall in stretch.chain.walls})
    among = {wall: k for k, wall in enumerate(used)}
    own = [outline.walls[wall] for wall in used]
    stretches = [stretch._replace(chain=stretch.chain.renumber(among)) for stretch in outline.stretches]
    chains = [stretch.chain for stretch in stretches]
    places = outline.sweep.flatten(outline.own_points(part))
    walls = refitted(own, chains, places, part.noise_m)
    if outline.is_divided:
        chains = [without_breaks(chain, walls, own) for chain in chains]
        used_still = sorted({wall for chain in chains for wall in chain.walls})
        place = {wall: k for k, wall in enumerate(used_still)}
        chains, used = [chain.renumber(place) for chain in chains], [used[wall] for wall in used_still]
        walls = refitted([walls[wall] for wall in used_still], chains, places, part.noise_m)
        stretches = [stretch._replace(chain=chain) for stretch, chain in zip(stretches, chains, strict=True)]
    if not walls or any(wall.n == 0 for wall in walls):
        return None
    if outline.sweep.kind == "revolved":
        walls.append(AXIS_LINE)
    graph = relate_walls(walls, chains, options)
    touching = {frozenset(relation.surfaces) for relation in graph.relations
                if relation.kind == "tangent" and relation.holds}  # fmt: skip
    surfaces = [fit.surface for fit in graph.fits]
    traced = [(stretch, stretch.chain.trace(surfaces, touching)) for stretch in stretches]
    if outline.sweep.kind == "extruded":
        loops = loops_of(traced, outline.levels, surfaces)
    else:
        loops = tuple(
            Loop(segments, "turned") if stretch.chain.is_closed else Loop(_shortened(segments), "open")
            for stretch, segments in traced
        )
    names = tuple(tuple(part.labels[number] for number in outline.faces[wall]) for wall in used)
    names += ((),) * (len(walls) - len(names))
    return Profile(outline.sweep, loops, names, tuple(walls), graph, n_alike)


def _shortened(segments: tuple[Segment, ...]) -> tuple[Segment, ...]:
    """An open chain with its loose lines no longer than all between them reach: they end somewhere else."""
    inner = np.concatenate([one.places() for one in segments[1:-1]] or [one.places() for one in segments])
    reach, made = float(np.linalg.norm(np.ptp(inner, axis=0))), list(segments)
    for k, is_start in ((0, True), (len(segments) - 1, False)):
        one = made[k]
        if one.centre is None and one.length > reach > 0:
            kept = one.end if is_start else one.start
            far = kept + reach * ((one.start if is_start else one.end) - kept) / one.length
            ends = (far, kept) if is_start else (kept, far)
            made[k] = Segment(one.wall, *ends, (far + kept) / 2)
    return tuple(made)


def relate_walls(
    walls: Sequence[SurfaceFit], chains: Sequence[Chain], options: RelationOptions
) -> RelationGraph:
    """Infer the relations of walls (k,): those that surfaces have, and tangency of neighbours in chains.

    Arcs have one direction from the start, and lines across an axis too, so that what is concentric and
    collinear among these is asked for.
    """
    candidates = []
    for chain in chains:
        for (one, two), place in zip(chain.neighbours, chain.corners, strict=False):
            surfaces = walls[one].surface, walls[two].surface
            is_line = [isinstance(surface, Plane) for surface in surfaces]
            if not all(is_line) and turn_between(*surfaces, place) <= limits.SMOOTH:
                candidates.append(Relation(kind="tangent", surfaces=(one, two)))
    for one, two in combinations(range(len(walls)), 2):
        pair = [isinstance(walls[number].surface, Plane) for number in (one, two)]
        if not any(pair):
            candidates.append(Relation(kind="coaxial", surfaces=(one, two)))
        elif all(pair) and not (walls[one].covariance[1, 1] or walls[two].covariance[1, 1]):
            candidates.append(Relation(kind="coplanar", surfaces=(one, two)))
    unsure = {number for number, wall in enumerate(walls) if not is_settled(wall)}
    wanted = [one for one in candidates if one.kind in options.kinds and not unsure & set(one.surfaces)]
    try:
        return infer(walls, options=options, candidates=wanted)
    except InputError:  # an arc so short that a relation would leave it no radius
        straight: tuple[RelationKind, ...] = ("parallel", "perpendicular", "coplanar")
        return infer(walls, options=replace(options, kinds=straight))
