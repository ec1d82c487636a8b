# SPDX-License-Identifier: MIT
"""Confidence: the probability that a surface is where it was hidden, or where nothing came back.

Past the end: a pipe or a column vanishes behind something that stands clear before it. A limb, an arm of a
chair or a stem stops where it meets the next part: there the neighbouring beams went past it, or lie on it
still.

Silence: nothing comes back from where the projector does not light, from what is dark, clear or polished, and
from where nothing is: a window pane is a hole without return in a wall. What surrounds such a hole, how wide
it is, and what the surface is like tell which of them it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.boundary.hidden_regions import HiddenRegions, Labelling
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Label
from completion.extension.extent import Extent
from completion.extension.limits import (
    ENCLOSED,
    EXACT_RADIUS,
    MOSTLY,
    NEAREST,
    PROBABLE,
    RAGGED_SHARE,
    UPRIGHT_SINE,
    WELL_SEEN_SHARE,
)
from completion.extension.room_surfaces import known_of_room, room_probability
from completion.room.roles import NO_ROOM, Room
from scenes.checks import BoolArray, FloatArray, IntArray, read_only_view
from scenes.surfaces.catalogue import Cylinder, Plane
from texture.engine.compiled import compiled

KNOWN = (
    "log of the distance past the rectangle, in units of its side",
    "log of that distance in metres",
    "share of its outline where beams passed",
    "encloses the room",
    "level, and does not enclose",
    "level, and encloses",
    "share of that side along which beams passed",
    "share of that side that is hidden",
    "encloses, and another plane closes that side",
    "stands on what closes that side",
    "improbability by its edges, where its outline was seen to end",
)
"""What the probability depends on, in the order of `WEIGHTS`."""

WEIGHTS: FloatArray = np.array([
    -1.51, -0.24, -0.29, -0.46, 0.68, -0.63, 0.25, -0.13, 0.64, 0.28, 0.68, -0.99,
])  # fmt: skip
"""Constant, and weight of each of `KNOWN`, in the logarithm of the odds (Cox 1958).

