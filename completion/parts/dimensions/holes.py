# SPDX-License-Identifier: MIT
"""Holes: how deep they are and whether they go through, and patterns of equal ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.linalg import cho_factor, cho_solve, qr
from scipy.special import chdtrc

from completion.features.holes.patterns import CIRCLE, GRID, LEAST_SEEN, ROW, Pattern, fit_pattern
from completion.parts.dimensions.dimension import Kind, PartDimension
from completion.parts.dimensions.distances import DirectionClass
from completion.parts.dimensions.face_samples import FaceSamples
from completion.parts.dimensions.frame import across_of
from completion.parts.dimensions.hole import CONE, FLOOR, OPEN, Hole, HoleEnd
from completion.parts.dimensions.joint_surfaces import JointSurfaces
from completion.parts.dimensions.sizes import RoundFaces
from completion.relations.equations import Placement
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Cone, Cylinder, Plane

_NEAR = 3.0  # sampling distances of a hole's end, within which the face lies that ends it
_WIDE = 1.5  # radii from the axis: what belongs to a hole's end
_MOSTLY = 0.5  # of its points there, that must lie within the radius of what closes a hole
_ACROSS = 0.1  # cosine of a plane's normal with the axis of a hole that ends in it


def holes_of(items: Sequence[RoundFaces], known: JointSurfaces, faces: FaceSamples) -> dict[int, Hole]:
    """The holes among round faces, by the place of their wall: each piece of a wall with its ends."""
    places = [place for item in items for place in sorted(item.places)
              if item.kind == "hole diameter" and isinstance(faces.surfaces[place], Cylinder)]  # fmt: skip
    return {place: Hole(place, _ends_of(place, known, faces)) for place in places}


def _ends_of(place: int, known: JointSurfaces, faces: FaceSamples) -> tuple[HoleEnd, HoleEnd]:
    """At either end the face that has most points there."""
    at = known.at[place]
    near, middle = _NEAR * faces.spacing_m, float(at.point @ at.direction)
    best = [(0, HoleEnd(OPEN, -1)), (0, HoleEnd(OPEN, -1))]
    for other in sorted(faces.neighbours[place]):
        surface, step = faces.surfaces[other], faces.of(other) - at.point
        height = step @ at.direction
        away = np.linalg.norm(step - height[:, None] * at.direction, axis=1)
        beside = away < _WIDE * at.radius + near
        if not beside.any():
            continue
        is_inside = float(np.mean(away[beside] < at.radius)) > _MOSTLY
        for k, end in enumerate(faces.reach(place, at.direction)):
            far = abs(float(np.median(height[beside])) + middle - end)
            if isinstance(surface, Plane):
                fits = bool(abs(surface.normal_direction @ at.direction) > _ACROSS)
                kind = FLOOR if is_inside else OPEN
            else:
                fits, kind = isinstance(surface, Cone), CONE if is_inside else OPEN
            if fits and far < (max(near, at.radius) if isinstance(surface, Cone) else near):
                best[k] = max(best[k], (int(beside.sum()), HoleEnd(kind, other)), key=lambda pair: pair[0])
    return best[0][1], best[1][1]


def depth_rows(
    groups: Sequence[Sequence[Hole]], known: JointSurfaces, faces: FaceSamples
) -> Iterator[PartDimension]:
    """The depth of blind holes, from the plane of their mouth to their floor, or to where a cone begins."""
    for group in groups:
        first = group[0]
        kinds = [end.kind for end in first.ends]
        if kinds.count(OPEN) != 1 or any(end.place < 0 for end in first.ends):
            continue
        mouth, floor = first.ends if kinds[0] == OPEN else first.ends[::-1]
        if not known.at[mouth.place].is_plane:  # a countersink: its depth is none of this cylinder's
            continue
        measure = _to_cone if floor.kind == CONE else _to_plane
        at, reach = known.at[first.place], faces.reach(first.place, known.at[first.place].direction)
        foot = at.point - float(at.point @ at.direction) * at.direction
        yield known.dimension(
            "hole depth", (first.place, mouth.place, floor.place), measure,
            alike=[hole.place for hole in group],
            note="to the cone" if floor.kind == CONE else "",
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
    point = cone.point + (hole.radius - cone.radius) / np.tan(cone.half_angle) * cone.direction
    return abs(float(hole.direction @ (point - hole.point)) - _height_on_axis(hole, at[1]))


def stepped_holes(holes: Mapping[int, Hole], kinds: Sequence[DirectionClass]) -> tuple[tuple[Hole, ...], ...]:
    """The holes by what is drilled at one place: those on one axis of which one opens in another's end."""
    line = {
        place: (k, n) for k, kind in enumerate(kinds) for n, line in enumerate(kind.axes) for place in line
    }
    head = {place: place for place in holes}
    for one, other in product(holes.values(), repeat=2):
        closed = {end.place for end in one.ends if end.kind != OPEN}
        opens = {end.place for end in other.ends if end.kind == OPEN and end.place >= 0}
        is_on_axis = one is not other and line.get(one.place, -1) == line.get(other.place, -2)
        if is_on_axis and closed & opens:
            old, new = head[other.place], head[one.place]
            head = {place: new if to == old else to for place, to in head.items()}
    return tuple(
        tuple(holes[place] for place in sorted(holes) if head[place] == to)
        for to in dict.fromkeys(head.values())
    )


