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
from typing import NamedTuple

import numpy as np
import shapely
from scipy.spatial import cKDTree

from completion.fitting.result import SurfaceFit
from completion.parts.profiles import limits
from completion.parts.profiles.chain import Chain
from completion.parts.profiles.refit import unfitted
from completion.parts.profiles.segment import Piece, corner_of
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_MOST_PLACES = 12_000  # of a curve
_SECTORS = 8  # of the height or turn, half of which a place must have
_MOST_BINS, _LEAST_BINS = 1500, 5  # of a curve, of a segment
_WIDER, _THINNER = 1.5, 1.25  # cells: discs about places, and what is taken off the band that they make
_ROUNDS = 2
_BIN_CELLS, _BIN_NOISES = 1 / 3, 3.0  # width of a bin: at least so many cells, deviations of noise
_BESIDE = 2  # bins at the ends of a segment that may lie over a corner
_MOST_LEFT_OUT = 3  # spans beside a corner
_NEWTON = 12
_POWERS = (
    (0, 0),
    (1, 0),
    (0, 1),
    (2, 0),
    (1, 1),
    (0, 2),
    (3, 0),
    (2, 1),
    (1, 2),
    (0, 3),
    (4, 0),
    (2, 2),
    (0, 4),
)


class Part(NamedTuple):
    """A line or an arc of a curve, and its ends (2,) in the curve's order, and a place (2,) between."""

    surface: Surface
    start: FloatArray
    middle: FloatArray
    end: FloatArray
    is_whole: bool


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
    near = cKDTree(places).query_ball_point(middle, cell_m)
    n_there = np.array([len(np.unique(sector[some])) for some in near])
    expected = _SECTORS * (1 - (1 - 1 / _SECTORS) ** np.array([len(some) for some in near]))
    is_swept = n_there >= expected / 2
    band = (
        shapely.union_all(shapely.buffer(shapely.points(middle[is_swept]), _WIDER * cell_m))
        if is_swept.any()
        else None
    )
    for piece in shapely.get_parts(band) if band is not None else ():
        holes = [ring for ring in piece.interiors if shapely.Polygon(ring).area > (2 * cell_m) ** 2]
        if len(holes) != 1:
            continue
        own = is_swept[which] & shapely.contains_xy(piece, places)
        some = places[own]
        some = some[:: max(1, len(some) // _MOST_PLACES)]
        yield _ordered(some, _middle_line(piece, cell_m), cell_m)


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
    thin = max(
        shapely.get_parts(shapely.buffer(band, -_THINNER * cell_m)), key=lambda part: part.area, default=band
    )
    is_ring = sum(shapely.Polygon(ring).area > (2 * cell_m) ** 2 for ring in thin.interiors) == 1
    ring = shapely.segmentize((thin if is_ring else band).exterior, cell_m)
    return shapely.get_coordinates(ring)[:-1]


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


def partition(curve: FloatArray, along: FloatArray, noise_m: float, cell_m: float) -> list[Part]:
    """Lines and arcs of a closed curve of places (n, 2) in order, `along` (n,) it, metres."""
    length = float(along[-1])
    n_bins = int(np.clip(length / max(_BIN_CELLS * cell_m, _BIN_NOISES * noise_m), 8, _MOST_BINS))
    bounds = np.searchsorted(along, np.linspace(0, length, n_bins + 1))
    bounds[-1] = len(curve)
    bounds = np.unique(bounds)
    n_bins = len(bounds) - 1
    centre, scale = curve.mean(axis=0), float(np.abs(curve - curve.mean(axis=0)).max())
    bins = _Bins((curve - centre) / scale, bounds, noise_m / scale)
    cuts = [0]
    for _ in range(2):  # from anywhere; then from a corner of that
        begin = cuts[len(cuts) // 2]
        cuts = [
            (cut + begin) % n_bins for cut in _best_cuts(np.roll(bins.moments, -begin, axis=1), bins.noise)
        ]
        if len(cuts) == 1:
            break
    return [bins.part(*span, centre, scale) for span in _simplified(sorted(cuts), bins)]


class _Bins:
    """Places (n, 2) in bins along a curve, with the sums (13, k) of their powers, in units of its size."""

    def __init__(self, unit: FloatArray, bounds: IntArray, noise: float) -> None:
        self.unit, self.bounds, self.noise, self.n = unit, bounds, noise, len(bounds) - 1
        x, y = unit.T
        self.moments = np.stack([np.add.reduceat(x**i * y**j, bounds[:-1]) for i, j in _POWERS])

    def sums(self, begin: int, end: int) -> FloatArray:
        """Sums (13, 1) of bins from `begin` up to `end`, round the curve."""
        return np.asarray(self.moments[:, np.arange(begin, end) % self.n].sum(axis=1, keepdims=True))

    def members(self, begin: int, end: int) -> FloatArray:
        """Their places (m, 2)."""
        return np.concatenate(
            [self.unit[self.bounds[k] : self.bounds[k + 1]] for k in np.arange(begin, end) % self.n]
        )

    def costs(self, begin: int, end: int) -> tuple[float, float]:
        """What they cost as a line and as an arc."""
        sums = self.sums(begin, end)
        return float(_line_cost(sums, self.noise)[0]), float(_arc_cost(sums, self.noise)[0])

    def surface(self, begin: int, end: int, *, is_whole: bool = False) -> Surface:
        """The line or circle that costs least, of what is not beside its ends, where that is enough."""
        if end - begin > 4 * _BESIDE and not is_whole:
            begin, end = begin + _BESIDE, end - _BESIDE
        line, arc = self.costs(begin, end)
        if arc < line or is_whole:
            return _circle(self.sums(begin, end))
        return _straight(self.members(begin, end))

    def part(self, begin: int, end: int, centre: FloatArray, scale: float) -> Part:
        """The part of the curve that they are, in its own place and size."""
        is_whole = end - begin == self.n
        surface = self.surface(begin, end, is_whole=is_whole)
        point = np.append(centre, 0.0) + scale * surface.point  # type: ignore[attr-defined]
        if isinstance(surface, Cylinder):
            surface = Cylinder(point, surface.direction, scale * surface.radius, surface.zero_direction)
        elif isinstance(surface, Plane):
            surface = Plane(point, surface.normal_direction, surface.u_direction)
        ends = [self.members(k, k + 1).mean(axis=0) for k in (begin, (begin + end) // 2, end - 1)]
        return Part(surface, *(centre + scale * place for place in ends), is_whole)


def _simplified(cuts: Sequence[int], bins: _Bins) -> list[tuple[int, int]]:
    """Spans of bins between cuts, without cuts that say nothing: within one line or arc, or beside a corner.

    A bin over a corner has places on both sides, which fit neither; up to three spans of such bins are none
    if each place lies as near to one of the neighbours of them.
    """
    spans = list(zip(cuts, [*cuts[1:], cuts[0] + bins.n], strict=True))
    while (simpler := _without_one(spans, bins)) is not None:
        spans = simpler
    return [(begin % bins.n, begin % bins.n + end - begin) for begin, end in spans]


def _without_one(spans: Sequence[tuple[int, int]], bins: _Bins) -> list[tuple[int, int]] | None:
    """The spans with two of them joined or some left out, the shortest first; None where all are needed."""
    n = len(spans)
    for k in sorted(range(n), key=lambda k: spans[k][1] - spans[k][0]):
        ring = [spans[(k + step) % n] for step in range(n)]  # from the span on
        for length in range(1, min(_MOST_LEFT_OUT, n - 2) + 1):
            begin, size = ring[0][0], sum(end - start for start, end in ring[:length])
            cost = sum(min(bins.costs(*span)) for span in ring[:length])
            before, after = ring[-1], ring[length]
            cut = _corner_within(before, (begin, begin + size), after, cost, bins)
            if cut is not None:
                between = ring[length + 1 : -1] if length + 1 < n else []
                return [(before[0], before[1] + cut), (after[0] - size + cut, after[1]), *between]
        if n > 1:
            together = ring[0][0], ring[0][1] + ring[1][1] - ring[1][0]
            if min(bins.costs(*together)) <= sum(min(bins.costs(*span)) for span in ring[:2]):
                return [together, *ring[2:]]
    return None


def _corner_within(
    before: tuple[int, int], span: tuple[int, int], after: tuple[int, int], cost: float, bins: _Bins
) -> int | None:
    """After how many bins of a span its neighbours meet, if these explain it at no more than its cost."""
    size = span[1] - span[0]
    if before is after or size > min(before[1] - before[0], after[1] - after[0]):
        return None
    members = bins.members(*span)
    flat = np.column_stack([members, np.zeros(len(members))])
    square = np.stack([np.square(bins.surface(*each).distance(flat)) for each in (before, after)])
    square = square / bins.noise**2
    if square.min(axis=0).sum() > cost:
        return None
    number = np.repeat(np.arange(size), [len(bins.members(k, k + 1)) for k in range(*span)])
    gain = np.bincount(number, square[0] - square[1], minlength=size)
    return int(np.argmin(np.concatenate([[0.0], np.cumsum(gain)])))


def _best_cuts(moments: FloatArray, noise: float) -> list[int]:
    """First bins of the segments into which bins with moments (13, n) fall at the least cost."""
    n = moments.shape[1]
    sums = np.concatenate([np.zeros((len(moments), 1)), np.cumsum(moments, axis=1)], axis=1)
    least, before = np.full(n + 1, np.inf), np.zeros(n + 1, dtype=np.int64)
    least[0] = 0.0
    for end in range(_LEAST_BINS, n + 1):
        inside = sums[:, end : end + 1] - sums[:, : end - _LEAST_BINS + 1]
        cost = least[: end - _LEAST_BINS + 1] + np.minimum(
            _line_cost(inside, noise), _arc_cost(inside, noise)
        )
        before[end] = int(np.argmin(cost))
        least[end] = cost[before[end]]
    cuts, at = list[int](), n
    while at > 0:
        at = int(before[at])
        cuts.append(at)
    return cuts[::-1]


def _line_cost(sums: FloatArray, noise: float) -> FloatArray:
    """Squares over those of noise of points with sums (13, k) of powers about lines; and parameters."""
    n, x, y, xx, xy, yy = sums[:6]
    a, b, c = xx - x * x / n, xy - x * y / n, yy - y * y / n
    rest = (a + c) / 2 - np.sqrt(np.square((a - c) / 2) + np.square(b))
    return np.asarray(rest / noise**2 + 3 * limits.NATS * np.log(n))


def _central(sums: FloatArray) -> tuple[FloatArray, ...]:
    """Means of x, y, and of the centred xx, xy, yy, xz, yz, zz with z = xx + yy."""
    mean = sums / sums[0]
    _, p, q, xx, xy, yy, xxx, xxy, xyy, yyy, x4, x2y2, y4 = mean
    cxx, cxy, cyy = xx - p * p, xy - p * q, yy - q * q
    c30 = xxx - 3 * p * xx + 2 * p**3
    c03 = yyy - 3 * q * yy + 2 * q**3
    c21 = xxy - 2 * p * xy - q * xx + 2 * p * p * q
    c12 = xyy - 2 * q * xy - p * yy + 2 * p * q * q
    c40 = x4 - 4 * p * xxx + 6 * p * p * xx - 3 * p**4
    c04 = y4 - 4 * q * yyy + 6 * q * q * yy - 3 * q**4
    c22 = x2y2 - 2 * q * xxy - 2 * p * xyy + q * q * xx + p * p * yy + 4 * p * q * xy - 3 * p * p * q * q
    return p, q, cxx, cxy, cyy, c30 + c12, c21 + c03, c40 + 2 * c22 + c04


def _eigenvalue(
    xx: FloatArray, xy: FloatArray, yy: FloatArray, xz: FloatArray, yz: FloatArray, zz: FloatArray
) -> FloatArray:
    """Taubin's least eigenvalue, the mean square of distances from the circle, by Newton from 0."""
    z, det = xx + yy, xx * yy - xy * xy
    spread = zz - z * z
    a3, a2 = 4 * z, -3 * z * z - zz
    a1 = spread * z + 4 * det * z - xz * xz - yz * yz
    a0 = xz * (xz * yy - yz * xy) + yz * (yz * xx - xz * xy) - spread * det
    root = np.zeros_like(z)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(_NEWTON):
            step = (a0 + root * (a1 + root * (a2 + root * a3))) / (a1 + root * (2 * a2 + 3 * root * a3))
            root = np.where(np.isfinite(step), root - step, root)
    return np.asarray(np.maximum(root, 0.0))


def _arc_cost(sums: FloatArray, noise: float) -> FloatArray:
    """The same about circles."""
    n = sums[0]
    return np.asarray(n * _eigenvalue(*_central(sums)[2:]) / noise**2 + 4 * limits.NATS * np.log(n))


def _circle(sums: FloatArray) -> Cylinder:
    p, q, xx, xy, yy, xz, yz, zz = (float(value[0]) for value in _central(sums))
    root = float(_eigenvalue(*(np.array([value]) for value in (xx, xy, yy, xz, yz, zz)))[0])
    det = root * root - root * (xx + yy) + xx * yy - xy * xy
    a, b = (xz * (yy - root) - yz * xy) / det / 2, (yz * (xx - root) - xz * xy) / det / 2
    radius = float(np.sqrt(a * a + b * b + xx + yy))
    return Cylinder((p + a, q + b, 0), (0, 0, 1), radius, (1, 0, 0))


def _straight(members: FloatArray) -> Plane:
    middle = members.mean(axis=0)
    away = members - middle
    x, y = np.linalg.eigh(away.T @ away)[1][:, 0]
    return Plane(np.append(middle, 0.0), (x, y, 0), (-y, x, 0))


def chain_of(parts: Sequence[Part]) -> tuple[Chain, list[SurfaceFit]]:
    """The closed chain of a curve's parts, and their walls.

    The walls have no covariance yet, but of the parameters that are free: a fit finds these (`refitted`).
    """
    walls = [unfitted(part.surface) for part in parts]
    if parts[0].is_whole:
        return Chain((Piece(0, 0.0, parts[0].surface.period, True),), (True,), (), True), walls
    pieces, forward, corners = list[Piece](), list[bool](), list[FloatArray]()
    for k, (part, following) in enumerate(zip(parts, [*parts[1:], parts[0]], strict=True)):
        near = (part.end + following.start) / 2
        corner = corner_of(part.surface, following.surface, near)
        is_far = corner is None or np.linalg.norm(corner - near) > 3 * np.linalg.norm(
            part.end - following.start
        )
        corners.append(near if is_far or corner is None else corner)
        begin, end = _unrolled(part)
        pieces.append(Piece(k, min(begin, end), max(begin, end)))
        forward.append(end > begin)
    return Chain(tuple(pieces), tuple(forward), tuple(corners), True), walls


def _unrolled(part: Part) -> tuple[float, float]:
    """Coordinates along a part's surface of its start and end, with its middle between."""
    flat = np.column_stack([[part.start, part.middle, part.end], np.zeros(3)])
    begin, middle, end = part.surface.to_uv(flat)[:, 0].tolist()
    period = part.surface.period
    if not np.isfinite(period):
        return begin, end
    to_middle, to_end = (middle - begin) % period, (end - begin) % period
    if to_middle <= to_end:
        return begin, begin + to_end
    return begin, begin - (begin - end) % period