The most likely ones on the generated rooms with seeds 1000 to 1015, the furnished flats with seeds 0 to 19
and the frames of a walk through a furnished storey, rounded (`python -m benchmarks run confidence`).
"""

_HALVINGS = 40  # of an interval of 40 in the logarithm
_LEAST_SIZE = 1e-9  # of a measured rectangle, metres


@dataclass(frozen=True, slots=True, eq=False)
class RectangleSides:
    """What was seen along the four sides of a rectangle, each (2, 2): low and high (rows) along u and v."""

    passed: FloatArray  # share of the lines across it beyond whose outermost measured cell beams passed
    hidden: FloatArray  # share of those beyond whose outermost cell it was hidden
    passed_outline: float  # share of the whole outline where beams passed

    @classmethod
    def of(cls, grid: ChartGrid, evidence: Evidence, extent: Extent) -> RectangleSides:
        """Look at the cells next to what was measured of a plane."""
        passed, hidden = np.zeros((2, 2)), np.zeros((2, 2))
        occluded = evidence.labels == Label.OCCLUDED
        for axis, centres in enumerate(grid.axes()):
            measured, open_, behind = (
                cells if axis == 0 else cells.T for cells in (evidence.observed, evidence.open, occluded)
            )
            lines = np.flatnonzero(measured.any(axis=1))
            slack = RAGGED_SHARE * (extent.own_high - extent.own_low)[axis] + 2 * float(grid.cell.max())
            last = measured.shape[1] - 1
            for row, side in enumerate((extent.own_low, extent.own_high)):
                if row == 0:
                    beside = measured[lines].argmax(axis=1) - 1
                else:
                    beside = last + 1 - measured[lines][:, ::-1].argmax(axis=1)
                at = np.clip(beside, 0, last)
                counts = (beside == at) & (np.abs(centres[at] - side[axis]) <= slack)
                n_lines = max(len(lines), 1)
                free = open_[lines, at]
                passed[row, axis] = np.count_nonzero(counts & free) / n_lines
                hidden[row, axis] = np.count_nonzero(counts & ~free & behind[lines, at]) / n_lines
        return cls(passed, hidden, share_seen_to_end(evidence))


def share_seen_to_end(evidence: Evidence) -> float:
    """Share of the cells around what was measured that beams passed: how much of the outline is known."""
    outline = ndimage.binary_dilation(evidence.observed, np.ones((3, 3))) & ~evidence.observed
    return float(np.count_nonzero(evidence.open & outline)) / max(int(np.count_nonzero(outline)), 1)


def known_beyond(
    uv: FloatArray, base: FloatArray, extent: Extent, sides: RectangleSides
) -> tuple[FloatArray, NDArray[np.int8]]:
    """Return `KNOWN` (n, 11) for places (n, 2) in a plane's chart, and the side that each is past.

    Of several sides it is the one that it is farthest past, in units of the rectangle's; `base` (n,) is the
    probability by the surface's edges. The side (n,) is 0 and 1 for low and high u, 2 and 3 for v, -1 for
    places within the rectangle.
    """
    outline_extent = np.array([extent.own_low, extent.own_high])
    side, past, past_m = _farthest_past(uv, outline_extent)
    row, axis = side % 2, side // 2
    well_seen = min(sides.passed_outline / WELL_SEEN_SHARE, 1.0)
    closed = np.isfinite(extent.ends)[row, axis]
    n, encloses, level = len(uv), float(extent.encloses), float(extent.is_level)
    goes_on = extent.end_probability[row, axis]
    return np.column_stack([
        np.log(past + NEAREST),
        np.log(past_m + NEAREST),
        np.full(n, sides.passed_outline),
        np.full(n, encloses),
        np.full(n, level * (1 - encloses)),
        np.full(n, level * encloses),
        sides.passed[row, axis],
        sides.hidden[row, axis],
        encloses * closed,
        (1 - encloses) * goes_on,
        (1 - base) * well_seen,
    ]), side  # fmt: skip


def as_far_as_probable(extent: Extent, least: float, weights: FloatArray = WEIGHTS) -> Extent:
    """Return the extent of a plane that ends where its probability surely falls below `least`.

    The bound holds whatever will be seen: what is not known yet has its most favourable value. There is none
    where the odds do not fall with the distance. `weights` (12,) are those of `WEIGHTS`.
    """
    if not isinstance(extent.chart, Plane) or (weights[1:3] > 0).any() or not (weights[1:3] < 0).any():
        return extent
    size = np.maximum(extent.own_high - extent.own_low, _LEAST_SIZE)
    closed, encloses, level = np.isfinite(extent.ends), float(extent.encloses), float(extent.is_level)
    known = np.zeros((2, 2, len(KNOWN)))
    known[..., [2, 6, 7, 10]] = weights[1:][[2, 6, 7, 10]] > 0
    known[..., 3], known[..., 4], known[..., 5] = encloses, level * (1 - encloses), level * encloses
    known[..., 8], known[..., 9] = encloses * closed, (1 - encloses) * extent.end_probability
    odds = weights[0] + known @ weights[1:] - np.log(least / (1 - least))

    # A place that is farthest past one side, in units of the rectangle's, may be past the one beside it too.
    beside = _farthest(odds.max(axis=0)[::-1], size.max(), weights)
    past = size * np.maximum(_farthest(odds, size, weights), beside)
    return replace(extent, reach=np.stack([extent.own_low - past[0], extent.own_high + past[1]]))


def _farthest(odds: FloatArray, size: FloatArray, weights: FloatArray) -> FloatArray:
    """How far past its side, in units of `size`, a place may be until its log odds fall to 0."""
    low, high = np.full(odds.shape, -20.0), np.full(odds.shape, 20.0)  # logarithms of the distance
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        past = np.exp(middle)
        left = odds + np.log(np.stack([past, past * size], axis=-1) + NEAREST) @ weights[1:3]
        low, high = np.where(left > 0, middle, low), np.where(left > 0, high, middle)
    return np.asarray(np.exp(high))


def probability_beyond(known: FloatArray, weights: FloatArray = WEIGHTS) -> FloatArray:
    """Probability (n,) that the surface is there, from `KNOWN` (n, 11)."""
    return np.asarray(1 / (1 + np.exp(-(weights[0] + known @ weights[1:]))), dtype=np.float64)


@compiled
def _farthest_past(
    uv: FloatArray, outline_extent: FloatArray
) -> tuple[NDArray[np.int8], FloatArray, FloatArray]:
    """The side (n,) of the rectangle `outline_extent` (2, 2) that places (n, 2) are farthest past; how far.

    Distances (n,) are in units of the rectangle's side, and in metres; of the latter the largest counts.
    """
    n = len(uv)
    side, past, past_m = np.full(n, -1, np.int8), np.zeros(n), np.zeros(n)
    for i in range(n):
        for axis in range(2):
            size = max(outline_extent[1, axis] - outline_extent[0, axis], _LEAST_SIZE)
            for row in range(2):
                away = (
                    outline_extent[0, axis] - uv[i, axis]
                    if row == 0
                    else uv[i, axis] - outline_extent[1, axis]
                )
                if away > 0.0:
                    past_m[i] = max(past_m[i], away)
                    if side[i] < 0 or away / size > past[i]:
                        side[i], past[i] = 2 * axis + row, away / size
    return side, past, past_m


KNOWN_PAST_END = (
    "log of the distance past the end, in units of the measured length",
    "log of the sine between its axis and the nearest normal of a plane that closes it",
    "log of the radius' standard deviation, in units of the radius",
    "share of that end's boundary where the cylinder was seen to end",
)
"""What the probability depends on, in the order of `PAST_END`."""

PAST_END: FloatArray = np.array([-0.07, -0.31, -0.25, -0.29, -3.10])
"""Constant, and weight of each of `KNOWN_PAST_END`, in the logarithm of the odds (Cox 1958).

