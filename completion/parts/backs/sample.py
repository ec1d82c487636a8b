# SPDX-License-Identifier: MIT
"""Measured surface of a part as evenly spread places, its edges and open ends, and what its scanners saw."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from completion.parts.backs.limits import (
    DEPTH,
    GAP,
    MATCH_SD,
    MOST_SIDES,
    N_NEAR,
    N_POINTS,
    N_SIDES,
    REACH,
    SAME_NORMAL,
    SEEN_FROM,
)
from completion.parts.division.divided_part import DividedPart
from scenes.checks import BoolArray, FloatArray, InputError, IntArray
from scenes.mesh.labelled_mesh import spread_points
from scenes.surfaces.catalogue import Surface

_FAR = 1e3  # sizes from which a side is looked at
_MOST_PLACES = 20_000


class Sight:
    """What was measured as one scanner sees it: directions to places (n, 3) and how far these are."""

    def __init__(self, origin: FloatArray, places: FloatArray, depth_m: float) -> None:
        rays = places - origin
        self.origin, self.depth_m = origin, depth_m
        self._ranges = np.linalg.norm(rays, axis=1)
        self._tree = cKDTree(rays / self._ranges[:, None])
        self._apart = 2 * float(np.median(self._tree.query(self._tree.data, k=4)[0][:, -1]))

    def look(self, points: FloatArray) -> tuple[BoolArray, BoolArray, BoolArray]:
        """Whether places (n, 3) are before what was measured, behind it, or beside all of it."""
        rays = points - self.origin
        ranges = np.linalg.norm(rays, axis=1)
        near, at = self._tree.query(rays / ranges[:, None], k=4, distance_upper_bound=self._apart)
        known = np.isfinite(near)
        there = self._ranges[np.minimum(at, len(self._ranges) - 1)]
        least = np.where(known, there, np.inf).min(axis=1)
        most = np.where(known, there, -np.inf).max(axis=1)
        beside = ~known.any(axis=1)
        return ~beside & (ranges < least - self.depth_m), ~beside & (ranges > most + self.depth_m), beside


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What speaks for surface at places (n,): `matched` 0 or 1; shares of the scanners for the others.

    `free`: before measured surface; `beside`: outside the outline of all that was measured; `hidden`: behind.
    `at` (n,) is the nearest sample.
    """

    matched: FloatArray
    free: FloatArray
    beside: FloatArray
    hidden: FloatArray
    at: IntArray


