# SPDX-License-Identifier: MIT
"""True dimensions: what each number should be in a known scene, or that there is nothing there."""

from __future__ import annotations

import numpy as np
from trimesh.triangles import closest_point

from completion.exchange.dimensions.dimension import Dimension
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder
from scenes.world.scene import Scene

_NEAR_M = 0.05  # between a place and the true surface there, along its normal
_BESIDE_M = 0.05  # within the surface, to its border
_SAME = float(np.cos(np.radians(5.0)))
_OPENING_M = 0.4  # between the middles of an opening and of its truth


class SceneTruth:
    """The true surfaces of a scene."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._corners = scene.mesh.vertices[scene.mesh.faces]
        normal = np.cross(
            self._corners[:, 1] - self._corners[:, 0], self._corners[:, 2] - self._corners[:, 0]
        )
        length = np.linalg.norm(normal, axis=1)
        self._normal = normal / np.maximum(length, 1e-15)[:, None]

    def of(self, dimension: Dimension) -> float | None:
        """What a dimension should be; None where one of its ends is not there."""
        kind = dimension.kind
        if kind.startswith("opening"):
            return self._opening(dimension)
        if kind in ("room area", "room volume"):
            return self._room(dimension)
        if kind in ("room width", "room height", "wall thickness", "slab thickness"):
            return self._between(dimension)
        return self._cylinder(dimension)

    def _between(self, dimension: Dimension) -> float | None:
        ends = dimension.ends
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        shifts = []
        for support in dimension.supports:
            shift = self._shift(support.place, support.element.normal_at(support.place), along)
            if shift is None:
                return None
            shifts.append(shift)
        return float(dimension.value + shifts[1] - shifts[0])

    def _shift(self, place: FloatArray, normal: FloatArray, along: FloatArray) -> float | None:
        """How far from a place, along a direction, the true surface is that is meant there."""
        slope = self._normal @ along
        off = np.einsum("ij,ij->i", self._corners[:, 0] - place, self._normal)
        fits = (np.abs(self._normal @ normal) >= _SAME) & (np.abs(off) <= _NEAR_M)
        which = np.flatnonzero(fits)
        if not len(which):
            return None
        at = place - off[which, None] * -self._normal[which]
        beside = np.linalg.norm(closest_point(self._corners[which], at) - at, axis=1)
        there = which[beside <= _BESIDE_M]
        if not len(there):
            return None
        best = there[int(np.argmin(np.abs(off[there])))]
        return float(off[best] / slope[best])

    def _room(self, dimension: Dimension) -> float:
        """Area or volume by moving each side to where it truly is."""
        total = dimension.value
        for support in dimension.supports:
            normal = support.element.normal_at(support.place)
            shift = self._shift(support.place, normal, normal)
            total -= support.weight * (0.0 if shift is None else shift)
        return float(total)

    def _opening(self, dimension: Dimension) -> float | None:
        middle = dimension.ends.mean(axis=0)
        along = (dimension.ends[1] - dimension.ends[0]) / max(dimension.value, 1e-9)
        best, least = None, _OPENING_M
        for one in self._scene.openings:
            reach = one.outline @ along
            apart = float(np.linalg.norm((one.outline.min(axis=0) + one.outline.max(axis=0)) / 2 - middle))
            if apart < least:
                best, least = float(np.ptp(reach)), apart
        return best

    def _cylinder(self, dimension: Dimension) -> float | None:
        axes = []
        for number in (0, len(dimension.supports) - 1 if dimension.kind == "column spacing" else 0):
            element = dimension.supports[number].element
            found = self._nearest(element)
            if found is None:
                return None
            axes.append(found)
        (label, one), (_, other) = axes
        if dimension.kind == "column spacing":
            across = (one.point - other.point) - ((one.point - other.point) @ one.direction) * one.direction
            return float(np.linalg.norm(across))
        if dimension.kind.endswith("radius"):
            return float(one.radius)
        corners = self._corners[self._scene.mesh.face_surface == label].reshape(-1, 3)
        return float(np.ptp(corners @ one.direction))

    def _nearest(self, element: object) -> tuple[int, Cylinder] | None:
        ends, radius = element.ends, element.radius_m  # type: ignore[attr-defined]
        middle = ends.mean(axis=0)
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        best, least = None, max(0.5 * radius, _NEAR_M)
        for label, one in enumerate(self._scene.surfaces):
            if not isinstance(one, Cylinder) or abs(one.direction @ along) < np.cos(np.radians(10)):
                continue
            away = middle - one.point
            apart = float(np.linalg.norm(away - (away @ one.direction) * one.direction))
            if apart < least and abs(one.radius - radius) < 0.5 * one.radius:
                best, least = (label, one), apart
        return best