The most likely ones on the same rooms, flats and frames as `WEIGHTS`, rounded.
"""


@dataclass(frozen=True, slots=True, eq=False)
class PastEnds:
    """What n places on a cylinder have to do with its ends."""

    side: NDArray[np.int8]  # (n,) 0 past the low end, 1 past the high one, -1 between them
    known: FloatArray  # (n, 4) `KNOWN_PAST_END`

    @classmethod
    def of(cls, along: FloatArray, extent: Extent) -> PastEnds:
        """Look at places by their chart coordinate `along` (n,) the axis, metres."""
        low, high = extent.own_low[1], extent.own_high[1]
        side = np.where(along < low, 0, np.where(along > high, 1, -1)).astype(np.int8)
        past = np.maximum(np.maximum(low - along, along - high), 0.0) / max(high - low, _LEAST_SIZE)
        n = len(along)
        known = np.column_stack([
            np.log(past + NEAREST),
            np.full(n, np.log(min(extent.tilt, 1.0) + UPRIGHT_SINE)),
            np.full(n, np.log(extent.radius_sd + EXACT_RADIUS)),
            extent.seen_ends[np.maximum(side, 0)],
        ])  # fmt: skip
        return cls(side, known)


def probability_past_end(known: FloatArray, weights: FloatArray = PAST_END) -> FloatArray:
    """Probability (n,) that the cylinder goes on to there, from `KNOWN_PAST_END` (n, 4)."""
    return np.asarray(1 / (1 + np.exp(-(weights[0] + known @ weights[1:]))), dtype=np.float64)


_STEP = 1.5  # from one width that is told apart to the next
_LEAST_M = 1e-6
_ALL_AROUND = np.ones((3, 3))


TRUST: FloatArray = np.array([
    [[0.97, 0.2], [0.88, 0.8]],
    [[0.975, 0.45], [0.975, 0.09]],
])  # fmt: skip
"""Probability p that narrow silent cells are surface, and half width w: it is p exp(-(x / w)^2) at width x.

By what brought nothing back, unknown or a shadow of the projector, and by walls, in metres, and other
surfaces, in units of the root of their measured area. The most likely ones on the desks with seeds 1000 to
1047, rounded (`python -m benchmarks run silence --fit`), but for wide holes in walls: whether they are
screens or panes depends on the house, so that they fall off in half the width that is likeliest there.
"""


@dataclass(frozen=True, slots=True, eq=False)
class SilentPart:
    """Connected cells without return, about as wide everywhere."""

    cells: NDArray[np.int64]  # (n,) flat
    half_width_m: float  # radius of the discs that cover it
    enclosed: float  # share of its rim that is measured or inferred surface


def silent_cells(evidence: Evidence, hidden: BoolArray) -> BoolArray:
    """Those of the hidden cells (rows, columns) from which nothing came back."""
    return np.asarray(hidden & np.isin(evidence.labels, (Label.NO_RETURN, Label.UNLIT)), dtype=np.bool_)


def trust(
    grid: ChartGrid,
    evidence: Evidence,
    hidden: BoolArray,
    filled: BoolArray,
    *,
    within: BoolArray,
    is_wall: bool,
) -> FloatArray:
    """Probability (rows, columns) that what brought nothing back is surface, if it goes on there; else 1.

    All (rows, columns): `hidden` cells are where the surface may be, `filled` where it is inferred for other
    reasons, and those not `within` lie beyond what it ends at. Silent cells count where surface is all
    around, to `ENCLOSED`, shadows on walls to `MOSTLY`; what is trusted counts as surface for narrower ones.
    """
    result = np.ones(grid.shape)
    for part, probability in judged_parts(grid, evidence, hidden, filled, within=within, is_wall=is_wall):
        result.ravel()[part.cells] = probability
    return result


def judged_parts(
    grid: ChartGrid,
    evidence: Evidence,
    hidden: BoolArray,
    filled: BoolArray,
    *,
    within: BoolArray,
    is_wall: bool,
) -> Iterator[tuple[SilentPart, float]]:
    """Yield a surface's silent parts and how probably they are surface; (rows, columns) as for `trust`."""
    solid, cell = evidence.observed | filled, float(grid.cell.max())
    unit = 1.0 if is_wall else float(np.sqrt(np.count_nonzero(evidence.observed) * grid.cell_area))
    for why, needed in ((Label.UNLIT, MOSTLY if is_wall else ENCLOSED), (Label.NO_RETURN, ENCLOSED)):
        start, length = TRUST[int(why == Label.UNLIT), int(not is_wall)]
        for part in silent_parts(hidden & (evidence.labels == why), solid, within, cell, wraps=grid.wraps):
            width = part.half_width_m / max(length * unit, _LEAST_M)
            probability = float(start * np.exp(-(width**2))) if part.enclosed >= needed else 0.0
            solid.ravel()[part.cells] = probability >= PROBABLE
            yield part, probability


