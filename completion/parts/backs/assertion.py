# SPDX-License-Identifier: MIT
"""Surface that symmetries of a part imply where no scan saw: turned and mirrored faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from completion.backs.symmetry import move, one_a_cell, product
from completion.parts.backs.axes import is_about, sectors, turn_of
from completion.parts.backs.hypothesis import Hypothesis, Provenance, across
from completion.parts.backs.limits import (
    HALF,
    MATCH_SD,
    MOST_REFUTED,
    MOST_SD,
    N_SECTORS,
    REACH,
    SAME_NORMAL,
    SQUARE_DEG,
)
from completion.parts.backs.sample import Measured
from scenes.checks import BoolArray, FloatArray, IntArray, Value
from scenes.pose import Pose
from scenes.surfaces.catalogue import Plane, Sphere, Surface

ORIGINS: dict[Provenance, int] = {"symmetry": 1, "turn": 2}
_FEWEST = 8  # places of a face that is asserted


@dataclass(frozen=True, slots=True, eq=False)
class Places(Value):
    """Places (n, 3) on surfaces of a part, their normals (n, 3), and for each what is to be known of it.

    `face`: place of the measured surface that it comes from; `label` of the surface that it lies on; `origin`
    0 measured, 1 by a mirror, 2 by a turn; `sd_m` along the normal; `probability` of the symmetry.
    """

    points: FloatArray
    normals: FloatArray
    face: IntArray
    label: IntArray
    origin: NDArray[np.uint8]
    sd_m: FloatArray
    probability: FloatArray

    def only(self, some: IntArray | BoolArray) -> Places:
        """Return those of numbers (m,), or that are true of (n,)."""
        return Places(*(getattr(self, name)[some] for name in self.__slots__))

    @classmethod
    def joined(cls, parts: Sequence[Places]) -> Places:
        """Return those of several, one after the other."""
        return cls(*(np.concatenate([getattr(one, name) for one in parts]) for name in cls.__slots__))


@dataclass(frozen=True, slots=True, eq=False)
class InferredFace(Value):
    """A face, or the rest of one, that a symmetry implies.

    Attributes
    ----------
    label : int
        Its own, or that of the measured surface that it goes on from.
    of : int
        Label of the measured surface whose image it is.
    surface : Surface
    provenance : "symmetry" or "turn"
    probability : float
    sd_m, area_m2 : float
        Standard deviation along the normal, and area.
    is_new : bool
        Whether no measured surface has this label.
    """

    label: int
    of: int
    surface: Surface
    provenance: Provenance
    probability: float
    sd_m: float
    area_m2: float
    is_new: bool

    def record(self) -> dict[str, Any]:
        """Return what files hold of it."""
        return {
            "surface": self.label, "image_of": self.of, "kind": self.surface.kind, "state": "inferred",
            "provenance": self.provenance, "probability": self.probability, "sd_m": self.sd_m,
            "area_m2": self.area_m2, "is_new": self.is_new,
        }  # fmt: skip


def choose(hypotheses: Sequence[Hypothesis], least: float) -> tuple[Hypothesis, ...]:
    """Return all axes of a probability, the most probable mirror of it, and those at right angles to that."""
    likely = [one for one in hypotheses if one.probability >= least]
    mirrors = list[Hypothesis]()
    for one in sorted(likely, key=lambda one: -one.probability):
        square = all(
            abs(one.direction @ other.direction) < np.sin(np.radians(SQUARE_DEG)) for other in mirrors
        )
        if one.kind == "mirror" and square:
            mirrors.append(one)
    return (*(one for one in likely if one.kind == "axis"), *mirrors)


def assert_surface(
    measured: Measured, labels: Sequence[int], chosen: Sequence[Hypothesis], least: float
) -> tuple[Places, tuple[InferredFace, ...]]:
    """Return inferred places, none of which a scanner looked through or measured, and the faces they make."""
    names = np.array(labels)
    n = len(measured.points)
    known = Places(
        points=measured.points, normals=measured.normals, face=measured.face, label=names[measured.face],
        origin=np.zeros(n, np.uint8), sd_m=measured.sd_m, probability=np.ones(n),
    )  # fmt: skip
    turns = [_turned(measured, one, names) for one in chosen if one.kind == "axis"]
    turns = [_free_places(measured, one) for one in turns]
    base = Places.joined([known, *turns])
    found, surfaces = list(turns), dict[int, Surface](zip(labels, measured.surfaces, strict=True))
    mirrors = [one for one in chosen if one.kind == "mirror"]
    for size in range(1, len(mirrors) + 1):
        for group in combinations(mirrors, size):
            likely = float(np.prod([one.probability for one in group]))
            if likely < least:
                continue
            images = _free_places(measured, _mirrored(base, group, likely))
            found.append(_labelled(measured, Places.joined([known, *found]), images, surfaces, group))
    every = Places.joined(found) if found else known.only(np.zeros(0, np.int64))
    every = every.only(one_a_cell(every.points, measured.spacing_m)) if len(every.points) else every
    every = every.only(np.bincount(every.label, minlength=1)[every.label] >= _FEWEST)
    return every, tuple(_faces(measured, names, every, surfaces))


def _turned(measured: Measured, axis: Hypothesis, names: IntArray) -> Places:
    """The surfaces of an axis all round: each place of their profile that is measured far enough round.

    Spheres that touch these are turned too, and planes at right angles as far as these surfaces reach; a ring
    of a plane of which a part was seen to be open stays as measured: it has holes.
    """
    group = [k for k, label in enumerate(names) if label in axis.surfaces]
    own = np.isin(measured.face, group)
    height, radius = _profile(measured.points, axis)
    tree, parts = cKDTree(measured.points[own]), list[Places]()
    for k, surface in enumerate(measured.surfaces):
        members = np.flatnonzero(measured.face == k)
        if not len(members) or not is_about(measured, surface, axis.point, axis.direction):
            continue
        if k not in group:
            if isinstance(surface, Plane):
                members = members[radius[members] <= radius[own].max() + measured.spacing_m]
            near = tree.query(measured.points[members])[0] <= REACH * measured.spacing_m
            if near.sum() < _FEWEST or not isinstance(surface, Plane | Sphere):
                continue
        cell = np.round(np.column_stack([radius, height])[members] / measured.spacing_m).astype(np.int64)
        _, first, of = np.unique(cell, axis=0, return_index=True, return_inverse=True)
        filled = np.zeros((len(first), N_SECTORS), np.bool_)
        filled[of.reshape(-1), sectors(measured.points[members], axis.point, axis.direction)] = True
        arc = filled.sum(axis=1)
        least = HALF * (N_SECTORS if isinstance(surface, Plane) else arc.max())
        parts += [_ring(measured, place, axis, int(names[k])) for place in members[first[arc >= least]]]
    rings = Places.joined(parts)
    number = np.repeat(np.arange(len(parts)), [len(one.points) for one in parts])
    seen = measured.see(rings.points, rings.normals, rings.sd_m, measured.kinds[rings.face])
    is_flat = np.array([isinstance(one, Plane) for one in measured.surfaces])[rings.face]
    open_ = np.where(is_flat, 1 - seen.matched - seen.hidden, seen.free + seen.beside)
    share = np.bincount(number, open_) / np.bincount(number)
    return rings.only(share[number] <= MOST_REFUTED)


def _profile(points: FloatArray, axis: Hypothesis) -> tuple[FloatArray, FloatArray]:
    """Heights (n,) along an axis of points (n, 3), and distances (n,) from it."""
    away = points - axis.point
    height = away @ axis.direction
    return height, np.linalg.norm(away - height[:, None] * axis.direction, axis=1)


def _ring(measured: Measured, place: int, axis: Hypothesis, label: int) -> Places:
    """A place turned all round an axis, about a sampling distance from one to the next."""
    away = measured.points[place] - axis.point
    radius = float(_profile(measured.points[place][None], axis)[1][0])
    n = max(N_SECTORS, int(np.ceil(2 * np.pi * radius / measured.spacing_m)))
    turns = [turn_of(axis.direction, 2 * np.pi * k / n) for k in range(n)]
    points = np.array([axis.point + turn @ away for turn in turns])
    normals = np.array([turn @ measured.normals[place] for turn in turns])
    face = np.full(n, measured.face[place])
    return Places(
        points=points, normals=normals, face=face, label=np.full(n, label),
        origin=np.full(n, ORIGINS["turn"], np.uint8), sd_m=np.full(n, measured.sd_m[place]),
        probability=np.full(n, axis.probability),
    )  # fmt: skip


def _mirrored(base: Places, group: Sequence[Hypothesis], likely: float) -> Places:
    """Places mirrored at planes, one after the other; what was turned keeps its lower probability."""
    points, normals, variance = base.points, base.normals, base.sd_m**2
    for one in group:
        variance = variance + one.spread(points, normals) ** 2
        points, normals = move(one.isometry, points), normals @ one.isometry[:, :3].T
    origin = np.full(len(points), ORIGINS["symmetry"], np.uint8)
    return replace(
        base, points=points, normals=normals, sd_m=np.sqrt(variance), origin=origin,
        probability=base.probability * likely,
    )  # fmt: skip


def _free_places(measured: Measured, images: Places) -> Places:
    """Images where nothing was measured and nothing refutes them, of faces of which little is refuted."""
    if not len(images.points):
        return images
    kind = measured.kinds[images.face]
    seen = measured.see(images.points, images.normals, images.sd_m, kind)
    refuted = seen.free + seen.beside >= 0.5
    n = len(measured.surfaces)
    share = np.bincount(images.face, refuted, minlength=n) / np.maximum(
        np.bincount(images.face, minlength=n), 1
    )
    kept = ~refuted & (seen.matched < 0.5) & (share[images.face] <= MOST_REFUTED)
    kept &= images.sd_m <= max(MOST_SD * measured.size_m, 2 * measured.noise_m)
    away = measured.tree.query(images.points)[0]
    return images.only(kept & (away > measured.spacing_m))


def _labelled(
    measured: Measured, before: Places, images: Places, surfaces: dict[int, Surface],
    group: Sequence[Hypothesis],
) -> Places:  # fmt: skip
    """Images with the labels of the surfaces that they go on from, else with new ones, which are added."""
    isometry = group[0].isometry
    for one in group[1:]:
        isometry = product(one.isometry, isometry)
    label = images.label.copy()
    tree = cKDTree(before.points)
    for old in np.unique(images.label):
        some = np.flatnonzero(images.label == old)
        surface = mirrored_surface(surfaces[int(old)], isometry)
        near, at = tree.query(images.points[some], distance_upper_bound=2 * REACH * measured.spacing_m)
        touched = np.unique(before.label[at[np.isfinite(near)]])
        same = [
            int(one) for one in touched if _is_one(measured, images.only(some), surfaces[int(one)], surface)
        ]
        if not same:
            same = [max(surfaces) + 1]
            surfaces[same[0]] = surface
        label[some] = same[0]
    return replace(images, label=label)


def _is_one(measured: Measured, images: Places, other: Surface, surface: Surface) -> bool:
    """Whether images of a surface lie on another one of the same kind."""
    if other.kind != surface.kind:
        return False
    gap, joint = np.abs(other.distance(images.points)), np.maximum(measured.noise_m, MATCH_SD * images.sd_m)
    alike = np.abs(np.einsum("ni,ni->n", other.normal(images.points), images.normals)) > SAME_NORMAL
    return bool((alike & (gap <= joint)).mean() > 0.9)


def mirrored_surface(surface: Surface, isometry: FloatArray) -> Surface:
    """Return a surface moved by an isometry (3, 4), which may mirror: planes and bodies of revolution alike.

    Each is its own mirror image at a plane along its axis, which makes a motion of a reflection.
    """
    turn = isometry[:, :3]
    if np.linalg.det(turn) > 0:
        return surface.transform(Pose.from_parts(turn, isometry[:, 3]))
    axis = np.asarray(getattr(surface, "normal_direction", getattr(surface, "direction", np.eye(3)[0])))
    place, normal = np.asarray(getattr(surface, "point", getattr(surface, "centre", None))), across(axis)[0]
    own = np.eye(3) - 2 * np.outer(normal, normal)
    shift = turn @ (2 * (place @ normal) * normal) + isometry[:, 3]
    return surface.transform(Pose.from_parts(turn @ own, shift))


def _faces(
    measured: Measured, names: IntArray, every: Places, surfaces: dict[int, Surface]
) -> list[InferredFace]:
    """The faces that inferred places make, by label and provenance."""
    found = []
    for label in np.unique(every.label).tolist():
        for provenance, origin in ORIGINS.items():
            some = (every.label == label) & (every.origin == origin)
            if some.any():
                of = int(names[np.bincount(every.face[some]).argmax()])
                found.append(
                    InferredFace(
                        label,
                        of,
                        surfaces[label],
                        provenance,
                        float(every.probability[some].min()),
                        sd_m=float(np.median(every.sd_m[some])),
                        area_m2=float(some.sum() * measured.spacing_m**2),
                        is_new=label not in names,
                    )
                )
    return found
