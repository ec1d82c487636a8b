# SPDX-License-Identifier: MIT
"""Blends: round faces on which a ball rolls along two faces, or lies in a corner of three; where these meet.

The centres of a ball that touches faces are as far from each as its radius: cylinders along two planes, tori
between what turns about one axis, and balls in corners are all told by this. A face is a blend where the
points of its spine (a cylinder's axis, a torus' ring, a sphere's centre) are so far from its neighbours as
its own radius says, by the joint covariance of all. A blend of known faces then has one free number, its
radius, to which its points are fitted; a ball of no radius lies where the faces meet behind the blend.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import chdtrc

from completion.parts.dimensions.dimension import NORMAL_95
from completion.parts.dimensions.face_samples import FaceSamples
from completion.parts.dimensions.joint_surfaces import JointSurfaces
from completion.parts.division.divided_part import RelatedPart
from completion.relations.equations import Placement, surface_at
from completion.relations.graph import is_settled
from completion.relations.options import RelationOptions
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder, Sphere, Surface, Torus

BlendKind = Literal["fillet", "round", "corner ball"]

_N_TEST, _N_EDGE = 6, 25  # points of a spine that are tested, and of the edge behind a blend
_LOOSE = 1e-2  # of their deviation without relations, within which lengths that relations determine are met
_EXACT = 1e-7  # of the part's size, of rounding
_LEAST_SHARE = 1e-6  # of the greatest variance: what is less, spines do not tell to first order
_N_STEPS, _N_ROUNDS = 8, 20  # of Newton's method
_STILL = 1e-4  # of its deviation, by which a radius moves no more
_FLAT = 1e-6  # squared sine between faces that do not meet
_NEAR = 2.0  # sampling distances from a blend within which its faces' points may be on it


@dataclass(frozen=True, slots=True, eq=False)
class Blend:
    """A face on which a ball of one radius rolls along two faces, or lies in a corner of three.

    Attributes
    ----------
    label : int
        Of its surface.
    supports : tuple of int
        Labels of the faces that it lies between.
    kind : str
        "fillet" where the ball lies outside the material, "round" where within; "corner ball" of three faces.
    radius_m, sd_m : float
        Its radius where it touches its faces exactly, and the standard deviation of that; metres.
    p : float
        Probability of a misfit at least so large, if it touches them.
    edge : (n, 3) float
        Along the edge in which the faces meet behind it, as long as it; of a corner the one point. Metres.
    edge_covariance : (n, 3, 3) float
        Of these points across the edge, m2.
    """

    label: int
    supports: tuple[int, ...]
    kind: BlendKind
    radius_m: float
    sd_m: float
    p: float
    edge: FloatArray
    edge_covariance: FloatArray

    @property
    def interval_m(self) -> tuple[float, float]:
        """The radius' 95 % interval, metres."""
        return self.radius_m - NORMAL_95 * self.sd_m, self.radius_m + NORMAL_95 * self.sd_m

    @property
    def edge_sd_m(self) -> FloatArray:
        """Standard deviation (n,) of the edge's points, the worst way across; metres."""
        return np.sqrt(np.maximum(np.linalg.eigvalsh(self.edge_covariance)[:, -1], 0.0))

    @property
    def note(self) -> str:
        """What it is, in words: "fillet between 3 and 7"."""
        *first, last = map(str, self.supports)
        return f"{self.kind} between {', '.join(first)} and {last}"


def blends_of(part: RelatedPart) -> tuple[Blend, ...]:
    """Return the blends of a part, those along edges first, then those in corners.

    Parameters
    ----------
    part : RelatedPart
        As `model_part` gives it.
    """
    return find_blends(JointSurfaces(part), FaceSamples(part))


def find_blends(known: JointSurfaces, faces: FaceSamples) -> tuple[Blend, ...]:
    """The same of surfaces and points that are at hand."""
    labels, found = known.part.labels, dict[int, Blend]()
    round_faces = [
        place
        for place, fit in enumerate(known.part.fits)
        if isinstance(fit.surface, Cylinder | Torus | Sphere) and is_settled(fit) and len(faces.of(place))
    ]
    for place in sorted(round_faces, key=lambda place: isinstance(faces.surfaces[place], Sphere)):
        beside = sorted(faces.neighbours[place], key=lambda other: (-len(faces.beside(place, other)), other))
        needed = 2
        if isinstance(faces.surfaces[place], Sphere):
            of = dict.fromkeys(name for other in beside if other in found for name in found[other].supports)
            beside, needed = [labels.index(name) for name in of], 3
        asked = _RollingBall(known, faces, place)
        near = [other for other in beside if asked.touches((other,))]
        for supports in combinations(near, needed):
            blend = asked.between(supports)
            if blend is not None:
                found[place] = blend
                break
    return tuple(found.values())


