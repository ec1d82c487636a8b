# SPDX-License-Identifier: MIT
"""Blends: round faces on which a ball rolls along two faces, or lies in a corner of three; where these meet.

A ball that touches faces has its centre as far from each as its radius: cylinders along two planes, tori
between what turns about one axis, and balls in corners are such. So a blend of known faces has one free
number, its radius. It is fitted to the points that the ball has between its contacts, whichever face they
were given to: there errors exchange points of narrow blends and of their faces, and fits to those that a
face was given are biased. A round face is a blend of its neighbours unless these points say that it lies or
is turned otherwise (a score test of its other parameters, by their noise and the joint covariance of the
faces), or that its radius may be none. A ball of no radius lies where the faces meet behind the blend.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import chdtrc

from completion.parts.dimensions.chamfers import find_chamfers
from completion.parts.dimensions.contacts import contact, meeting, spread, surfaces_at, turns
from completion.parts.dimensions.dimension import Blend, BlendKind
from completion.parts.dimensions.face_samples import FaceSamples
from completion.parts.dimensions.joint_surfaces import JointSurfaces
from completion.parts.division.divided_part import RelatedPart
from completion.relations.equations import Placement
from completion.relations.options import RelationOptions
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Sphere, Surface, Torus

_N_EDGE = 25  # points of the edge behind a blend
_ABOUT = 0.5  # of a face's radius, by which its spine may be nearer to or farther from those it may touch
_MOST = 0.5  # of a blend's points, that lie between where its ball touches
_EXACT = 1e-7  # of the part's size, of rounding
_LEAST_SHARE = 1e-3  # of the greatest change of distances: a face's moves that change them less are not told
_N_ROUNDS = 30  # of Newton's method
_STILL = 1e-7  # of a radius, by which it moves no more
_NEAR = 2.0  # sampling distances from a blend within which its faces' points may be on it


def blends_of(part: RelatedPart) -> tuple[Blend, ...]:
    """Return the blends of a part: those along edges first, then those in corners, then chamfers.

    Parameters
    ----------
    part : RelatedPart
        As `model_part` gives it.
    """
    return find_blends(JointSurfaces(part), FaceSamples(part))


def find_blends(known: JointSurfaces, faces: FaceSamples) -> tuple[Blend, ...]:
    """The same of surfaces and points that are at hand."""
    labels, found = known.part.labels, dict[int, Blend]()
    round_faces = [place for place, surface in enumerate(faces.surfaces)
                   if isinstance(surface, Cylinder | Torus | Sphere) and len(faces.of(place))]  # fmt: skip
    for place in sorted(round_faces, key=lambda place: isinstance(faces.surfaces[place], Sphere)):
        beside = sorted(faces.neighbours[place], key=lambda other: (-len(faces.beside(place, other)), other))
        needed = 2
        if isinstance(faces.surfaces[place], Sphere):
            of = dict.fromkeys(name for other in beside if other in found for name in found[other].supports)
            beside, needed = [labels.index(name) for name in of], 3
        asked = _RollingBall(known, faces, (place,))
        near = [other for other in beside if asked.may_touch(other)]
        blends = (asked.between(supports) for supports in combinations(near, needed))
        best = next((blend for blend in blends if blend is not None), None)
        if best is not None:
            found[place] = best
    graph = known.part.relations
    level = (RelationOptions() if graph is None else graph.options).level
    return (*_joined(found, known, faces), *find_chamfers(known, faces, level))


def _joined(found: Mapping[int, Blend], known: JointSurfaces, faces: FaceSamples) -> Iterator[Blend]:
    """Blends, those that are pieces of one in one."""
    together: dict[object, list[int]] = {}
    for place, blend in found.items():
        together.setdefault((frozenset(blend.supports), blend.kind), []).append(place)
    for places in together.values():
        places.sort(key=lambda place: -len(faces.of(place)))
        supports = [known.part.labels.index(name) for name in found[places[0]].supports]
        whole = None if len(places) < 2 else _RollingBall(known, faces, places).between(supports)
        yield from [found[place] for place in places] if whole is None else [whole]


class _RollingBall:
    """Round faces, pieces of one, asked whether they are a blend of others."""

    def __init__(self, known: JointSurfaces, faces: FaceSamples, places: Sequence[int]) -> None:
        self._known, self._faces, self._places = known, faces, tuple(places)
        self._at, graph = known.at[places[0]], known.part.relations
        options = RelationOptions() if graph is None else graph.options
        self._level, self._built_m = options.level, float(options.built_sd[1])
        self._own = np.concatenate([faces.of(place) for place in places])
        is_ring = self._at.ring_radius > 0
        along = turns(self._at, self._own) if is_ring else (self._own - self._at.point) @ self._at.direction
        self._spine = _spine(self._at, spread(self._own, along, _N_EDGE))

    def may_touch(self, other: int) -> bool:
        """Whether a face is about as far from all of the spine as its radius."""
        off = np.abs(self._faces.surfaces[other].distance(self._spine)) - self._at.radius
        return bool(np.abs(off).max() < _ABOUT * self._at.radius)

    def between(self, supports: Sequence[int]) -> Blend | None:
        """The blend of two or three faces; None where it is none, or they do not meet."""
        like = [self._faces.surfaces[k] for k in supports]
        signs = self._signs(supports)
        if np.mean(contact(like, signs, self._at.radius, self._own).has(self._own)) < _MOST:
            return None
        points = self._points(supports)
        radius = self._radius(like, signs, points)
        if radius is None:
            return None
        used = contact(like, signs, radius, points).has(points)
        points = points[used]
        ball = contact(like, signs, radius, points)
        far, way = ball.seen(points)
        slope = 1 + np.einsum("ij,ij->i", way, ball.by_radius)
        weight = slope / float(slope @ slope)
        moves = self._moves(points, way, slope / np.linalg.norm(slope))
        n_free = len(points) - moves.shape[1] - 1
        if n_free < 1:
            return None
        noise = self._noise(far - radius - moves @ (moves.T @ (far - radius)), n_free)

        def misfit(at: Sequence[Placement]) -> FloatArray:
            here = contact(surfaces_at(at, like), signs, radius, ball.centre).seen(points)[0] - radius
            return np.concatenate([[weight @ here], moves.T @ here])

        found = self._known.estimate(supports, misfit)
        sd = float(np.sqrt(found.covariance[0, 0] + noise**2 * (weight @ weight)))
        chance = noise**2 + self._built_m**2 * len(points)
        known = found.covariance[1:, 1:] + chance * np.eye(moves.shape[1])
        square = float(found.value[1:] @ np.linalg.solve(known, found.value[1:]))
        p = float(chdtrc(moves.shape[1], square))
        is_sharp = chdtrc(1, (radius / sd) ** 2) > self._level
        if p < self._level or is_sharp:
            return None
        start = self._spine[:1] if len(supports) > 2 else self._spine
        edge, covariance = meeting(self._known, supports, like, start)
        if not np.isfinite(edge).all():
            return None
        names = self._known.part.labels
        kind: BlendKind = (
            "corner ball" if len(supports) > 2 else "fillet" if self._is_outside(supports) else "round"
        )
        return Blend(
            labels=tuple(names[k] for k in self._places), supports=tuple(names[k] for k in supports),
            kind=kind, size_m=radius, sd_m=sd, p=p, edge=edge, edge_covariance=covariance,
        )  # fmt: skip

    def _signs(self, places: Sequence[int]) -> FloatArray:
        """On which side (m,) of faces the spine is: 1 along their normals, -1."""
        surfaces = [self._faces.surfaces[place] for place in places]
        return np.array([np.sign(np.median(surface.distance(self._spine))) for surface in surfaces])

    def _is_outside(self, supports: Sequence[int]) -> bool:
        """Whether the spine lies outside the material, by what most of the faces say."""
        places = [*supports, *self._places]
        return bool(self._signs(places) @ self._faces.sides[places] > 0)

    def _radius(self, surfaces: Sequence[Surface], signs: FloatArray, points: FloatArray) -> float | None:
        """The radius of the ball that fits points (n, 3) best; None where none does."""
        radius = self._at.radius
        for _ in range(_N_ROUNDS):
            ball = contact(surfaces, signs, radius, points)
            far, way = ball.seen(points)
            slope = np.where(ball.has(points), 1 + np.einsum("ij,ij->i", way, ball.by_radius), 0.0)
            whole = float(slope @ slope)
            step = float(slope @ (far - radius)) / whole if whole > 0 else np.nan
            radius += step
            if not 0 < radius < self._known.size_m:
                return None
            if abs(step) < _STILL * radius:
                return radius
        return None

    def _points(self, supports: Sequence[int]) -> FloatArray:
        """Points (n, 3) of the faces, and of supports those so near that errors may exchange them."""
        part = self._known.part
        own, near = (_points_of(part, [part.labels[place] for place in places])
                     for places in (self._places, supports))  # fmt: skip
        far = cKDTree(own).query(near, distance_upper_bound=_NEAR * part.spacing_m)[0]
        return np.unique(np.concatenate([own, near[np.isfinite(far)]]), axis=0)

    def _moves(self, points: FloatArray, way: FloatArray, slope: FloatArray) -> FloatArray:
        """Orthonormal ways (n, k) in which distances of points change as the face moves, but for its radius.

        As a whole, and a torus by its ring's radius.
        """
        arm = (points - self._at.point) / self._known.size_m
        columns = [way, np.cross(arm, way)]
        if self._at.ring_radius > 0:
            level = arm - (arm @ self._at.direction)[:, None] * self._at.direction
            out = level / np.linalg.norm(level, axis=1, keepdims=True)
            columns.append(np.einsum("ij,ij->i", out, way)[:, None])
        moved = np.concatenate([*columns, np.ones((len(way), 1))], axis=1)
        moved -= np.outer(slope, slope @ moved)
        left, size, _ = np.linalg.svd(moved, full_matrices=False)
        return left[:, size > _LEAST_SHARE * size[0]]

    def _noise(self, residual: FloatArray, n_free: int) -> float:
        """Deviation of points, metres; neighbours that err alike count as they do in the face's own fit."""
        scatter = float(np.linalg.norm(residual)) / np.sqrt(n_free)
        exact = _EXACT * self._known.size_m
        fit = self._known.part.measured[self._places[0]]
        return float(max(scatter, self._known.part.noise_m, exact) * np.sqrt(fit.inflation))


def _points_of(part: RelatedPart, labels: Sequence[int]) -> FloatArray:
    """Points (n, 3) of surfaces; of a mesh the corners of their triangles, which other surfaces share."""
    if part.faces is None or part.triangle_surface is None:
        return part.points[np.isin(part.surface, labels)]
    return part.points[np.unique(part.faces[np.isin(part.triangle_surface, labels)])]


def _spine(at: Placement, points: FloatArray) -> FloatArray:
    """Feet (n, 3) of points on a cylinder's axis, a torus' ring, or a sphere's centre."""
    along = ((points - at.point) @ at.direction)[:, None] * at.direction
    if at.ring_radius <= 0:
        return np.asarray(at.point + along)
    level = points - at.point - along
    return np.asarray(at.point + at.ring_radius * level / np.linalg.norm(level, axis=1, keepdims=True))
