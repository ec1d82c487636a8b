# SPDX-License-Identifier: MIT
"""Distances between parallel planes and axes, and angles; of neighbours, not of all pairs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import cKDTree

from completion.parts.dimensions.dimension import Kind, PartDimension
from completion.parts.dimensions.face_samples import FaceSamples
from completion.parts.dimensions.joint_surfaces import JointSurfaces
from completion.relations.equations import Placement
from completion.relations.graph import is_settled
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane, Sphere

_MOST_ASIDE = float(np.radians(2.0))  # between directions that may be parallel
_SAME_SD = 4.0  # standard deviations within which directions, and levels, are one
_EXACT = 1e-7  # radians, and of the part's size: what is one in any case
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
    directed = [
        place
        for place, surface in enumerate(faces.surfaces)
        if not isinstance(surface, Sphere) and len(faces.of(place)) and is_settled(known.part.measured[place])
    ]
    spread = {
        place: float(np.trace(known.at[place].by_direction @ known.part.measured[place].covariance
                              @ known.at[place].by_direction.T)) for place in directed
    }  # fmt: skip
    classes: list[list[int]] = []
    for place in sorted(directed, key=lambda place: (spread[place], place)):
        for members in classes:
            if are_parallel(members[0], place, known):
                members.append(place)
                break
        else:
            classes.append([place])
    area = [sum(faces.share(place) for place in members) for members in classes]
    order = sorted(range(len(classes)), key=lambda k: (-area[k], classes[k][0]))
    return [_class_of(classes[k], known, faces) for k in order]


def are_parallel(first: int, second: int, known: JointSurfaces) -> bool:
    """Whether two directions are parallel, as far as is known."""
    aside = float(np.linalg.norm(np.cross(known.at[first].direction, known.at[second].direction)))
    if aside <= _EXACT:
        return True
    return aside <= _MOST_ASIDE and aside <= _SAME_SD * known.angle_sd(first, second)


def are_square(first: int, second: int, known: JointSurfaces) -> bool:
    """Whether two directions are at right angles, as far as is known."""
    found = known.estimate((first, second), lambda at: at[0].direction @ at[1].direction)
    off, sd = abs(float(found.value[0])), float(np.sqrt(max(found.covariance[0, 0], 0.0)))
    return off <= _EXACT or (off <= _MOST_ASIDE and off <= _SAME_SD * sd)


def _class_of(members: Sequence[int], known: JointSurfaces, faces: FaceSamples) -> DirectionClass:
    along = known.at[members[0]].direction
    planes = [place for place in members if isinstance(faces.surfaces[place], Plane)]
    axes = [place for place in members if place not in planes]
    planes.sort(key=lambda place: (float(along @ known.at[place].point), place))
    return DirectionClass(
        members[0],
        tuple(tuple(group) for group in _merged(planes, known, between_planes)),
        tuple(tuple(group) for group in _merged(axes, known, between_axes)),
        sum(faces.share(place) for place in members),
    )


def _merged(places: Sequence[int], known: JointSurfaces, measure: object) -> list[list[int]]:
    """Places of planes in one plane, or of axes on one line, together."""
    groups: list[list[int]] = []
    for place in places:
        for group in groups:
            found = known.estimate((group[0], place), measure)  # type: ignore[arg-type]
            far, sd = float(found.value[0]), float(np.sqrt(max(found.covariance[0, 0], 0.0)))
            if far <= _EXACT * known.size_m or (far <= _SAME_SD * sd and far <= 0.01 * known.size_m):
                group.append(place)
                break
        else:
            groups.append([place])
    return groups


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
        chain = {(low, low + 1) for low in range(len(kind.levels) - 1)}
        sides = [_side_of(level, along, faces) for level in kind.levels]
        facing: dict[tuple[int, int], tuple[Kind, FloatArray]] = {}
        ways: tuple[tuple[int, Kind], ...] = ((-1, "thickness"), (1, "slot width"))
        for way, name in ways:
            for low in (k for k, side in enumerate(sides) if side == way):
                for high in range(low + 1, len(kind.levels)):
                    found = None if sides[high] != -way else _opposite(kind, low, high, along, faces)
                    if found is not None:
                        facing[low, high] = (name if found.is_thin or way > 0 else "length", found.ends)
        for low, high in sorted(chain | set(facing)):
            first, second = kind.levels[low][0], kind.levels[high][0]
            default: Kind = "step" if sides[low] == sides[high] != 0 else "distance"
            named, ends = facing.get((low, high), (default, _plain_ends(first, second, along, faces)))
            yield known.dimension(named, (first, second), between_planes, ends=ends)


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
    classes: Sequence[DirectionClass],
    nodes: dict[int, list[tuple[int, ...]]],
    known: JointSurfaces,
    faces: FaceSamples,
) -> Iterator[PartDimension]:
    """Distances of neighbouring parallel axes, and of axes from the nearest outer planes they are along.

    `nodes` are, for the first of each class, the places of each of its axes, or of all of a pattern's.
    """
    for kind in classes:
        axes = [members[0] for members in nodes.get(kind.first, [])]
        if len(axes) > 1:
            far = np.array([[between_axes((known.at[a], known.at[b])) for b in axes] for a in axes])
            tree = minimum_spanning_tree(far).tocoo()
            for row, column in sorted(zip(tree.row.tolist(), tree.col.tolist(), strict=True)):
                first, second = axes[row], axes[column]
                yield known.dimension(
                    "axis distance", (first, second), between_axes,
                    ends=_axis_ends(first, second, known, faces),
                )  # fmt: skip
        for members in nodes.get(kind.first, []):
            yield from _from_planes(members, classes, known, faces)


def _axis_ends(first: int, second: int, known: JointSurfaces, faces: FaceSamples) -> FloatArray:
    at, two = known.at[first], known.at[second]
    top = max((faces.reach(place, at.direction)[1], place) for place in (first, second))[0]
    start = at.point + (top - float(at.direction @ at.point)) * at.direction
    step = two.point - start
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
        far, plane, axis = min(
            (between_planes((known.at[plane], known.at[axis])), plane, axis)
            for plane in outer
            for axis in axes
        )
        if far <= 1e-3 * known.size_m:
            continue
        at, normal = known.at[axis], known.at[plane].direction
        start = (
            at.point + (faces.reach(axis, at.direction)[1] - float(at.direction @ at.point)) * at.direction
        )
        ends = np.stack([start, start - float(normal @ (start - known.at[plane].point)) * normal])
        n_given += 1
        yield known.dimension("axis to plane", (plane, axis), between_planes, ends=ends)


def angle_rows(
    classes: Sequence[DirectionClass], known: JointSurfaces, faces: FaceSamples
) -> Iterator[PartDimension]:
    """Angles of faces that meet, other than none and right ones: one for two directions."""
    for first, second in combinations([kind for kind in classes if kind.levels], 2):
        planes = ([place for level in kind.levels for place in level] for kind in (first, second))
        pairs = [(a, b) for a in next(planes) for b in sorted(faces.neighbours[a])]
        others = set(next(planes))
        met = [(a, b) for a, b in pairs if b in others]
        if not met:
            continue
        found = known.estimate(met[0], angle_between)
        sd = float(np.sqrt(max(found.covariance[0, 0], 0.0)))
        if min(found.value[0], np.pi / 2 - found.value[0]) <= max(1e-6, _SAME_SD * sd):
            continue
        border = faces.beside(*met[0])
        middle = border.mean(axis=0) if len(border) else faces.of(met[0][0]).mean(axis=0)
        yield known.dimension("angle", met[0], angle_between, unit="rad", ends=np.stack([middle, middle]))
