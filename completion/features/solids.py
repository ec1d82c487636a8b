# SPDX-License-Identifier: MIT
"""Solids on one page: an upright frame, a start by structure, the template, and what it measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from completion.features import limits
from completion.features.engine.template import (
    FeatureStatus,
    Given,
    Measurements,
    Template,
    TemplateFit,
    best_first,
)
from completion.features.engine.template_fit import NOTHING, fit_template
from completion.features.upright_structure import (
    Flight,
    Shaft,
    Upright,
    UprightSample,
    find_flight,
    find_shafts,
    levels,
    trim_flight,
)
from scenes.checks import BoolArray, FloatArray, InputError, IntArray

_WIDTHS, _TURNS, _TOPS = (2.2, 2.8, 3.6), (0.2, 1.0), (15, 30, 50)  # radii, radians, percentiles of height


class ColumnTemplate:
    """A shaft above the top of a base, which goes down to wherever it ends.

    Parameters: x, y (of the axis), heading (of a side, in a quarter turn), width (of the base), top (of the
    base), radius (of the shaft); in an upright frame.
    """

    kind = "column"
    names = ("x", "y", "heading", "width", "top", "radius")
    faces = ("side 1", "side 2", "side 3", "side 4", "top", "shaft")

    def __init__(self, frame: Upright) -> None:
        self.frame = frame

    def bounds(self, measured: Measurements) -> tuple[FloatArray, FloatArray]:
        """Return (6,) and (6,): the box of what was measured; widths and radii up to its size."""
        local = self.frame.local(measured.points)
        low, high = local.min(axis=0), local.max(axis=0)
        size = float(np.ptp(local[:, :2], axis=0).max())
        lower = [low[0], low[1], -np.pi / 2, 0.02 * size, low[2], 0.01 * size]
        return np.array(lower), np.array([high[0], high[1], np.pi / 2, 1.5 * size, high[2], 0.75 * size])

    def distance(self, points: FloatArray, x: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the distance of points (n, 3) from the nearest face (n,), and its number (n,)."""
        place_x, place_y, heading, width, top, radius = x
        local = self.frame.local(points) - [place_x, place_y, top]
        cosine, sine = np.cos(heading), np.sin(heading)
        u = cosine * local[:, 0] + sine * local[:, 1]
        v = cosine * local[:, 1] - sine * local[:, 0]
        up, out, half = local[:, 2], np.hypot(local[:, 0], local[:, 1]), width / 2
        over = np.maximum(up, 0.0)
        beside = [np.maximum(np.abs(coordinate) - half, 0.0) for coordinate in (v, u)]
        sides = [
            np.sqrt((coordinate - sign * half) ** 2 + over**2 + past**2)
            for sign in (1.0, -1.0)
            for coordinate, past in zip((u, v), beside, strict=True)
        ]
        within = np.maximum(radius - out, 0.0)
        flat = np.sqrt(up**2 + beside[0] ** 2 + beside[1] ** 2 + within**2)
        shaft = np.hypot(out - radius, np.minimum(up, 0.0))
        each = np.stack([*sides, flat, shaft])
        return each.min(axis=0), each.argmin(axis=0) + 1


def column_starts(shaft: Shaft, heights: FloatArray) -> FloatArray:
    """Return parameters (s, 6) to begin with, by a shaft and the heights (n,) of what lies about it."""
    tops = np.percentile(heights, _TOPS)
    starts = [
        [shaft.x, shaft.y, turn, wide * shaft.radius, top, shaft.radius]
        for top in tops
        for wide in _WIDTHS
        for turn in _TURNS
    ]
    return np.array(starts)


