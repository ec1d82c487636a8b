# SPDX-License-Identifier: MIT
"""Partition: a closed curve of points as the lines and arcs that describe it most shortly.

Along a sweep all points of a wall fall on one curve, where many of them lie in each stretch that noise is
wide: what a face's neighbourhoods cannot tell, the curve does. All divisions into lines and arcs are compared
(dynamic programming; Bellman 1961, Perez and Vidal 1994), a line fitted by its moments, an arc by Taubin's
method as Chernov (2010, Circular and linear regression, section 5.9) solves it, whose eigenvalue is the mean
square of distances.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from scipy.spatial import cKDTree

from completion.fitting.result import SurfaceFit
from completion.parts.profiles import limits
from completion.parts.profiles.chain import Chain, Piece, along_wall, corner_of
from completion.parts.profiles.refit import line_of, unfitted
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Cylinder, Surface

_MOST_PLACES = 12_000  # of a curve
_SECTORS = 8  # of the height or turn, half of which a place must have
_MOST_BINS, _LEAST_BINS = 1500, 5  # of a curve, of a segment
_WIDER, _THINNER = 1.5, 1.25  # cells: discs about places, and what is taken off the band that they make
_ROUNDS = 2
_BIN_CELLS, _BIN_NOISES = 1 / 3, 3.0  # width of a bin: at least so many cells, deviations of noise
_BESIDE = 2  # bins at the ends of a segment that may lie over a corner
_MOST_LEFT_OUT = 3  # spans beside a corner
_NEWTON, _STILL = 12, 1e-7  # most steps; of the size squared, a step that is the last
_PARAMETERS = (3, 4)  # of a line and an arc, with where each ends
_FAR_CORNER = 3.0  # times the distance of ends, beyond which a corner is not theirs
_Span = tuple[int, int]  # of bins: the first, and the one after the last


def curves_of(
    places: FloatArray, share: FloatArray, cell_m: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Places (m, 2) of each closed curve among those (n, 2) of points, in order, and how far along (m,).

    `share` (n,) of the height or turn, from 0 to 1, tells what is swept: a place where points have less than
    half of it is none. Curves that cross or touch others are left out, and what is no closed curve.
    """
    cell = np.floor(places / cell_m).astype(np.int64)
    _, which, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    middle = np.column_stack([np.bincount(which, places[:, k]) for k in (0, 1)]) / count[:, None]
    sector = np.minimum((share * _SECTORS).astype(np.int64), _SECTORS - 1)
    n_near = cKDTree(places).query_ball_point(middle, cell_m, return_length=True)
    trees = [cKDTree(places[sector == number]) for number in range(_SECTORS)]
    is_there = [np.isfinite(tree.query(middle, distance_upper_bound=cell_m)[0]) for tree in trees]
    is_swept = np.sum(is_there, axis=0) >= _SECTORS / 2 * (1 - (1 - 1 / _SECTORS) ** n_near)
    band = shapely.union_all(shapely.buffer(shapely.points(middle[is_swept]), _WIDER * cell_m))
    for piece in shapely.get_parts(band):
        if _is_ring(piece, cell_m):
            some = places[is_swept[which] & shapely.contains_xy(piece, places)]
            some = some[:: max(1, len(some) // _MOST_PLACES)]
            yield _ordered(some, _middle_line(piece, cell_m), cell_m)


def _is_ring(band: shapely.Polygon, cell_m: float) -> bool:
    """Whether a band has one hole that is larger than gaps between places."""
    return bool(sum(shapely.Polygon(ring).area > (2 * cell_m) ** 2 for ring in band.interiors) == 1)


def _along_ring(places: FloatArray, ring: FloatArray) -> tuple[FloatArray, float]:
    """How far along a ring with corners (k, 2) places (n, 2) are, by the nearest sides; and its length."""
    side = np.roll(ring, -1, axis=0) - ring
    length = np.linalg.norm(side, axis=1)
    start = np.concatenate([[0.0], np.cumsum(length)])
    nearest = cKDTree(ring).query(places)[1]
    both = np.stack([nearest, (nearest - 1) % len(ring)])
    unit = np.maximum(length[both], 1e-12)
    share = np.clip(np.einsum("skj,skj->sk", places - ring[both], side[both]) / unit**2, 0.0, 1.0)
    off = np.linalg.norm(places - ring[both] - share[..., None] * side[both], axis=2)
    best = np.argmin(off, axis=0), np.arange(len(places))
    return np.asarray(start[both][best] + share[best] * length[both][best]), float(start[-1])


def _middle_line(band: shapely.Polygon, cell_m: float) -> FloatArray:
    """Corners (k, 2) of a ring along a band of discs, as near to its middle as it stays in one."""
    parts = shapely.get_parts(shapely.buffer(band, -_THINNER * cell_m))
    thin = max(parts, key=lambda part: part.area, default=band)
    ring = shapely.segmentize((thin if _is_ring(thin, cell_m) else band).exterior, cell_m)
    return np.asarray(shapely.get_coordinates(ring)[:-1])


def _ordered(places: FloatArray, ring: FloatArray, cell_m: float) -> tuple[FloatArray, FloatArray]:
    """Places (n, 2) in their order along a ring, and their coordinates (n,) along it.

    Then along the curve of their means, which noise does not bend.

    It is the principal curve of Hastie and Stuetzle (1989), at the width of two cells.
    """
    for _ in range(_ROUNDS):
        along, length = _along_ring(places, ring)
        order = np.argsort(along, kind="stable")
        places, along = places[order], along[order]
        at = np.arange(0, length, cell_m / 2)
        every = np.concatenate([along - length, along, along + length])
        sums = np.concatenate([np.zeros((1, 2)), np.cumsum(np.tile(places, (3, 1)), axis=0)])
        low, high = (np.searchsorted(every, at + side * cell_m) for side in (-1, 1))
        is_some = high > low
        mean = (sums[high] - sums[low])[is_some] / (high - low)[is_some, None]
        if len(mean) < 4:
            break
        ring = mean
    along, _ = _along_ring(places, ring)
    order = np.argsort(along, kind="stable")
    return places[order], along[order]


def partition(
    curve: FloatArray, along: FloatArray, noise_m: float, cell_m: float
) -> tuple[Chain, list[SurfaceFit]]:
    """Return the lines and arcs of a closed curve of places (n, 2) in order, `along` (n,) it, metres.

    As a chain and its walls. These have no covariance yet, but of the parameters that are free: a fit finds
    these (`refitted`).
    """
    length = float(along[-1])
    n_bins = int(np.clip(length / max(_BIN_CELLS * cell_m, _BIN_NOISES * noise_m), 8, _MOST_BINS))
    bounds = np.searchsorted(along, np.linspace(0, length, n_bins + 1))
    bounds[-1] = len(curve)
    bins = _Bins(curve, np.unique(bounds), noise_m)
    cuts = [0]
    for _ in range(2):  # from anywhere; then from a corner of that
        begin = cuts[len(cuts) // 2]
        rolled = np.roll(bins.moments, -begin, axis=1)
        cuts = [(cut + begin) % bins.n for cut in _best_cuts(rolled, bins.noise)]
        if len(cuts) == 1:
            break
    return _chain_of(_simplified(sorted(cuts), bins), bins)


def _chain_of(spans: Sequence[_Span], bins: _Bins) -> tuple[Chain, list[SurfaceFit]]:
    """The closed chain of a curve's spans, and their walls."""
    surfaces = [bins.surface(*span) for span in spans]
    walls = [unfitted(surface) for surface in surfaces]
    if spans[0][1] - spans[0][0] == bins.n:
        return Chain.circle(0, surfaces[0]), walls
    ends = [[bins.middle(k) for k in (begin, (begin + end) // 2, end - 1)] for begin, end in spans]
    pieces, forward, corners = list[Piece](), list[bool](), list[FloatArray]()
    for k, surface in enumerate(surfaces):
        last, following = ends[k][-1], (k + 1) % len(spans)
        near, apart = (last + ends[following][0]) / 2, np.linalg.norm(last - ends[following][0])
        corner = corner_of(surface, surfaces[following], near)
        is_far = corner is None or np.linalg.norm(corner - near) > _FAR_CORNER * apart
        corners.append(near if is_far or corner is None else corner)
        begin, middle, end = along_wall(surface, np.array(ends[k])).tolist()
        if isinstance(surface, Cylinder):  # round by its middle
            to_middle, to_end = (middle - begin) % surface.period, (end - begin) % surface.period
            end = begin + to_end - (0.0 if to_middle <= to_end else surface.period)
        pieces.append(Piece(k, min(begin, end), max(begin, end)))
        forward.append(end > begin)
    return Chain(tuple(pieces), tuple(forward), tuple(corners), is_closed=True), walls


class _Bins:
    """Places (n, 2) in bins along a curve, with the sums (10, k) of what fits need, in units of its size."""

    def __init__(self, curve: FloatArray, bounds: IntArray, noise_m: float) -> None:
        self.centre = curve.mean(axis=0)
        self.scale = float(np.abs(curve - self.centre).max())
        self.unit, self.bounds = (curve - self.centre) / self.scale, bounds
        self.noise, self.n = noise_m / self.scale, len(bounds) - 1
        x, y = self.unit.T
        z = x * x + y * y
        powers = np.stack([np.ones_like(x), x, y, z, x * x, x * y, y * y, x * z, y * z, z * z])
        self.moments = np.add.reduceat(powers, bounds[:-1], axis=1)

    def sums(self, begin: int, end: int) -> FloatArray:
        """Sums (10, 1) of bins from `begin` up to `end`, round the curve."""
        return np.asarray(self.moments[:, np.arange(begin, end) % self.n].sum(axis=1, keepdims=True))

    def members(self, begin: int, end: int) -> FloatArray:
        """Their places (m, 2)."""
        spans = [self.unit[self.bounds[k] : self.bounds[k + 1]] for k in np.arange(begin, end) % self.n]
        return np.concatenate(spans)

    def middle(self, k: int) -> FloatArray:
        """Mean place (2,) of a bin, metres."""
        return np.asarray(self.centre + self.scale * self.members(k, k + 1).mean(axis=0))

    def cost(self, begin: int, end: int) -> float:
        """What they cost as what costs less, a line or an arc."""
        return float(_costs(self.sums(begin, end), self.noise).min())

    def surface(self, begin: int, end: int) -> Surface:
        """The line or circle that costs least, metres, of what is not beside its ends."""
        is_whole = end - begin == self.n
        if end - begin > 4 * _BESIDE and not is_whole:
            begin, end = begin + _BESIDE, end - _BESIDE
        sums = self.sums(begin, end)
        if is_whole or np.argmin(_costs(sums, self.noise)[:, 0]) == 1:
            centre, radius = _circle(sums)
            place = np.append(self.centre + self.scale * centre, 0.0)
            return Cylinder(place, (0, 0, 1), self.scale * radius, (1, 0, 0))
        return line_of(self.centre + self.scale * self.members(begin, end))


def _simplified(cuts: Sequence[int], bins: _Bins) -> list[_Span]:
    """Spans of bins between cuts, without cuts that say nothing: within one line or arc, or beside a corner.

    A bin over a corner has places on both sides, which fit neither; up to three spans of such bins are none
    if each place lies as near to one of the neighbours of them.
    """
    spans = list(zip(cuts, [*cuts[1:], cuts[0] + bins.n], strict=True))
    while (simpler := _without_one(spans, bins)) is not None:
        spans = simpler
    return [(begin % bins.n, begin % bins.n + end - begin) for begin, end in spans]


def _without_one(spans: Sequence[_Span], bins: _Bins) -> list[_Span] | None:
    """The spans with two of them joined or some left out, the shortest first; None where all are needed."""
    n = len(spans)
    for k in sorted(range(n), key=lambda k: spans[k][1] - spans[k][0]):
        ring = [*spans[k:], *spans[:k]]
        for length in range(1, min(_MOST_LEFT_OUT, n - 2) + 1):
            begin, size = ring[0][0], sum(end - start for start, end in ring[:length])
            before, after = ring[-1], ring[length]
            cost = sum(bins.cost(*span) for span in ring[:length])
            cut = _corner_within(before, (begin, begin + size), after, cost, bins)
            if cut is not None:
                kept = (before[0], before[1] + cut), (after[0] - size + cut, after[1])
                return [*kept, *ring[length + 1 : -1]]
        if n > 1:
            together = ring[0][0], ring[0][1] + ring[1][1] - ring[1][0]
            if bins.cost(*together) <= sum(bins.cost(*span) for span in ring[:2]):
                return [together, *ring[2:]]
    return None


def _corner_within(before: _Span, span: _Span, after: _Span, cost: float, bins: _Bins) -> int | None:
    """After how many bins of a span its neighbours meet, if these explain it at no more than its cost."""
    size = span[1] - span[0]
    if before is after or size > min(before[1] - before[0], after[1] - after[0]):
        return None
    flat = np.pad(bins.centre + bins.scale * bins.members(*span), ((0, 0), (0, 1)))
    noise_m = bins.noise * bins.scale
    square = np.square([bins.surface(*each).distance(flat) / noise_m for each in (before, after)])
    if square.min(axis=0).sum() > cost:
        return None
    number = np.repeat(np.arange(size), [len(bins.members(k, k + 1)) for k in range(*span)])
    gain = np.bincount(number, square[0] - square[1], minlength=size)
    return int(np.argmin(np.concatenate([[0.0], np.cumsum(gain)])))


def _best_cuts(moments: FloatArray, noise: float) -> list[int]:
    """First bins of the segments into which bins with sums (10, n) fall at the least cost."""
    n = moments.shape[1]
    sums = np.concatenate([np.zeros((len(moments), 1)), np.cumsum(moments, axis=1)], axis=1)
    least, before = np.full(n + 1, np.inf), np.zeros(n + 1, dtype=np.int64)
    least[0] = 0.0
    for end in range(_LEAST_BINS, n + 1):
        starts = slice(0, end - _LEAST_BINS + 1)
        inside = sums[:, end : end + 1] - sums[:, starts]
        cost = least[starts] + _costs(inside, noise).min(axis=0)
        before[end] = int(np.argmin(cost))
        least[end] = cost[before[end]]
    cuts, at = list[int](), n
    while at > 0:
        at = int(before[at])
        cuts.append(at)
    return cuts[::-1]


def _costs(sums: FloatArray, noise: float) -> FloatArray:
    """What points with sums (10, k) cost as lines and circles (2, k): squares over noise, parameters."""
    n, central = sums[0], _central(sums)
    _, _, xx, xy, yy, *_ = central
    line = (xx + yy) / 2 - np.sqrt(np.square((xx - yy) / 2) + np.square(xy))
    square = np.stack([line, _eigenvalue(central)]) / noise**2
    return np.asarray(n * square + np.outer(_PARAMETERS, limits.NATS * np.log(n)))


def _central(sums: FloatArray) -> tuple[FloatArray, ...]:
    """Means of x, y, and of xx, xy, yy, xz, yz, zz about these, with z = xx + yy."""
    _, p, q, z, xx, xy, yy, xz, yz, zz = sums / sums[0]
    xx, xy, yy, xz, yz, zz = xx - p * p, xy - p * q, yy - q * q, xz - p * z, yz - q * z, zz - z * z
    by = p * xx + q * xy, p * xy + q * yy
    about = zz - 4 * (p * xz + q * yz) + 4 * (p * by[0] + q * by[1]) + np.square(xx + yy)
    return p, q, xx, xy, yy, xz - 2 * by[0], yz - 2 * by[1], about


def _eigenvalue(central: Sequence[FloatArray]) -> FloatArray:
    """Taubin's least eigenvalue (k,), the mean square of distances from the circle, by Newton from 0."""
    _, _, xx, xy, yy, xz, yz, zz = central
    z, det = xx + yy, xx * yy - xy * xy
    spread = zz - z * z
    a3, a2 = 4 * z, -3 * z * z - zz
    a1 = spread * z + 4 * det * z - xz * xz - yz * yz
    a0 = xz * (xz * yy - yz * xy) + yz * (yz * xx - xz * xy) - spread * det
    root = np.zeros_like(z)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(_NEWTON):
            step = (a0 + root * (a1 + root * (a2 + root * a3))) / (a1 + root * (2 * a2 + 3 * root * a3))
            step = np.where(np.isfinite(step), step, 0.0)
            root = root - step
            if (np.abs(step) <= _STILL * z).all():
                break
    return np.asarray(np.maximum(root, 0.0))


def _circle(sums: FloatArray) -> tuple[FloatArray, float]:
    """Centre (2,) and radius of the circle about points with sums (10, 1)."""
    central = _central(sums)
    p, q, xx, xy, yy, xz, yz, _ = (float(value[0]) for value in central)
    root = float(_eigenvalue(central)[0])
    scatter = np.array([[xx - root, xy], [xy, yy - root]])
    away = np.linalg.solve(scatter, [xz, yz]) / 2
    return away + [p, q], float(np.sqrt(away @ away + xx + yy))
