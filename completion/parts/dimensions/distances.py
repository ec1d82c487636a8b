# SPDX-License-Identifier: MIT
"""Distances between parallel planes and axes, and angles; of neighbours, not of all pairs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import cKDTree

from completion.parts.dimensions.dimension import Kind, Measure, PartDimension
from completion.parts.dimensions.face_samples import FaceSamples
from completion.parts.dimensions.joint_surfaces import JointSurfaces, grouped
from completion.parts.division.limits import FACET_TURN
from completion.relations.equations import Placement
from completion.relations.graph import is_settled
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane, Sphere

_MOST_ASIDE = float(np.radians(2.0))  # between directions that may be parallel
_SAME_SD = 4.0  # standard deviations within which directions, and levels, are one
_EXACT = 1e-7  # radians, and of the part's size: what is one in any case
_NEAR = 0.01  # of the part's size: levels and lines that are farther apart are two
_COVERED = 0.2  # of a face, that must lie opposite another for a wall or a slot between them


@dataclass(frozen=True, slots=True, eq=False)
class DirectionClass:
    """Parallel planes and axes: `levels` are planes by height, those in one plane together; `axes` likewise.

    `first` is the place of the surface whose direction counts, the best known; `share` is that of the area.
    """

    first: int
    levels: tuple[tuple[int, ...], ...]
    axes: tuple[tuple[int, ...], ...]
    share: float

    @property
    def members(self) -> tuple[int, ...]:
        """Places of all its surfaces."""
        return tuple(place for group in (*self.levels, *self.axes) for place in group)


def direction_classes(known: JointSurfaces, faces: FaceSamples) -> list[DirectionClass]:
    """The surfaces with a direction, by what is parallel as far as is known; most area first."""

    def spread(place: int) -> float:
        by_direction = known.at[place].by_direction
        return float(np.trace(by_direction @ known.part.measured[place].covariance @ by_direction.T))

    settled = [
        place for place, fit in enumerate(known.part.measured) if len(faces.of(place)) and is_settled(fit)
    ]
    directed = [place for place in settled if not isinstance(faces.surfaces[place], Sphere)]
    directed.sort(key=lambda place: (spread(place), place))
    classes = [_class_of(members, known, faces)
               for members in grouped(directed, lambda one, two: are_parallel(one, two, known))]  # fmt: skip
    return sorted(classes, key=lambda kind: (-kind.share, kind.first))


def are_parallel(first: int, second: int, known: JointSurfaces) -> bool:
    """Whether two directions are parallel, as far as is known."""
    aside = float(np.linalg.norm(np.cross(known.at[first].direction, known.at[second].direction)))
    return aside <= _EXACT or (aside <= _MOST_ASIDE and aside <= _SAME_SD * known.angle_sd(first, second))


def are_square(first: int, second: int, known: JointSurfaces) -> bool:
    """Whether two directions are at right angles, as far as is known."""
    found = known.estimate((first, second), lambda at: at[0].direction @ at[1].direction)
    off = abs(float(found.value[0]))
    return off <= _EXACT or (off <= _MOST_ASIDE and off <= _SAME_SD * found.sd)


def _class_of(members: Sequence[int], known: JointSurfaces, faces: FaceSamples) -> DirectionClass:
    """Parallel surfaces by levels and lines: what is one as far as is known together."""
    along = known.at[members[0]].direction

    def merged(places: Sequence[int], measure: Measure) -> tuple[tuple[int, ...], ...]:
        def are_one(one: int, two: int) -> bool:
            found = known.estimate((one, two), measure)
            far = float(found.value[0]) / known.size_m
            return far <= _EXACT or far <= min(_SAME_SD * found.sd / known.size_m, _NEAR)

        return tuple(tuple(group) for group in grouped(places, are_one))

    planes = [place for place in members if isinstance(faces.surfaces[place], Plane)]
    planes.sort(key=lambda place: (float(along @ known.at[place].point), place))
    axes = [place for place in members if place not in planes]
    share = sum(faces.share(place) for place in members)
    return DirectionClass(members[0], merged(planes, between_planes), merged(axes, between_axes), share)


def between_planes(at: Sequence[Placement]) -> float:
    """Distance of the second plane's point, or axis, from the first, a plane; metres."""
    return float(abs(at[0].direction @ (at[1].point - at[0].point)))


