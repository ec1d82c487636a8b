# SPDX-License-Identifier: MIT
"""Structure of upright points: levels, flights of them, and shafts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.features import limits
from completion.features.engine.template import Measurements
from scenes.checks import FloatArray

_SHARE, _N_SAMPLE = 0.05, (20_000, 100_000)  # of all points, that are looked at; at least and at most
_N_TREE = 1_000_000  # among which neighbours are sought
_N_NEIGHBOURS = 16


@dataclass(frozen=True, slots=True, eq=False)
class Upright:
    """A frame that stands upright.

    Attributes
    ----------
    turn : (3, 3) float
        Rows: its axes in the frame of the points; the last points up.
    origin : (3,) float
        Its origin there.
    """

    turn: FloatArray
    origin: FloatArray

    @classmethod
    def about(cls, measured: Measurements, up: FloatArray) -> Upright:
        """Return the frame in the middle of what was measured, with up (3,) of any length; z stays z."""
        axis = np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
        beside = np.eye(3)[0] if abs(axis[0]) < 0.9 else np.eye(3)[1]
        first = beside - (beside @ axis) * axis
        first = first / np.linalg.norm(first)
        return cls(np.stack([first, np.cross(axis, first), axis]), np.median(measured.points, axis=0))

    def local(self, points: FloatArray) -> FloatArray:
        """Return points (n, 3) in this frame."""
        return np.asarray((points - self.origin) @ self.turn.T)

    def outside(self, local: FloatArray) -> FloatArray:
        """Return points (n, 3) of this frame where they were measured."""
        return np.asarray(local @ self.turn + self.origin)


@dataclass(frozen=True, slots=True, eq=False)
class UprightSample:
    """Some points (n, 3) of an upright frame with their normals (n, 3), which have no side."""

    points: FloatArray
    normals: FloatArray

    @classmethod
    def of(cls, local: FloatArray) -> UprightSample:
        """Return some of the points (n, 3), spread evenly, with normals by their nearest neighbours."""
        sample = _evenly(local, int(np.clip(_SHARE * len(local), *_N_SAMPLE)))
        points = local[:: max(1, len(local) // _N_TREE)]
        _, nearest = cKDTree(points).query(sample, k=min(_N_NEIGHBOURS, len(points)))
        around = points[nearest] - points[nearest].mean(axis=1, keepdims=True)
        _, vectors = np.linalg.eigh(np.einsum("mki,mkj->mij", around, around))
        return cls(sample, vectors[:, :, 0])

    @property
    def flat(self) -> FloatArray:
        """Points (m, 3) of surfaces that lie flat."""
        return np.asarray(self.points[np.abs(self.normals[:, 2]) > limits.FLAT_COSINE])

    @property
    def steep(self) -> tuple[FloatArray, FloatArray]:
        """Points (m, 3) of surfaces that stand upright, and their normals (m, 3)."""
        which = np.abs(self.normals[:, 2]) < limits.STEEP_SINE
        return self.points[which], self.normals[which]


def _evenly(points: FloatArray, most: int) -> FloatArray:
    """About so many of the points (n, 3), spread over what was measured: one of each cube."""
    if len(points) <= most:
        return points
    low = points.min(axis=0)
    side = float(np.ptp(points, axis=0).max()) / np.sqrt(most)
    first = np.zeros(0, np.int64)
    for _ in range(4):
        cubes = np.floor((points - low) / side).astype(np.int64)
        wide = cubes.max(axis=0) + 1
        number = (cubes[:, 0] * wide[1] + cubes[:, 1]) * wide[2] + cubes[:, 2]
        _, first = np.unique(number, return_index=True)
        if most / 2 <= len(first) <= most:
            break
        side *= np.sqrt(len(first) / (0.7 * most))
    return points[np.sort(first)]


def levels(heights: FloatArray, width: float, least: int) -> FloatArray:
    """Return heights (l,) about which at least so many of the heights (n,) lie within a width, ascending."""
    if len(heights) == 0:
        return np.zeros(0)
    first = float(heights.min())
    count = np.bincount(np.floor((heights - first) / width).astype(np.int64) + 1, minlength=3)
    count = np.append(count, 0)
    around = count[:-2] + count[1:-1] + count[2:]
    peak = (count[1:-1] >= count[:-2]) & (count[1:-1] > count[2:]) & (around >= least)
    middles = first + width * (np.flatnonzero(peak) + 0.5)
    return np.array([heights[np.abs(heights - middle) <= 1.5 * width].mean() for middle in middles])


_NEIGHBOURS = 6  # that tell how far apart the points that were looked at are
_SIDES = (2.0, 98.0)  # percentiles of points that a patch spans
_MARGIN = (100.0 / 96.0 - 1) / 2  # of the width between them, up to the ends


class Flight(NamedTuple):
    """Where structure sees a flight, in an upright frame."""

    x: FloatArray  # (5,) as the parameters of stairs
    n_steps: int
    sides: FloatArray  # (2,) least and greatest place across the way


def find_flight(sample: UprightSample, noise: float, spacing: float, given: dict[str, float]) -> Flight | str:
    """Return the flight that most level patches belong to, or why none is.

    Points of level surfaces that lie side by side at one height are a patch. Two patches give a rise and a
    move; others that lie where these lead belong to the flight, if treads are about as deep as it moves.

    Parameters
    ----------
    sample : UprightSample
        Points of an upright frame, with their normals.
    noise, spacing : float
        Of a point across its surface; between neighbouring points of all.
    given : mapping
        "rise" and "going", if they are known.
    """
    patches = _patches(sample.flat, max(4 * noise, 0.7 * spacing))
    if len(patches) < limits.LEAST_STEPS:
        return f"{len(patches)} level patches; a flight has {limits.LEAST_STEPS}"
    heights = np.array([float(np.median(patch[:, 2])) for patch in patches])
    middles = np.array([(patch[:, :2].min(axis=0) + patch[:, :2].max(axis=0)) / 2 for patch in patches])
    row = _longest_row(patches, heights, middles, max(4 * noise, 0.7 * spacing), given)
    if len(row) < limits.LEAST_STEPS:
        sentence = f"{len(patches)} level patches, of which {len(row)} rise and move on equally"
        return f"{sentence}; a flight has {limits.LEAST_STEPS}"
    number, step = (np.array(columns) for columns in zip(*row, strict=True))
    rise = given.get("rise", float(np.median(np.diff(heights[number]) / np.diff(step))))
    move = np.median(np.diff(middles[number], axis=0) / np.diff(step)[:, None], axis=0)
    going = given.get("going", float(np.linalg.norm(move)))
    way = move / max(float(np.linalg.norm(move)), 1e-12)
    first = float(np.median(middles[number] @ way - step * going)) - going / 2
    across = np.concatenate([patches[k] for k in number])[:, :2] @ [-way[1], way[0]]
    x = np.array(
        [np.arctan2(way[1], way[0]), first, float(np.median(heights[number] - step * rise)), going, rise]
    )
    low, high = np.percentile(across, _SIDES)
    margin = _MARGIN * (high - low)
    return Flight(x, int(step[-1]) + 1, np.array([low - margin, high + margin]))


def trim_flight(flight: Flight, x: FloatArray, seen: list[int]) -> Flight:
    """Return the flight from the first to the last step that was seen, with parameters x (5,) of before."""
    first, last = min(seen), max(seen)
    moved = x + first * np.array([0.0, x[3], x[4], 0.0, 0.0])
    return Flight(moved, last - first + 1, flight.sides)


def _patches(flat: FloatArray, thick: float) -> list[FloatArray]:
    """Points (n, 3) of level surfaces as patches: side by side, and no higher apart than they are thick."""
    if len(flat) <= _NEIGHBOURS:
        return []
    away, _ = cKDTree(flat[:, :2]).query(flat[:, :2], k=_NEIGHBOURS + 1)
    reach = max(limits.NEAR_POINTS * float(np.median(away[:, -1])), 1e-12)
    tree = cKDTree(flat * [1 / reach, 1 / reach, 1 / thick])
    pairs = tree.query_pairs(1.0, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), (len(flat),) * 2)
    _, part = connected_components(graph, directed=False)
    order = np.argsort(part, kind="stable")
    groups = np.split(flat[order], np.flatnonzero(np.diff(part[order])) + 1)
    return [group for group in groups if len(group) >= limits.PATCH_POINTS]


def _longest_row(
    patches: list[FloatArray], heights: FloatArray, middles: FloatArray, thick: float, given: dict[str, float]
) -> list[tuple[int, int]]:
    """Patch and step of each in the row with the most patches less misses, ascending."""
    best, most = list[tuple[int, int]](), 0
    for i in range(len(patches)):
        for j in range(len(patches)):
            rise, move = heights[j] - heights[i], middles[j] - middles[i]
            going = float(np.linalg.norm(move))
            if rise < 2 * thick or going < 2 * thick or not _agrees(rise, going, given):
                continue
            if not (_is_deep(patches[i], move, going) and _is_deep(patches[j], move, going)):
                continue
            members = _members(i, heights, middles, rise, move)
            members = [member for member in members if _is_deep(patches[member[0]], move, going)]
            score = len(members) - (members[-1][1] + 1 - len(members))
            if score > most:
                best, most = members, score
    return best


def _agrees(rise: float, going: float, given: dict[str, float]) -> bool:
    """Whether a step is as large as it is known to be."""
    agrees = {"rise": rise, "going": going}
    return all(
        abs(agrees[name] - given[name]) < limits.SAME_RISE * given[name] for name in agrees if name in given
    )


def _is_deep(patch: FloatArray, move: FloatArray, going: float) -> bool:
    """Whether a patch is about as deep along a move as that is long."""
    low, high = np.percentile(patch[:, :2] @ move / going, _SIDES)
    return bool(limits.TREAD_DEPTHS[0] * going <= high - low <= limits.TREAD_DEPTHS[1] * going)


def _members(
    first: int, heights: FloatArray, middles: FloatArray, rise: float, move: FloatArray
) -> list[tuple[int, int]]:
    """Patches that lie where a rise and a move lead up from a first one, and their steps."""
    members, step = [(first, 0)], 0
    going, way = float(np.linalg.norm(move)), move / np.linalg.norm(move)
    while step - members[-1][1] <= limits.MOST_MISSED:
        step += 1
        last, before = members[-1]
        off = np.abs(heights - heights[last] - (step - before) * rise) / (limits.SAME_RISE * rise)
        along = np.abs((middles - middles[last] - (step - before) * move) @ way) / (
            limits.ASIDE_GOING * going
        )
        near = np.maximum(off, along)
        k = int(np.argmin(near))
        if near[k] < 1.0:
            members.append((k, step))
    return members


_N_RADII = 28
_CELL = 0.2  # of the radius: how near centres must be to each other
_PEAKS = 4  # cells of most centres, of each radius
_N_BINS = 24  # of directions round the axis
_MOST = 4  # shafts


class Shaft(NamedTuple):
    """An upright cylinder, and how many of the points that were looked at lie on it."""

    x: float
    y: float
    radius: float
    n: int = 0


def find_shafts(
    sample: UprightSample, spacing: float, noise: float, *, radius: float | None = None
) -> list[Shaft]:
    """Return upright cylinders, the one of most points first.

    A point of a cylinder has its axis a radius away along its normal, to one side or the other. For each of
    some radii the axes of all points are counted in cells (Hough 1962): those of a wall are spread along it,
    those of a cylinder lie in one. A circle is then fitted to what lies about it; it counts if most of that
    lies on it, and is seen from a quarter turn.

    Parameters
    ----------
    sample : UprightSample
        Points of an upright frame, with their normals.
    spacing, noise : float
        Between neighbouring points of all; of a point.
    radius : float, optional
        If it is known.
    """
    points, normals = sample.steep
    if len(points) < limits.SHAFT_POINTS:
        return []
    flat, way = points[:, :2], normals[:, :2] / np.linalg.norm(normals[:, :2], axis=1, keepdims=True)
    size = float(np.ptp(flat, axis=0).max())
    low, high = limits.SHAFT_SPACINGS * spacing, limits.SHAFT_SIZE * size
    radii = np.array([radius]) if radius is not None else np.geomspace(low, max(high, low), _N_RADII)
    fitted = [
        _fit_shaft(flat, rough, noise, fixed=radius is not None)
        for radius_m in radii
        for rough in _peaks(flat, way, radius_m)
    ]
    pairs: list[Shaft] = []
    for shaft in sorted((shaft for shaft in fitted if shaft.n), key=lambda shaft: -shaft.n):
        if all(
            np.hypot(shaft.x - kept_shaft.x, shaft.y - kept_shaft.y) > max(shaft.radius, kept_shaft.radius)
            for kept_shaft in pairs
        ):
            pairs.append(shaft)
    return pairs[:_MOST]


def _peaks(flat: FloatArray, way: FloatArray, radius: float) -> Iterator[Shaft]:
    """Where most points (n, 2) have an axis of a radius in one cell, along their normals (n, 2)."""
    centres = np.concatenate([flat - radius * way, flat + radius * way])
    low = centres.min(axis=0)
    for shift in (0.0, 0.5):
        column, row = np.floor((centres - low) / (_CELL * radius) + shift).astype(np.int64).T
        _, member, count = np.unique(column * (row.max() + 1) + row, return_inverse=True, return_counts=True)
        for number in np.argsort(-count, kind="stable")[:_PEAKS]:
            if count[number] >= limits.SHAFT_POINTS:
                middle = centres[member == number].mean(axis=0)
                yield Shaft(float(middle[0]), float(middle[1]), radius)


def _fit_shaft(flat: FloatArray, rough: Shaft, noise: float, *, fixed: bool) -> Shaft:
    """The circle through the points (n, 2) about a rough one by least squares; of no points if it is none."""
    shaft = rough
    for width in (limits.AROUND_SHAFT, limits.AROUND_SHAFT, limits.ON_SHAFT, limits.ON_SHAFT):
        away = flat - [shaft.x, shaft.y]
        out = np.hypot(*away.T)
        near = np.abs(out - shaft.radius) < max(width * shaft.radius, limits.ON_SHAFT_SD * noise)
        if near.sum() < limits.SHAFT_POINTS:
            return rough
        unit = away[near] / out[near, None]
        slopes = np.column_stack([unit, np.ones(len(unit))])[:, : 2 if fixed else 3]
        step = np.linalg.lstsq(slopes, out[near] - shaft.radius, rcond=None)[0]
        x, y, radius = np.array(shaft[:3]) + np.append(step, 0.0)[:3]
        if not 0.5 * rough.radius < radius < 2 * rough.radius:
            return rough
        shaft = Shaft(float(x), float(y), float(radius))
    away = flat - [shaft.x, shaft.y]
    off = np.abs(np.hypot(*away.T) - shaft.radius)
    on = off < max(limits.ON_SHAFT * shaft.radius, limits.ON_SHAFT_SD * noise)
    about = off < max(limits.AROUND_SHAFT * shaft.radius, limits.ON_SHAFT_SD * noise)
    turn = np.floor((np.arctan2(away[on, 1], away[on, 0]) / (2 * np.pi) + 0.5) * _N_BINS)
    is_round = len(np.unique(turn)) >= limits.LEAST_BINS and on.sum() >= limits.ROUND_SHARE * about.sum()
    return shaft._replace(n=int(on.sum()) if is_round and on.sum() >= limits.SHAFT_POINTS else 0)
