# SPDX-License-Identifier: MIT
"""Confidence: the probability that a surface is where it was hidden."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from completion.chart import ChartGrid
from completion.labelling import Labelling
from completion.limits import Limits
from completion.shadows import Shadows
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces import Cylinder


@dataclass(frozen=True, slots=True)
class Persistence:
    """How surfaces of a kind go on: with probability start * exp(-x / length).

    Attributes
    ----------
    start : float
        Probability just beside what was measured.
    length : float
        Distance x, in units of a measured size, in which it falls to 1/e.
    """

    start: float
    length: float

    def at(self, x: FloatArray) -> FloatArray:
        """Probability (...,) at distances (...,) in units of the measured size."""
        return np.asarray(self.start * np.exp(-x / self.length), dtype=np.float64)


# Most likely on the generated rooms with seeds 1000 to 1031, rounded (examples/calibrate_confidence.py).
# In the rectangle of what was measured, and towards what ends a wall, distance to the measured part over the
# root of its area; beyond the rectangle, distance from it over its side in that direction.
WALL_WITHIN = Persistence(0.995, 4.0)  # walls, floors, ceilings
WALL_TO_END = Persistence(0.98, 2.0)
WALL_BEYOND = Persistence(0.98, 0.25)  # where nothing is known to end it
OBJECT_WITHIN = Persistence(0.985, 13.0)  # other planes
OBJECT_BEYOND = Persistence(0.98, 0.75)
CYLINDER = Persistence(0.995, 35.0)


def estimate(
    grid: ChartGrid,
    shadows: Shadows,
    labelling: Labelling,
    limits: Limits,
    observed: BoolArray,
    open_: BoolArray,
) -> FloatArray:
    """Probability (rows, columns) that the surface is at each cell; 1 where it was measured.

    With a probability that is the piece's margin the labelling holds. Otherwise the boundary between surface
    and opening lies anywhere between measured and open cells, as far from the latter as an opening may reach
    of which that much was seen: with probability s / (s + e) for e more (Gott 1993). Either way the surface
    goes on for a distance with the persistence of its kind.

    Parameters
    ----------
    grid : ChartGrid
        The cells.
    shadows : Shadows
        Hidden cells in pieces.
    labelling : Labelling
        Which pieces are surface.
    limits : Limits
        What bounds the surface.
    observed, open_ : (rows, columns) bool
        Where the surface was measured, and where beams passed.
    """
    result = np.where(observed, 1.0, 0.0)
    inside = shadows.piece >= 0
    if not inside.any() or not observed.any():
        return result
    number = shadows.piece[inside]
    d = distance_to(observed, grid)[0][inside]
    e, s = (values[inside] for values in distance_to(open_, grid))
    root = float(np.sqrt(observed.sum() * grid.cell_area))
    goes_on = _goes_on(grid.centres_uv()[inside], d, root, limits)
    ended = e / (s + e)  # the opening, before it comes here
    apart = (d + e) / (s + d + e)
    measured, beside_open = shadows.beside_measured[number] > 0, shadows.beside_open[number] > 0
    between = np.where(measured, ended / np.maximum(apart, 1e-12), ended)
    anywhere = np.where(measured & ~beside_open, 1.0, between)
    held = np.abs(labelling.margin[number])
    result[inside] = (held * labelling.is_surface[number] + (1 - held) * anywhere) * goes_on
    return result


def _goes_on(uv: FloatArray, distance: FloatArray, root: float, limits: Limits) -> FloatArray:
    """Probability (n,) that the surface goes on to places (n, 2) so far from its measured part."""
    near = distance / root
    if isinstance(limits.chart, Cylinder):
        return CYLINDER.at(near)
    size = np.maximum(limits.own_high - limits.own_low, 1e-9)
    past = np.stack([limits.own_low - uv, uv - limits.own_high])  # side, place, axis
    is_out = (past > 0).any(axis=(0, 2))
    beyond = (np.maximum(past, 0.0) / size).max(axis=(0, 2))
    reaches = np.where(past > 0, limits.reaches[:, None, :], 1.0).min(axis=(0, 2))
    if limits.encloses:
        out = np.where(reaches > 0, WALL_TO_END.at(near), WALL_BEYOND.at(beyond))
        return np.where(is_out, out, WALL_WITHIN.at(near))
    out = reaches + (1 - reaches) * OBJECT_BEYOND.at(beyond)
    return np.where(is_out, out, OBJECT_WITHIN.at(near))


def distance_to(cells: BoolArray, grid: ChartGrid) -> tuple[FloatArray, FloatArray]:
    """Distance of each cell to the nearest of `cells`, and the longer side of the part it belongs to, metres.

    Without any the distance is very long and the side nothing.
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
