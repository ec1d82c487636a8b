# SPDX-License-Identifier: MIT
"""Growing: a surface from few oriented points in closed form, grown to where it still predicts others.

A surface fitted to a patch is known well there and badly far from it. A point joins where its distance is
within what noise and the surface's own deviation there explain, and where that deviation is small; with more
points the surface is known farther out. So it grows to the points it explains and no farther, and no radius
of search is given.

In closed form normals count as lines. A cylinder's axis is at right angles to all normals, a cone's apex lies
in all tangent planes, and the normals of a torus meet its axis; what is left are circles and directions,
linear again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.sparse import csr_array

from completion.fitting.chart import SphereChart, axis_frame
from completion.fitting.kinds import chart_of
from completion.fitting.result import SurfaceFit
from completion.fitting.starts import rotation_axes, torus_about
from completion.parts.division.adjusting import KINDS, N_PARAMETERS, adjusted, n_within, row_of
from completion.parts.division.limits import (
    CUT,
    LEAST_ANGLE,
    MOST_DEVIATION,
    MOST_OF_FACE,
    PLANE_RADIUS,
    STILL_SHARE,
)
from completion.parts.division.neighbourhoods import Neighbourhoods
from scenes.checks import BoolArray, FloatArray, InputError, IntArray
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus
from texture.engine.compiled import compiled

_MOST_POINTS = 800  # that a surface is polished on
_LIMITS = (3, 0.01, PLANE_RADIUS)  # steps: what calls this repeats it; tolerances; extents of the points


def hypotheses(kind: str, points: FloatArray, normals: FloatArray) -> list[Surface]:
    """Return surfaces of a kind near points (n, 3) with normals (n, 3), none or few; metres."""
    centre = points.mean(axis=0)
    offset = points - centre
    scale = float(np.sqrt(np.einsum("ij,ij->", offset, offset) / len(offset)))
    if scale == 0:
        return []
    unit = offset / scale
    made = {"plane": _planes, "sphere": _spheres, "cylinder": _cylinders, "cone": _cones, "torus": _tori}
    try:
        surfaces = made[kind](unit, normals)
        return [chart_of(surface, np.zeros(3), 1.0).surface(centre, scale, False) for surface in surfaces]
    except (np.linalg.LinAlgError, InputError):
        return []


def refine_surface(
    surface: Surface, points: FloatArray, tolerance: float, most: int = _MOST_POINTS
) -> tuple[Surface, FloatArray] | None:
    """Return the least-squares surface near another, and its covariance (k, k) at this tolerance.

    Points (n, 3), about so many of them at `most`, count with Tukey's weights at `tolerance`, metres, about
    the surface as it comes. None where they determine no such surface.
    """
    stride = max(1, len(points) // most)
    kind, row = row_of(surface)
    is_found, row, covariance = adjusted(
        kind, row, np.ascontiguousarray(points[::stride]), tolerance, _LIMITS
    )
    made = _surface_of(surface.kind, row, points) if is_found else None
    return None if made is None else (made, covariance / stride)


def _surface_of(kind: str, row: FloatArray, points: FloatArray) -> Surface | None:
    """The surface of a kind and a row (8,), `adjusting`'s, near points (n, 3), in its covariance's frame."""
    point, axis = row[:3], row[3:6]
    try:
        if kind == "plane":
            return Plane(point, axis, axis_frame(axis)[0])
        if kind == "sphere":
            middle = points.mean(axis=0)
            return SphereChart(point - middle, row[6]).surface(middle, 1.0, False)
        if kind == "torus":
            return Torus(point, axis, row[6], row[7])
        return Cylinder(point, axis, row[6]) if kind == "cylinder" else Cone(point, axis, row[6], row[7])
    except InputError:
        return None


def _planes(points: FloatArray, _normals: FloatArray) -> list[Surface]:
    _, axes = np.linalg.eigh(points.T @ points)
    return [Plane(np.zeros(3), axes[:, 0])]


def _spheres(points: FloatArray, normals: FloatArray) -> list[Surface]:
    """By the squared distances, and where the normals meet."""
    surfaces: list[Surface] = []
    basis = np.column_stack([2 * points, np.ones(len(points))])
    *centre, constant = np.linalg.lstsq(basis, np.einsum("ij,ij->i", points, points), rcond=None)[0]
    radius2 = float(constant + np.dot(centre, centre))
    if radius2 > 0:
        surfaces.append(Sphere(centre, np.sqrt(radius2)))
    across = np.eye(3) - np.einsum("ni,nj->nij", normals, normals)
    matrix, right = across.sum(axis=0), np.einsum("nij,nj->i", across, points)
    met = np.linalg.solve(matrix + 1e-12 * len(points) * np.eye(3), right)
    radius = float(np.median(np.linalg.norm(points - met, axis=1)))
    return [*surfaces, Sphere(met, radius)] if radius > 0 else surfaces


def _cylinders(points: FloatArray, normals: FloatArray) -> list[Surface]:
    """About the direction that the normals are across: a circle by squares, and where the normals meet."""
    _, axes = np.linalg.eigh(normals.T @ normals)
    axis, frame = axes[:, 0], axes[:, 1:]
    flat, across = points @ frame, normals @ frame
    surfaces: list[Surface] = []
    basis = np.column_stack([2 * flat, np.ones(len(flat))])
    *middle, constant = np.linalg.lstsq(basis, np.einsum("ij,ij->i", flat, flat), rcond=None)[0]
    radius2 = float(constant + np.dot(middle, middle))
    if radius2 > 0:
        surfaces.append(Cylinder(frame @ np.asarray(middle), axis, np.sqrt(radius2)))
    turned = np.column_stack([-across[:, 1], across[:, 0]])
    met = np.linalg.lstsq(turned, np.einsum("ij,ij->i", turned, flat), rcond=None)[0]
    radius = float(np.median(np.linalg.norm(flat - met, axis=1)))
    return [*surfaces, Cylinder(frame @ met, axis, radius)] if radius > 0 else surfaces


def _cones(points: FloatArray, normals: FloatArray) -> list[Surface]:
    """By the apex in all tangent planes, and by the meridians about the axes that the normals meet."""
    cones: list[Surface] = []
    apex = np.linalg.lstsq(normals, np.einsum("ij,ij->i", normals, points), rcond=1e-9)[0]
    ways = points - apex
    length = np.linalg.norm(ways, axis=1)
    if (length > 0).all():
        ways = ways / length[:, None]
        axis = np.linalg.lstsq(ways, np.ones(len(ways)), rcond=1e-9)[0]
        size = float(np.linalg.norm(axis))
        if 1 < size < np.inf:
            cosine = 1 / size
            cones += _cone(apex, axis * cosine, float(np.arccos(cosine)), float(length.mean()))
    for point, axis in rotation_axes(points, normals, 3):
        cones += cones_about(points, point, axis)
    return cones


def cones_about(points: FloatArray, point: FloatArray, axis: FloatArray) -> list[Surface]:
    """The cone about an axis through `point` (3,) along a unit `axis` (3,), of points (n, 3)."""
    offset = points - point
    height = offset @ axis
    from_axis = np.linalg.norm(offset - height[:, None] * axis, axis=1)
    about = np.column_stack([height - height.mean(), from_axis - from_axis.mean()])
    _, sides = np.linalg.eigh(about.T @ about)
    along = sides[:, 1]
    if abs(along[0]) < 1e-6 or abs(along[1]) < 1e-6:
        return []
    slope = float(along[1] / along[0])
    direction = axis if slope > 0 else -axis
    middle = point + height.mean() * axis
    return [Cone(middle, direction, float(from_axis.mean()), float(np.arctan(abs(slope))))]


def _cone(apex: FloatArray, axis: FloatArray, half_angle: float, length: float) -> list[Surface]:
    sine, cosine = np.sin(half_angle), np.cos(half_angle)
    if length * sine < 1e-9:
        return []
    return [Cone(apex + length * cosine * axis, axis, length * sine, half_angle)]


def _tori(points: FloatArray, normals: FloatArray) -> list[Surface]:
    charts = [chart for axis in rotation_axes(points, normals, 3) for chart in torus_about(points, *axis)]
    rings = [chart for chart in charts if chart.tube_radius < chart.radius]
    return [chart.surface(np.zeros(3), 1.0, False) for chart in rings]


@compiled
def rings_around(first: IntArray, beside: IntArray, allowed: BoolArray, begin: IntArray, n: int) -> IntArray:
    """Points within n steps of those in `begin`, these too, of those allowed (m,).

    `first` and `beside` are a sparse graph's.
    """
    seen = np.zeros(len(allowed), dtype=np.bool_)
    stack = np.empty(len(allowed), dtype=np.int64)
    top = 0
    for start in begin:
        if allowed[start] and not seen[start]:
            seen[start] = True
            stack[top] = start
            top += 1
    here = begin
    for _ in range(n):
        high = top
        for at in here:
            for place in range(first[at], first[at + 1]):
                there = beside[place]
                if allowed[there] and not seen[there]:
                    seen[there] = True
                    stack[top] = there
                    top += 1
        if top == high:
            break
        here = stack[high:top].copy()
    return stack[:top].copy()


@compiled
def reachable(first: IntArray, beside: IntArray, allowed: BoolArray, begin: IntArray) -> BoolArray:
    """Which points (n,) can be walked to over allowed ones from those in `begin`; as for `rings_around`."""
    mask = np.zeros(len(allowed), dtype=np.bool_)
    mask[rings_around(first, beside, allowed, begin[allowed[begin]], len(allowed))] = True
    return mask


def walked(
    links: csr_array, allowed: BoolArray, begin: IntArray, holds: Callable[[IntArray], BoolArray]
) -> BoolArray:
    """Which points (n,) can be walked to from those in `begin` over allowed ones of which something holds.

    `holds` is asked of places (k,), and only of those that are walked over and their neighbours, each once:
    most surfaces are small.
    """
    first, beside = links.indptr, links.indices
    held, is_known = np.zeros(len(allowed), np.bool_), np.zeros(len(allowed), np.bool_)
    fresh, n_rings = begin, 1
    while True:
        fresh = rings_around(first, beside, allowed & ~is_known, fresh, n_rings)
        is_known[fresh] = True
        held[fresh] = holds(fresh)
        mask = reachable(first, beside, held, begin)
        fresh = rings_around(first, beside, allowed & ~is_known, np.flatnonzero(mask), 1)
        if not len(fresh):
            return np.asarray(mask)
        n_rings *= 2


GAIN = CUT**2 / 2  # what it is worth to explain a point, in logarithms of likelihood
_N_ROUNDS = 40


@dataclass(frozen=True, slots=True, eq=False)
class GrownRegion:
    """A surface, the points (n,) that it explains, and how much likelier it makes those that were free.

    The likelihood is given by its logarithm, less what the surface's parameters cost.
    """

    surface: Surface
    members: IntArray
    score: float


def score_of(
    surface: Surface, points: FloatArray, tolerance: float, worth: FloatArray | float = GAIN
) -> float:
    """How much likelier a surface makes points (n, 3), less what its parameters cost (logarithms).

    `worth` (n,) is what it is worth to explain each: less where another surface explains it somehow.
    """
    share = surface.distance(points) / tolerance
    explained = np.maximum(worth - share * share / 2, 0.0)
    return float(explained.sum()) - parameter_cost(surface.kind, len(points))


def parameter_cost(kind: str, n: int) -> float:
    """What the parameters of a kind of surface cost that explains n points (logarithms)."""
    return N_PARAMETERS[kind] * (GAIN + float(np.log(max(n, 2))) / 2)


def grown(about: Neighbourhoods, surface: Surface, begin: IntArray, worth: FloatArray) -> GrownRegion | None:
    """Grow a surface from points `begin` (m,) over all that it explains; None where too few are worth it.

    Points on the rim of two surfaces are on both: what is explained already still says where a surface is,
    but not that there is one. So it is `worth` (n,) nothing to explain it again.
    """
    tolerance, members = about.tolerance_m, begin
    seen: set[int] = set()
    n_least = N_PARAMETERS[surface.kind] + 2
    for _ in range(_N_ROUNDS):
        pair = refine_surface(surface, about.points[members], tolerance)
        if pair is None:
            return None
        surface, covariance = pair
        explains = partial(_is_explained, about, surface, covariance, np.full(len(worth), np.nan))
        new = np.flatnonzero(walked(about.links, np.ones(len(worth), np.bool_), members, explains))
        if np.count_nonzero(worth[new]) < n_least:
            return None
        changed = len(np.setxor1d(new, members, assume_unique=True))
        members = new
        mark = hash(new.tobytes())
        if changed <= STILL_SHARE * len(new) or mark in seen:
            break
        seen.add(mark)
    free = members[worth[members] > 0]
    return GrownRegion(surface, members, score_of(surface, about.points[free], tolerance, worth[free]))


def _is_explained(
    about: Neighbourhoods, surface: Surface, covariance: FloatArray, signed: FloatArray, chosen: IntArray
) -> BoolArray:
    """Which of the points `chosen` (k,) are near enough to the surface where it is known, and turn alike.

    They are near enough with their neighbours too: the mean of what those are off, which are near, scatters
    less, and tells a surface that departs from this one sooner. `signed` (n,) keeps distances, NaN before
    they are asked for.
    """
    tolerance, links = about.tolerance_m, about.links
    most = CUT * tolerance * np.hypot(1, MOST_DEVIATION)
    asked = chosen[np.isnan(signed[chosen])]
    signed[asked] = surface.distance(about.points[asked])
    explained: BoolArray = np.asarray(np.abs(signed[chosen]) <= most)
    which = chosen[explained]
    if not len(which):
        return explained
    beside = rings_around(links.indptr, links.indices, np.isnan(signed), which, 1)
    signed[beside] = surface.distance(about.points[beside])
    places = about.points[which]
    deviation = SurfaceFit(surface, tolerance, covariance, len(places)).standard_deviation(places)
    fits = np.abs(signed[which]) <= CUT * np.hypot(tolerance, deviation)
    fits &= deviation <= MOST_DEVIATION * tolerance
    n_near, mean = _means_beside(links.indptr, links.indices, signed, which, most)
    fits &= np.abs(mean) <= CUT * np.hypot(tolerance * np.sqrt(about.alike / n_near), deviation)
    aligned = np.abs(np.einsum("ij,ij->i", surface.normal(places), about.normals[which]))
    turned = aligned < np.cos(np.minimum(np.maximum(CUT * about.normal_sd[which], LEAST_ANGLE), np.pi / 2))
    explained[explained] = fits & ~(turned & about.is_smooth[which])
    return explained


@compiled
def _means_beside(
    first: IntArray, beside: IntArray, values: FloatArray, asked: IntArray, most: float
) -> tuple[FloatArray, FloatArray]:
    """Number (m,) and mean (m,) of values (n,) of at most so much at points (m,) and those beside them.

    `first` and `beside` are a sparse graph's.
    """
    number, mean = np.empty(len(asked)), np.empty(len(asked))
    for k in range(len(asked)):
        number[k], mean[k] = 1.0, values[asked[k]]
        for place in range(first[asked[k]], first[asked[k] + 1]):
            if abs(values[beside[place]]) <= most:
                number[k] += 1.0
                mean[k] += values[beside[place]]
        mean[k] /= number[k]
    return number, mean


def best_grown(about: Neighbourhoods, patch: IntArray, worth: FloatArray) -> GrownRegion | None:
    """The surface that explains most from a patch (m,) on, simple kinds first.

    Each kind begins from the patch, and from what the kinds before it explained with a margin of two points
    about it: a strip of a torus that a cylinder grew over begins the torus. What explains most begins each
    kind once more: of a patch that noise hides the bend of, any kind may grow over a face.
    """
    best: GrownRegion | None = None
    for kind in KINDS:
        begins = [patch]
        if best is not None and len(best.members) > 1.5 * len(patch):
            links, every = about.links, np.ones(len(worth), np.bool_)
            begins.append(np.sort(rings_around(links.indptr, links.indices, every, best.members, 2)))
        best = _best_of(about, kind, begins, worth, best)
    if best is None or best.surface.kind == KINDS[0]:
        return best
    found = best.members
    for kind in KINDS:
        if best is not None and kind != best.surface.kind:
            best = _best_of(about, kind, [found], worth, best)
    return best


def _best_of(
    about: Neighbourhoods,
    kind: str,
    begins: Sequence[IntArray],
    worth: FloatArray,
    best: GrownRegion | None,
) -> GrownRegion | None:
    """The region of a kind from some points (m,) on, where it explains more than the best so far."""
    for begin in begins:
        for surface in likely(about, kind, begin):
            region = grown(about, surface, begin, worth)
            if region is not None and region.score > 0 and (best is None or region.score > best.score):
                best = region
    return best


def joint(about: Neighbourhoods, both: IntArray) -> GrownRegion | None:
    """The surface of most score that explains nearly all of some points (m,), grown from them."""
    best: GrownRegion | None = None
    everything = np.full(len(about.points), GAIN)
    for kind in KINDS:
        for surface in likely(about, kind, both, MOST_OF_FACE):
            region = grown(about, surface, both, everything)
            if region is not None and (best is None or region.score > best.score):
                best = region
    return best


def likely(about: Neighbourhoods, kind: str, begin: IntArray, share: float = 0.5) -> Iterator[Surface]:
    """The hypothesis of a kind that explains most of the points (m,) it is from, if that is such a share."""
    stride = max(1, len(begin) // 300)
    sample = begin[::stride]
    points, normals = about.points[sample], about.normals[sample]
    best, most = None, share * len(sample)
    for surface in hypotheses(kind, points, normals):
        number, row = row_of(surface)
        for factor in (30.0, 8.0, 2.0, 1.0):
            is_found, row, _ = adjusted(number, row, points, factor * about.tolerance_m, _LIMITS)
            n_explained = n_within(number, row, points, CUT * factor * about.tolerance_m) if is_found else 0
            if n_explained <= most:
                break
        else:
            best, most = _surface_of(kind, row, points), n_explained
    if best is not None:
        yield best
