# SPDX-License-Identifier: MIT
"""Measures of a profile: ordinates, radii, diameters and angles, with 95 % intervals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import ndtri

from completion.parts.profiles.chain import Segment
from completion.parts.profiles.profile import Loop, Profile
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane

SIGMA = float(ndtri(0.975))
"""Standard deviations in half a 95 % interval."""
_ALONG = 1e-3  # radians from an axis within which a line lies along it
_ROUND = np.radians(150.0)  # of an arc, from which its centre has ordinates
_CROSSING = 0.05  # sine of the angle between walls, below which their corner's interval is not told


@dataclass(frozen=True, slots=True, eq=False)
class Measure:
    """A number of a profile.

    Attributes
    ----------
    value_mm, half_mm : float
        Millimetres, or degrees of angles; half of its 95 % interval, NaN where it is not told.
    place : (2,) float
        Where it is taken, in the profile, metres.
    way : (2,) float
        Which way a leader goes from there.
    is_diameter : bool
        Whether it is a diameter.
    """

    value_mm: float
    half_mm: float
    place: FloatArray
    way: FloatArray
    is_diameter: bool = False


def ordinates_of(profile: Profile, axis: int) -> list[Measure]:
    """Places of a profile along x (0) or y (1) from the least of them, or from the centre of a round outline.

    Of a revolution diameters for y.
    """
    places = sorted(_places(profile, axis), key=lambda pair: float(pair[0][axis]))
    if not places:
        return []
    is_diameter = profile.sweep.kind == "revolved" and axis == 1
    (datum, slope), factor = places[0], 2.0 if is_diameter else 1.0
    outer = profile.loops[0].segments[0]
    if outer.is_whole and outer.centre is not None and not is_diameter:
        datum, slope = next(pair for pair in places if pair[0] is outer.centre)
    found = []
    for place, by in places:
        if is_diameter and place[1] <= 0:
            continue
        by_value = factor * by if is_diameter else by - slope
        value = factor * place[axis] if is_diameter else place[axis] - datum[axis]
        found.append(
            Measure(
                1e3 * float(value), 1e3 * _half(profile, by_value), place, -np.eye(2)[1 - axis], is_diameter
            )
        )
    return found


def radii_of(profile: Profile) -> list[Measure]:
    """Radii of arcs and diameters of circles."""
    found = []
    for loop, one in _segments(profile):
        if one.centre is None:
            continue
        by = np.zeros(len(profile.graph.covariance))
        factor = 2.0 if one.is_whole else 1.0
        by[_first(profile, one.wall) + 4] = factor
        away = (
            np.array([np.sqrt(0.5), np.sqrt(0.5)]) if one.is_whole else (one.middle - one.centre) / one.radius
        )
        sign = -1.0 if not one.is_whole and loop.kind in ("hole", "slot", "pocket") else 1.0
        place = one.centre + one.radius * away
        half = 1e3 * _half(profile, by)
        found.append(Measure(1e3 * factor * one.radius, half, place, sign * away, one.is_whole))
    return found


def angles_of(profile: Profile) -> list[Measure]:
    """Angles of slanted lines with x, degrees, known as the longest line along x or y is."""
    found = []
    straight = [one for _, one in _segments(profile) if one.centre is None and _is_along(profile, one)]
    datum = max(straight, key=lambda one: one.length, default=None)
    for _, one in _segments(profile):
        surface = profile.walls[one.wall].surface
        if not isinstance(surface, Plane) or _is_along(profile, one):
            continue
        angle = float(np.degrees(np.arctan2(*np.abs(surface.u_direction[1::-1]))))
        by = np.zeros(len(profile.graph.covariance))
        by[_first(profile, one.wall) + 1] = np.degrees(1.0)
        if datum is not None:
            by[_first(profile, datum.wall) + 1] -= np.degrees(1.0)
        found.append(Measure(angle, _half(profile, by), one.middle, np.array([1.0, 0.0])))
    return found


def _is_along(profile: Profile, one: Segment) -> bool:
    """Whether a line lies along x or y."""
    surface = profile.walls[one.wall].surface
    return isinstance(surface, Plane) and bool(np.abs(surface.normal_direction[:2]).min() < _ALONG)


def _segments(profile: Profile) -> Iterator[tuple[Loop, Segment]]:
    for loop in profile.loops:
        yield from ((loop, one) for one in loop.segments if one.wall >= 0)


def _first(profile: Profile, wall: int) -> int:
    """Where a wall's parameters begin among all."""
    return sum(len(fit.covariance) for fit in profile.walls[:wall])


def _half(profile: Profile, by: FloatArray) -> float:
    """Half the 95 % interval of what has derivatives (n,) by all parameters."""
    return SIGMA * float(np.sqrt(max(by @ profile.graph.covariance @ by, 0.0)))


def _places(profile: Profile, axis: int) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Places (2,) with an ordinate, its derivative (n,): lines across it, centres, ends of slanted lines."""
    for loop in profile.loops:
        for one in (segment for segment in loop.segments if segment.wall >= 0):
            surface = profile.walls[one.wall].surface
            by = np.zeros(len(profile.graph.covariance))
            if isinstance(surface, Cylinder):
                if (
                    abs(one.sweep_rad) >= _ROUND
                    and profile.sweep.kind == "extruded"
                    and one.centre is not None
                ):
                    by[_first(profile, one.wall) + axis] = 1.0
                    yield one.centre, by
            elif isinstance(surface, Plane) and abs(surface.normal_direction[1 - axis]) < _ALONG:
                yield (
                    one.middle,
                    _shift(profile, one.wall, one.middle) * np.sign(surface.normal_direction[axis]),
                )
        for one, two in _corners(loop):
            by_corner = _corner_shift(profile, one, two, axis)
            if by_corner is not None:
                yield one.end, by_corner


def _corners(loop: Loop) -> Iterator[tuple[Segment, Segment]]:
    ring = (
        [*loop.segments, *loop.segments[:1]] if loop.is_closed and len(loop.segments) > 1 else loop.segments
    )
    yield from ((one, two) for one, two in pairwise(ring) if min(one.wall, two.wall) >= 0)


def _shift(profile: Profile, wall: int, place: FloatArray) -> FloatArray:
    """Derivative (n,) of how far a wall moves along its normal at a place (2,)."""
    by = np.zeros(len(profile.graph.covariance))
    fit, first = profile.walls[wall], _first(profile, wall)
    slope = fit.gradient(np.append(place, 0.0)[None])[0]
    by[first : first + len(slope)] = -slope
    return by


def _corner_shift(profile: Profile, one: Segment, two: Segment, axis: int) -> FloatArray | None:
    """Derivative (n,) of a corner's ordinate where a slanted line is; else None, or where walls touch."""
    normals = []
    is_slanted = False
    for segment in (one, two):
        surface = profile.walls[segment.wall].surface
        if isinstance(surface, Plane):
            normals.append(surface.normal_direction[:2])
            is_slanted |= min(abs(normals[-1])) >= _ALONG
        else:
            away = one.end - segment.centre
            normals.append(away / np.linalg.norm(away))
    turn = np.array(normals)
    if not is_slanted or abs(float(np.linalg.det(turn))) < _CROSSING:
        return None
    shifts = np.stack([_shift(profile, segment.wall, one.end) for segment in (one, two)])
    return np.asarray(np.linalg.solve(turn, shifts)[axis])
