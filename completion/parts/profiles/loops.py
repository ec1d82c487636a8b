# SPDX-License-Identifier: MIT
"""Loops of a sweep: chains of walls between the caps of an extrusion, or over the axis of a revolution."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely

from completion.parts.profiles import limits
from completion.parts.profiles.chain import Chain, chains_of
from completion.parts.profiles.profile import Loop, LoopKind
from completion.parts.profiles.segment import Segment, pieces_of
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane, Surface

_OVER = 0.5  # of a loop's area that lies in another, from which it counts as within


class Level(NamedTuple):
    """A height of an extrusion at which something ends, and its standard deviation; NaN without a plane."""

    height_m: float
    sd_m: float


class Stretch(NamedTuple):
    """A chain and the levels, from 0, between which it is swept."""

    chain: Chain
    low: int
    high: int


def levels_of(caps: Sequence[tuple[float, float]], heights: FloatArray, least_m: float) -> list[Level]:
    """Levels, at least so far apart, by caps' heights and deviations, and by heights (n,) of points."""
    ends = [(float(heights.min()), np.nan), (float(heights.max()), np.nan)] if len(heights) else []
    levels: list[Level] = []
    for height, sd in sorted([*caps, *ends]):
        near = levels and height - levels[-1].height_m <= least_m
        if not near:
            levels.append(Level(height, sd))
        elif not np.isfinite(levels[-1].sd_m) or sd < levels[-1].sd_m:
            levels[-1] = Level(height, sd)
    return levels


def stretches_of(
    surfaces: Sequence[Surface],
    places: Sequence[FloatArray],
    levels: Sequence[Level],
    *,
    spacing_m: float,
    noise_m: float,
) -> list[Stretch]:
    """Chains between each level and the next, those that go on as one.

    `places` (n, 3) are those of each wall's points in the profile.
    """
    found: list[Stretch] = []
    for number, (low, high) in enumerate(pairwise(levels)):
        thick = high.height_m - low.height_m
        margin = min(spacing_m, 0.2 * thick)
        pieces = []
        for wall, (surface, points) in enumerate(zip(surfaces, places, strict=True)):
            inside = points[np.abs(points[:, 2] - (low.height_m + high.height_m) / 2) < thick / 2 - margin]
            if len(inside) and np.ptp(inside[:, 2]) >= limits.LEAST_HEIGHT_SHARE * (thick - 2 * margin):
                pieces += pieces_of(surface, wall, inside[:, :2], limits.GAP * spacing_m)
        for chain in chains_of(pieces, surfaces, spacing_m, noise_m):
            found.append(
                joined(
                    found,
                    chain,
                    number,
                    surfaces,
                    limits.SAME_NOISES * noise_m + limits.SAME_SPACINGS * spacing_m,
                )
            )
    return found


def joined(
    found: list[Stretch], chain: Chain, number: int, surfaces: Sequence[Surface], off_m: float
) -> Stretch:
    """The chain between a level and the next, with the one below that is as near to it, taken off the list.

    Nearer than `off_m`, metres, in the mean along both; of two the one of fewer pieces stays.
    """
    two = _polygon(chain.trace(surfaces)) if chain.is_closed and not chain.on_axis else shapely.Polygon()
    for k, before in enumerate(found):
        if before.high == number and before.chain.is_closed and two.area > 0:
            one = _polygon(before.chain.trace(surfaces))
            if one.symmetric_difference(two).area <= off_m * two.length:
                del found[k]
                simpler = min(before.chain, chain, key=lambda each: len(each.pieces))
                return Stretch(simpler, before.low, number + 1)
    return Stretch(chain, number, number + 1)


def _polygon(segments: Sequence[Segment]) -> shapely.Polygon:
    polygon = Loop(tuple(segments), "outer").polygon
    return polygon if polygon.is_valid else polygon.buffer(0)


