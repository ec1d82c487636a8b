# SPDX-License-Identifier: MIT
"""Face samples: points on each face of a part, which faces meet, how far they reach, where material is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from completion.parts.division.divided_part import RelatedPart
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh, spread_points
from scenes.mesh.winding import turn_outside_out
from scenes.surfaces.catalogue import Plane, Surface
from scenes.surfaces.surface import perpendicular

_N_NEAR, _MOST_ASKED = 8, 5_000  # neighbours that tell how dense points are, and of how many points
_N_MESH = 36_000  # points that a mesh is sampled by
_BESIDE = 2.0  # sampling distances, within which faces meet
_LEAST_BESIDE = 3  # points of a face that are so near another
_N_PLACES, _N_RAYS = 9, 9  # from which rays are cast to either side, and how many from each
_TILT = 0.45  # of a ray from the normal: no ray along another face
_AGREED = 0.7  # of the rays that tell where material is
_MET = 1.4  # sampling distances from a face's points, within which a ray meets it
_SURELY = (1.1, 2.0)  # between which that is in doubt


class FaceSamples:
    """Points of a part by face: those that were measured, or points on the triangles of a mesh.

    Attributes
    ----------
    points : (n, 3) float
        Metres.
    place : (n,) int
        Place of the surface of each, from 0; -1 for none.
    spacing_m : float
        Their sampling distance.
    """

    def __init__(self, part: RelatedPart) -> None:
        self._part, points, label = part, part.points, part.surface
        self.surfaces: tuple[Surface, ...] = tuple(fit.surface for fit in part.fits)
        self.spacing_m = _spacing(points)
        if part.faces is not None and part.triangle_surface is not None:
            mesh = LabelledMesh(part.points, part.faces.astype(np.int32))
            self.spacing_m = float(np.sqrt(1.2 * mesh.face_areas().sum() / _N_MESH))
            points, members = spread_points(mesh.corners, _N_MESH)
            label = part.triangle_surface[members]
        labels = np.array(part.labels, dtype=np.int64)
        place = np.minimum(np.searchsorted(labels, label), max(len(labels) - 1, 0))
        is_some = (label > 0) & (labels[place] == label) if len(labels) else np.zeros(len(label), np.bool_)
        self.points, self.place = points, np.where(is_some, place, -1)
        order = np.argsort(self.place, kind="stable")
        bounds = np.searchsorted(self.place[order], np.arange(len(labels) + 1))
        self._members = [order[low:high] for low, high in pairwise(bounds)]
        self._trees: dict[int, cKDTree] = {}

    def of(self, place: int) -> FloatArray:
        """Points (m, 3) of a face."""
        return self.points[self._members[place]]

    def share(self, place: int) -> float:
        """Share of all points, and so of the area, that a face has."""
        return len(self._members[place]) / max(len(self.points), 1)

    def tree(self, place: int) -> cKDTree:
        """The points of a face, for neighbours."""
        if place not in self._trees:
            self._trees[place] = cKDTree(self.of(place))
        return self._trees[place]

    def beside(self, first: int, second: int) -> FloatArray:
        """Points (m, 3) of the first face that are near the second, the nearest first."""
        points = self.of(first)
        if not len(points) or not len(self.of(second)):
            return points[:0]
        far = self.tree(second).query(points, distance_upper_bound=_BESIDE * self.spacing_m)[0]
        order = np.argsort(far, kind="stable")
        return np.asarray(points[order[: int(np.isfinite(far).sum())]])

    @cached_property
    def neighbours(self) -> list[set[int]]:
        """The faces that each face meets."""
        tree = cKDTree(self.points)
        near = tree.query(
            self.points, k=min(9, len(self.points)), distance_upper_bound=_BESIDE * self.spacing_m
        )
        other = near[1].reshape(len(self.points), -1)
        beside = np.where(other < len(self.points), self.place[np.minimum(other, len(self.points) - 1)], -1)
        n = len(self.surfaces)
        count = np.zeros((n, n), dtype=np.int64)
        for column in beside.T:
            told = (column >= 0) & (self.place >= 0) & (column != self.place)
            np.add.at(count, (self.place[told], column[told]), 1)
        meets = (count >= _LEAST_BESIDE) & (count.T >= _LEAST_BESIDE)
        return [set(np.flatnonzero(row).tolist()) for row in meets]

    def meet(self, first: int, second: int) -> None:
        """Faces that meet behind a blend are neighbours."""
        self.neighbours[first].add(second)
        self.neighbours[second].add(first)

    def reach(self, place: int, direction: FloatArray) -> tuple[float, float]:
        """Least and greatest coordinate of a face along a direction (3,), metres."""
        along = self.of(place) @ direction
        return float(along.min()), float(along.max())

    def turn(self, places: Sequence[int]) -> float:
        """Angle about the axis of the first (of a torus about its tube) that faces cover, radians."""
        surface, points = self.surfaces[places[0]], np.concatenate([self.of(place) for place in places])
        angle = _angles_about(surface, points)
        if len(angle) < 2:
            return 0.0
        angle = np.sort(angle % (2 * np.pi))
        gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
        return float(2 * np.pi - gaps.max())

    def is_hollow(self, place: int) -> bool:
        """Whether a round face is seen from within, as a bore is."""
        return bool(self.sides[place] * (-1 if getattr(self.surfaces[place], "concave", False) else 1) < 0)

    @cached_property
    def sides(self) -> IntArray:
        """On which side of each surface (k,) there is none of the part: 1 along its normal, -1; 0 unknown."""
        if self._part.faces is not None and self._part.triangle_surface is not None:
            return self._sides_of_triangles(self._part.faces, self._part.triangle_surface)
        return np.array([self._side_by_rays(place) for place in range(len(self.surfaces))], dtype=np.int64)

    def _sides_of_triangles(self, faces: IntArray, label: IntArray) -> IntArray:
        """By the winding of triangles, closed components turned outside out."""
        mesh = LabelledMesh(self._part.points, faces.astype(np.int32))
        mesh = turn_outside_out(mesh, np.zeros(len(faces), np.int64)).mesh
        areas, normals, middle = mesh.face_areas(), mesh.face_normals(), mesh.corners.mean(axis=1)
        sides = np.zeros(len(self.surfaces), dtype=np.int64)
        for place, name in enumerate(self._part.labels):
            own = np.flatnonzero(label == name)
            along = np.einsum("ij,ij->i", self.surfaces[place].normal(middle[own]), normals[own])
            agreed = float((np.sign(along) * areas[own]).sum()) / max(float(areas[own].sum()), 1e-300)
            sides[place] = np.sign(agreed) if abs(agreed) > 2 * _AGREED - 1 else 0
        return sides

    def _side_by_rays(self, place: int) -> int:
        """By the parity of what rays to either side meet: even outside of a closed body."""
        own = self.of(place)
        if len(own) < _N_PLACES:
            return 0
        own = own[:: max(1, len(own) // _MOST_ASKED)]
        others = self.points[self.place != place]
        others = others[:: max(1, len(others) // _MOST_ASKED)]
        far = cKDTree(others).query(own)[0] if len(others) else np.ones(len(own))
        inner = np.argsort(-far, kind="stable")[: max(len(own) // 2, _N_PLACES)]
        chosen = own[inner[np.linspace(0, len(inner) - 1, _N_PLACES).astype(np.int64)]]
        normal = np.repeat(self.surfaces[place].normal(chosen), _N_RAYS, axis=0)
        first = np.array([perpendicular(each) for each in normal])
        turn = 2 * np.pi * (np.arange(len(normal)) * 0.6180339887498949 % 1.0)
        across = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * np.cross(normal, first)
        origins, votes = np.repeat(chosen, _N_RAYS, axis=0), []
        for sign in (1.0, -1.0):
            rays = sign * normal + _TILT * across
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            count, is_clear = self._n_met(origins, rays, place)
            votes.append(np.where(count % 2, -sign, sign)[is_clear])
        every = np.concatenate(votes)
        agreed = float(every.mean()) if len(every) else 0.0
        return int(np.sign(agreed)) if abs(agreed) > 2 * _AGREED - 1 else 0

    def _n_met(self, origins: FloatArray, rays: FloatArray, start: int) -> tuple[IntArray, BoolArray]:
        """How many faces rays (n, 3) meet, but for where they begin on the face `start`.

        And which rays pass no border of a face so closely that this is in doubt.
        """
        count, is_clear = np.zeros(len(origins), dtype=np.int64), np.ones(len(origins), dtype=np.bool_)
        for place, surface in enumerate(self.surfaces):
            for twin in _walls(surface) if len(self.of(place)) else ():
                far = twin.ray_ranges(origins, rays)
                met = np.isfinite(far)
                if place == start:
                    met &= far > self.spacing_m
                if met.any():
                    off = (
                        self.tree(place).query(origins[met] + far[met, None] * rays[met])[0] / self.spacing_m
                    )
                    count[met] += off <= _MET
                    is_clear[met] &= (off < _SURELY[0]) | (off > _SURELY[1])
        return count, is_clear


def _spacing(points: FloatArray) -> float:
    """The side of the square that each of points (n, 3) on surfaces stands for, at a usual one, metres."""
    if len(points) <= _N_NEAR:
        return 0.0
    sample = points[:: max(1, len(points) // _MOST_ASKED)]
    far = cKDTree(points).query(sample, k=_N_NEAR + 1)[0][:, -1]
    return float(np.median(far) * np.sqrt(np.pi / _N_NEAR))


def _walls(surface: Any) -> tuple[Surface, ...]:
    """A surface by its near and by its far wall; a plane from either side."""
    if isinstance(surface, Plane):
        return surface, surface.flip()
    return replace(surface, concave=False), replace(surface, concave=True)


def _angles_about(surface: Surface, points: FloatArray) -> FloatArray:
    """Angles (n,) of points about the axis, of a torus about its tube, radians."""
    centre = getattr(surface, "centre", getattr(surface, "point", np.zeros(3)))
    axis = getattr(surface, "direction", np.array([0.0, 0.0, 1.0]))
    offset = points - centre
    height = offset @ axis
    radial = offset - height[:, None] * axis
    if surface.kind == "torus":
        return np.asarray(np.arctan2(height, np.linalg.norm(radial, axis=1) - surface.radius))  # type: ignore[attr-defined]  # a torus
    first = perpendicular(axis)
    return np.asarray(np.arctan2(radial @ np.cross(axis, first), radial @ first))
