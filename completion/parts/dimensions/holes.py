# SPDX-License-Identifier: MIT
"""Holes: how deep they are and whether they go through, and patterns of equal ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, qr
from scipy.special import chdtrc

from completion.features.holes.patterns import CIRCLE, GRID, LEAST_SEEN, ROW, Pattern, fit_pattern
from completion.parts.dimensions.dimension import NORMAL_95, Kind, PartDimension
from completion.parts.dimensions.distances import DirectionClass
from completion.parts.dimensions.face_samples import FaceSamples
from completion.parts.dimensions.frame import across_of
from completion.parts.dimensions.joint_surfaces import JointSurfaces
from completion.parts.dimensions.sizes import RoundFaces
from completion.relations.equations import Placement
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Cone, Cylinder, Plane

_NEAR = 3.0  # sampling distances of a hole's end, within which the face lies that ends it
_WIDE = 1.5  # radii from the axis: what belongs to a hole's end
_MOSTLY = 0.5  # of its points there, that must lie within the radius of what closes a hole
_ACROSS = 0.1  # cosine of a plane's normal with the axis of a hole that ends in it
_OPEN, _FLOOR, _CONE = "open", "floor", "cone"


class HoleEnd(NamedTuple):
    """What ends a hole: nothing behind it, a floor, or a cone; and the place of that face, -1 for none."""

    kind: str
    place: int


@dataclass(frozen=True, slots=True, eq=False)
class Hole:
    """A hole: the place of its wall, and its ends, the lower first along its axis."""

    place: int
    ends: tuple[HoleEnd, HoleEnd]

    @property
    def note(self) -> str:
        """Whether it goes through."""
        kinds = sorted(end.kind for end in self.ends)
        if kinds == [_OPEN, _OPEN]:
            return "through" if all(end.place >= 0 for end in self.ends) else ""
        return "blind" if _OPEN in kinds else ""


def holes_of(items: Sequence[RoundFaces], known: JointSurfaces, faces: FaceSamples) -> list[Hole]:
    """The holes among round faces: each wall once for each of its pieces, with its ends."""
    return [
        Hole(place, _ends_of(place, known, faces))
        for item in items
        if item.kind == "hole diameter" and isinstance(faces.surfaces[item.places[0]], Cylinder)
        for place in sorted(item.places)
    ]


def _ends_of(place: int, known: JointSurfaces, faces: FaceSamples) -> tuple[HoleEnd, HoleEnd]:
    """At either end the face that has most points there."""
    at = known.at[place]
    near = _NEAR * faces.spacing_m
    best = [(0, HoleEnd(_OPEN, -1)), (0, HoleEnd(_OPEN, -1))]
    for other in sorted(faces.neighbours[place]):
        surface, step = faces.surfaces[other], faces.of(other) - at.point
        height = step @ at.direction
        away = np.linalg.norm(step - height[:, None] * at.direction, axis=1)
        beside = away < _WIDE * at.radius + near
        if not beside.any():
            continue
        is_inside = float(np.mean(away[beside] < at.radius)) > _MOSTLY
        here = float(np.median(height[beside]))
        for k, end in enumerate(faces.reach(place, at.direction)):
            far = abs(here + float(at.point @ at.direction) - end)
            if (
                isinstance(surface, Plane)
                and far < near
                and abs(surface.normal_direction @ at.direction) > _ACROSS
            ):
                found = HoleEnd(_FLOOR if is_inside else _OPEN, other)
            elif isinstance(surface, Cone) and far < max(near, at.radius) and is_inside:
                found = HoleEnd(_CONE, other)
            else:
                continue
            best[k] = max(best[k], (int(beside.sum()), found), key=lambda pair: pair[0])
    return best[0][1], best[1][1]


def depth_rows(
    groups: Sequence[Sequence[Hole]], known: JointSurfaces, faces: FaceSamples
) -> Iterator[PartDimension]:
    """The depth of blind holes, from the plane of their mouth to their floor, or to where a cone begins."""
    for group in groups:
        first = group[0]
        kinds = [end.kind for end in first.ends]
        if kinds.count(_OPEN) != 1 or any(end.place < 0 for end in first.ends):
            continue
        mouth, floor = first.ends if kinds[0] == _OPEN else first.ends[::-1]
        measure = _to_cone if floor.kind == _CONE else _to_plane
        at, reach = known.at[first.place], faces.reach(first.place, known.at[first.place].direction)
        foot = at.point - float(at.point @ at.direction) * at.direction
        yield known.dimension(
            "hole depth", (first.place, mouth.place, floor.place), measure,
            alike=[hole.place for hole in group],
            note="to the cone" if floor.kind == _CONE else "",
            ends=np.stack([foot + height * at.direction for height in reach]),
        )  # fmt: skip


def _height_on_axis(axis: Placement, plane: Placement) -> float:
    """Where a plane crosses an axis, metres from the axis' own point."""
    return float(plane.direction @ (plane.point - axis.point) / (plane.direction @ axis.direction))