def between_axes(at: Sequence[Placement]) -> float:
    """Distance between two parallel axes, metres."""
    return float(np.linalg.norm(np.cross(at[0].direction, at[1].point - at[0].point)))


def angle_between(at: Sequence[Placement]) -> float:
    """Angle between two directions, at most a right one, radians."""
    first, second = at[0].direction, at[1].direction
    return float(np.arctan2(np.linalg.norm(np.cross(first, second)), abs(first @ second)))


def plane_rows(
    classes: Sequence[DirectionClass], known: JointSurfaces, faces: FaceSamples
) -> Iterator[PartDimension]:
    """Chains of parallel planes; walls and slots between faces that lie opposite each other."""
    for kind in classes:
        along = known.at[kind.first].direction
        sides = [_side_of(level, along, faces) for level in kind.levels]
        for low, high in combinations(range(len(kind.levels)), 2):
            first, second = kind.levels[low][0], kind.levels[high][0]
            way, found = sides[low], None
            if way and sides[high] == -way:
                found = _opposite(kind, low, high, along, faces)
            if found is not None:
                name: Kind = "slot width" if way > 0 else "thickness" if found.is_thin else "length"
                yield known.dimension(name, (first, second), between_planes, ends=found.ends)
            elif high == low + 1:
                name = "step" if way == sides[high] != 0 else "distance"
                ends = _plain_ends(first, second, along, faces)
                yield known.dimension(name, (first, second), between_planes, ends=ends)


def _side_of(level: Sequence[int], along: FloatArray, faces: FaceSamples) -> int:
    """Whether the faces of a level look along a direction (1) or against it (-1); 0: both, or unknown."""
    looks = {
        int(faces.sides[place] * np.sign(faces.surfaces[place].normal(faces.of(place)[:1])[0] @ along))
        for place in level
    }
    return looks.pop() if len(looks) == 1 else 0


class _Opposite(NamedTuple):
    """Ends (2, 3) where two levels lie opposite each other, and whether that is wider than they are apart."""

    ends: FloatArray
    is_thin: bool


def _opposite(
    kind: DirectionClass, low: int, high: int, along: FloatArray, faces: FaceSamples
) -> _Opposite | None:
    """Where two levels lie opposite each other with no other between; None where they do not."""
    under, over = (np.concatenate([faces.of(place) for place in kind.levels[k]]) for k in (low, high))
    flat = np.eye(3) - np.outer(along, along)
    few, many = (under, over) if len(under) <= len(over) else (over, under)
    covered = cKDTree(many @ flat).query(few @ flat)[0] <= 1.5 * faces.spacing_m
    for between in range(low + 1, high):
        other = np.concatenate([faces.of(place) for place in kind.levels[between]])
        covered &= cKDTree(other @ flat).query(few @ flat)[0] > 1.5 * faces.spacing_m
    if covered.mean() < _COVERED:
        return None
    middle = few[covered].mean(axis=0)
    point = few[covered][int(np.argmin(np.linalg.norm(few[covered] - middle, axis=1)))]
    partner = many[int(np.argmin(np.linalg.norm((many - point) @ flat, axis=1)))]
    ends = np.stack([point, point + float(along @ (partner - point)) * along])
    wide = np.sqrt(12 * np.linalg.eigvalsh(np.cov((few[covered] @ flat).T))[1])  # of an even spread
    is_thin = bool(np.linalg.norm(ends[1] - ends[0]) < wide)
    return _Opposite(ends if few is under else ends[::-1], is_thin)


def _plain_ends(first: int, second: int, along: FloatArray, faces: FaceSamples) -> FloatArray:
    """Ends (2, 3) from a point of one face, along a direction, to the height of the other."""
    start, other = faces.of(first), faces.of(second)
    point = start[int(np.argmin(cKDTree(other).query(start)[0]))]
    return np.stack([point, point + float(along @ (other.mean(axis=0) - point)) * along])