@dataclass(frozen=True, eq=False)
class Measured:
    """Measured surface of a part, on the fitted surfaces themselves.

    Attributes
    ----------
    points, normals : (n, 3) float
        Metres, and unit normals out of the material.
    face : (n,) int
        Place of the surface of each, from 0.
    surfaces : tuple of Surface
    sd_m : (n,) float
        Standard deviation of its surface there.
    sights : tuple of Sight
        Of each scanner; where the file tells of none, of all sides from which the scan may have been taken.
    is_told : bool
        Whether the file tells where scanners stood.
    some : (m,) int
        Evenly spread samples that hypotheses are tested with.
    """

    points: FloatArray
    normals: FloatArray
    face: IntArray
    surfaces: tuple[Surface, ...]
    sd_m: FloatArray
    sights: tuple[Sight, ...]
    is_told: bool
    some: IntArray
    size_m: float
    spacing_m: float
    noise_m: float

    @cached_property
    def tree(self) -> cKDTree:
        """The samples."""
        return cKDTree(self.points)

    @cached_property
    def ends(self) -> tuple[BoolArray, BoolArray, FloatArray]:
        """Which samples (n,) lie on an edge, which at an open end, and the way out (n, 3) there.

        An edge: where another surface begins, or where this one ends and what lies beyond is farther, unless
        it is curved and turns away from the scanner. An open end: where nothing measured follows.
        """
        away, near = self.tree.query(self.points, k=N_NEAR + 1)
        offset = self.points[near[:, 1:]] - self.points[:, None]
        close = away[:, 1:] <= 2 * REACH * self.spacing_m
        first, second = _tangents(self.normals)
        uv = np.stack([np.einsum("nki,ni->nk", offset, way) for way in (first, second)], axis=2)
        spread = np.einsum("nki,nkj->nij", uv, uv) / N_NEAR + 1e-3 * self.spacing_m**2 * np.eye(2)
        even = np.einsum("nij,nkj->nki", np.linalg.inv(np.linalg.cholesky(spread)), uv)
        angle = np.sort(np.where(close, np.arctan2(even[..., 1], even[..., 0]), np.nan), axis=1)
        between = np.nan_to_num(np.diff(angle, axis=1)).max(axis=1)
        widest = np.maximum(between, 2 * np.pi - np.nan_to_num(np.fmax.reduce(angle, axis=1) - angle[:, 0]))
        is_open = widest > GAP * 2 * np.pi
        out = -np.einsum("nk,nki->ni", close, offset)
        out -= np.einsum("ni,ni->n", out, self.normals)[:, None] * self.normals
        out /= np.maximum(np.linalg.norm(out, axis=1), 1e-12)[:, None]
        other = (self.face[near[:, 1:]] != self.face[:, None]) & close
        crease = other.sum(axis=1) >= 2
        step = REACH * self.spacing_m * out
        deeper, facing = np.zeros(len(self.points)), np.zeros(len(self.points))
        ahead = self._normals_at(self.points + step)
        for sight in self.sights:
            free, _, beside = sight.look(self.points + 2 * step)
            deeper += (free | beside) / len(self.sights)
            facing += (np.einsum("ni,ni->n", sight.origin - self.points, ahead) > 0) / len(self.sights)
        limb = is_open & (deeper >= 0.5) & (facing >= 0.5)
        return crease | limb, is_open & ~crease, out

    def _normals_at(self, points: FloatArray) -> FloatArray:
        """Normals (n, 3) out of the material that each sample's surface has at a place (n, 3)."""
        ahead = np.zeros_like(points)
        for number, surface in enumerate(self.surfaces):
            some = self.face == number
            if some.any():
                side = np.einsum("ni,ni->n", surface.normal(self.points[some]), self.normals[some])
                ahead[some] = surface.normal(points[some]) * np.sign(side)[:, None]
        return ahead

    @cached_property
    def edges(self) -> IntArray:
        """Samples (e,) on edges."""
        return np.flatnonzero(self.ends[0])

    @cached_property
    def edge_tree(self) -> cKDTree:
        """The edges."""
        return cKDTree(self.points[self.edges])

    def edges_at(self, places: FloatArray) -> dict[str, float]:
        """Shares of moved edges (n, 3) that fall on edges, and within measured surface without one."""
        reach = REACH * self.spacing_m
        away = self.edge_tree.query(places)[0]
        inside = (self.tree.query(places)[0] <= reach) & (away > 2 * reach)
        return {"edges": float((away <= reach).mean()), "lost": float(inside.mean())}

    def see(self, points: FloatArray, normals: FloatArray, sd_m: FloatArray, kind: IntArray) -> Seen:
        """What speaks for surface of kinds (n,) at places (n, 3) with normals and standard deviations."""
        away, at = self.tree.query(points, distance_upper_bound=REACH * self.spacing_m)
        near = np.isfinite(away)
        at = np.where(near, at, 0)
        gap = self.distance(points, self.face[at])
        joint = np.maximum(self.noise_m, MATCH_SD * np.hypot(sd_m, self.sd_m[at]))
        alike = np.einsum("ni,ni->n", normals, self.normals[at]) > SAME_NORMAL
        matched = near & (self.kinds[self.face[at]] == kind) & (gap <= joint) & alike
        looks = [sight.look(points) for sight in self.sights]
        several = np.max if self.is_told else np.mean
        free = several([one[0] for one in looks], axis=0) * ~matched
        hidden, beside = (np.mean([one[k] for one in looks], axis=0) * ~matched for k in (1, 2))
        return Seen(matched.astype(np.float64), free, beside, hidden, np.where(near, at, -1))

    @cached_property
    def kinds(self) -> IntArray:
        """The kind (k,) of each surface as a number."""
        names = ("plane", "cylinder", "cone", "sphere", "torus")
        return np.array([names.index(one.kind) for one in self.surfaces], dtype=np.int64)

    def distance(self, points: FloatArray, face: IntArray) -> FloatArray:
        """Distance (n,) of places (n, 3) from the surfaces of faces (n,)."""
        away: FloatArray = np.zeros(len(points))
        for number in np.unique(face):
            some = face == number
            away[some] = np.abs(self.surfaces[number].distance(points[some]))
        return away