def _to_plane(at: Sequence[Placement]) -> float:
    return abs(_height_on_axis(at[0], at[2]) - _height_on_axis(at[0], at[1]))


def _to_cone(at: Sequence[Placement]) -> float:
    """To where the radius of the cone is that of the hole, measured along the hole's axis."""
    hole, cone = at[0], at[2]
    along = (hole.radius - _cone_radius(cone)) / np.tan(cone.half_angle)
    point = cone.point + along * cone.direction
    return abs(float(hole.direction @ (point - hole.point)) - _height_on_axis(hole, at[1]))


def _cone_radius(cone: Placement) -> float:
    return cone.radius


def alike_holes(
    sizes: Sequence[Sequence[RoundFaces]], holes: Sequence[Hole], kinds: Sequence[DirectionClass]
) -> list[list[Hole]]:
    """Holes of one size and direction that are made alike: their ends are of one kind and in one plane."""
    of = {hole.place: hole for hole in holes}
    level = {
        place: (k, n)
        for k, kind in enumerate(kinds)
        for n, level in enumerate(kind.levels)
        for place in level
    }
    turned = {place: k for k, kind in enumerate(kinds) for place in kind.members}
    groups: list[list[Hole]] = []
    for size in sizes:
        own: dict[object, list[Hole]] = {}
        for hole in (of[place] for item in size for place in sorted(item.places) if place in of):
            ends = sorted((end.kind, level.get(end.place, (-1, -1))) for end in hole.ends)
            own.setdefault((turned.get(hole.place, -1), *ends), []).append(hole)
        groups += own.values()
    return groups


_LEAST_P = 1e-3  # of a pattern's misfit
_LEAST_EVIDENCE = float(np.log(100.0))  # of regular places, against any
_ASIDE = 0.1  # of the part's size, within which unrelated holes may lie about a regular place
_EXACT_M = 1e-9
_TIED_SD = 1e-2  # of the deviations without relations, to which these tie holes: what is not linear in them
_ONE_RUNG = 0.02  # of a pattern's length
_ONE_RING = 0.02  # of the distance from an axis, within which holes may be on one circle about it
_MOST_HOLES = 48  # of a circle, with those that are missing


@dataclass(frozen=True, slots=True, eq=False)
class HolePattern:
    """Equal holes at regular places.

    `places` are those of the holes' walls, `numbers` which of the pattern's holes they are; `x` and
    `covariance` its parameters (`Pattern`) in the chart of `across` (2, 3), metres.
    """

    pattern: Pattern
    places: tuple[int, ...]
    numbers: IntArray
    x: FloatArray
    covariance: FloatArray
    measured_covariance: FloatArray
    across: FloatArray
    about: int = -1  # the place of another surface, about whose axis a circle is


