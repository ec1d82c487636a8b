# SPDX-License-Identifier: MIT
"""Axes of a part: coaxial surfaces that may go all round, tested by turns."""

from __future__ import annotations

import numpy as np

from completion.parts.backs.hypothesis import Hypothesis, across
from completion.parts.backs.limits import COAXIAL_DEG, LEAST_ARC, MATCH_SD, N_SECTORS, REACH, SAME_OFFSET
from completion.parts.backs.sample import Measured
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus

_MOST = 300  # samples that are turned


def find_axes(measured: Measured, labels: tuple[int, ...]) -> list[Hypothesis]:
    """Return the axes of coaxial cylinders, cones and tori that are not measured all round, with evidence."""
    count = np.bincount(measured.face, minlength=len(measured.surfaces))
    todo = [
        k for k in np.argsort(-count, kind="stable").tolist()
        if isinstance(measured.surfaces[k], Cylinder | Cone | Torus) and count[k]
    ]  # fmt: skip
    found = []
    while todo:
        first = todo[0]
        point, direction = axis_of(measured.surfaces[first])
        group = [
            k for k in todo
            if is_about(measured, measured.surfaces[k], point, direction)
            and is_concave(measured, k) == is_concave(measured, first)
        ]  # fmt: skip
        todo = [k for k in todo if k not in group and k != first]
        if not is_concave(measured, first) and _radius(measured, first) <= 2 * REACH * measured.spacing_m:
            continue  # a fillet, or a pin that sampling does not tell from one
        one = _tested(measured, point, direction, np.array(sorted({first, *group})), labels)
        if LEAST_ARC <= one.evidence["arc"] < 1:
            found.append(one)
    return found


def axis_of(surface: Surface) -> tuple[FloatArray, FloatArray]:
    """Return a place (3,) on the axis of a cylinder, cone or torus, and its direction (3,)."""
    point = getattr(surface, "point", getattr(surface, "centre", None))
    return np.asarray(point), np.asarray(getattr(surface, "direction", None))


def is_about(measured: Measured, surface: Surface, point: FloatArray, direction: FloatArray) -> bool:
    """Tell whether turns about an axis, by a place (3,) and direction (3,), map a surface into itself."""
    near = SAME_OFFSET * measured.size_m
    if isinstance(surface, Plane):
        return bool(abs(surface.normal_direction @ direction) > np.cos(np.radians(COAXIAL_DEG)))
    away = (surface.centre if isinstance(surface, Sphere) else axis_of(surface)[0]) - point
    off = np.linalg.norm(away - (away @ direction) * direction)
    if isinstance(surface, Sphere):
        return bool(off <= near)
    turned = abs(axis_of(surface)[1] @ direction)
    return bool(off <= near and turned > np.cos(np.radians(COAXIAL_DEG)))


def _radius(measured: Measured, face: int) -> float:
    """The usual distance of a face from its axis, metres."""
    point, direction = axis_of(measured.surfaces[face])
    away = measured.points[measured.face == face] - point
    return float(np.median(np.linalg.norm(away - (away @ direction)[:, None] * direction, axis=1)))


def is_concave(measured: Measured, face: int) -> bool:
    """Tell whether a cylinder, cone or torus is the wall of a hole: its normals point to its axis."""
    own = measured.face == face
    point, direction = axis_of(measured.surfaces[face])
    away = measured.points[own] - point
    radial = away - (away @ direction)[:, None] * direction
    return bool((np.einsum("ni,ni->n", measured.normals[own], radial) < 0).mean() > 0.5)


def sectors(points: FloatArray, point: FloatArray, direction: FloatArray) -> IntArray:
    """Return the sector (n,) of a turn that places (n, 3) lie in."""
    away = points - point
    first, second = across(direction)
    angle = np.arctan2(away @ second, away @ first) / (2 * np.pi)
    return np.floor(angle % 1 * N_SECTORS).astype(np.int64) % N_SECTORS


def turned(points: FloatArray, point: FloatArray, direction: FloatArray, angle: float) -> FloatArray:
    """Return places (n, 3) turned about an axis by an angle, radians."""
    return point + (points - point) @ turn_of(direction, angle).T


def turn_of(direction: FloatArray, angle: float) -> FloatArray:
    """Return the rotation (3, 3) by an angle about a unit direction."""
    cross = np.cross(np.eye(3), direction).T
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def _tested(
    measured: Measured, point: FloatArray, direction: FloatArray, group: IntArray, labels: tuple[int, ...]
) -> Hypothesis:
    """An axis of some surfaces with its evidence."""
    own = np.flatnonzero(np.isin(measured.face, group))
    some = own[:: -(-len(own) // _MOST)]
    shares = np.zeros((N_SECTORS - 1, 4))
    for k in range(1, N_SECTORS):
        angle = 2 * np.pi * k / N_SECTORS
        moved = turned(measured.points[some], point, direction, angle)
        normals = measured.normals[some] @ turn_of(direction, angle).T
        slack = np.hypot(measured.sd_m[some], measured.spacing_m / MATCH_SD / 4)
        seen = measured.see(moved, normals, slack, measured.kinds[measured.face[some]])
        shares[k - 1] = [one.mean() for one in (seen.matched, seen.hidden, seen.free, seen.beside)]
    matched, hidden, free, beside = shares.mean(axis=0).tolist()
    largest = group[np.argmax([(measured.face == k).sum() for k in group])]
    edges = measured.edges
    rim = edges[
        measured.distance(measured.points[edges], np.full(len(edges), largest)) < REACH * measured.spacing_m
    ]
    round_ = [sectors(measured.points[one], point, direction) for one in (own, np.append(rim, own))]
    is_edge, is_open, out = measured.ends
    away = measured.points[own] - point
    along = np.cross(direction, away)
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
    ends = (is_edge | is_open)[own] & (np.abs(np.einsum("ni,ni->n", out[own], along)) > 0.7)
    evidence = {
        "matched": matched, "hidden": hidden, "free": free, "beside": beside,
        "arc": len(np.unique(round_[0])) / N_SECTORS,
        "rim": len(np.unique(round_[1])) / N_SECTORS,
        "open": float((is_open & ~is_edge)[own][ends].mean()) if ends.any() else 1.0,
        "lost": _lost_edges(measured, point, direction, group),
        "concave": float(is_concave(measured, largest)), "coaxial": float(np.log(len(group))),
    }  # fmt: skip
    names = tuple(labels[k] for k in group)
    return Hypothesis("axis", point, direction, np.zeros((3, 3)), evidence, surfaces=names)


def _lost_edges(measured: Measured, point: FloatArray, direction: FloatArray, group: IntArray) -> float:
    """Share of the edges of some surfaces that, turned about an axis, fall within measured surface."""
    own = measured.edges[np.isin(measured.face[measured.edges], group)]
    places = measured.points[own[:: -(-max(len(own), 1) // _MOST)]]
    if not len(places):
        return 0.0
    angles = 2 * np.pi * np.arange(1, N_SECTORS) / N_SECTORS
    every = np.concatenate([turned(places, point, direction, angle) for angle in angles])
    return measured.edges_at(every)["lost"]
