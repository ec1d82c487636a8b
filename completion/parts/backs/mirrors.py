# SPDX-License-Identifier: MIT
"""Mirror planes of a part: proposed by its surfaces, tested on all measured surface, refined by matches."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from completion.parts.backs.hypothesis import Hypothesis, across, mirror_change, reflection
from completion.parts.backs.limits import (
    EDGE_SD,
    FACE_DATA,
    MOST_DIRECTIONS,
    MOST_REFINED,
    N_COARSE,
    OFF_PLANE,
    REACH,
    SAME_DEG,
    SAME_OFFSET,
)
from completion.parts.backs.sample import Measured, Seen
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.surfaces.catalogue import Surface

_ROUNDS = 3
_LEAST_OFF = 0.2  # share of the samples off a plane from which a test means anything
_FREE, _EDGES = 3.0, 0.4  # what refuted samples and edges count beside matched ones, to choose candidates


def find_mirrors(measured: Measured) -> list[Hypothesis]:
    """Return the mirror planes of a part that its surface speaks for, best first, with their evidence.

    Directions: normals of planes, axes, bisectors of two planes, lines between equal surfaces. Offsets: the
    middles of faces and of the whole, axes, middles between equal surfaces.
    """
    some = measured.some[:N_COARSE]
    scored = list[tuple[float, int, FloatArray, FloatArray]]()
    for direction in _directions(measured):
        for offset in _offsets(measured, direction):
            one = direction * offset
            scored.append((_score(measured, some, one, direction), len(scored), one, direction))
    scored.sort(key=lambda each: (-each[0], each[1]))
    found = list[Hypothesis]()
    for score, _, point, direction in scored:
        if score <= 0 or len(found) == MOST_REFINED:
            break
        point = point + _middle_in(measured, direction)
        if not any(_is_same(measured, point, direction, one) for one in found):
            refined = _tested(measured, *_refined(measured, point, direction))
            if not any(_is_same(measured, refined.point, refined.direction, one) for one in found):
                found.append(refined)
    return sorted(found, key=lambda one: -_value(one.evidence))


def _middle_in(measured: Measured, direction: FloatArray) -> FloatArray:
    """The part's middle, put down on the plane through 0 with a normal."""
    middle = measured.points.mean(axis=0)
    return np.asarray(middle - (middle @ direction) * direction)


def _value(evidence: dict[str, float]) -> float:
    refuted = evidence["free"] + evidence["beside"] + evidence["lost"]
    return evidence["matched"] - _FREE * refuted + _EDGES * evidence["edges"]


def _is_same(measured: Measured, point: FloatArray, direction: FloatArray, other: Hypothesis) -> bool:
    turned = abs(float(direction @ other.direction)) > np.cos(np.radians(2 * SAME_DEG))
    return turned and abs(float((point - other.point) @ other.direction)) < 2 * SAME_OFFSET * measured.size_m


def _axis_of(surface: Surface) -> FloatArray | None:
    """The direction (3,) of a plane's normal or an axis; None of a sphere."""
    axis = getattr(surface, "normal_direction", getattr(surface, "direction", None))
    return None if axis is None else np.asarray(axis)


def _centre_of(surface: Surface) -> FloatArray:
    """A place (3,) on a surface's axis, or its centre."""
    return np.asarray(getattr(surface, "point", getattr(surface, "centre", None)))


def _radii(surface: Surface) -> FloatArray:
    return np.array([getattr(surface, name, 0.0) for name in ("radius", "tube_radius")])


