# SPDX-License-Identifier: MIT
"""Outlines: what of a part a sweep explains, as chains of walls between levels, and the loops that these are.

A cloud is divided anew in the profile, where all points of a wall fall on one curve; of a model's mesh, whose
triangles are chords, and where curves touch, the faces of the part are the walls, joined by their ends.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from scipy.spatial import cKDTree

from completion.fitting.result import SurfaceFit
from completion.parts.division.divided_part import RelatedPart
from completion.parts.profiles import limits
from completion.parts.profiles.chain import Chain, Piece, Segment, chains_of, pieces_of
from completion.parts.profiles.partition import curves_of, partition
from completion.parts.profiles.profile import Loop, LoopKind
from completion.parts.profiles.sweep import Sweep
from completion.relations.graph import is_settled
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_SAME_NOISES = 1.0  # deviations within which a wall between other caps is the same
_OVER, _NEARLY = 0.5, 0.98  # of a loop's area that lies in another, from which it is within, and wholly so
_ACROSS = float(np.sin(limits.SMOOTH / 4))  # of a line's angle to what is across an axis, or along it
_SECTORS = 36  # of a turn, in each of which a face has points or none


class Level(NamedTuple):
    """A height of an extrusion at which something ends, and its standard deviation; NaN without a plane."""

    height_m: float
    sd_m: float


_TURN = (Level(-np.pi, np.nan), Level(np.pi, np.nan))  # of a revolution, radians


class Stretch(NamedTuple):
    """A chain and the levels, from 0, between which it is swept."""

    chain: Chain
    low: int
    high: int


class Outline(NamedTuple):
    """What a sweep explains: its walls (k,), the faces of each by their places, and chains between levels.

    `sides` (k,): 1 where a line's normal leads out of material, or the radius of an arc; else -1; 0: unknown.
    """

    sweep: Sweep
    walls: tuple[SurfaceFit, ...]
    faces: tuple[tuple[int, ...], ...]
    levels: tuple[Level, ...]
    stretches: tuple[Stretch, ...]
    explained: frozenset[int]
    is_divided: bool
    sides: tuple[int, ...]

    @property
    def used(self) -> list[int]:
        """Walls in chains."""
        return sorted({wall for stretch in self.stretches for wall in stretch.chain.walls})

    def own_points(self, part: RelatedPart) -> FloatArray:
        """Points (n, 3) of the part to which walls are fitted: all, or those of their faces."""
        if self.is_divided:
            return part.points[_along(part, self.sweep)]
        numbers = [part.labels[number] for wall in self.used for number in self.faces[wall]]
        return part.points[np.isin(part.surface, numbers)]


def outline_of(part: RelatedPart, sample: Sequence[FloatArray], sweep: Sweep, share: float) -> Outline:
    """Return what a sweep explains.

    `sample` holds points (n, 3) of each face, metres; `share` of the part may be swept so.
    """
    is_turned = sweep.kind == "revolved"
    caps = {number: cap for number, fit in enumerate(part.measured)
            if not is_turned and (cap := sweep.cap(fit)) is not None}  # fmt: skip
    if part.faces is None and share >= limits.LEAST_SHARE:
        is_along = _along(part, sweep)
        local = sweep.flatten(part.points[is_along])
        least = 2 * _cell_m(part)
        levels = list(_TURN) if is_turned else _levels(list(caps.values()), local[:, 2], least)
        walls, stretches = _divided(part, sweep, local, levels)
        if stretches:
            faces = _faces_of(part, (local, part.surface[is_along]), walls, stretches)
            sides = [0] * len(walls)
            return _outline(sweep, walls, faces, levels, stretches, caps=caps, sides=sides, is_divided=True)
    walls, faces = _walls(part, sweep)
    surfaces, sides = [wall.surface for wall in walls], [_side(part, numbers[0]) for numbers in faces]
    places = [sweep.flatten(np.concatenate([sample[number] for number in numbers])) for numbers in faces]
    if is_turned:
        stretches = _turned(part, surfaces, places)
        return _outline(sweep, walls, faces, list(_TURN), stretches, caps={}, sides=sides)
    heights = np.concatenate([np.zeros(0), *(each[:, 2] for each in places)])
    levels = _levels(list(caps.values()), heights, 2 * part.spacing_m)
    stretches = [one for one in _stretches(part, surfaces, places, levels) if one.chain.is_closed]
    return _outline(sweep, walls, faces, levels, stretches, caps=caps if stretches else {}, sides=sides)


def _side(part: RelatedPart, number: int) -> int:
    """1 where the normal of a face leads out of material, -1 where into it, by its triangles; else 0."""
    surface = part.measured[number].surface
    if part.faces is None or part.triangle_surface is None:
        return -1 if getattr(surface, "concave", False) else 0
    own: FloatArray = part.points[part.faces[part.triangle_surface == part.labels[number]]]
    turned = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
    side = int(np.sign(np.sum(turned * surface.normal(own.mean(axis=1)))))
    return -side if getattr(surface, "concave", False) else side


def _outline(
    sweep: Sweep, walls: Sequence[SurfaceFit], faces: Sequence[tuple[int, ...]], levels: Sequence[Level],
    stretches: Sequence[Stretch], *, caps: Mapping[int, object], sides: Sequence[int],
    is_divided: bool = False,
) -> Outline:  # fmt: skip
    explained = {n for one in stretches for wall in one.chain.walls for n in faces[wall]} | set(caps)
    made = tuple(walls), tuple(faces), tuple(levels), tuple(stretches)
    return Outline(sweep, *made, frozenset(explained), is_divided=is_divided, sides=tuple(sides))  # fmt: skip


def _along(part: RelatedPart, sweep: Sweep) -> BoolArray:
    """Points (n,) of a part that a sweep may have made: those on no face, and on faces along its motion."""
    is_along = np.ones(len(part.points), dtype=np.bool_)
    for number, fit in zip(part.labels, part.measured, strict=True):
        own = np.flatnonzero(part.surface == number)
        is_along[own] = sweep.is_along(fit.surface, part.points[own])
    return is_along


def _cell_m(part: RelatedPart) -> float:
    """How wide a place on a curve is, metres."""
    return max(limits.CELL_NOISES * part.noise_m, limits.CELL_SPACINGS * part.spacing_m)


def _levels(caps: Sequence[tuple[float, float]], heights: FloatArray, least_m: float) -> list[Level]:
    """Levels, at least so far apart, by caps' heights and deviations, and by heights (n,) of points."""
    ends = [(float(heights.min()), np.nan), (float(heights.max()), np.nan)] if len(heights) else []
    levels: list[Level] = []
    for height, sd in sorted([*caps, *ends]):
        if not levels or height - levels[-1].height_m > least_m:
            levels.append(Level(height, sd))
        elif not np.isfinite(levels[-1].sd_m) or sd < levels[-1].sd_m:
            levels[-1] = Level(height, sd)
    return levels