def axis_rows(
    classes: Sequence[DirectionClass], nodes: Sequence[Sequence[tuple[int, ...]]], known: JointSurfaces,
    faces: FaceSamples,
) -> Iterator[PartDimension]:  # fmt: skip
    """Distances of neighbouring parallel axes, and of axes from the nearest outer planes they are along.

    `nodes` are, for each class, the places of each of its axes, or of all of a pattern's.
    """
    for lines in nodes:
        axes = [members[0] for members in lines]
        if len(axes) > 1:
            far = np.array([[between_axes((known.at[a], known.at[b])) for b in axes] for a in axes])
            tree = minimum_spanning_tree(far).tocoo()
            for row, column in sorted(zip(tree.row.tolist(), tree.col.tolist(), strict=True)):
                pair = axes[row], axes[column]
                yield known.dimension(
                    "axis distance", pair, between_axes, ends=_axis_ends(*pair, known, faces)
                )
        for members in lines:
            yield from _from_planes(members, classes, known, faces)


def _axis_ends(first: int, second: int, known: JointSurfaces, faces: FaceSamples) -> FloatArray:
    """Ends (2, 3) from axis to axis, where the higher of their faces ends."""
    at = known.at[first]
    top = max(faces.reach(place, at.direction)[1] for place in (first, second))
    start = at.point + (top - float(at.direction @ at.point)) * at.direction
    step = known.at[second].point - start
    return np.stack([start, start + step - float(step @ at.direction) * at.direction])


def _from_planes(
    axes: Sequence[int], classes: Sequence[DirectionClass], known: JointSurfaces, faces: FaceSamples
) -> Iterator[PartDimension]:
    """From at most two directions the outer plane that is nearest to an axis, or to any of a pattern's."""
    n_given = 0
    for kind in classes:
        if not kind.levels or n_given == 2 or not are_square(kind.first, axes[0], known):
            continue
        outer = sorted({kind.levels[0][0], kind.levels[-1][0]})
        far, plane, axis = min((between_planes((known.at[plane], known.at[axis])), plane, axis)
                               for plane, axis in product(outer, axes))  # fmt: skip
        if far > 1e-3 * known.size_m:
            at, normal = known.at[axis], known.at[plane].direction
            rise = faces.reach(axis, at.direction)[1] - float(at.direction @ at.point)
            start = at.point + rise * at.direction
            ends = np.stack([start, start - float(normal @ (start - known.at[plane].point)) * normal])
            n_given += 1
            yield known.dimension("axis to plane", (plane, axis), between_planes, ends=ends)


def angle_rows(
    classes: Sequence[DirectionClass], known: JointSurfaces, faces: FaceSamples
) -> Iterator[PartDimension]:
    """Angles of faces that meet, other than none and right ones; those that relations make equal in one row.

    Faces of a mesh that meet bluntly may be facets of a free-form one: their angles tell nothing.
    """
    found: list[tuple[int, int]] = []
    least = 1e-6 if known.part.faces is None else float(FACET_TURN)
    for first, second in combinations([kind for kind in classes if kind.levels], 2):
        others = {place for level in second.levels for place in level}
        met = [(a, b) for level in first.levels for a in level for b in sorted(faces.neighbours[a] & others)]
        if met:
            angle = known.estimate(met[0], angle_between)
            margin = _SAME_SD * angle.sd
            if angle.value[0] > max(least, margin) and np.pi / 2 - angle.value[0] > max(1e-6, margin):
                found.append(met[0])
    for pairs in grouped(found, lambda one, two: known.are_equal(one, two, angle_between)):
        border = faces.beside(*pairs[0])
        middle = (border if len(border) else faces.of(pairs[0][0])).mean(axis=0)
        alike = [place for pair in pairs for place in pair] if len(pairs) > 1 else []
        row = known.dimension("angle", pairs[0], angle_between, alike=alike, ends=np.stack([middle, middle]))
        yield replace(row, count=len(pairs))