def measured_of(part: DividedPart, origins: FloatArray | None, normals: FloatArray | None) -> Measured:
    """Return the measured surface of a part; `origins` (n, 3) and `normals` (n, 3) of its points, if known.

    Raises InputError: no surface, no scanner's place and no side, or one from which it cannot all be seen.
    """
    points, label, is_mesh = part.points, part.surface, part.faces is not None
    if part.faces is not None and part.triangle_surface is not None:
        corners = part.points[part.faces]
        points, members = spread_points(corners, _MOST_PLACES)
        label, across = part.triangle_surface[members], np.cross(*np.diff(corners, axis=1).transpose(1, 0, 2))
        normals = across[members]
    place = np.full(max((*part.labels, *label.tolist(), 0)) + 1, -1, dtype=np.int64)
    place[list(part.labels)] = np.arange(len(part.labels))
    face = place[np.maximum(label, 0)]
    usable = np.flatnonzero(face >= 0)
    if not len(usable):
        raise InputError("no surface was fitted: there is nothing to mirror")
    usable = usable[:: -(-len(usable) // _MOST_PLACES)]
    points, face = points[usable], face[usable]
    feet, across, sd = points.copy(), np.zeros_like(points), np.zeros(len(points))
    for number, fit in enumerate(part.fits):
        some = face == number
        if some.any():
            across[some] = fit.surface.normal(points[some])
            feet[some] -= fit.surface.distance(points[some])[:, None] * across[some]
            sd[some] = fit.standard_deviation(feet[some])
    size = float(np.linalg.norm(np.ptp(feet, axis=0)))
    spacing = max(part.spacing_m, float(np.median(cKDTree(feet).query(feet, k=3)[0][:, -1])))
    depth = max(DEPTH * size, spacing / 2, MATCH_SD * part.noise_m)
    if origins is not None and not is_mesh:
        stands = origins[usable]
        side = stands - points
        eyes, of = np.unique(stands, axis=0, return_inverse=True)
        sights = [Sight(eye, points[of.reshape(-1) == k], depth) for k, eye in enumerate(eyes)]
    elif normals is not None:
        side, sights = normals[usable], []
    else:
        raise InputError(
            "the file tells neither where the scanner stood nor which side of the surface it saw"
        )
    outward = across * np.where(np.einsum("ni,ni->n", across, side) < 0, -1.0, 1.0)[:, None]
    if not sights:
        sights = _sides(points, outward, size, depth)
    some = np.random.default_rng(0).permutation(len(points))[:N_POINTS]
    return Measured(
        points=feet, normals=outward, face=face, surfaces=tuple(fit.surface for fit in part.fits), sd_m=sd,
        sights=tuple(sights), is_told=origins is not None and not is_mesh, some=some, size_m=size,
        spacing_m=spacing, noise_m=part.noise_m,
    )  # fmt: skip


def _sides(points: FloatArray, normals: FloatArray, size: float, depth: float) -> list[Sight]:
    """The sides, or some of many, from which all places (n, 3) with normals are seen.

    Raises InputError: there is none.
    """
    k = np.arange(N_SIDES) + 0.5
    height, turn = 1 - 2 * k / N_SIDES, np.pi * (1 + 5**0.5) * k
    ways = np.stack([*(np.sqrt(1 - height**2) * wave(turn) for wave in (np.cos, np.sin)), height], axis=1)
    fronts = (normals @ ways.T > 0).mean(axis=0)
    middle, found = points.mean(axis=0), []
    for number in np.flatnonzero(fronts >= SEEN_FROM):
        sight = Sight(middle + _FAR * size * ways[number], points, depth)
        if 1 - sight.look(points)[1].mean() >= SEEN_FROM:
            found.append(sight)
    if not found:
        raise InputError(
            f"no side shows all of its surface (at most {100 * fronts.max():.0f} % face one way), and the "
            "file does not tell where the scanners stood"
        )
    return found[:: -(-len(found) // MOST_SIDES)]


def _tangents(normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors (n, 3) at right angles to normals (n, 3) and each other."""
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, least)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(normals, first)