def find_patterns(
    sizes: Sequence[Sequence[RoundFaces]],
    kinds: Sequence[DirectionClass],
    known: JointSurfaces,
    axes: FloatArray,
) -> list[HolePattern]:
    """The patterns among parallel holes of one size: all of these, or those at one distance from an axis.

    Their charts are along `axes` (3, 3), the rows of the part's frame.
    """
    found = list[HolePattern]()
    for size, kind in product(sizes, kinds):
        left = [
            item.places[0] for item in size if item.places[0] in kind.members and item.kind == "hole diameter"
        ]
        while len(left) >= min(LEAST_SEEN.values()):
            best = _best_pattern(left, known, across_of(axes, known.at[left[0]].direction))
            if best is None:
                break
            found.append(best)
            left = [place for place in left if place not in best.places]
    return found


def _best_pattern(places: Sequence[int], known: JointSurfaces, across: FloatArray) -> HolePattern | None:
    """The pattern of most holes."""
    centres = np.array([across @ known.at[place].point for place in places])
    subsets = [tuple(range(len(places)))]
    for place, at in enumerate(known.at):
        if (
            place not in places
            and at.radius > 0
            and np.linalg.norm(np.cross(at.direction, known.at[places[0]].direction)) < 1e-2
        ):
            far = np.linalg.norm(centres - across @ at.point, axis=1)
            near = np.abs(far[:, None] - far) < _ONE_RING * far
            subsets += [tuple(np.flatnonzero(column).tolist()) for column in near.T]
    for subset in sorted(set(subsets), key=lambda each: (-len(each), each)):
        if len(subset) < min(LEAST_SEEN.values()):
            break
        tried = (
            _judged(begun, numbers, [places[k] for k in subset], known, across)
            for begun, numbers in _begun(centres[list(subset)])
        )
        found = [replace(one, about=_about(one, known)) for one in tried if one is not None]
        if found:  # four in a square are a circle where something stands in their middle
            return max(found, key=lambda one: one.about >= 0)
    return None


def _begun(centres: FloatArray) -> Iterator[tuple[Pattern, IntArray]]:
    """Patterns that centres (n, 2) may have, and the number of each in them: a row, a grid, a circle."""
    yield from _begun_lattice(centres)
    n, middle = len(centres), centres.mean(axis=0)
    step = centres - middle
    side = np.column_stack([2 * step, np.ones(n)])
    found, *_ = np.linalg.lstsq(side, np.square(step).sum(axis=1), rcond=None)
    centre = middle + found[:2]
    out = centres - centre
    ring, angle = float(np.linalg.norm(out, axis=1).mean()), np.arctan2(out[:, 1], out[:, 0])
    for count in range(n, min(2 * n, _MOST_HOLES) + 1):
        turn = (angle - angle[0]) * count / (2 * np.pi)
        numbers = np.rint(turn).astype(np.int64) % count
        if len(set(numbers.tolist())) == n and np.abs(turn - np.rint(turn)).max() < 0.1:
            yield Pattern(CIRCLE, (count, 1), np.array([*centre, angle[0], ring]), 0.0), numbers
            return


def _begun_lattice(centres: FloatArray) -> Iterator[tuple[Pattern, IntArray]]:
    """A row or a grid that has as many places as there are holes."""
    middle = centres.mean(axis=0)
    step = centres - centres[0]
    apart = np.linalg.norm(step, axis=1)
    near = [int(k) for k in np.argsort(apart, kind="stable")[1:]]
    for first in near[:3]:
        along = step[first] / apart[first]
        side = np.array([-along[1], along[0]])
        u, v = (centres - middle) @ along, (centres - middle) @ side
        columns, rows = (_ladder(each, float(apart.max())) for each in (u, v))
        if columns is None or rows is None:
            continue
        shape = (int(columns.max()) + 1, int(rows.max()) + 1)
        if shape[0] * shape[1] != len(centres) or shape[0] < 2:
            continue
        pitch = float(np.ptp(u)) / max(shape[0] - 1, 1)
        angle = float(np.arctan2(along[1], along[0]))
        if shape[1] == 1:
            yield Pattern(ROW, shape, np.array([*middle, angle, pitch]), 0.0), columns
        else:
            x = np.array([*middle, angle, pitch, float(np.ptp(v)) / (shape[1] - 1)])
            yield Pattern(GRID, shape, x, 0.0), columns * shape[1] + rows
        return