def silent_parts(
    silent: BoolArray, solid: BoolArray, within: BoolArray, cell_m: float, *, wraps: bool
) -> Iterator[SilentPart]:
    """Part silent cells by how wide they are there, and look at each part's rim, the widest first.

    Cells (rows, columns) that are `solid` are measured or inferred; parts that the caller adds to them count
    for narrower ones. Those that are not `within` lie beyond what the surface ends at, and say nothing; nor
    do silent cells of narrower parts.
    """
    columns, box = silent.shape[1], _box_around(silent)
    if box is None:
        return
    silent, solid, within = silent[box], solid[box], within[box]
    level = half_widths(silent)
    for step_level in sorted(set(level[silent].tolist()), reverse=True):
        number, n_parts = ndimage.label(level == step_level, _ALL_AROUND)
        row, column = map(np.ascontiguousarray, np.nonzero(number))
        members = number[row, column]
        good, bad = np.zeros(n_parts + 1), _at_border(number, n_parts, wraps)
        now, inside = (read_only_view(np.ascontiguousarray(cells)) for cells in (solid, within))
        _look_beside(number, row, column, now, inside, level, step_level, good, bad)
        order = np.argsort(members, kind="stable")
        ends = np.searchsorted(members[order], np.arange(n_parts + 2))
        cells = ((row + box[0].start) * columns + column + box[1].start)[order]
        for part in range(1, n_parts + 1):
            share = float(good[part] / max(good[part] + bad[part], 1.0))
            yield SilentPart(cells[ends[part] : ends[part + 1]], step_level * cell_m, share)


