# SPDX-License-Identifier: MIT
"""Confidence: the probability that a surface is where it was hidden."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.boundary.hidden_regions import HiddenRegions, Labelling
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence
from completion.extension.beyond import KNOWN, WEIGHTS, Sides, known_beyond, probability_beyond
from completion.extension.extent import Extent
from completion.extension.past_end import KNOWN_PAST_END, PAST_END, PastEnds, probability_past_end
from completion.extension.silence import half_widths
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder


class Onward(IntEnum):
    """How a surface goes on to a hidden place.

    Within the measured rectangle of a plane the distance is that to the measured part, in units of the root
    of its area, and so it is on cylinders.
    """

    WALL_WITHIN = 0  # walls, floors and ceilings, in their rectangle
    OBJECT_WITHIN = 1  # other planes, in their rectangle
    CYLINDER = 2
    BEYOND = 3  # the rectangle of a plane (`extension.beyond`)
    PAST_END = 4  # of a cylinder (`extension.past_end`)


PERSISTENCE: FloatArray = np.array([
    [0.999, 25.0],
    [0.928, 7.8],
    [0.994, 6.6],
])  # fmt: skip
"""Probability (3,) just beside what was measured for each `Onward`, and distance in which it falls to 1/e.

The most likely ones on the same rooms, flats and frames as `beyond.WEIGHTS`, rounded.
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
    known: FloatArray  # (n, 11) `beyond.KNOWN` of those beyond the rectangle; else of no use
    past_end: FloatArray  # (n, 4) `past_end.KNOWN_PAST_END` of those past an end; else of no use
    is_said: BoolArray  # (n,) whether a person, or a joint, says that it goes on past them

    def probability(
        self,
        persistence: FloatArray = PERSISTENCE,
        weights: FloatArray = WEIGHTS,
        even_m: float = EVEN_M,
        past_end: FloatArray = PAST_END,
    ) -> FloatArray:
        """Probability (n,) that the surface is there."""
        beyond, ended = self.onward == Onward.BEYOND, self.onward == Onward.PAST_END
        start, length = persistence[np.where(beyond | ended, 0, self.onward)].T
        whole = 1 / (1 + np.square(self.width / even_m))
        within = self.base * start * np.exp(-self.distance / length) * whole
        past = np.where(ended, self.base * probability_past_end(self.past_end, past_end), within)
        past = np.where(beyond, probability_beyond(self.known, weights), past)
        return np.where((beyond | ended) & self.is_said, self.base, past)


def estimate(
    grid: ChartGrid, regions: HiddenRegions, labelling: Labelling, extent: Extent, evidence: Evidence
) -> FloatArray:
    """Probability (rows, columns) that the surface is at each cell; 1 where it was measured."""
    result = np.where(evidence.observed, 1.0, 0.0)
    if evidence.observed.any() and regions.n_regions:
        found = prospects(grid, regions, labelling, extent, evidence)
        result[regions.region >= 0] = found.probability()
    return result


def prospects(
    grid: ChartGrid, regions: HiddenRegions, labelling: Labelling, extent: Extent, evidence: Evidence
) -> Prospects:
    """Return what the probability depends on at each hidden cell, in the order of `regions.region`.

    The labelling holds with a probability that is the region's margin. Otherwise the boundary between surface
    and opening lies anywhere between measured and open cells: an opening that was seen over a length s goes
    on for e more with probability s / (s + e) (Gott 1993). In both cases the surface goes on for a distance
    with the persistence of its kind. Past the rectangle of a plane, and past the ends of a cylinder, all that
    is known of it is weighed instead (`extension.beyond`, `extension.past_end`).
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
            base, kind, near, nothing, np.zeros((len(d), len(KNOWN))), past_end=ends.known, is_said=is_said
        )
    sides, past_end = Sides.of(grid, evidence, extent), np.zeros((len(d), len(KNOWN_PAST_END)))
    known, side = known_beyond(places, base, extent, sides)
    width = nothing
    if extent.encloses and not extent.is_level:
        width = hidden_widths(inside & grid.within(extent.own_low, extent.own_high), grid)[inside]
    kind = np.where(side >= 0, Onward.BEYOND, Onward.WALL_WITHIN if extent.encloses else Onward.OBJECT_WITHIN)
    is_said = (side >= 0) & set_by[side % 2, side // 2]
    return Prospects(base, kind.astype(np.int8), near, width, known, past_end=past_end, is_said=is_said)


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