def _ladder(values: FloatArray, longest: float) -> IntArray | None:
    """Numbers (n,) of the rungs that values lie on, from 0; None where they are not evenly spaced.

    What differs by less than a small part of the pattern's length is on one rung.
    """
    order = np.sort(values)
    steps = np.diff(order)
    wide = steps[steps > _ONE_RUNG * longest]
    if not len(wide):
        return np.zeros(len(values), dtype=np.int64)
    turn = (values - order[0]) / float(np.median(wide))
    return np.rint(turn).astype(np.int64) if np.abs(turn - np.rint(turn)).max() < 0.1 else None


def _judged(
    begun: Pattern, numbers: IntArray, places: Sequence[int], known: JointSurfaces, across: FloatArray
) -> HolePattern | None:
    """A pattern fitted with the joint covariance of its holes' centres, where these bear it out."""
    middle = known.at[places[0]].point

    def centres_of(at: Sequence[Placement]) -> FloatArray:
        return np.concatenate([across @ (each.point - middle) for each in at])

    origin = across @ middle
    found = known.estimate(places, centres_of)
    centres = found.value.reshape(-1, 2)
    begun = replace(begun, x=begun.x - np.concatenate([origin, np.zeros(len(begun.x) - 2)]))
    begun = fit_pattern(begun, numbers, centres, np.zeros(len(begun.x), np.bool_))
    floor = _EXACT_M**2 + _TIED_SD**2 * float(np.diag(found.measured_covariance).mean())
    spread = found.covariance + floor * np.eye(2 * len(places))
    factor = cho_factor(spread)
    for _ in range(5):
        slopes = begun.slopes[numbers].reshape(2 * len(places), -1)
        error = (centres - begun.centres[numbers]).ravel()
        normal = slopes.T @ cho_solve(factor, slopes)
        begun = replace(begun, x=begun.x + np.linalg.solve(normal, slopes.T @ cho_solve(factor, error)))
    slopes = begun.slopes[numbers].reshape(2 * len(places), -1)
    error = (centres - begun.centres[numbers]).ravel()
    freedom = len(error) - len(begun.x)
    square = float(error @ cho_solve(factor, error))
    rest = qr(slopes)[0][:, len(begun.x) :]
    _, volume = np.linalg.slogdet(2 * np.pi * rest.T @ spread @ rest)
    evidence = freedom * np.log(2 * _ASIDE * known.size_m) - (volume + square) / 2
    if freedom < 1 or chdtrc(freedom, square) < _LEAST_P or evidence < _LEAST_EVIDENCE:
        return None
    gain = np.linalg.solve(slopes.T @ cho_solve(factor, slopes), cho_solve(factor, slopes).T)
    shift = np.concatenate([origin, np.zeros(len(begun.x) - 2)])
    return HolePattern(
        pattern=begun, places=tuple(places), numbers=numbers, x=begun.x + shift,
        covariance=gain @ spread @ gain.T, measured_covariance=gain @ found.measured_covariance @ gain.T,
        across=across,
    )  # fmt: skip


