# SPDX-License-Identifier: MIT
"""Areas: pieces between which there is no evidence of a step are one; the plane is one of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from completion.flattening.limits import (
    BORDER_ERROR,
    EVIDENCE,
    FLAT,
    KNOWN_LEVEL,
    LEAST_RIM_CELLS,
    LEVEL_PRIOR,
    NEAR_PLANE,
    PIECE,
    PLANE_SHARE,
    PRICE,
    RIM_CELLS,
    SHARED_BORDER,
    USUAL_SD,
)
from completion.flattening.ripple import Ripple
from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled

Labels = NDArray[np.int64]

_MOST_PIECES = 250
_RISES = np.concatenate([np.geomspace(1e-3, 1, 8), 2.0 ** np.arange(1, 200)])
CROSSED = np.pi / 4
"""Length of a border for each pair of neighbouring cells that it crosses, on the mean of all directions."""


def cut_pieces(steps: FloatArray, ripple: Ripple) -> Labels:
    """Labels (rows, columns) from 0 of the pieces of a field of steps, at most some 250.

    Cells without a step between them are together. Then pieces are joined, each with the neighbour from which
    it differs with the least evidence for its border, the least first: half the whitened square of the step,
    bounded by that of the smaller piece's cells.
    """
    energy, noise = ripple.step_energy(), ripple.noise_power()
    labels = flat_zones(steps, FLAT * np.sqrt(2 / energy))
    area = np.bincount(labels.ravel()).astype(np.float64)
    total = np.bincount(labels.ravel(), steps.ravel())
    soft: FloatArray = np.bincount(labels.ravel(), ripple.strength.ravel()) / area
    first, second, border = borders_of(labels)
    now = np.arange(len(area))
    for most in _RISES:
        if most > 1 and len(area) <= _MOST_PIECES:
            break
        while len(first):
            step = total[first] / area[first] - total[second] / area[second]
            both = area[first] * area[second] / (area[first] + area[second])
            square = (
                np.minimum(energy * border, both / noise)
                * (step / np.maximum(soft[first], soft[second])) ** 2
            )
            price = square / 2 / (EVIDENCE * border + 1)
            cheap = np.flatnonzero(price < most)
            if not len(cheap):
                break
            onto = np.arange(len(area))
            _merge(first, second, cheap[np.argsort(price[cheap], kind="stable")], area, onto)
            left, onto = np.unique(onto, return_inverse=True)
            soft = np.bincount(onto, soft * area) / np.bincount(onto, area)
            area, total, now = (
                np.bincount(onto, area).astype(np.float64),
                np.bincount(onto, total).astype(np.float64),
                onto[now],
            )
            first, second, border = _together(onto[first], onto[second], border, len(left))
    return now[labels]


@compiled
def _merge(first: Labels, second: Labels, order: Labels, area: FloatArray, onto: Labels) -> None:
    """Let pieces go to larger neighbours, by pairs in order; none that goes takes others, or goes on."""
    takes = np.zeros(len(area), np.bool_)
    for pair in order:
        big, small = first[pair], second[pair]
        if area[small] > area[big]:
            big, small = small, big
        if onto[big] == big and onto[small] == small and not takes[small]:
            onto[small] = big
            takes[big] = True


def flat_zones(field: FloatArray, most: float) -> Labels:
    """Labels (rows, columns) from 0 of cells joined by steps of at most `most` between neighbours."""
    index = np.arange(field.size).reshape(field.shape)
    down, right = np.abs(np.diff(field, axis=0)) <= most, np.abs(np.diff(field, axis=1)) <= most
    first = np.concatenate([index[:-1][down], index[:, :-1][right]])
    other = np.concatenate([index[1:][down], index[:, 1:][right]])
    return label_components(first, other, field.size)[1].reshape(field.shape)


def borders_of(labels: Labels) -> tuple[Labels, Labels, FloatArray]:
    """Neighbouring pieces (n,), (n,), the lower label first, and the lengths of their borders (n,), cells."""
    first = np.concatenate([labels[:-1].ravel(), labels[:, :-1].ravel()])
    other = np.concatenate([labels[1:].ravel(), labels[:, 1:].ravel()])
    return _together(first, other, np.full(len(first), CROSSED), int(labels.max()) + 1)


def _together(first: Labels, second: Labels, length: FloatArray, n: int) -> tuple[Labels, Labels, FloatArray]:
    """Pairs of different pieces, each once, their lengths added."""
    apart = first != second
    first, second, length = first[apart], second[apart], length[apart]
    key, place = np.unique(np.minimum(first, second) * n + np.maximum(first, second), return_inverse=True)
    return key // n, key % n, np.bincount(place, length, minlength=len(key)).astype(np.float64)


def label_components(first: Labels, second: Labels, n: int) -> tuple[int, Labels]:
    """How many remain of n when pairs are joined, and which each becomes."""
    graph = coo_matrix((np.ones(len(first)), (first, second)), shape=(n, n))
    count, onto = connected_components(graph, directed=False)
    return int(count), onto.astype(np.int64)


_PASSES = 3
_CHUNK = 8_192  # cells at a time


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """Levels (n,) of areas in metres, and their covariance (n, n).

    The ripple's longest waves are taken to be of any strength, so that differences are known, not the mean.
    """

    height_m: FloatArray
    covariance: FloatArray

    @classmethod
    def fit(cls, heights: FloatArray, labels: Labels, ripple: Ripple, known: BoolArray) -> Levels:
        """Of heights (rows, columns) on a canvas that are levels by label plus ripple: least squares.

        Where heights are not `known` they follow the levels in turn, as the ripple is most probable there.
        """
        n = int(labels.max()) + 1
        columns = ripple.whitened_areas(labels, known)
        white = ripple.whiten(heights)[known].astype(np.float32)
        weight = np.ones_like(white)
        for turn in range(_PASSES):
            normal, right = _normal_equations(columns, weight, white)
            normal += 1e-8 * np.trace(normal) / n * np.eye(n)
            covariance = np.linalg.inv(normal)
            level = covariance @ right
            if turn + 1 == _PASSES:
                break
            residual = white - level.astype(np.float32) @ columns
            weight = np.minimum(1, (USUAL_SD / np.maximum(np.abs(residual), 1e-6)) ** 2).astype(np.float32)
            heights = level[labels] + ripple.extrapolate(heights - level[labels], known)
            white = ripple.whiten(heights)[known].astype(np.float32)
        return cls(np.asarray(level, dtype=np.float64), np.asarray(covariance, dtype=np.float64))

    def variance_between(self, first: Labels, second: Labels) -> FloatArray:
        """Variance (n,) of the steps from some areas (n,) to others (n,), m^2."""
        both = (
            self.covariance[first, first]
            + self.covariance[second, second]
            - 2 * self.covariance[first, second]
        )
        return np.maximum(both, 1e-30)

    def against(self, first: Labels, second: Labels) -> FloatArray:
        """Evidence (n,) against some areas (n,) being level with others (n,): half the chi-square, nats."""
        out: FloatArray = (
            (self.height_m[first] - self.height_m[second]) ** 2 / self.variance_between(first, second) / 2
        )
        return out

    def with_equal(self, first: int, second: int) -> Levels:
        """The estimate given that two areas are level."""
        toward = self.covariance[first] - self.covariance[second]
        square = max(float(toward[first] - toward[second]), 1e-30)
        height = self.height_m - toward * ((self.height_m[first] - self.height_m[second]) / square)
        return Levels(height, self.covariance - np.outer(toward, toward) / square)

    def over(self, number: int) -> Levels:
        """Heights over one of the areas, with their covariance."""
        toward = self.covariance - self.covariance[number]
        return Levels(self.height_m - self.height_m[number], toward - toward[:, number][:, None])


def _normal_equations(
    columns: NDArray[np.float32], weight: NDArray[np.float32], white: NDArray[np.float32]
) -> tuple[FloatArray, FloatArray]:
    """Matrix (n, n) and right-hand side (n,) of levels by columns (n, m), of heights with weights (m,)."""
    n = len(columns)
    normal = np.zeros((n, n), np.float32)
    for first in range(0, columns.shape[1], _CHUNK):
        sample = columns[:, first : first + _CHUNK]
        normal += (sample * weight[first : first + _CHUNK]) @ sample.T
    return normal.astype(np.float64), (columns @ (weight * white)).astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class PieceJoin:
    """An area that was joined to a larger one: it may be relief, but was not shown to be."""

    pieces: tuple[int, ...]
    height_m: float
    sd_m: float
    evidence: float


@dataclass(frozen=True, slots=True, eq=False)
class Areas:
    """Pieces as areas.

    Attributes
    ----------
    owner : (n,) int
        The area of each piece, from 0.
    levels : Levels
        Of the areas, over the plane.
    plane : int
        The area that is the plane.
    joins : tuple of Join
        What was joined, in turn.
    """

    owner: Labels
    levels: Levels
    plane: int
    joins: tuple[PieceJoin, ...]


def join_pieces(heights: FloatArray, pieces: Labels, ripple: Ripple, known: BoolArray) -> Areas:
    """Areas of the pieces (rows, columns) of heights on a canvas.

    Two neighbours are joined while half the chi-square of their equal levels is below the price of their
    border, the least first. Then levels are estimated again without the rims of the areas, where borders
    slope, and areas apart from the plane join it that are more probably level with it than as high as the
    ripple. The plane is what is largest and near zero where heights are `known`.
    """
    owner, joins = _join_neighbours(Levels.fit(heights, pieces, ripple, known), pieces, known)
    areas = owner[pieces]
    levels = Levels.fit(heights, _with_rims(areas), ripple, known)
    ripple_m = max(float(np.std((heights - levels.height_m[areas])[known])), 1e-30)
    plane = _plane_of(levels, areas, heights, ripple_m, known)
    join = _join_plane(levels, areas, plane, ripple_m)
    joins += [replace(join, pieces=tuple(np.flatnonzero(owner == join.pieces[0]).tolist())) for join in join]
    owner = np.where(np.isin(owner, [join.pieces[0] for join in join]), plane, owner)
    plane = int(np.searchsorted(np.unique(owner), plane))
    owner = np.unique(owner, return_inverse=True)[1]
    return Areas(owner, Levels.fit(heights, owner[pieces], ripple, known).over(plane), plane, tuple(joins))


def _join_plane(levels: Levels, areas: Labels, plane: int, ripple_m: float) -> list[PieceJoin]:
    """Areas apart from the plane that are level with it, the most probable first.

    Those that border on it are not asked, since the step there is evident, nor those of which little is left
    without rims. What rims leave of misplaced borders is a systematic error of a tenth of the ripple.
    """
    border = _borders(areas)
    around, joins = border.sum(axis=1), list[PieceJoin]()
    left = np.ones(len(border), np.bool_)
    left[plane] = False
    while len(others := np.flatnonzero(left & (border[plane] <= SHARED_BORDER * around))):
        above = _above_level(levels, np.full(len(others), plane), others, ripple_m)
        least = int(np.argmin(above))
        if above[least] > 0:
            break
        other = int(others[least])
        step = float(levels.height_m[other] - levels.height_m[plane])
        variance = (
            levels.variance_between(np.array([plane]), others[[least]])[0] + (BORDER_ERROR * ripple_m) ** 2
        )
        worth = step**2 / variance / 2 - PRICE * around[other] - PIECE
        joins.append(PieceJoin((other,), step, float(np.sqrt(variance)), float(worth)))
        levels = levels.with_equal(plane, other)
        border[plane] += border[other]
        left[other] = False
    return joins


def _borders(labels: Labels) -> FloatArray:
    """Lengths (n, n) of the borders between labelled areas, cells."""
    n = int(labels.max()) + 1
    first, second, length = borders_of(labels)
    border = np.zeros((n, n))
    border[first, second] = border[second, first] = length
    return border


def _join_neighbours(levels: Levels, pieces: Labels, known: BoolArray) -> tuple[Labels, list[PieceJoin]]:
    """For each piece the number of its area, from 0, and what was joined."""
    n, border = len(levels.height_m), _borders(pieces)
    area = np.bincount(pieces[known], minlength=n)
    owner, joins = np.arange(n), []
    while True:
        first, second = np.nonzero(np.triu(border))
        if not len(first):
            break
        evidence = levels.against(first, second) - PRICE * border[first, second] - PIECE
        least = int(np.argmin(evidence))
        if evidence[least] > 0:
            break
        big, small = int(first[least]), int(second[least])
        if area[small] > area[big]:
            big, small = small, big
        step = levels.height_m[small] - levels.height_m[big]
        sd = float(np.sqrt(levels.variance_between(np.array([big]), np.array([small]))[0]))
        members = tuple(np.flatnonzero(owner == small).tolist())
        joins.append(PieceJoin(members, float(step), sd, float(evidence[least])))
        levels = levels.with_equal(big, small)
        owner[owner == small] = big
        border[big] += border[small]
        border[:, big] += border[:, small]
        border[small], border[:, small], border[big, big] = 0, 0, 0
        area[big] += area[small]
    return np.unique(owner, return_inverse=True)[1], joins


def _with_rims(areas: Labels) -> Labels:
    """Areas (rows, columns) whose rims are areas of their own, for each neighbour and cell away from it."""
    out, n = areas.copy(), int(areas.max()) + 1
    first, second, length = borders_of(areas)
    new = n
    long = length >= LEAST_RIM_CELLS
    pairs = np.concatenate([np.stack([first, second], 1), np.stack([second, first], 1)])[np.r_[long, long]]
    boxes = ndimage.find_objects(areas + 1)
    deepest = _depths(areas, n)
    for area_a, other in pairs:
        box = tuple(slice(max(side.start - RIM_CELLS, 0), side.stop + RIM_CELLS) for side in boxes[other])
        inside, near = areas[box] == area_a, areas[box] == other
        for _ in range(min(RIM_CELLS, deepest[area_a] - 1)):
            near = ndimage.binary_dilation(near, np.ones((3, 3)))
            rim = near & inside & (out[box] == area_a)
            if rim.any():
                out[box][rim] = new
                new += 1
    return out


def _depths(areas: Labels, n: int) -> Labels:
    """How many cells (n,) lie between the border of each area and its inmost one, counted to `_RIM` + 1."""
    depth = np.zeros(n, np.int64)
    for k in range(RIM_CELLS + 1):
        size = 2 * k + 1
        whole = ndimage.maximum_filter(areas, size) == ndimage.minimum_filter(areas, size)
        depth[np.unique(areas[whole])] = k + 1
    return depth


def _plane_of(levels: Levels, areas: Labels, heights: FloatArray, ripple_m: float, known: BoolArray) -> int:
    """The area that is the plane: with all that is level with it it is large, and on the mean near zero."""
    n = int(areas.max()) + 1
    size = np.bincount(areas[known], minlength=n).astype(np.float64)
    total = np.bincount(areas[known], heights[known], minlength=n)
    first, second = np.divmod(np.arange(n * n), n)
    level = _above_level(levels, first, second, ripple_m).reshape(n, n) <= 0
    together, sums = level @ size, level @ total
    near = (sums / np.maximum(together, 1) / (NEAR_PLANE * ripple_m)) ** 2
    score = np.log(np.maximum(together, 1e-9)) - near / 2
    score[size < PLANE_SHARE * size.max()] = -np.inf
    return int(np.argmax(score))


def _above_level(levels: Levels, first: Labels, second: Labels, ripple_m: float) -> FloatArray:
    """Nats by which areas are more probably as high over others as the ripple than level with them."""
    step = levels.height_m[second] - levels.height_m[first]
    variance = levels.variance_between(first, second) + (BORDER_ERROR * ripple_m) ** 2
    above = step**2 / variance / 2 - np.log1p(ripple_m**2 / variance) / 2 - LEVEL_PRIOR
    return np.where(variance <= (KNOWN_LEVEL * ripple_m) ** 2, above, np.inf)
