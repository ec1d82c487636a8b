# SPDX-License-Identifier: MIT
"""Measures of a profile: ordinates, radii, diameters and angles, with 95 % intervals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import ndtri

from completion.parts.profiles.chain import Segment
from completion.parts.profiles.profile import Profile
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane

SIGMA = float(ndtri(0.975))
"""Standard deviations in half a 95 % interval."""
_ALONG = 1e-3  # radians from an axis within which a line lies along it
_ROUND = np.radians(150.0)  # of an arc, from which its centre has ordinates
_CROSSING = 0.05  # sine of the angle between walls, below which their corner's interval is not told
_MM, _DEGREES = 1e3, float(np.degrees(1.0))
_Sign = Literal["", "R", "\u2300", "\u00b0"]


class Measure(NamedTuple):
    """A number of a profile.

    Attributes
    ----------
    value, half : float
        Millimetres, or degrees of angles; half of its 95 % interval, NaN where it is not told.
    place : (2,) float
        Where it is taken, in the profile, metres.
    way : (2,) float
        Which way a leader goes from there.
    sign : str
        Of a radius, a diameter or an angle; none of an ordinate.
    """

    value: float
    half: float
    place: FloatArray
    way: FloatArray
    sign: _Sign = ""


def ordinates_of(profile: Profile, axis: int) -> list[Measure]:
    """Places of a profile along x (0) or y (1) from the least of them, or from the centre of a round outline.

    Of a revolution diameters for y.
    """
    places = sorted(_places(profile, axis), key=lambda pair: float(pair[0][axis]))
    way, outer = -np.eye(2)[1 - axis], profile.loops[0].segments[0]
    if profile.sweep.kind == "revolved" and axis == 1:
        return [
            _measure(profile, 2 * at[1], 2 * by, at, way, sign="\u2300") for at, by in places if at[1] > 0
        ]
    first = next((k for k, pair in enumerate(places) if outer.is_whole and pair[0] is outer.centre), 0)
    return [_measure(profile, at[axis] - places[first][0][axis], by - places[first][1], at, way)
            for at, by in places]  # fmt: skip


def leaders_of(profile: Profile) -> list[Measure]:
    """Radii of arcs, diameters of circles, angles of slanted lines with the longest line along x or y."""
    found = []
    straight = [one for one in _segments(profile) if _slant(profile, one) <= _ALONG]
    datum = max(straight, key=lambda one: one.length, default=None)
    hollow = {id(one) for loop in profile.loops if loop.is_hollow for one in loop.segments}
    for one in _segments(profile):
        if one.centre is not None:
            away = np.sqrt([0.5, 0.5]) if one.is_whole else (one.middle - one.centre) / one.radius
            times, by = 2 if one.is_whole else 1, _by(profile, one.wall, [0, 0, 0, 0, 1])
            sign: _Sign = "\u2300" if one.is_whole else "R"
            way = -away if id(one) in hollow and not one.is_whole else away
            place = one.centre + one.radius * away
            found.append(_measure(profile, times * one.radius, times * by, place, way, sign=sign))
        elif one.length > 0 and _slant(profile, one) > _ALONG:
            x, y = one.end - one.start
            by = _by(profile, one.wall, [0, 1]) - (0 if datum is None else _by(profile, datum.wall, [0, 1]))
            angle, normal = float(np.arctan2(abs(y), abs(x))), np.array([y, -x]) / one.length
            found.append(_measure(profile, angle, by, one.middle, normal, sign="\u00b0"))
    return found


def _measure(
    profile: Profile, value: float, by: FloatArray, place: FloatArray, way: FloatArray, *, sign: _Sign = ""
) -> Measure:
    """A length or an angle of SI units, which has derivatives (n,) by all parameters."""
    scale = _DEGREES if sign == "\u00b0" else _MM
    half = SIGMA * float(np.sqrt(np.maximum(by @ profile.graph.covariance @ by, 0.0)))
    return Measure(scale * float(value), scale * half, place, way, sign)


def _slant(profile: Profile, one: Segment) -> float:
    """Sine of a line's least angle to x or y; of an arc infinite."""
    surface = profile.walls[one.wall].surface
    return float(np.abs(surface.normal_direction[:2]).min()) if isinstance(surface, Plane) else np.inf


def _segments(profile: Profile) -> list[Segment]:
    return [one for loop in profile.loops for one in loop.segments if one.wall >= 0]


def _by(profile: Profile, wall: int, slopes: Sequence[float] | FloatArray) -> FloatArray:
    """Derivatives (n,) by all parameters of what has slopes (k,) by the first of a wall's."""
    first = sum(len(fit.covariance) for fit in profile.walls[:wall])
    by = np.zeros(len(profile.graph.covariance))
    by[first : first + len(slopes)] = slopes
    return by


def _places(profile: Profile, axis: int) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Places (2,) with an ordinate, its derivative (n,): lines across it, centres, ends of slanted lines."""
    for one in _segments(profile):
        surface = profile.walls[one.wall].surface
        if isinstance(surface, Plane) and abs(surface.normal_direction[1 - axis]) < _ALONG:
            yield one.middle, _shift(profile, one, one.middle) * np.sign(surface.normal_direction[axis])
        elif one.centre is not None and abs(one.sweep_rad) >= _ROUND and profile.sweep.kind == "extruded":
            yield one.centre, _by(profile, one.wall, np.eye(2)[axis])
    for loop in profile.loops:
        ring = (
            [*loop.segments, *loop.segments[:1]]
            if loop.is_closed and len(loop.segments) > 1
            else loop.segments
        )
        for pair in pairwise(ring):
            if min(one.wall for one in pair) < 0 or not any(
                np.inf > _slant(profile, one) > _ALONG for one in pair
            ):
                continue
            place = pair[0].end
            turn = np.array([_normal(profile, one, place) for one in pair])
            if abs(float(np.linalg.det(turn))) >= _CROSSING:
                shifts = np.stack([_shift(profile, one, place) for one in pair])
                yield place, np.asarray(np.linalg.solve(turn, shifts)[axis])


def _normal(profile: Profile, one: Segment, place: FloatArray) -> FloatArray:
    """Unit normal (2,) of a segment's wall at a place (2,) on it."""
    if one.centre is not None:
        return (place - one.centre) / float(np.linalg.norm(place - one.centre))
    return np.asarray(profile.walls[one.wall].surface.normal_direction[:2])  # type: ignore[attr-defined]  # a plane


def _shift(profile: Profile, one: Segment, place: FloatArray) -> FloatArray:
    """Derivative (n,) of how far a segment's wall moves along its normal at a place (2,)."""
    return _by(profile, one.wall, -profile.walls[one.wall].gradient(np.append(place, 0.0)[None])[0])