def _divided(
    part: RelatedPart, sweep: Sweep, local: FloatArray, levels: Sequence[Level]
) -> tuple[list[SurfaceFit], list[Stretch]]:
    """Walls and chains of a cloud's places (n, 3) in the profile, divided anew between its levels."""
    walls, stretches = list[SurfaceFit](), list[Stretch]()
    for number, (low, high) in enumerate(pairwise(levels)):
        thick, known = high.height_m - low.height_m, len(walls)
        margin = 0.0 if sweep.kind == "revolved" else min(2 * part.spacing_m, 0.2 * thick)
        share = (local[:, 2] - low.height_m - margin) / max(thick - 2 * margin, 1e-12)
        inside = (share >= 0) & (share <= 1)
        for chain, own in _curves(part, sweep, local[inside, :2], share[inside]):
            named = _renamed(chain, own, walls, known, part.noise_m)
            none: list[set[int]] = [set()] * (number + 1)
            stretches.append(_joined(stretches, named, none, [wall.surface for wall in walls], part))
    if sweep.kind == "revolved":
        surfaces = [wall.surface for wall in walls]
        stretches = [stretch for stretch in stretches if _is_turned(stretch.chain, surfaces)]
    return walls, stretches


def _curves(
    part: RelatedPart, sweep: Sweep, places: FloatArray, share: FloatArray
) -> Iterator[tuple[Chain, list[SurfaceFit]]]:
    """Chains of the closed curves of places (n, 2), and their walls; of a revolution those above the axis."""
    cell = _cell_m(part)
    if sweep.kind == "revolved":
        places, share = np.concatenate([places, places * [1.0, -1.0]]), np.tile(share, 2)
    for curve, along in curves_of(places, share, cell):
        low, high = float(curve[:, 1].min()), float(curve[:, 1].max())
        if sweep.kind == "revolved" and high + 2 * cell < -low:
            continue
        chain, walls = partition(curve, along, part.noise_m, cell)
        yield (
            _upper(chain, [wall.surface for wall in walls])
            if sweep.kind == "revolved" and low < 0
            else chain,
            walls,
        )