class Stairs:
    """A straight flight of n treads and the n risers before them, between two places across the way.

    Parameters: heading (of the way up), forward and height (of the nose of the first tread, along the way
    and up), going, rise; in an upright frame.
    """

    kind = "stairs"
    names = ("heading", "forward", "height", "going", "rise")

    def __init__(self, frame: Upright, count: int, about: FloatArray, sides: FloatArray) -> None:
        self.frame, self.count, self.about, self.sides = frame, count, about, sides
        numbers = range(1, count + 1)
        self.faces = (*(f"tread {k}" for k in numbers), *(f"riser {k}" for k in numbers))

    def bounds(self, measured: Measurements) -> tuple[FloatArray, FloatArray]:
        """Return (5,) and (5,): a step round what structure says; steps longer than the spacing of points."""
        _, _, _, going, rise = self.about
        reach = np.array([np.pi / 6, going, rise, 0.4 * going, 0.3 * rise])
        lower = self.about - reach
        lower[3:] = np.maximum(lower[3:], np.minimum(measured.spacing, self.about[3:]))
        return lower, self.about + reach

    def distance(self, points: FloatArray, x: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the distance of points (n, 3) from the nearest tread or riser (n,), and its number (n,)."""
        heading, forward, height, going, rise = x
        local = self.frame.local(points)
        along = local[:, :2] @ [np.cos(heading), np.sin(heading)] - forward
        up = local[:, 2] - height
        near = np.round((along / going + up / rise) / 2).astype(np.int64)
        step = np.clip(near[:, None] + np.arange(-1, 2), 0, self.count - 1)
        u, v = along[:, None] - step * going, up[:, None] - step * rise
        across = local[:, :2] @ [-np.sin(heading), np.cos(heading)]
        beside = np.abs(across - np.clip(across, *self.sides))
        each = np.hstack([np.hypot(v, u - np.clip(u, 0.0, going)), np.hypot(u, v - np.clip(v, -rise, 0.0))])
        numbers = np.hstack([step + 1, step + 1 + self.count])
        best = each.argmin(axis=1)[:, None]
        nearest, number = (np.take_along_axis(choice, best, 1)[:, 0] for choice in (each, numbers))
        return np.hypot(nearest, beside), number


KINDS = ("stairs", "column")
_UP = (0.0, 0.0, 1.0)
_MOST_POINTS = 20_000  # that a template is fitted to


def find_solids(
    measured: Measurements,
    kinds: Sequence[str],
    given: Given = NOTHING,
    *,
    rng: np.random.Generator,
    budget: int = 20_000,
    up: Sequence[float] = _UP,
) -> list[TemplateFit]:
    """Find a flight of stairs or a column with a square base; the best first.

    Parameters
    ----------
    measured : Measurements
        Points, and beams where there are.
    kinds : sequence of str
        Of "stairs", "column".
    given : mapping
        What is known: going, rise, count; width, top, radius; held exactly.
    rng : Generator
        Of the search.
    budget : int
        Evaluations at most, for each kind.
    up : (3,) float
        Which way is up; both stand upright.

    Raises
    ------
    InputError
        Another kind, an up without length, too few points.
    """
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown:
        raise InputError(f"there is no solid {unknown[0]}; there are {', '.join(KINDS)}")
    axis = np.asarray(up, dtype=np.float64)
    if axis.shape != (3,) or not np.isfinite(axis).all() or not axis.any():
        raise InputError(f"up is a direction of three numbers, got {up}")
    frame = Upright.about(measured, axis)
    find = {"stairs": _stairs, "column": _column}
    return best_first([find[kind](frame, measured, given, rng=rng, budget=budget) for kind in kinds])


def _stairs(
    frame: Upright, measured: Measurements, given: Given, *, rng: np.random.Generator, budget: int
) -> TemplateFit:
    """A flight where structure sees one, fitted to what lies about it."""
    local = frame.local(measured.points)
    sample = UprightSample.of(local)
    flight = find_flight(sample, measured.noise, measured.spacing, dict(given))
    if isinstance(flight, str):
        return TemplateFit.absent("stairs", Stairs.names, len(local), flight)
    known = {name: value for name, value in given.items() if name in Stairs.names}
    if "count" in given:
        flight = flight._replace(n_steps=int(given["count"]))
    for _ in range(2):
        template, near = Stairs(frame, flight.n_steps, flight.x, flight.sides), _about_flight(local, flight)
        fit = _fit_solid(template, measured, near, known, rng=rng, budget=budget, starts=flight.x[None])
        seen = [
            k for k in range(flight.n_steps) if any(fit.sides[n].is_seen for n in (k, k + flight.n_steps))
        ]
        if "count" in given or not seen or len(seen) == flight.n_steps:
            break
        flight = trim_flight(flight, fit.x, seen)  # a step at an end that nothing shows is none
    count = flight.n_steps
    heading, forward, height, going, rise = fit.x
    way, middle = np.array([np.cos(heading), np.sin(heading)]), float(flight.sides.mean())
    steps = np.arange(count)
    along = forward + (steps + 0.5) * going
    flat = along[:, None] * way + middle * np.array([-way[1], way[0]])
    geometry = {
        "count": count,
        "width": float(np.ptp(flight.sides)),
        "axis": way @ frame.turn[:2],
        "centres": frame.outside(np.column_stack([flat, height + steps * rise])),
    }
    treads = sum(side.is_seen for side in fit.sides[:count])
    if fit.status is FeatureStatus.FOUND and treads < limits.LEAST_STEPS:
        fit = replace(fit, status=FeatureStatus.AMBIGUOUS, reason=f"only {treads} treads were seen")
    return replace(fit, geometry=geometry)


def _about_flight(local: FloatArray, flight: Flight) -> BoolArray:
    """Which points (n, 3) lie about a flight, without the floor that its first riser stands on."""
    heading, forward, height, going, rise = flight.x
    along = local[:, :2] @ [np.cos(heading), np.sin(heading)] - forward
    across = local[:, :2] @ [-np.sin(heading), np.cos(heading)]
    up = local[:, 2] - height
    inside = (along > -going) & (along < (flight.n_steps + 1) * going)
    inside &= (up > -limits.BELOW_TREAD * rise) & (up < (flight.n_steps + 0.5) * rise)
    return np.asarray(inside & (across > flight.sides[0]) & (across < flight.sides[1]))


def _column(
    frame: Upright, measured: Measurements, given: Given, *, rng: np.random.Generator, budget: int
) -> TemplateFit:
    """A column about one of the upright cylinders among the points."""
    local = frame.local(measured.points)
    known = {name: value for name, value in given.items() if name in ColumnTemplate.names}
    sample = UprightSample.of(local)
    shafts = find_shafts(sample, measured.spacing, measured.noise, radius=known.get("radius"))
    if not shafts:
        return TemplateFit.absent(
            "column", ColumnTemplate.names, len(local), "no upright cylinder was measured"
        )
    fits = []
    for shaft in shafts:
        near = _about_shaft(local, shaft, sample, measured)
        starts = column_starts(shaft, local[near, 2])
        each = budget // len(shafts)
        fit = _fit_solid(ColumnTemplate(frame), measured, near, known, rng=rng, budget=each, starts=starts)
        fits.append(_as_column(fit, frame))
    return best_first(fits)[0]


def _about_shaft(local: FloatArray, shaft: Shaft, sample: UprightSample, measured: Measurements) -> BoolArray:
    """Which points (n, 3) lie about a shaft, without floors and ceilings, which go on beyond."""
    out = np.hypot(*(sample.flat[:, :2] - shaft[:2]).T) / shaft.radius
    beyond = sample.flat[(out > limits.BASE_RADII) & (out < limits.BEYOND_RADII), 2]
    width = max(limits.ON_SHAFT_SD * measured.noise, measured.spacing)
    near: BoolArray = np.hypot(*(local[:, :2] - shaft[:2]).T) < limits.BASE_RADII * shaft.radius
    for height in levels(beyond, width, limits.SHAFT_POINTS):
        near &= np.abs(local[:, 2] - height) > width
    return near


def _as_column(fit: TemplateFit, frame: Upright) -> TemplateFit:
    """The fit with what else a column must show, and its geometry."""
    x, y, _, width, top, radius = fit.x
    if fit.status is not FeatureStatus.NONE:
        seen = {side.name for side in fit.sides if side.is_seen}
        of_base = [name for name in seen if name.startswith("side")]
        against = [side.name for side in fit.sides if side.contradicted > side.confirmed]
        if "shaft" not in seen or not of_base:
            reason = f"shaft and base belong to a column: seen were {', '.join(sorted(seen))}"
            fit = replace(fit, status=FeatureStatus.NONE, reason=reason)
        elif against:
            sentence = f"beams went through {', '.join(against)}"
            fit = replace(fit, status=FeatureStatus.NONE, reason=sentence)
        elif len(of_base) == 1 and fit.status is FeatureStatus.FOUND:
            sentence = "one side of its base was seen: anything may stand beside a shaft"
            fit = replace(fit, status=FeatureStatus.AMBIGUOUS, reason=sentence)
        elif width < 2 * radius:
            fit = replace(fit, status=FeatureStatus.NONE, reason="the base is narrower than the shaft")
    place = frame.outside(np.array([[x, y, top]]))
    return replace(fit, geometry={"radius": radius, "axis": frame.turn[2], "centres": place})


def _fit_solid(
    template: Template,
    measured: Measurements,
    near: BoolArray,
    known: Given,
    *,
    rng: np.random.Generator,
    budget: int,
    starts: FloatArray,
) -> TemplateFit:
    """A template fitted to some of the points that are near (n,); all near ones are assigned to its faces."""
    which = np.flatnonzero(near)
    sample = which[:: max(1, len(which) // _MOST_POINTS)]
    beam = None if measured.beam_of_point is None else measured.beam_of_point[sample]
    part = replace(measured, points=measured.points[sample], beam_of_point=beam, faces=None)
    fit = fit_template(template, part, known, rng=rng, budget=budget, starts=starts)
    off, _ = template.distance(part.points, fit.x)
    allowed = float(np.abs(off[fit.assignment > 0]).max(initial=0.0))
    away, face = template.distance(measured.points[which], fit.x)
    assignment = np.zeros(len(near), dtype=fit.assignment.dtype)
    assignment[which] = np.where(np.abs(away) <= allowed, face, 0)
    return replace(fit, assignment=assignment)
