# SPDX-License-Identifier: MIT
"""Angle grid: rows and columns of pixels that the directions of points without a grid lie on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from scenes import limits
from scenes.checks import BoolArray, FloatArray
from scenes.scan.projection import SphericalProjection

_N_SAMPLE = 20_000  # points whose neighbours are looked at
_BINS = 1 << 19  # of angles, whose spectrum shows the steps
_MOST_PIXELS = 1 << 25  # of an image whose columns are not the instrument's


@dataclass(frozen=True, slots=True, eq=False)
class AngleGrid:
    """Pixels that points fall into.

    Attributes
    ----------
    pole : (3,) float
        The axis that the scanner turned about: the image's up.
    projection : SphericalProjection
        In a sensor frame whose y is against the pole and whose z is `forward`.
    forward : (3,) float
        At right angles to the pole.
    row, column : (n,) int64
        The pixel of each point.
    is_own : bool
        Whether columns are the instrument's own; else each beam has its own azimuths, and columns may miss
        some of them.
    """

    pole: FloatArray
    projection: SphericalProjection
    forward: FloatArray
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    is_own: bool = True

    @property
    def flat(self) -> NDArray[np.int64]:
        """Flat pixel (n,) of each point."""
        return self.row * self.projection.shape[1] + self.column

    @property
    def kept(self) -> float:
        """Share of the points that have a pixel of their own."""
        return np.count_nonzero(self.filled) / len(self.row)

    @property
    def filled(self) -> BoolArray:
        """Tell which pixels (rows, columns) have a point."""
        filled = np.zeros(self.projection.shape, np.bool_)
        filled[self.row, self.column] = True
        return filled


def find_grid(
    rays: FloatArray, poles: Sequence[FloatArray], beam: NDArray[np.int64] | None = None
) -> AngleGrid | None:
    """Return the grid of azimuths and elevations that unit `rays` (n, 3) lie on, None where there is none.

    About each pole rows and columns are looked for apart, in this order: even steps, which the angles'
    spectrum shows (a wave of that length has all angles at the same phase); rows by the number of the beam;
    uneven steps, lines of angles with gaps in between (beams of a spinning lidar, stops of a stepped one);
    columns so narrow that a beam's returns have a pixel each. The grid that gives most points a pixel of
    their own counts, if they are at least 95 %, and its own steps leave no more than a fifth of holes.

    Parameters
    ----------
    rays : (n, 3) float
        Unit vectors.
    poles : sequence of (3,) float
        Axes that the scanner may have turned about.
    beam : (n,) int64, optional
        The number of each ray's beam, where the lidar has several; about the first pole.
    """
    grids = [
        grid
        for number, pole in enumerate(poles)
        if (grid := _grid_about(rays, pole, beam if number == 0 else None)) is not None
    ]
    return max(grids, key=_merit, default=None)


def swept_beams(rays: FloatArray) -> NDArray[np.int64] | None:
    """Number (n,) of the beam of each unit ray (n, 3), by the file's order; None where it is another one.

    Beam after beam, each a turn about z: azimuths grow (or fall) all along, and jump back between beams,
    which follow each other upwards or downwards. Files of several sweeps are none: these begin again.
    """
    azimuth = np.arctan2(rays[:, 1], rays[:, 0])
    way = (np.diff(azimuth) + np.pi) % (2 * np.pi) - np.pi
    near = way[np.abs(way) < limits.APART]
    sense = float(np.sign(np.median(near))) if len(near) else 0.0
    if not sense or np.mean(sense * near >= 0) < limits.NEARLY_ALL:
        return None
    along = (sense * (azimuth - azimuth[0]) + limits.APART) % (2 * np.pi)
    beam = np.concatenate([[0], np.cumsum(np.diff(along) < -limits.APART)])
    n_beams = int(beam[-1]) + 1
    is_lidar = limits.FEWEST_LINES <= n_beams <= limits.MOST_BEAMS
    if not is_lidar or len(rays) < limits.FEWEST_POINTS * n_beams:
        return None
    elevation = np.arcsin(np.clip(rays[:, 2], -1.0, 1.0))
    rises = np.diff([np.median(elevation[beam == k]) for k in range(n_beams)])
    return beam if (rises * np.sign(np.sum(rises)) > -limits.APART / 2).all() else None


def swept_poles(rays: FloatArray) -> list[FloatArray]:
    """Return axes (3,) that the points may have been swept about, by unit rays (n, 3) in the file's order.

    Two points that follow each other in a column span a plane with the axis; the way from one to the next in
    a row is at right angles to it. None where too few points follow each other closely.
    """
    poles = []
    for across in (np.cross(rays[:-1], rays[1:]), np.diff(rays, axis=0)):
        length = np.linalg.norm(across, axis=1)
        near = (length > 1e-9) & (length < limits.APART)
        if near.sum() >= limits.FEWEST_POINTS:
            unit = across[near] / length[near, None]
            pole = np.linalg.eigh(unit.T @ unit)[1][:, 0]
            poles.append(np.asarray(pole * np.copysign(1.0, pole[int(np.argmax(np.abs(pole)))])))
    return poles


def is_filled(filled: BoolArray, share: float) -> bool:
    """Tell whether so many of the pixels (rows, columns) between filled ones are filled."""
    between = scipy.ndimage.binary_closing(np.pad(filled, 2), np.ones((3, 3)))[2:-2, 2:-2]
    return bool(filled.sum() >= share * between.sum())


def neighbour_steps(angles: FloatArray) -> FloatArray:
    """Median angle (2,) to the next point sideways and upwards, of azimuths, elevations (n, 2), radians."""
    flat = angles.copy()
    flat[:, 0] *= np.cos(angles[:, 1])
    sample = np.linspace(0, len(flat) - 1, min(_N_SAMPLE, len(flat))).astype(np.int64)
    _, near = scipy.spatial.cKDTree(flat).query(flat[sample], k=9)
    way = np.abs(flat[near[:, 1:]] - flat[sample, None])
    is_level = way[..., 0] >= way[..., 1]
    steps = []
    for axis, chosen in ((0, is_level), (1, ~is_level)):
        nearest = np.where(chosen & (way[..., axis] > 1e-9), way[..., axis], np.inf).min(axis=1)
        known = nearest[np.isfinite(nearest)]
        steps.append(float(np.median(known)) if len(known) else np.inf)
    smaller = min(steps) if np.isfinite(min(steps)) else 1e-3
    return np.array([value if np.isfinite(value) else smaller for value in steps])


_Steps = tuple[NDArray[np.int64], FloatArray]  # the number (n,) of each point's step, and the steps' angles


def _grid_about(rays: FloatArray, pole: FloatArray, beam: NDArray[np.int64] | None) -> AngleGrid | None:
    forward = rays.mean(axis=0) - (rays.mean(axis=0) @ pole) * pole
    if np.linalg.norm(forward) < 1e-6:
        forward = np.eye(3)[int(np.argmin(np.abs(pole)))]
        forward = forward - (forward @ pole) * pole
    forward = forward / np.linalg.norm(forward)
    azimuth = np.arctan2(rays @ np.cross(forward, pole), rays @ forward)
    elevation = np.arcsin(np.clip(rays @ pole, -1.0, 1.0))
    level = np.abs(elevation) < limits.LEVEL_ANGLE
    if level.sum() < limits.FEWEST_POINTS:
        return None
    wide, high = neighbour_steps(np.column_stack([azimuth, elevation])[level])
    every = np.ones(len(rays), np.bool_)
    rows = [_even_steps(elevation, high, every), _beam_steps(elevation, beam), _lines(elevation, every)]
    beside = np.cos(elevation) > 2 * high  # at the pole itself every azimuth is as good
    columns = [_even_azimuths(azimuth, wide, level, beside), _lines(azimuth, level)]
    found = list[AngleGrid]()
    for row, elevations in filter(None, rows):
        for own in (*filter(None, columns), None):
            column, azimuths = own or _beam_columns(azimuth, row)
            if min(len(elevations), len(azimuths)) < 2 or np.ptp(azimuths) >= 2 * np.pi + 1e-9:
                continue
            projection = SphericalProjection(azimuths, elevations[::-1])
            grid = AngleGrid(
                pole, projection, forward, len(elevations) - 1 - row, column, is_own=own is not None
            )
            found += [grid] if grid.kept >= limits.NEARLY_ALL and _is_whole(grid) else []
    return max(found, key=_merit, default=None)


def _merit(grid: AngleGrid) -> tuple[bool, float]:
    """By which the best of several grids is the largest."""
    return grid.is_own, grid.kept


def _is_whole(grid: AngleGrid) -> bool:
    """Tell whether a grid's steps are the instrument's: few are empty, and few pixels between filled ones."""
    filled = grid.filled
    if filled.any(axis=1).mean() < limits.FILLED:
        return False
    return not grid.is_own or (
        bool(filled.any(axis=0).mean() >= limits.FILLED) and is_filled(filled, limits.FILLED)
    )


def _even_steps(angles: FloatArray, near: float, telling: BoolArray) -> _Steps | None:
    comb = _comb(angles, near)
    return None if comb is None else _number_steps(angles, *comb, telling)


def _even_azimuths(azimuth: FloatArray, near: float, level: BoolArray, beside: BoolArray) -> _Steps | None:
    """Even steps of azimuths, of which a whole turn has a whole number."""
    comb = _comb(azimuth[level], near)
    if comb is None:
        return None
    turn = round(2 * np.pi / comb[0])
    if abs(turn * comb[0] - 2 * np.pi) < comb[0] / 4:
        comb = 2 * np.pi / turn, comb[1]
    column, azimuths = _number_steps(azimuth, *comb, beside)
    if len(azimuths) > turn:  # the seam of a full turn
        column, azimuths = column % turn, azimuths[:turn]
    return column, azimuths


def _beam_steps(elevation: FloatArray, beam: NDArray[np.int64] | None) -> _Steps | None:
    """Rows by the number of the beam, each at the median of its elevations."""
    if beam is None:
        return None
    number, whose = np.unique(beam, return_inverse=True)
    middle = np.array([np.median(elevation[whose == k]) for k in range(len(number))])
    place = np.argsort(np.argsort(middle, kind="stable"), kind="stable")
    return place[whose], np.sort(middle) + 1e-9 * np.arange(len(number))


def _lines(angles: FloatArray, telling: BoolArray) -> _Steps | None:
    """Uneven steps: angles in lines that are narrower than the gaps beside them; None where they are not.

    Lines are what gaps of some width part, from wide gaps to narrow ones; strays belong to the nearest line.
    """
    held, found = np.sort(angles[telling]), None
    gaps = np.diff(held)
    for width in np.ptp(held) / limits.FEWEST_LINES / 1.5 ** np.arange(limits.N_WIDTHS):
        start = np.concatenate([[0], np.flatnonzero(gaps > width) + 1])
        count = np.diff(np.append(start, len(held)))
        real = count >= limits.STRAY * np.median(count)
        low, high, count = held[start][real], held[start + count - 1][real], count[real]
        if len(low) < limits.FEWEST_LINES or count.mean() < limits.LINE_POINTS:
            continue
        apart = np.concatenate([[np.inf], low[1:] - high[:-1], [np.inf]])
        is_narrow = high - low <= np.minimum(apart[:-1], apart[1:])
        if count[is_narrow].sum() >= limits.NEARLY_ALL * len(held):
            found = (high[:-1] + low[1:]) / 2, (low + high) / 2
    return None if found is None else (np.searchsorted(found[0], angles).astype(np.int64), found[1])


def _beam_columns(azimuth: FloatArray, row: NDArray[np.int64]) -> _Steps:
    """Even azimuths about as far apart as a beam's returns, closer where these come at uneven times."""
    order = np.lexsort((azimuth, row))
    way = np.diff(azimuth[order])[np.diff(row[order]) == 0]
    step = float(np.median(way[way > 1e-9])) if (way > 1e-9).any() else np.pi
    n_rows = int(row.max()) + 1
    for share in (1.0, 0.9, 0.8, 0.7, 0.6, 0.5):
        n_columns = int(np.clip(round(2 * np.pi / (share * step)), 1, _MOST_PIXELS // n_rows))
        column = np.floor((azimuth + np.pi) / (2 * np.pi) * n_columns).astype(np.int64) % n_columns
        taken = np.zeros(n_rows * n_columns, np.bool_)
        taken[row * n_columns + column] = True
        if np.count_nonzero(taken) >= limits.NEARLY_ALL * len(row):
            break
    first, last = int(column.min()), int(column.max())
    azimuths = -np.pi + (np.arange(first, last + 1) + 0.5) * 2 * np.pi / n_columns
    return column - first, azimuths


def _number_steps(angles: FloatArray, step: float, phase: float, telling: BoolArray) -> _Steps:
    """Number (n,) of each angle's step, from the least to the largest of those that tell; their angles."""
    number = np.rint((angles - phase) / step).astype(np.int64)
    first, last = int(number[telling].min()), int(number[telling].max())
    steps = np.arange(first, last + 1, dtype=np.float64)
    return np.clip(number, first, last) - first, np.asarray(phase + step * steps)


def _comb(angles: FloatArray, near: float) -> tuple[float, float] | None:
    """Step and phase of angles (n,) that come in steps of about `near`, radians; None where they do not."""
    span = float(np.ptp(angles))
    length = 4 * span  # four times as many waves as differ from each other
    if not _BINS * near > 16 * length or span < 4 * near:
        return None
    count, _ = np.histogram(angles - angles.min(), bins=_BINS, range=(0.0, length))
    strength = np.abs(np.fft.rfft(count)) / len(angles)
    low, high = int(length / (limits.WIDEST_STEP * near)), int(length / (limits.NARROWEST_STEP * near))
    waves = np.arange(max(low, 8), min(high, len(strength) - 1))
    if not len(waves) or strength[waves].max() < limits.SHARP:
        return None
    first = int(waves[np.argmax(strength[waves] >= limits.FUNDAMENTAL * strength[waves].max())])
    peak = first + int(np.argmax(strength[first : first + 5]))  # up the slope of the first strong one
    sample = angles[:: max(1, len(angles) // (2 * _N_SAMPLE))]

    def at(wave: float) -> complex:
        return complex(np.exp(2j * np.pi * wave / length * sample).mean())

    wave = float(
        scipy.optimize.minimize_scalar(
            lambda shift: -abs(at(shift)), bounds=(peak - 1.0, peak + 1.0), method="bounded"
        ).x
    )
    return length / wave, float(np.angle(at(wave))) * length / (2 * np.pi * wave)