class _Contact(NamedTuple):
    """Centres (n, 3) of balls that touch m faces, which way (n, m, 3) these are, and how centres move (n, 3).

    As the radius grows, metres a metre.
    """

    centre: FloatArray
    way: FloatArray
    by_radius: FloatArray

    def seen(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far points (n, 3) are from their centres, and which way."""
        step = points - self.centre
        far = np.linalg.norm(step, axis=1)
        return far, step / np.maximum(far, 1e-300)[:, None]


def _contact(surfaces: Sequence[Surface], signs: FloatArray, radius: float, start: FloatArray) -> _Contact:
    """Where a ball touches m faces on the sides `signs` (m,), from near places (n, 3), across the edge.

    Of no radius: where the faces meet. NaN where they do not.
    """
    centre = start.copy()
    for _ in range(_N_STEPS):
        normal = np.stack([surface.normal(centre) for surface in surfaces], axis=1)
        off = np.stack([surface.distance(centre) for surface in surfaces], axis=1)
        square = normal @ normal.transpose(0, 2, 1)
        square[np.linalg.det(square) < _FLAT] = np.nan
        lack = np.column_stack([(signs * radius - off)[..., None], np.repeat(signs[None, :, None], len(off), 0)]
                               ).reshape(len(off), 2, -1).transpose(0, 2, 1)  # fmt: skip
        step, by_radius = (normal.transpose(0, 2, 1) @ np.linalg.solve(square, lack)).transpose(2, 0, 1)
        centre = centre + step
    return _Contact(centre, -signs[:, None] * normal, by_radius)


class _RollingBall:
    """A round face, asked whether it is a blend of others."""

    def __init__(self, known: JointSurfaces, faces: FaceSamples, place: int) -> None:
        self._known, self._faces, self._place = known, faces, place
        self._at, self._surface, graph = known.at[place], faces.surfaces[place], known.part.relations
        options = RelationOptions() if graph is None else graph.options
        self._level, self._built_m = options.level, float(options.built_sd[1])
        self._along = _spread(self._at, faces.of(place), _N_TEST)

    def touches(self, supports: Sequence[int]) -> bool:
        """Whether it touches faces, as a blend does, by chance no better."""
        return self._test(supports) >= self._level

    def _signs(self, supports: Sequence[int]) -> FloatArray:
        """On which side (m,) of faces its spine is, 1 along their normals."""
        spine = _spine(self._at, self._along)
        return np.array([np.sign(np.median(self._faces.surfaces[k].distance(spine))) for k in supports])

    def _test(self, supports: Sequence[int]) -> float:
        """Probability of the spine's distances from faces; 0 where those are as likely by chance."""
        signs, like = self._signs(supports), [self._faces.surfaces[k] for k in supports]

        def off(at: Sequence[Placement]) -> FloatArray:
            spine = _spine(at[0], self._along)
            sides = zip(signs, at[1:], like, strict=True)
            return np.concatenate([sign * surface_at(one, two).distance(spine) - at[0].radius
                                   for sign, one, two in sides])  # fmt: skip

        found = self._known.estimate((self._place, *supports), off)
        exact = (_EXACT * self._known.size_m) ** 2 + self._built_m**2
        variance, ways = np.linalg.eigh(
            found.covariance + _LOOSE**2 * found.measured_covariance + exact * np.eye(len(found.value))
        )
        told = variance > _LEAST_SHARE * variance[-1]
        variance, misfit = variance[told], found.value @ ways[:, told]
        square = float((misfit**2 / variance).sum())
        by_chance = 2 * self._at.radius  # metres, within which anything may be as far from a face
        evidence = -(square + np.log(2 * np.pi * variance / by_chance**2).sum()) / 2
        return float(chdtrc(len(variance), square)) if evidence > 0 else 0.0

    def between(self, supports: Sequence[int]) -> Blend | None:
        """The blend of two or three faces; None where it is none, or they do not meet."""
        p = self._test(supports)
        if p < self._level:
            return None
        known, part = self._known, self._known.part
        signs, like = self._signs(supports), [self._faces.surfaces[k] for k in supports]
        surfaces = [surface_at(known.at[k], one) for k, one in zip(supports, like, strict=True)]
        points = self._points(supports)
        own = self._faces.of(self._place)
        if np.mean(_is_between(_contact(surfaces, signs, self._at.radius, own), own)) < 0.5:
            return None
        radius = self._at.radius
        for _ in range(_N_ROUNDS):
            contact = _contact(surfaces, signs, radius, points)
            far, way = contact.seen(points)
            weight = np.where(_is_between(contact, points), 1 + np.einsum("ij,ij->i", way, contact.by_radius), 0)
            whole = float(np.sum(weight**2))
            if not whole > 0:
                return None
            step = float(weight @ (far - radius)) / whole
            noise = self._noise(far - radius, weight)
            radius += step
            if not 0 < radius < known.size_m:
                return None
            if abs(step) <= _STILL * noise / np.sqrt(whole) + 1e-12 * radius:
                break
        used = weight != 0
        start, weight = contact.centre[used], weight[used] / whole

        def moved(at: Sequence[Placement]) -> float:
            here = _contact([surface_at(one, two) for one, two in zip(at, like, strict=True)],
                            signs, radius, start)  # fmt: skip
            return float(weight @ here.seen(points[used])[0])

        from_supports = known.estimate(supports, moved)
        sd = float(np.hypot(from_supports.sd, noise / np.sqrt(whole)))
        edge, covariance = self._edge(supports, like, signs)
        if not np.isfinite(edge).all():
            return None
        outside = [signs[k] * self._faces.sides[place] for k, place in enumerate(supports)]
        outside.append(1.0 if self._faces.is_hollow(self._place) else -1.0)
        kind: BlendKind = "corner ball" if len(supports) > 2 else "fillet" if sum(outside) > 0 else "round"
        return Blend(
            label=part.labels[self._place], supports=tuple(part.labels[k] for k in supports), kind=kind,
            radius_m=radius, sd_m=sd, p=p, edge=edge, edge_covariance=covariance,
        )  # fmt: skip

    def _points(self, supports: Sequence[int]) -> FloatArray:
        """Points (n, 3) of the face, and those of its supports that are so near that noise may exchange them."""
        part = self._known.part
        own = part.points[part.surface == part.labels[self._place]]
        tree, reach = cKDTree(own), _NEAR * part.spacing_m
        every = [own]
        for place in supports:
            points = part.points[part.surface == part.labels[place]]
            every.append(points[np.isfinite(tree.query(points, distance_upper_bound=reach)[0])])
        return np.concatenate(every)

    def _noise(self, residual: FloatArray, weight: FloatArray) -> float:
        """Deviation of points from the blend, metres: neighbours that err alike count as they do in its fit."""
        fit = self._known.part.measured[self._place]
        n = max(int(np.count_nonzero(weight)) - 1, 1)
        scatter = float(np.sqrt(np.sum(residual[weight != 0] ** 2) / n))
        return max(scatter, self._known.part.noise_m) * float(np.sqrt(fit.inflation))

    def _edge(
        self, supports: Sequence[int], like: Sequence[Surface], signs: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Where faces meet (n, 3), and its covariance (n, 3, 3)."""
        start = _spine(self._at, _spread(self._at, self._faces.of(self._place), _N_EDGE))
        start = start[:1] if len(supports) > 2 else start

        def meeting(at: Sequence[Placement]) -> FloatArray:
            surfaces = [surface_at(one, two) for one, two in zip(at, like, strict=True)]
            return _contact(surfaces, signs, 0.0, start).centre.ravel()

        found = self._known.estimate(supports, meeting)
        n = len(start)
        spread = found.covariance.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n)]
        return found.value.reshape(n, 3), spread


def _is_between(contact: _Contact, points: FloatArray) -> BoolArray:
    """Which points (n, 3) their ball has between its contacts, as seen from its centre."""
    _, way = contact.seen(points)
    square = contact.way @ contact.way.transpose(0, 2, 1)
    parts = np.linalg.solve(square, contact.way @ way[:, :, None])[..., 0]
    return np.asarray((parts > 0).all(axis=1))


def _spine(at: Placement, points: FloatArray) -> FloatArray:
    """Feet (n, 3) of points on a cylinder's axis, a torus' ring, or a sphere's centre."""
    along = ((points - at.point) @ at.direction)[:, None] * at.direction
    if at.ring_radius <= 0:
        return np.asarray(at.point + along)
    level = points - at.point - along
    return np.asarray(at.point + at.ring_radius * level / np.linalg.norm(level, axis=1, keepdims=True))


def _spread(at: Placement, points: FloatArray, n: int) -> FloatArray:
    """Points (n, 3), evenly from one end of a spine to the other, out of many."""
    step = points - at.point
    along = step @ at.direction
    if at.ring_radius > 0:
        angle = np.sort(np.arctan2(step @ at.across[1], step @ at.across[0]))
        gap = np.diff(angle, append=angle[0] + 2 * np.pi)
        first = int(np.argmax(gap)) + 1  # the widest gap is where the face ends
        along = (np.arctan2(step @ at.across[1], step @ at.across[0]) - angle[first % len(angle)]) % (2 * np.pi)
    order = np.argsort(along, kind="stable")
    wanted = np.linspace(along[order[0]], along[order[-1]], n)
    return np.asarray(points[order[np.minimum(np.searchsorted(along[order], wanted), len(order) - 1)]])