def pattern_rows(
    patterns: Sequence[HolePattern], known: JointSurfaces, x_axis: FloatArray
) -> Iterator[PartDimension]:
    """A row for each pitch circle, with its count and the angle of its first hole, or for each pitch."""
    for pattern in patterns:
        middle = known.at[pattern.places[0]]
        lift = middle.point - pattern.across.T @ (pattern.across @ middle.point)
        centre = lift + pattern.across.T @ pattern.x[:2]
        n, count = len(pattern.places), pattern.pattern.count
        seen = "" if n == count else f"{n} of {count} places"
        if pattern.pattern.kind == CIRCLE:
            out = pattern.pattern.centres[pattern.numbers[0]] - pattern.pattern.x[:2]
            end = centre + pattern.across.T @ out
            about = f"about surface {known.part.labels[pattern.about]}" if pattern.about >= 0 else ""
            note = ", ".join(text for text in (about, seen) if text)
            ends = np.stack([2 * centre - end, end])
            yield _pattern_row("pitch circle diameter", pattern, known, (3, 2.0), ends=ends, note=note)
            yield _start_angle(pattern, centre, end, known, x_axis)
            continue
        angle = float(pattern.x[2])
        along = pattern.across.T @ np.array([np.cos(angle), np.sin(angle)])
        side = pattern.across.T @ np.array([-np.sin(angle), np.cos(angle)])
        first = lift + pattern.across.T @ (pattern.x[:2] - pattern.pattern.x[:2] + pattern.pattern.centres[0])
        for k, way in enumerate((along, side)[: 1 + (pattern.pattern.kind == GRID)]):
            note = f"{pattern.pattern.shape[k]} along" if pattern.pattern.kind == GRID else seen
            ends = np.stack([first, first + pattern.x[3 + k] * way])
            yield _pattern_row("pitch", pattern, known, (3 + k, 1.0), ends=ends, note=note)


def _about(pattern: HolePattern, known: JointSurfaces) -> int:
    """The place of another surface on whose axis the middle of a circle lies; -1 for none."""
    if pattern.pattern.kind != CIRCLE:
        return -1
    sd = float(np.sqrt(np.trace(pattern.covariance[:2, :2])))
    for place, at in enumerate(known.at):
        is_axis = at.direction.any() and not at.is_plane and place not in pattern.places
        if is_axis and np.linalg.norm(pattern.across @ at.direction) < 1e-2:
            off = float(np.linalg.norm(pattern.across @ at.point - pattern.x[:2]))
            if off <= 4 * sd + 1e-6 * known.size_m:
                return place
    return -1


def _pattern_row(
    kind: Kind, pattern: HolePattern, known: JointSurfaces, part_of: tuple[int, float],
    *, ends: FloatArray, note: str,
) -> PartDimension:  # fmt: skip
    """A parameter of a pattern times a factor, `part_of`, as a dimension."""
    k, factor = part_of
    sd, before = (
        factor * float(np.sqrt(max(each[k, k], 0.0)))
        for each in (pattern.covariance, pattern.measured_covariance)
    )
    value = factor * float(pattern.x[k])
    return _plain_row(kind, value, (sd, before), pattern, known, ends=ends, note=note)


def _start_angle(
    pattern: HolePattern, centre: FloatArray, end: FloatArray, known: JointSurfaces, x_axis: FloatArray
) -> PartDimension:
    """The least angle from the frame's x to a hole, counted about the holes' direction."""
    zero = pattern.across @ x_axis
    step = 2 * np.pi / pattern.pattern.count
    begin = float(np.arctan2(zero[1], zero[0]))
    angle = (float(pattern.x[2]) - begin) % step
    sd = float(np.sqrt(max(pattern.covariance[2, 2], 0.0)))
    if step - angle <= 4 * sd + 1e-9:  # nothing, rounded the other way
        angle -= step
    before = float(np.sqrt(max(pattern.measured_covariance[2, 2], 0.0)))
    return _plain_row(
        "start angle", angle, (sd, before), pattern, known, ends=np.stack([centre, end]), note="from x"
    )


def _plain_row(
    kind: Kind, value: float, deviations: tuple[float, float], pattern: HolePattern, known: JointSurfaces,
    *, ends: FloatArray, note: str,
) -> PartDimension:  # fmt: skip
    sd, before = deviations
    return PartDimension(
        kind=kind,
        value=value,
        low=value - NORMAL_95 * sd,
        high=value + NORMAL_95 * sd,
        sd=sd,
        measured_sd=before,
        unit="rad" if kind == "start angle" else "m",
        surfaces=tuple(known.part.labels[place] for place in pattern.places),
        ends=ends,
        count=len(pattern.places),
        basis="pattern",
        note=note,
        places=pattern.places,
    )