def alike_holes(
    sizes: Sequence[Sequence[RoundFaces]], holes: Mapping[int, Hole], kinds: Sequence[DirectionClass]
) -> list[list[Hole]]:
    """Holes of one size and direction that are made alike: their ends are of one kind and in one plane."""
    level = {
        place: (k, n)
        for k, kind in enumerate(kinds)
        for n, level in enumerate(kind.levels)
        for place in level
    }
    turned = {place: k for k, kind in enumerate(kinds) for place in kind.members}
    groups: dict[object, list[Hole]] = {}
    for number, size in enumerate(sizes):
        for hole in (holes[place] for item in size for place in sorted(item.places) if place in holes):
            ends = sorted((end.kind, level.get(end.place, (-1, -1))) for end in hole.ends)
            groups.setdefault((number, turned.get(hole.place, -1), *ends), []).append(hole)
    return list(groups.values())


_LEAST_P = 1e-3  # of a pattern's misfit
_LEAST_EVIDENCE = float(np.log(100.0))  # of regular places, against any
_ASIDE = 0.1  # of the part's size, within which unrelated holes may lie about a regular place
_EXACT_M = 1e-9
_TIED_SD = 1e-2  # of the deviations without relations, to which these tie holes: what is not linear in them
_ONE_RUNG = 0.02  # of a pattern's length
_ONE_RING = 0.02  # of the distance from an axis, within which holes may be on one circle about it
_LEAST_HOLES = min(LEAST_SEEN.values())
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

    def row(
        self, kind: Kind, value: float, parameter: int, known: JointSurfaces, *, ends: FloatArray, note: str
    ) -> PartDimension:
        """The dimension that a parameter is, or twice that, with its `ends` (2, 3)."""
        factor = 2.0 if kind.endswith("diameter") else 1.0
        sd, before = (factor * float(np.sqrt(max(each[parameter, parameter], 0.0)))
                      for each in (self.covariance, self.measured_covariance))  # fmt: skip
        return PartDimension(
            kind=kind, value=float(value), sd=sd, measured_sd=before, places=self.places, ends=ends,
            surfaces=tuple(known.part.labels[place] for place in self.places), count=len(self.places),
            note=note, is_pattern=True,
        )  # fmt: skip


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
        left = [item.places[0] for item in size
                if item.places[0] in kind.members and item.kind == "hole diameter"]  # fmt: skip
        while len(left) >= _LEAST_HOLES:
            best = _best_pattern(left, known, across_of(axes, known.at[left[0]].direction))
            if best is None:
                break
            found.append(best)
            left = [place for place in left if place not in best.places]
    return found


