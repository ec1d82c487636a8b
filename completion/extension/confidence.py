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
from completion.extension.extent import Extent
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder
from texture.engine.compiled import compiled


class Onward(IntEnum):
    """How a surface goes on to a hidden place.

    Within the measured rectangle, and towards the end of a wall, the distance is that to the measured part,
    in units of the root of its area. Beyond the rectangle it is the distance from it, in units of its side.
    """

    WALL_WITHIN = 0  # walls, floors and ceilings, in their rectangle
    WALL_TO_END = 1  # beyond it, towards the next wall or floor
    WALL_BEYOND = 2  # beyond it, where nothing is known to end it
    OBJECT_WITHIN = 3  # other planes, in their rectangle
    OBJECT_BEYOND = 4
    CYLINDER = 5
    FRAGMENT_BEYOND = 6  # planes that were hardly seen to end anywhere: a piece of who knows what


_WALL_WITHIN, _WALL_TO_END, _WALL_BEYOND = map(
    int, (Onward.WALL_WITHIN, Onward.WALL_TO_END, Onward.WALL_BEYOND)
)
_OBJECT_WITHIN, _OBJECT_BEYOND = int(Onward.OBJECT_WITHIN), int(Onward.OBJECT_BEYOND)
_FRAGMENT_SHARE = 0.1  # of a plane's outline, below which it was hardly seen to end
_LEAST_SIZE = 1e-9  # of a measured rectangle, metres

PERSISTENCE: FloatArray = np.array([
    [0.998, 5.0],
    [0.985, 2.7],
    [0.98, 0.25],
    [0.99, 15.0],
    [0.98, 0.9],
    [0.997, 45.0],
    [0.57, 1.1],
])  # fmt: skip
"""Probability (7,) just beside what was measured for each `Onward`, and distance in which it falls to 1/e.

The most likely ones on the generated rooms with seeds 1000 to 1031, rounded, and of fragments, which those
rooms hardly have, on the rooms and the frames of a walk through a furnished storey
(examples/calibrate_confidence.py).
"""


@dataclass(frozen=True, slots=True, eq=False)
class Prospects:
    """What the probability at n hidden places depends on."""

    base: FloatArray  # (n,) probability that no opening or end of the surface lies before them
    onward: NDArray[np.int8]  # (n,) an `Onward`
    distance: FloatArray  # (n,) in its units
    end_probability: FloatArray  # (n,) probability that it goes on past them, to what it stands on

    def probability(self, persistence: FloatArray = PERSISTENCE) -> FloatArray:
        """Probability (n,) that the surface is there."""
        start, length = persistence[self.onward].T
        goes_on = start * np.exp(-self.distance / length)
        return np.asarray(
            self.base * (self.end_probability + (1 - self.end_probability) * goes_on), dtype=np.float64
        )


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
    with the persistence of its kind.
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
    return Prospects(base, *_onward(grid.centres_uv()[inside], near, extent, is_fragment(evidence)))


def is_fragment(evidence: Evidence) -> bool:
    """Tell whether a surface was hardly seen to end: nearly all its outline is hidden or out of view.

    What was seen to end over a good part of its outline shows its shape, and how it goes on can be told from
    that. A piece of which only a piece was seen may end anywhere.
    """
    outline = ndimage.binary_dilation(evidence.observed, np.ones((3, 3))) & ~evidence.observed
    return bool(np.count_nonzero(evidence.open & outline) < _FRAGMENT_SHARE * np.count_nonzero(outline))


def _onward(
    uv: FloatArray, near: FloatArray, extent: Extent, is_piece: bool
) -> tuple[NDArray[np.int8], FloatArray, FloatArray]:
    """How the surface goes on to places (n, 2), how far it is, and how probably it goes on to its end.

    Fragments do not go on to ends.
    """
    nothing = np.zeros(len(uv))
    if isinstance(extent.chart, Cylinder):
        return np.full(len(uv), Onward.CYLINDER, np.int8), near, nothing
    own = np.array([extent.own_low, extent.own_high])
    onward, distance, to_end = onward_on_plane(uv, near, own, extent.end_probability, extent.encloses)
    if extent.encloses or not is_piece:
        return onward, distance, to_end
    return np.where(onward == Onward.OBJECT_BEYOND, Onward.FRAGMENT_BEYOND, onward), distance, nothing


@compiled
def onward_on_plane(
    uv: FloatArray, near: FloatArray, own: FloatArray, end_probability: FloatArray, encloses: bool
) -> tuple[NDArray[np.int8], FloatArray, FloatArray]:
    """`_onward` on a plane with the measured rectangle `own` (2, 2), whose sides go on to ends (2, 2)."""
    n = len(uv)
    onward, distance, to_end = np.empty(n, np.int8), near.copy(), np.zeros(n)
    for i in range(n):
        is_out, beyond, certain = False, 0.0, 1.0
        for axis in range(2):
            size = max(own[1, axis] - own[0, axis], _LEAST_SIZE)
            for side in range(2):
                past = own[0, axis] - uv[i, axis] if side == 0 else uv[i, axis] - own[1, axis]
                if past > 0.0:
                    is_out = True
                    beyond = max(beyond, past / size)
                    certain = min(certain, end_probability[side, axis])
        if not is_out:
            onward[i] = _WALL_WITHIN if encloses else _OBJECT_WITHIN
        elif not encloses:
            onward[i], distance[i], to_end[i] = _OBJECT_BEYOND, beyond, certain
        elif certain > 0.0:
            onward[i] = _WALL_TO_END
        else:
            onward[i], distance[i] = _WALL_BEYOND, beyond
    return onward, distance, to_end


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
