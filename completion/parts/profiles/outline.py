# SPDX-License-Identifier: MIT
"""Outlines: what of a part a sweep explains, as chains of walls, before these are related.

A cloud is divided anew in the profile, where all points of a wall fall on one curve; of a model's mesh, whose
triangles are chords, and where curves touch, the faces of the part are the walls, joined by their ends.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from completion.fitting.result import SurfaceFit
from completion.parts.profiles import limits
from completion.parts.profiles.chain import Chain, chains_of
from completion.parts.profiles.loops import Level, Stretch, joined, levels_of, stretches_of
from completion.parts.profiles.partition import chain_of, curves_of, partition
from completion.parts.profiles.sample import SweptPart
from completion.parts.profiles.segment import Piece, pieces_of
from completion.parts.profiles.sweep import Sweep
from completion.relations.graph import is_settled
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane

_SAME_NOISES = 1.0  # deviations within which a wall between other caps is the same


class Outline(NamedTuple):
    """What a sweep explains: its walls (k,), the faces of each by their places, and chains between levels."""

    sweep: Sweep
    walls: tuple[SurfaceFit, ...]
    faces: tuple[tuple[int, ...], ...]
    levels: tuple[Level, ...]
    stretches: tuple[Stretch, ...]
    explained: frozenset[int]
    straight: frozenset[int] = frozenset()
    is_divided: bool = False

    def own_points(self, part: SweptPart) -> FloatArray:
        """Points (n, 3) of the part to which walls are fitted: all, or those of their faces."""
        if self.is_divided:
            return part.points
        numbers = [part.labels[number] for stretch in self.stretches for wall in stretch.chain.walls
                   for number in self.faces[wall]]  # fmt: skip
        return part.points[np.isin(part.surface, numbers)]


AXIS_LINE = SurfaceFit(Plane((0, 0, 0), (0, 1, 0), (-1, 0, 0)), 0.0, np.diag([1e-18, 0.0, 0.0]), 0)
"""The axis of a revolution among its walls, exactly known: what lines may be parallel to, or across."""


def outline_of(part: SweptPart, sample: Sequence[FloatArray], sweep: Sweep, share: float) -> Outline:
    """Return what a sweep explains; `share` of the part may be swept so."""
    if part.faces is None and share >= limits.LEAST_SHARE:
        return divided(part, sample, sweep)
    return joined_faces(part, sample, sweep)


def divided(part: SweptPart, sample: Sequence[FloatArray], sweep: Sweep) -> Outline:
    """Return what a sweep explains of a cloud, divided anew; without closed curves as `joined_faces` does."""
    local = sweep.flatten(part.points)
    if sweep.kind == "extruded":
        caps = {
            number: cap for number, fit in enumerate(part.measured) if (cap := sweep.cap(fit)) is not None
        }
        least = max(2 * limits.CELL_NOISES * part.noise_m, 2 * limits.CELL_SPACINGS * part.spacing_m)
        levels = levels_of(list(caps.values()), local[:, 2], least)
    else:
        caps, levels = {}, [Level(-np.pi, np.nan), Level(np.pi, np.nan)]
    walls, stretches = list[SurfaceFit](), list[Stretch]()
    for number, (low, high) in enumerate(pairwise(levels)):
        thick, known = high.height_m - low.height_m, len(walls)
        margin = 0.0 if sweep.kind == "revolved" else min(2 * part.spacing_m, 0.2 * thick)
        inside = local[np.abs(local[:, 2] - (low.height_m + high.height_m) / 2) <= thick / 2 - margin]
        share = (inside[:, 2] - low.height_m - margin) / max(thick - 2 * margin, 1e-12)
        for chain, own in _curves(part, sweep, inside[:, :2], share):
            chain = _renamed(chain, own, walls, known, part.noise_m)
            off = limits.SAME_NOISES * part.noise_m + limits.SAME_SPACINGS * part.spacing_m
            stretches.append(joined(stretches, chain, number, [wall.surface for wall in walls], off))
    if sweep.kind == "revolved":
        stretches = [stretch for stretch in stretches if _is_turned(stretch.chain, walls)]
    if not stretches:
        return joined_faces(part, sample, sweep)
    faces = _faces_of(part, local, walls, stretches)
    used = {wall for stretch in stretches for wall in stretch.chain.walls}
    explained = {number for wall in used for number in faces[wall]} | set(caps)
    return Outline(
        sweep, tuple(walls), faces, tuple(levels), tuple(stretches), frozenset(explained), is_divided=True
    )


def _curves(
    part: SweptPart, sweep: Sweep, places: FloatArray, share: FloatArray
) -> Iterator[tuple[Chain, list[SurfaceFit]]]:
    """Chains of the closed curves of places (n, 2), and their walls; of a revolution those above the axis."""
    cell = max(limits.CELL_NOISES * part.noise_m, limits.CELL_SPACINGS * part.spacing_m)
    if sweep.kind == "revolved":
        places, share = np.concatenate([places, places * [1.0, -1.0]]), np.tile(share, 2)
    for curve, along in curves_of(places, share, cell):
        if sweep.kind == "revolved" and curve[:, 1].max() + 2 * cell < -curve[:, 1].min():
            continue
        parts = partition(curve, along, part.noise_m, cell)
        chain, walls = chain_of(parts)
        if sweep.kind == "revolved" and curve[:, 1].min() < 0:
            chain = _upper(chain, parts)
        yield chain, walls


def joined_faces(part: SweptPart, sample: Sequence[FloatArray], sweep: Sweep) -> Outline:
    """Return what a sweep explains by the faces of a part, of which `sample` has points (n, 3) each."""
    return (_extruded if sweep.kind == "extruded" else _revolved)(part, sample, sweep)


def _extruded(part: SweptPart, sample: Sequence[FloatArray], sweep: Sweep) -> Outline:
    """Chains of walls along a direction, between the planes across it."""
    walls, faces = _walls(part, sweep, (Plane, Cylinder))
    caps = {number: cap for number, fit in enumerate(part.measured) if (cap := sweep.cap(fit)) is not None}
    places = [sweep.flatten(np.concatenate([sample[number] for number in numbers])) for numbers in faces]
    heights = np.concatenate([np.zeros(0), *(each[:, 2] for each in places)])
    levels = levels_of(list(caps.values()), heights, 2 * part.spacing_m)
    surfaces = [wall.surface for wall in walls]
    stretches = stretches_of(surfaces, places, levels, spacing_m=part.spacing_m, noise_m=part.noise_m)
    kept = [stretch for stretch in stretches if stretch.chain.is_closed]
    used = {wall for stretch in kept for wall in stretch.chain.walls}
    explained = {number for wall in used for number in faces[wall]} | (set(caps) if kept else set())
    return Outline(sweep, walls, faces, tuple(levels), tuple(kept), frozenset(explained))


def _revolved(part: SweptPart, sample: Sequence[FloatArray], sweep: Sweep) -> Outline:
    """Chains of what is turned about an axis: at least three faces, or one that no extrusion has."""
    walls, faces = _walls(part, sweep, (Plane, Cylinder))
    places = [sweep.flatten(np.concatenate([sample[number] for number in numbers])) for numbers in faces]
    surfaces = [wall.surface for wall in walls]
    gap_m, pieces = limits.GAP * part.spacing_m, list[Piece]()
    for wall, points in enumerate(places):
        pieces += pieces_of(surfaces[wall], wall, points[:, :2], gap_m)
    kept = []
    for chain in chains_of(pieces, surfaces, part.spacing_m, part.noise_m, axis=True):
        curved = {wall for wall in chain.walls if any(_is_curved(part, number) for number in faces[wall])}
        bent = {wall for wall in curved if any(_is_bent(part, number) for number in faces[wall])}
        turns = [len(np.unique(np.floor(places[wall][:, 2] / np.radians(10)))) / 36 for wall in curved]
        if (len(curved) >= 3 or bent) and len(chain.pieces) > 1 and np.mean(turns) >= limits.TURN_SHARE:
            kept.append(Stretch(chain, 0, 1))
    explained = {number for stretch in kept for wall in stretch.chain.walls for number in faces[wall]}
    straight = frozenset(number for number in explained if not _is_bent(part, number))
    return Outline(sweep, walls, faces, (), tuple(kept), frozenset(explained), straight)


def _is_curved(part: SweptPart, number: int) -> bool:
    return not isinstance(part.fits[number].surface, Plane)


def _is_bent(part: SweptPart, number: int) -> bool:
    return not isinstance(part.fits[number].surface, Plane | Cylinder)


def _walls(
    part: SweptPart, sweep: Sweep, kinds: tuple[type, ...]
) -> tuple[tuple[SurfaceFit, ...], tuple[tuple[int, ...], ...]]:
    """Walls of a sweep; faces on one cylinder are one."""
    walls, faces = list[SurfaceFit](), list[tuple[int, ...]]()
    of: dict[int, int] = {}
    for number, fit in enumerate(part.measured):
        wall = sweep.wall(fit) if np.isfinite(fit.covariance).all() and is_settled(fit) else None
        if wall is None or not isinstance(wall.surface, kinds):
            continue
        group = part.groups[number]
        if isinstance(wall.surface, Cylinder) and group in of:
            faces[of[group]] += (number,)
            continue
        of[group] = len(walls)
        walls.append(wall)
        faces.append((number,))
    return tuple(walls), tuple(faces)


def _upper(chain: Chain, parts: Sequence[object]) -> Chain:
    """The part above y = 0 of a chain that is alike below it, from the axis to the axis."""
    n = len(chain.pieces)
    is_above = [max(float(place[1]) for place in (part.start, part.middle, part.end)) > 0 for part in parts]  # type: ignore[attr-defined]
    starts = [k for k in range(n) if is_above[k] and not is_above[k - 1]]
    if len(starts) != 1:
        return chain
    run = [(starts[0] + k) % n for k in range(n) if is_above[(starts[0] + k) % n]]
    return Chain(
        tuple(chain.pieces[k] for k in run),
        tuple(chain.is_forward[k] for k in run),
        tuple(chain.corners[k] for k in run[:-1]),
        True,
        True,
    )


def _is_turned(chain: Chain, walls: Sequence[SurfaceFit]) -> bool:
    """Whether at least three walls are not planes across the axis, or one is no cylinder either."""
    surfaces = [walls[wall].surface for wall in set(chain.walls)]
    slopes = [abs(float(one.normal_direction[1])) if isinstance(one, Plane) else 0.5 for one in surfaces]
    low, high = np.sin(limits.SMOOTH / 4), np.cos(limits.SMOOTH / 4)
    return sum(slope > low for slope in slopes) >= 3 or any(low < slope < high for slope in slopes)


def _renamed(
    chain: Chain, own: Sequence[SurfaceFit], walls: list[SurfaceFit], known: int, noise_m: float
) -> Chain:
    """The chain with those of its walls that go on from other heights by their numbers; others are added.

    `known` walls are of other heights.
    """
    among: dict[int, int] = {}
    for piece in chain.pieces:
        fit = own[piece.wall]
        places = fit.surface.from_uv(np.column_stack([np.linspace(piece.low, piece.high, 7), np.zeros(7)]))
        same = [
            k for k, wall in enumerate(walls[:known])
            if wall.surface.kind == fit.surface.kind
            and np.abs(wall.surface.distance(places)).max() <= _SAME_NOISES * noise_m
        ]  # fmt: skip
        if same:
            among[piece.wall] = same[0]
        else:
            among[piece.wall] = len(walls)
            walls.append(fit)
    return chain.renumber(among)


def _faces_of(
    part: SweptPart, local: FloatArray, walls: Sequence[SurfaceFit], stretches: Sequence[Stretch]
) -> tuple[tuple[int, ...], ...]:
    """The faces (by place) of which most points lie on each wall."""
    surfaces = [wall.surface for wall in walls]
    places, wall_of = [], []
    for stretch in stretches:
        for segment in stretch.chain.trace(surfaces):
            if segment.wall >= 0:
                n = max(2, int(segment.length / part.spacing_m))
                line = (
                    segment.places(n)
                    if segment.centre is not None
                    else np.linspace(segment.start, segment.end, n)
                )
                places.append(line)
                wall_of += [segment.wall] * len(line)
    off, near = cKDTree(np.concatenate(places)).query(local[:, :2])
    wall = np.where(off <= limits.REACH * part.spacing_m, np.array(wall_of)[near], len(walls))
    number = {label: place for place, label in enumerate(part.labels)}
    faces: list[tuple[int, ...]] = [() for _ in walls]
    for label in part.labels:
        votes = np.bincount(wall[part.surface == label], minlength=len(walls) + 1)
        if votes.sum() and votes[:-1].sum() > votes.sum() / 2:
            faces[int(np.argmax(votes[:-1]))] += (number[label],)
    return tuple(faces)