def loops_of(
    traced: Sequence[tuple[Stretch, tuple[Segment, ...]]],
    levels: Sequence[Level],
    surfaces: Sequence[Surface],
) -> tuple[Loop, ...]:
    """Return loops with their kinds, by what lies within what between the same levels; the largest first."""
    polygons = [
        _polygon(segments) if stretch.chain.is_closed else shapely.Polygon() for stretch, segments in traced
    ]
    depths = [_depth(k, traced, polygons) for k in range(len(traced))]
    depths = [
        depth
        + int(
            depth % 2 == 0
            and segments[0].is_whole
            and bool(getattr(surfaces[segments[0].wall], "concave", False))
        )
        for depth, (_, segments) in zip(depths, traced, strict=True)
    ]  # a bore is one whatever is around it
    loops = []
    for k, (stretch, segments) in enumerate(traced):
        is_solid = depths[k] % 2 == 0
        kind: LoopKind = "open"
        through = False
        if stretch.chain.is_closed:
            kind = _solid_kind(k, polygons, depths) if is_solid else _hollow_kind(segments, surfaces)
            ccw = shapely.is_ccw(polygons[k].exterior)
            segments = segments if ccw == is_solid else tuple(one.reverse() for one in segments[::-1])
            through = not is_solid and not any(
                _is_solid_at(polygons[k], level, traced, polygons, depths)
                for level in (stretch.low - 1, stretch.high)
            )
        low, high = levels[stretch.low], levels[stretch.high]
        loops.append(Loop(segments, kind, low.height_m, high.height_m, (low.sd_m, high.sd_m), through))
    order = sorted(range(len(loops)), key=lambda k: (not loops[k].is_closed, -polygons[k].area, k))
    return tuple(loops[k] for k in order)


def _depth(
    k: int, traced: Sequence[tuple[Stretch, tuple[Segment, ...]]], polygons: Sequence[shapely.Polygon]
) -> int:
    """Within how many others a loop lies between the levels that it is swept, at most of these."""
    own = traced[k][0]
    around = [j for j in range(len(traced)) if j != k and _is_within(polygons[k], polygons[j])]
    counts = [
        sum(traced[j][0].low <= level < traced[j][0].high for j in around)
        for level in range(own.low, own.high)
    ]
    return int(np.median(counts))


def _is_within(inner: shapely.Polygon, outer: shapely.Polygon) -> bool:
    return bool(outer.area > inner.area > 0 and inner.intersection(outer).area > _OVER * inner.area)


def _is_solid_at(
    polygon: shapely.Polygon,
    level: int,
    traced: Sequence[tuple[Stretch, tuple[Segment, ...]]],
    polygons: Sequence[shapely.Polygon],
    depths: Sequence[int],
) -> bool:
    """Whether there is material over most of a polygon between a level and the next."""
    left = shapely.Polygon()
    for k in np.argsort(depths, kind="stable"):
        stretch = traced[k][0]
        if stretch.low <= level < stretch.high and polygons[k].area > 0:
            left = left.difference(polygons[k]) if depths[k] % 2 else left.union(polygons[k])
    return bool(polygon.intersection(left).area > _OVER * polygon.area)


def _solid_kind(k: int, polygons: Sequence[shapely.Polygon], depths: Sequence[int]) -> LoopKind:
    """A section within a larger one at other heights is a boss, or a rib."""
    larger = [
        other
        for j, other in enumerate(polygons)
        if j != k and depths[j] % 2 == 0 and other.area > 1.02 * polygons[k].area
    ]
    if not any(polygons[k].intersection(other).area > 0.98 * polygons[k].area for other in larger):
        return "outer"
    box = np.array(shapely.oriented_envelope(polygons[k]).exterior.coords)
    sides = sorted(np.linalg.norm(np.diff(box[:3], axis=0), axis=1))
    return "rib" if sides[1] >= limits.RIB * sides[0] else "boss"


def _hollow_kind(segments: Sequence[Segment], surfaces: Sequence[Surface]) -> LoopKind:
    """What is cut out: round, a slot, or anything else."""
    if len(segments) == 1:
        return "hole"
    lines = [surfaces[one.wall].normal_direction for one in segments if isinstance(surfaces[one.wall], Plane)]  # type: ignore[attr-defined]
    if (
        len(segments) == 4
        and len(lines) == 2
        and isinstance(surfaces[segments[0].wall], Plane) == isinstance(surfaces[segments[2].wall], Plane)
    ):
        return "slot" if abs(float(lines[0] @ lines[1])) > np.cos(limits.SMOOTH) else "pocket"
    return "pocket"