def _upper(chain: Chain, surfaces: Sequence[Surface]) -> Chain:
    """The part above y = 0 of a chain that is alike below it, from the axis to the axis."""
    n = len(chain.pieces)
    is_above = [one.places(3)[:, 1].max() > 0 for one in chain.trace(surfaces)]
    starts = [k for k in range(n) if is_above[k] and not is_above[k - 1]]
    if len(starts) != 1:
        return chain
    run = [(starts[0] + k) % n for k in range(n) if is_above[(starts[0] + k) % n]]
    pieces, forward = tuple(chain.pieces[k] for k in run), tuple(chain.is_forward[k] for k in run)
    corners = tuple(chain.corners[k] for k in run[:-1])
    return Chain(pieces, forward, corners, is_closed=True, on_axis=True)


def _slope(surface: Surface) -> float:
    """Sine of a line's angle to what is across the axis; of an arc that of 30 degrees."""
    return abs(float(surface.normal_direction[1])) if isinstance(surface, Plane) else 0.5


def _is_turned(chain: Chain, surfaces: Sequence[Surface]) -> bool:
    """Whether at least three walls are not planes across the axis, or one is no cylinder either."""
    slopes = [_slope(surfaces[wall]) for wall in set(chain.walls)]
    low, high = _ACROSS, np.sqrt(1 - _ACROSS**2)
    return sum(slope > low for slope in slopes) >= 3 or any(low < slope < high for slope in slopes)


def _renamed(
    chain: Chain, own: Sequence[SurfaceFit], walls: list[SurfaceFit], known: int, noise_m: float
) -> Chain:
    """The chain with those of its walls that go on from other heights by their numbers; others are added.

    `known` walls are of other heights.
    """
    among: dict[int, int] = {}
    for piece in chain.pieces:
        surface = own[piece.wall].surface
        places = surface.from_uv(np.column_stack([np.linspace(piece.low, piece.high, 7), np.zeros(7)]))
        same = (k for k, wall in enumerate(walls[:known]) if wall.surface.kind == surface.kind
                and np.abs(wall.surface.distance(places)).max() <= _SAME_NOISES * noise_m)  # fmt: skip
        among[piece.wall] = next(same, len(walls))
        if among[piece.wall] == len(walls):
            walls.append(own[piece.wall])
    return chain.renumber(among)


def _faces_of(
    part: RelatedPart,
    named: tuple[FloatArray, IntArray],
    walls: Sequence[SurfaceFit],
    stretches: Sequence[Stretch],
) -> list[tuple[int, ...]]:
    """The faces (by place) of which most points, `named` by places (n, 3) and labels, lie on each wall."""
    local, own = named
    surfaces = [wall.surface for wall in walls]
    segments = [one for stretch in stretches for one in stretch.chain.trace(surfaces) if one.wall >= 0]
    lines = [one.places(max(2, int(one.length / part.spacing_m))) for one in segments]
    off, near = cKDTree(np.concatenate(lines)).query(local[:, :2])
    wall_of = np.repeat([one.wall for one in segments], [len(line) for line in lines])
    wall = np.where(off <= limits.REACH * part.spacing_m, wall_of[near], len(walls))
    faces: list[tuple[int, ...]] = [() for _ in walls]
    for number, label in enumerate(part.labels):
        votes = np.bincount(wall[own == label], minlength=len(walls) + 1)
        if votes[:-1].sum() > votes.sum() / 2:
            faces[int(np.argmax(votes[:-1]))] += (number,)
    return faces


def _walls(part: RelatedPart, sweep: Sweep) -> tuple[list[SurfaceFit], list[tuple[int, ...]]]:
    """Walls of a sweep; faces on one cylinder are one."""
    walls, faces, of = list[SurfaceFit](), list[tuple[int, ...]](), dict[int, int]()
    for number, fit in enumerate(part.measured):
        wall = sweep.wall(fit) if np.isfinite(fit.covariance).all() and is_settled(fit) else None
        group = part.groups[number]
        if wall is not None and isinstance(wall.surface, Cylinder) and group in of:
            faces[of[group]] += (number,)
        elif wall is not None:
            of[group] = len(walls)
            walls.append(wall)
            faces.append((number,))
    return walls, faces