def _box_around(cells: BoolArray, margin: int = 1) -> tuple[slice, slice] | None:
    """Rows and columns of cells (rows, columns), with a margin where there is one; None without cells."""
    rows, columns = (np.flatnonzero(cells.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return None
    row, column = (
        slice(max(hit_indices[0] - margin, 0), hit_indices[-1] + margin + 1)
        for hit_indices in (rows, columns)
    )
    return row, column


def half_widths(silent: BoolArray) -> FloatArray:
    """Radius in cells (rows, columns) of the largest disc of cells that covers each, by steps; else 0."""
    level = silent.astype(np.float64)
    away = _away_from(np.pad(~silent, 1, constant_values=True))[1:-1, 1:-1]
    radius = _STEP
    while (box := _box_around(core := away >= radius, int(np.ceil(radius)))) is not None:
        level[box][_away_from(core[box]) < radius] = radius
        radius *= _STEP
    return np.where(silent, level, 0.0)


def _away_from(cells: BoolArray) -> NDArray[np.float32]:
    """Distance (rows, columns) to the nearest of some cells, in cells: roots of whole numbers to 1e-7.

    Powers of `_STEP` are no such roots, so that what is nearer than one does not depend on rounding.
    """
    away = cv2.distanceTransform((~cells).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(away, dtype=np.float32)


def _at_border(number: NDArray[np.int32], n_parts: int, wraps: bool) -> FloatArray:
    """How many cells of each part (n_parts + 1,) lie at the grid's border."""
    sides = [number[0], number[-1]] + ([] if wraps else [number[:, 0], number[:, -1]])
    return np.bincount(np.concatenate(sides), minlength=n_parts + 1).astype(np.float64)


@compiled
def _look_beside(
    number: NDArray[np.int32],
    rows: IntArray,
    columns: IntArray,
    solid: BoolArray,
    within: BoolArray,
    level: FloatArray,
    value: float,
    good: FloatArray,
    bad: FloatArray,
) -> None:
    """Count for each part, of cells at rows (n,) and columns (n,), those beside that are surface, and not.

    Silent cells of a `level` below `value`, which narrower parts have, are neither.
    """
    for k in range(len(rows)):
        part = number[rows[k], columns[k]]
        for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            row, column = rows[k] + down, columns[k] + right
            if not (0 <= row < number.shape[0] and 0 <= column < number.shape[1]):
                continue
            if number[row, column] == part:
                continue
            if solid[row, column]:
                good[part] += 1.0
            elif within[row, column] and not 0.0 < level[row, column] < value:
                bad[part] += 1.0


class Onward(IntEnum):
    """How a surface goes on to a hidden place.

    Within the measured rectangle of a plane the distance is that to the measured part, in units of the root
    of its area, and so it is on cylinders.
    """

    WALL_WITHIN = 0  # walls, floors and ceilings, in their rectangle
    OBJECT_WITHIN = 1  # other planes, in their rectangle
    CYLINDER = 2
    BEYOND = 3  # the rectangle of a plane
    PAST_END = 4  # of a cylinder


PERSISTENCE: FloatArray = np.array([
    [0.999, 25.0],
    [0.928, 7.8],
    [0.994, 6.6],
])  # fmt: skip
"""Probability (3,) just beside what was measured for each `Onward`, and distance in which it falls to 1/e.

The most likely ones on the same rooms, flats and frames as `WEIGHTS`, rounded.
"""

EVEN_M = 1.6
"""Half width, metres, of hidden wall from which on a door or a niche is as probable there as wall.

Where furniture hides an upright wall over a disc, nothing tells whether an opening is behind it, and the odds
that one is grow with the disc's area: this is how often the walls of the same rooms and flats had one. Floors
and ceilings have none.
"""

_COARSE_M = 0.025  # cells in which widths are found


@dataclass(frozen=True, slots=True, eq=False)
class Prospects:
    """What the probability at n hidden places depends on."""

    base: FloatArray  # (n,) probability that no opening or end of the surface lies before them
    onward: NDArray[np.int8]  # (n,) an `Onward`
    distance: FloatArray  # (n,) in its units
    width: FloatArray  # (n,) half width of what is hidden of an upright wall around them, metres; else 0
    known: FloatArray  # (n, 11) `KNOWN` of those beyond the rectangle; else of no use
    end_features: FloatArray  # (n, 4) `KNOWN_PAST_END` of those past an end; else of no use
    is_said: BoolArray  # (n,) whether a person, or a joint, says that it goes on past them

    def probability(
        self,
        persistence: FloatArray = PERSISTENCE,
        weights: FloatArray = WEIGHTS,
        even_m: float = EVEN_M,
        end_weights: FloatArray = PAST_END,
    ) -> FloatArray:
        """Probability (n,) that the surface is there."""
        beyond, ended = self.onward == Onward.BEYOND, self.onward == Onward.PAST_END
        start, length = persistence[np.where(beyond | ended, 0, self.onward)].T
        whole = 1 / (1 + np.square(self.width / even_m))
        within = self.base * start * np.exp(-self.distance / length) * whole
        past = np.where(ended, self.base * probability_past_end(self.end_features, end_weights), within)
        past = np.where(beyond, probability_beyond(self.known, weights), past)
        return np.where((beyond | ended) & self.is_said, self.base, past)


def estimate(
    grid: ChartGrid,
    regions: HiddenRegions,
    labelling: Labelling,
    extent: Extent,
    evidence: Evidence,
    *,
    room: Room = NO_ROOM,
) -> FloatArray:
    """Probability (rows, columns) that the surface is at each cell; 1 where it was measured."""
    result = np.where(evidence.observed, 1.0, 0.0)
    if evidence.observed.any() and regions.n_regions:
        prospect = prospects(grid, regions, labelling, extent, evidence)
        probability = prospect.probability()
        if extent.role:
            known = known_of_room(grid, regions, extent, evidence, base=prospect.base, room=room)
            probability = np.where(prospect.is_said, probability, room_probability(known, extent.role))
        result[regions.region >= 0] = probability
    return result


def prospects(
    grid: ChartGrid, regions: HiddenRegions, labelling: Labelling, extent: Extent, evidence: Evidence
) -> Prospects:
    """Return what the probability depends on at each hidden cell, in the order of `regions.region`.

    The labelling holds with a probability that is the region's margin. Otherwise the boundary between surface
    and opening lies anywhere between measured and open cells: an opening that was seen over a length s goes
    on for e more with probability s / (s + e) (Gott 1993). In both cases the surface goes on for a distance
    with the persistence of its kind. Past the rectangle of a plane, and past the ends of a cylinder, all that
    is known of it is weighed instead (`KNOWN`, `KNOWN_PAST_END`).
    """
    observed, open_ = evidence.observed, evidence.open
    inside = regions.region >= 0
    number = regions.region[inside]
    d = distance_to(observed, grid)[0][inside]
    e, s = (values[inside] for values in distance_to(open_, grid))
    ended = e / (s + e)  # the opening, before it comes here
    apart = (d + e) / (s + d + e)
    measured, beside_open = regions.beside_measured[number] > 0, regions.beside_open[number] > 0
    between = np.where(measured, ended / np.maximum(apart, 1e-12), ended)
    anywhere = np.where(measured & ~beside_open, 1.0, between)
    held = np.abs(labelling.margin[number])
    base = held * labelling.is_surface[number] + (1 - held) * anywhere
    near = d / float(np.sqrt(observed.sum() * grid.cell_area))
    nothing = np.zeros(len(d))
    places, set_by = grid.centres_uv()[inside], extent.by_edit | extent.by_feature
    if isinstance(extent.chart, Cylinder):
        ends = PastEnds.of(places[:, 1], extent)
        kind = np.where(ends.side >= 0, Onward.PAST_END, Onward.CYLINDER).astype(np.int8)
        is_said = (ends.side >= 0) & set_by[ends.side, 1]
        return Prospects(
            base,
            kind,
            near,
            nothing,
            np.zeros((len(d), len(KNOWN))),
            end_features=ends.known,
            is_said=is_said,
        )
    sides, end_features = RectangleSides.of(grid, evidence, extent), np.zeros((len(d), len(KNOWN_PAST_END)))
    known, side = known_beyond(places, base, extent, sides)
    width = nothing
    if extent.encloses and not extent.is_level:
        width = hidden_widths(inside & grid.within(extent.own_low, extent.own_high), grid)[inside]
    kind = np.where(side >= 0, Onward.BEYOND, Onward.WALL_WITHIN if extent.encloses else Onward.OBJECT_WITHIN)
    is_said = (side >= 0) & set_by[side % 2, side // 2]
    return Prospects(
        base, kind.astype(np.int8), near, width, known, end_features=end_features, is_said=is_said
    )


def hidden_widths(hidden: BoolArray, grid: ChartGrid) -> FloatArray:
    """Radius (rows, columns) of the largest disc of hidden cells that covers each, metres; 0 elsewhere.

    Found in cells of 2.5 cm where the grid's are smaller.
    """
    step = max(1, int(_COARSE_M / float(grid.cell.max())))
    level = half_widths(hidden[::step, ::step]) * step * float(grid.cell.max())
    fine = np.repeat(np.repeat(level, step, axis=0), step, axis=1)[: hidden.shape[0], : hidden.shape[1]]
    return np.where(hidden, fine, 0.0)


def distance_to(cells: BoolArray, grid: ChartGrid) -> tuple[FloatArray, FloatArray]:
    """Distance of each cell to the nearest of `cells` (rows, columns), and how long that part is, metres.

    Both are (rows, columns). Without any cells the distance is 1e6 and the length 0.
    """
    if not cells.any():
        return np.full(cells.shape, 1e6), np.zeros(cells.shape)
    width = cells.shape[1]
    around = np.pad(cells, ((0, 0), (width, width)), mode="wrap") if grid.wraps else cells
    distance, nearest = ndimage.distance_transform_edt(~around, sampling=grid.cell[::-1], return_indices=True)
    part, _ = ndimage.label(around)
    sides = [np.ptp([(axis.start, axis.stop) for axis in box], axis=1) for box in ndimage.find_objects(part)]
    longer = np.append(0.0, (np.array(sides) * grid.cell[::-1]).max(axis=1))[part[tuple(nearest)]]
    middle = slice(width, 2 * width) if grid.wraps else slice(None)
    return np.asarray(distance[:, middle]), np.asarray(longer[:, middle])