def _best_pattern(places: Sequence[int], known: JointSurfaces, across: FloatArray) -> HolePattern | None:
    """The pattern of most holes."""
    centres = np.array([across @ known.at[place].point for place in places])
    subsets = {tuple(range(len(places)))}
    for place, at in enumerate(known.at):
        if place not in places and at.radius > 0 and _is_along(across, at):
            far = np.linalg.norm(centres - across @ at.point, axis=1)
            near = np.abs(far[:, None] - far) < _ONE_RING * far
            subsets |= {tuple(np.flatnonzero(column).tolist()) for column in near.T}
    enough = [subset for subset in subsets if len(subset) >= _LEAST_HOLES]
    for subset in sorted(enough, key=lambda each: (-len(each), each)):
        tried = (_judged(begun, numbers, [places[k] for k in subset], known, across)
                 for begun, numbers in _begun(centres[list(subset)]))  # fmt: skip
        found = [replace(one, about=_about(one, known)) for one in tried if one is not None]
        if found:  # four in a square are a circle where something stands in their middle
            return max(found, key=lambda one: one.about >= 0)
    return None


def _is_along(across: FloatArray, at: Placement) -> bool:
    """Whether an axis is at right angles to both directions (2, 3) of a chart."""
    return bool(at.direction.any() and np.linalg.norm(across @ at.direction) < 1e-2)


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
    patterns: Sequence[HolePattern], known: JointSurfaces, faces: FaceSamples, x_axis: FloatArray
) -> Iterator[PartDimension]:
    """A row for each pitch circle, with its count and the angle of its first hole, or for each pitch.

    The angle is the least from the frame's `x_axis` (3,) to a hole, counted about the holes' direction.
    """
    for of in patterns:
        at, count = known.at[of.places[0]], of.pattern.count
        rise = faces.reach(of.places[0], at.direction)[1] - float(at.point @ at.direction)
        first = at.point + rise * at.direction
        seen = "" if len(of.places) == count else f"{len(of.places)} of {count} places"

        def place(uv: FloatArray, first: FloatArray = first, of: HolePattern = of) -> FloatArray:
            return np.asarray(first + of.across.T @ (uv - of.across @ first))

        centres, middle = of.pattern.centres + of.x[:2] - of.pattern.x[:2], place(of.x[:2])
        if of.pattern.kind == CIRCLE:
            end = place(centres[of.numbers[0]])
            about = f"about surface {known.part.labels[of.about]}" if of.about >= 0 else ""
            note = ", ".join(text for text in (about, seen) if text)
            ends = np.stack([2 * middle - end, end])
            yield of.row("pitch circle diameter", 2 * of.x[3], 3, known, ends=ends, note=note)
            zero, step = of.across @ x_axis, 2 * np.pi / count
            angle = float(of.x[2] - np.arctan2(zero[1], zero[0])) % step
            if step - angle <= 4 * float(np.sqrt(max(of.covariance[2, 2], 0.0))) + 1e-9:
                angle -= step  # nothing, rounded the other way
            yield of.row("start angle", angle, 2, known, ends=np.stack([middle, end]), note="from x")
            continue
        is_grid = of.pattern.kind == GRID
        along = np.array([np.cos(of.x[2]), np.sin(of.x[2])])
        ways = (along, np.array([-along[1], along[0]]))
        for k, way in enumerate(ways[: 1 + is_grid]):
            ends = np.stack([place(centres[0]), place(centres[0] + of.x[3 + k] * way)])
            note = f"{of.pattern.shape[k]} along" if is_grid else seen
            yield of.row("pitch", float(of.x[3 + k]), 3 + k, known, ends=ends, note=note)


def _about(of: HolePattern, known: JointSurfaces) -> int:
    """The place of another surface on whose axis the middle of a circle lies; -1 for none."""
    reach = 4 * float(np.sqrt(np.trace(of.covariance[:2, :2]))) + 1e-6 * known.size_m
    found = [place for place, at in enumerate(known.at)
             if not at.is_plane and place not in of.places and _is_along(of.across, at)
             and np.linalg.norm(of.across @ at.point - of.x[:2]) <= reach]  # fmt: skip
    if of.pattern.kind != CIRCLE or not found:
        return -1
    return min(found, key=lambda place: (known.at[place].half_angle + known.at[place].ring_radius > 0, place))