def _turned(part: RelatedPart, surfaces: Sequence[Surface], places: Sequence[FloatArray]) -> list[Stretch]:
    """Chains of what is turned about an axis, by places (n, 3) of each wall's points in the profile."""
    gap_m, pieces = limits.GAP * part.spacing_m, list[Piece]()
    for wall, points in enumerate(places):
        pieces += pieces_of(surfaces[wall], wall, points[:, :2], gap_m)
    turn = [len(np.unique(np.floor(points[:, 2] * _SECTORS / (2 * np.pi)))) / _SECTORS for points in places]
    found = []
    for chain in chains_of(pieces, surfaces, part.spacing_m, part.noise_m, axis=True):
        curved = [wall for wall in set(chain.walls) if _slope(surfaces[wall]) > _ACROSS]
        if len(chain.pieces) > 1 and _is_turned(chain, surfaces):
            share = float(np.mean([turn[wall] for wall in curved]))
            found += [Stretch(chain, 0, 1)] if share >= limits.TURN_SHARE else []
    return found


def _stretches(
    part: RelatedPart, surfaces: Sequence[Surface], places: Sequence[FloatArray], levels: Sequence[Level]
) -> list[Stretch]:
    """Chains between each level and the next, those that go on as one, by places (n, 3) of walls' points."""
    found, present = list[Stretch](), list[set[int]]()
    for low, high in pairwise(levels):
        thick, middle = high.height_m - low.height_m, (low.height_m + high.height_m) / 2
        margin, pieces = min(part.spacing_m, 0.2 * thick), list[Piece]()
        for wall, points in enumerate(places):
            inside = points[np.abs(points[:, 2] - middle) < thick / 2 - margin]
            if len(inside) and np.ptp(inside[:, 2]) >= limits.LEAST_HEIGHT_SHARE * (thick - 2 * margin):
                pieces += pieces_of(surfaces[wall], wall, inside[:, :2], limits.GAP * part.spacing_m)
        present.append({piece.wall for piece in pieces})
        for chain in chains_of(pieces, surfaces, part.spacing_m, part.noise_m):
            found.append(_joined(found, chain, present, surfaces, part))
    return found


def _joined(
    found: list[Stretch],
    chain: Chain,
    present: Sequence[set[int]],
    surfaces: Sequence[Surface],
    part: RelatedPart,
) -> Stretch:
    """The chain above the last level, with the one below that is the same, taken off the list.

    It is if it is near in the mean along both; of two the one of fewer pieces stays. Between them there may
    be levels where others cut into it, but half of its walls are `present`.
    """
    number = len(present) - 1
    off_m = limits.SAME_NOISES * part.noise_m + limits.SAME_SPACINGS * part.spacing_m
    two = _area(chain, chain.trace(surfaces)) if chain.is_ring else shapely.Polygon()
    for k, before in enumerate(found):
        own = set(before.chain.walls)
        goes_on = all(2 * len(own & there) >= len(own) for there in present[before.high : number])
        if goes_on and before.chain.is_closed and two.area > 0:
            one = _area(before.chain, before.chain.trace(surfaces))
            if one.symmetric_difference(two).area <= off_m * two.length:
                del found[k]
                return Stretch(
                    min(before.chain, chain, key=lambda each: len(each.pieces)), before.low, number + 1
                )
    return Stretch(chain, number, number + 1)


def _area(chain: Chain, segments: Sequence[Segment]) -> shapely.Polygon:
    """The area within a chain, empty of an open one."""
    polygon = Loop(tuple(segments), "outer" if chain.is_closed else "open").polygon
    if polygon.is_valid:
        return polygon
    parts = shapely.get_parts(polygon.buffer(0))  # one that crosses itself may fall apart
    return max(parts, key=lambda part: part.area, default=shapely.Polygon())


class _Traced(NamedTuple):
    """A chain on its walls, anticlockwise, the area within, and whether there is material."""

    stretch: Stretch
    segments: tuple[Segment, ...]
    area: shapely.Polygon
    is_solid: bool = True

    def lies_in(self, other: _Traced) -> bool:
        """Whether most of it lies within another."""
        return other.area.area > self.area.area > 0 and _is_over(self.area, other.area, _OVER)


