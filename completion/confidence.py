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
    """How surfaces of a kind go on: with probability start * exp(-d / (length * s)).

    Attributes
    ----------
    start : float
        Probability just beside what was measured.
    length : float
        Distance d, in units of the measured extent s (the root of its area), in which it falls to 1/e.
    """

    start: float
    length: float

    def at(self, distance: FloatArray, extent: float) -> FloatArray:
        """Probability (n,) at distances (n,) in metres from a measured part of an extent in metres."""
        return np.asarray(self.start * np.exp(-distance / (self.length * extent)), dtype=np.float64)


# Read off the shares that came true on the generated rooms with seeds 1000 to 1015, by distance and kind.
WALL_WITHIN = Persistence(0.995, 3.0)  # a wall or floor, inside the rectangle of what was measured of it
WALL_TO_END = Persistence(0.96, 1.5)  # beyond it, towards the next wall or floor
WALL_ON = Persistence(0.98, 0.18)  # beyond it, where nothing is known to end it
OBJECT_WITHIN = Persistence(0.98, 10.0)  # any other plane inside its rectangle
CYLINDER = Persistence(0.98, 10.0)


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
    extent = float(np.sqrt(observed.sum() * grid.cell_area))
    goes_on = _goes_on(grid.centres_uv()[inside], d, extent, limits)
    ended = e / (s + e)  # the opening, before it comes here
    apart = (d + e) / (s + d + e)
    measured, beside_open = shadows.beside_measured[number] > 0, shadows.beside_open[number] > 0
    between = np.where(measured, ended / np.maximum(apart, 1e-12), ended)
    anywhere = np.where(beside_open, between, measured)
    held = np.abs(labelling.margin[number])
    result[inside] = (held * labelling.is_surface[number] + (1 - held) * anywhere) * goes_on
    return result


def _goes_on(uv: FloatArray, distance: FloatArray, extent: float, limits: Limits) -> FloatArray:
    """Probability (n,) that the surface goes on to places (n, 2) so far from its measured part."""
    if isinstance(limits.chart, Cylinder):
        return CYLINDER.at(distance, extent)
    beyond = np.stack([uv < limits.own_low, uv > limits.own_high])  # side, place, axis
    is_out = beyond.any(axis=(0, 2))
    reaches = np.where(beyond, limits.reaches[:, None, :], 1.0).min(axis=(0, 2))
    if not limits.encloses:
        return np.where(is_out, reaches, OBJECT_WITHIN.at(distance, extent))
    out = np.where(reaches > 0, WALL_TO_END.at(distance, extent), WALL_ON.at(distance, extent))
    return np.where(is_out, out, WALL_WITHIN.at(distance, extent))


def distance_to(cells: BoolArray, grid: ChartGrid) -> tuple[FloatArray, FloatArray]:
    """Distance of each cell to the nearest of `cells`, and the extent of the part that it belongs to, metres.

    Without any the distance is very long and the extent nothing.
    """
    if not cells.any():
        return np.full(cells.shape, 1e6), np.zeros(cells.shape)
    width = cells.shape[1]
    around = np.pad(cells, ((0, 0), (width, width)), mode="wrap") if grid.wraps else cells
    distance, nearest = ndimage.distance_transform_edt(~around, sampling=grid.cell[::-1], return_indices=True)
    part, _ = ndimage.label(around)
    extent = np.sqrt(np.bincount(part.ravel()) * grid.cell_area)[part[tuple(nearest)]]
    middle = slice(width, 2 * width) if grid.wraps else slice(None)
    return np.asarray(distance[:, middle]), np.asarray(extent[:, middle])