def _directions(measured: Measured) -> list[FloatArray]:
    """Unit normals (3,) of candidates, those of more surface first."""
    count = np.bincount(measured.face, minlength=len(measured.surfaces)).astype(np.float64)
    axes = [_axis_of(one) for one in measured.surfaces]
    given = [(axis, weight) for axis, weight in zip(axes, count, strict=True) if axis is not None]
    for i, j in _pairs(measured):
        a, b, less = axes[i], axes[j], min(count[i], count[j])
        if measured.surfaces[i].kind == "plane":
            given += [(a + sign * b, less / 2) for sign in (-1, 1) if a is not None and b is not None]
        else:
            line = _centre_of(measured.surfaces[j]) - _centre_of(measured.surfaces[i])
            given.append((line if a is None else line - (line @ a) * a, less))
    for axis in [axis for one, axis in zip(measured.surfaces, axes, strict=True) if one.kind != "plane"]:
        given += [(np.cross(axis, other), 0.0) for other in axes if axis is not None and other is not None]
    kept, weights = list[FloatArray](), list[float]()
    for way, weight in given:
        length = float(np.linalg.norm(way))
        if length < 0.05 * (1 if abs(length) < 2 else measured.size_m):
            continue
        unit = way / length
        same = [k for k, one in enumerate(kept) if abs(unit @ one) > np.cos(np.radians(SAME_DEG))]
        if same:
            weights[same[0]] += weight
        else:
            kept.append(unit)
            weights.append(weight)
    return [kept[k] for k in np.argsort(-np.array(weights), kind="stable")[:MOST_DIRECTIONS]]


def _pairs(measured: Measured) -> Iterator[tuple[int, int]]:
    """Places of two surfaces of one kind and size."""
    surfaces, near = measured.surfaces, SAME_OFFSET * measured.size_m
    for j in range(len(surfaces)):
        for i in range(j):
            alike = surfaces[i].kind == surfaces[j].kind
            if alike and np.abs(_radii(surfaces[i]) - _radii(surfaces[j])).max() < near:
                yield i, j


def _offsets(measured: Measured, direction: FloatArray) -> list[float]:
    """Offsets along a direction of candidates: middles and axes."""
    height = measured.points @ direction
    order = np.argsort(measured.face, kind="stable")
    bounds = np.searchsorted(measured.face[order], np.arange(len(measured.surfaces) + 1))
    found = [(height.min() + height.max()) / 2]
    along = list[float | None]()
    for number, surface in enumerate(measured.surfaces):
        axis, members = _axis_of(surface), height[order[bounds[number] : bounds[number + 1]]]
        if len(members):
            found.append((members.min() + members.max()) / 2)
        is_flat = surface.kind == "plane"
        tilt = 0.0 if axis is None else abs(float(axis @ direction))
        fixed = tilt > np.cos(np.radians(SAME_DEG)) if is_flat else tilt < np.sin(np.radians(SAME_DEG))
        along.append(float(_centre_of(surface) @ direction) if fixed else None)
        if fixed and not is_flat:
            found.append(float(_centre_of(surface) @ direction))
    both = [(along[i], along[j]) for i, j in _pairs(measured)]
    found += [(a + b) / 2 for a, b in both if a is not None and b is not None]
    kept = list[float]()
    for offset in found:
        if all(abs(offset - other) > SAME_OFFSET * measured.size_m / 2 for other in kept):
            kept.append(float(offset))
    return kept


def _moved(
    measured: Measured, some: IntArray, point: FloatArray, direction: FloatArray
) -> tuple[BoolArray, Seen]:
    """Which samples are off a mirror, and what speaks for surface where these are mirrored to."""
    off = np.abs((measured.points[some] - point) @ direction) >= OFF_PLANE * measured.size_m
    chosen, isometry = some[off], reflection(point, direction)
    moved = measured.points[chosen] @ isometry[:, :3].T + isometry[:, 3]
    normals = measured.normals[chosen] @ isometry[:, :3].T
    slack = np.hypot(measured.sd_m[chosen], SAME_OFFSET * measured.size_m / 4)
    return off, measured.see(moved, normals, slack, measured.kinds[measured.face[chosen]])


def _score(measured: Measured, some: IntArray, point: FloatArray, direction: FloatArray) -> float:
    off, seen = _moved(measured, some, point, direction)
    if off.mean() < _LEAST_OFF:
        return -1.0
    return float(seen.matched.mean() - _FREE * (seen.free + seen.beside).mean()) + 0.5