def loops_of(
    outline: Outline, traced: Sequence[tuple[Segment, ...]], surfaces: Sequence[Surface]
) -> tuple[Loop, ...]:
    """Return the loops of an extrusion by its chains' segments on surfaces (k,); the largest first.

    Their kinds are by the side of material, or else by what lies within what between the same levels.
    """
    rows = []
    for stretch, segments in zip(outline.stretches, traced, strict=True):
        area = _area(stretch.chain, segments)
        is_ccw = not area.area or shapely.is_ccw(area.exterior)
        rows.append(_Traced(stretch, segments if is_ccw else _reversed(segments), area))
    rows = [row._replace(is_solid=_is_solid(row, rows, outline.sides, surfaces)) for row in rows]
    loops = []
    for row in sorted(rows, key=lambda row: (not row.stretch.chain.is_closed, -row.area.area)):
        segments = row.segments if row.is_solid else _reversed(row.segments)
        kind: LoopKind = "open"
        if row.stretch.chain.is_closed:
            kind = _solid_kind(row, rows) if row.is_solid else _hollow_kind(segments, surfaces)
        beside = row.stretch.low - 1, row.stretch.high
        is_through = not row.is_solid and not any(
            _is_solid_at(row.area, level, rows, len(outline.levels)) for level in beside
        )
        low, high = outline.levels[row.stretch.low], outline.levels[row.stretch.high]
        ends = {"end_sd_m": (low.sd_m, high.sd_m), "is_through": is_through}
        loops.append(Loop(segments, kind, low.height_m, high.height_m, **ends))  # type: ignore[arg-type]
    return tuple(loops)


def _reversed(segments: Sequence[Segment]) -> tuple[Segment, ...]:
    return tuple(one.reverse() for one in segments[::-1])


def _is_solid(
    row: _Traced, rows: Sequence[_Traced], sides: Sequence[int], surfaces: Sequence[Surface]
) -> bool:
    """Whether material is in a loop: by its walls' sides, or as it lies within an even number of others."""
    outward = 0.0
    for one in row.segments if row.stretch.chain.is_closed else ():
        x, y = one.end - one.start
        same = np.sign(one.sweep_rad) if one.centre is not None else np.sign(
            np.array([y, -x]) @ surfaces[one.wall].normal_direction[:2])  # type: ignore[attr-defined]  # fmt: skip
        outward += float(same) * sides[one.wall] * one.length
    if outward:
        return outward > 0
    around = [other.stretch for other in rows if other is not row and row.lies_in(other)]
    levels = range(row.stretch.low, row.stretch.high)
    return int(np.median([sum(one.low <= level < one.high for one in around) for level in levels])) % 2 == 0


def _is_over(inner: shapely.Polygon, outer: shapely.Polygon, share: float) -> bool:
    return bool(inner.intersection(outer).area > share * inner.area)


def _is_solid_at(area: shapely.Polygon, level: int, rows: Sequence[_Traced], n_levels: int) -> bool:
    """Whether material is over most of an area between a level and the next, or it is not known what is."""
    there = [row for row in rows if row.stretch.low <= level < row.stretch.high and row.area.area > 0]
    left = shapely.Polygon()
    for row in sorted(there, key=lambda row: -row.area.area):
        left = left.union(row.area) if row.is_solid else left.difference(row.area)
    return _is_over(area, left, _OVER) if there else 0 <= level < n_levels - 1


def _solid_kind(row: _Traced, rows: Sequence[_Traced]) -> LoopKind:
    """A section within a larger one at other heights is a boss, or a rib."""
    larger = [other.area for other in rows if other.is_solid and _NEARLY * other.area.area > row.area.area]
    if not any(_is_over(row.area, area, _NEARLY) for area in larger):
        return "outer"
    box = np.array(shapely.oriented_envelope(row.area).exterior.coords)
    sides = sorted(np.linalg.norm(np.diff(box[:3], axis=0), axis=1))
    return "rib" if sides[1] >= limits.RIB * sides[0] else "boss"


def _hollow_kind(segments: Sequence[Segment], surfaces: Sequence[Surface]) -> LoopKind:
    """What is cut out: round, a slot (two parallel lines between two arcs), or anything else."""
    lines = [surfaces[one.wall].normal_direction for one in segments if one.centre is None]  # type: ignore[attr-defined]
    if len(segments) == 1:
        return "hole"
    is_even = len(segments) == 4 and (segments[0].centre is None) == (segments[2].centre is None)
    is_slot = is_even and len(lines) == 2 and abs(float(lines[0] @ lines[1])) > np.cos(limits.SMOOTH)
    return "slot" if is_slot else "pocket"