def _refined(
    measured: Measured, point: FloatArray, direction: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A mirror by least squares of samples and edges, and the covariance (3, 3) of tilts and offset."""
    some = np.concatenate([measured.some, measured.edges[:: max(1, len(measured.edges) // 1500)]])
    is_edge = np.arange(len(some)) >= len(measured.some)
    loose = np.radians(SAME_DEG) ** 2, np.radians(SAME_DEG) ** 2, (SAME_OFFSET * measured.size_m) ** 2
    covariance = np.diag(loose)
    for _ in range(_ROUNDS):
        isometry = reflection(point, direction)
        moved = measured.points[some] @ isometry[:, :3].T + isometry[:, 3]
        normals = measured.normals[some] @ isometry[:, :3].T
        away, at = measured.tree.query(moved, distance_upper_bound=2 * REACH * measured.spacing_m)
        near = np.isfinite(away)
        at = np.where(near, at, 0)
        change = mirror_change(point, direction, measured.points[some])
        information, gradient = np.diag(1 / np.array(loose)), np.zeros(3)
        face = measured.face[at]
        good = near & ~is_edge & (np.einsum("ni,ni->n", normals, measured.normals[at]) > 0.9)
        good &= measured.kinds[face] == measured.kinds[measured.face[some]]
        for number in np.unique(face[good]):
            of = good & (face == number)
            surface = measured.surfaces[number]
            residual = surface.distance(moved[of])
            slope = np.einsum("nij,ni->nj", change[of], surface.normal(moved[of]))
            sd = np.hypot(measured.noise_m, np.hypot(measured.sd_m[some[of]], measured.sd_m[at[of]]))
            weight = np.minimum(1.0, FACE_DATA / of.sum()) / sd**2
            information = information + (slope * weight[:, None]).T @ slope
            gradient = gradient + (slope * weight[:, None]).T @ residual
        to = measured.edges
        if is_edge.any():
            gap = moved[is_edge][:, None] - measured.points[to][_nearest(measured, moved[is_edge])][:, None]
            residual = gap[:, 0] @ direction
            use = np.linalg.norm(gap[:, 0], axis=1) < 2 * REACH * measured.spacing_m
            use &= np.abs(measured.ends[2][some[is_edge]] @ direction) > 0.5
            slope = np.einsum("nij,i->nj", change[is_edge][use], direction)
            weight = 1 / (EDGE_SD * measured.spacing_m) ** 2 * min(1.0, 10 * FACE_DATA / max(use.sum(), 1))
            information = information + weight * slope.T @ slope
            gradient = gradient + weight * slope.T @ residual[use]
        covariance = np.linalg.inv(information)
        step = -covariance @ gradient
        first, second = across(direction)
        turned = direction + step[0] * first + step[1] * second
        direction, point = turned / np.linalg.norm(turned), point + step[2] * direction
    return point, direction, covariance


def _nearest(measured: Measured, points: FloatArray) -> IntArray:
    """Which edge (k,) is nearest to places (k, 3)."""
    return np.asarray(measured.edge_tree.query(points)[1])


def _tested(
    measured: Measured, point: FloatArray, direction: FloatArray, covariance: FloatArray
) -> Hypothesis:
    """A mirror with its evidence."""
    off, seen = _moved(measured, measured.some, point, direction)
    height = (measured.points[measured.some] - point) @ direction
    front, back = int((height > 0).sum()), int((height < 0).sum())
    to = [sight.origin - measured.points.mean(axis=0) for sight in measured.sights]
    evidence = {
        "matched": float(seen.matched.mean()) if off.any() else 0.0,
        "hidden": float(seen.hidden.mean()) if off.any() else 0.0,
        "free": float(seen.free.mean()) if off.any() else 1.0,
        "beside": float(seen.beside.mean()) if off.any() else 1.0,
        **_edges(measured, point, direction),
        "across": float(np.mean([abs(way @ direction) / np.linalg.norm(way) for way in to])),
        "balance": min(front, back) / max(front, back, 1),
    }
    return Hypothesis("mirror", point, direction, covariance, evidence)


def _edges(measured: Measured, point: FloatArray, direction: FloatArray) -> dict[str, float]:
    """Shares of the edges off a mirror that fall on edges, and within measured surface without one."""
    if not len(measured.edges):
        return {"edges": 0.0, "lost": 0.0}
    places = measured.points[measured.edges]
    places = places[np.abs((places - point) @ direction) >= OFF_PLANE * measured.size_m]
    if not len(places):
        return {"edges": 0.0, "lost": 0.0}
    isometry = reflection(point, direction)
    return measured.edges_at(places @ isometry[:, :3].T + isometry[:, 3])
