# SPDX-License-Identifier: MIT
"""Angle grid: about which axis a scanner turned, and in which steps, read off its points' directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from scenes.scan.projection import SphericalProjection

_N_SAMPLE = 20_000  # points whose neighbours are looked at
_BINS = 1 << 19  # of angles, whose spectrum shows the steps
_NARROWEST, _WIDEST = 0.4, 3.0  # of the angle between neighbours: where the step is looked for
_FUNDAMENTAL = 0.85  # of the strongest wave: the first so strong is the step, later ones its overtones
_SHARP = 0.5  # strength of a wave that angles in steps have; 1 without any error
_LEVEL = np.radians(60.0)  # elevation up to which points tell the step of the azimuth
_KEPT, _FILLED = 0.95, 0.8  # of the points, and of the pixels between filled ones
_FEW = 100  # points, below which they tell nothing
_APART = np.radians(5.0)  # between consecutive points: they are of neither one column nor one row


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
    """

    pole: FloatArray
    projection: SphericalProjection
    forward: FloatArray
    row: NDArray[np.int64]
    column: NDArray[np.int64]

    @property
    def flat(self) -> NDArray[np.int64]:
        """Flat pixel (n,) of each point."""
        return self.row * self.projection.shape[1] + self.column

    @property
    def kept(self) -> float:
        """Share of the points that have a pixel of their own."""
        return len(np.unique(self.flat)) / len(self.row)


def find_grid(rays: FloatArray, poles: Sequence[FloatArray]) -> AngleGrid | None:
    """Return the grid of azimuths and elevations that unit `rays` (n, 3) lie on, None where there is none.

    About each pole the angles' spectrum tells whether they come in steps: where they do, a wave of that
    length has all angles at the same phase. The grid that gives most points a pixel of their own counts, if
    they are at least 95 %, and their image has no more than a fifth of holes.
    """
    found = [grid for grid in (_grid_about(rays, pole) for pole in poles) if grid is not None]
    best = max(found, key=lambda grid: grid.kept, default=None)
    return best if best is not None and best.kept >= _KEPT else None


def swept_poles(rays: FloatArray) -> list[FloatArray]:
    """Return axes (3,) that the points may have been swept about, by unit rays (n, 3) in the file's order.

    Two points that follow each other in a column span a plane with the axis; the way from one to the next in
    a row is at right angles to it. None where too few points follow each other closely.
    """
    found = []
    for across in (np.cross(rays[:-1], rays[1:]), np.diff(rays, axis=0)):
        length = np.linalg.norm(across, axis=1)
        near = (length > 1e-9) & (length < _APART)
        if near.sum() >= _FEW:
            unit = across[near] / length[near, None]
            pole = np.linalg.eigh(unit.T @ unit)[1][:, 0]
            found.append(np.asarray(pole * np.copysign(1.0, pole[int(np.argmax(np.abs(pole)))])))
    return found


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
    found = []
    for axis, chosen in ((0, is_level), (1, ~is_level)):
        nearest = np.where(chosen & (way[..., axis] > 1e-9), way[..., axis], np.inf).min(axis=1)
        known = nearest[np.isfinite(nearest)]
        found.append(float(np.median(known)) if len(known) else np.inf)
    smaller = min(found) if np.isfinite(min(found)) else 1e-3
    return np.array([one if np.isfinite(one) else smaller for one in found])


def _grid_about(rays: FloatArray, pole: FloatArray) -> AngleGrid | None:
    forward = rays.mean(axis=0) - (rays.mean(axis=0) @ pole) * pole
    if np.linalg.norm(forward) < 1e-6:
        forward = np.eye(3)[int(np.argmin(np.abs(pole)))]
        forward = forward - (forward @ pole) * pole
    forward = forward / np.linalg.norm(forward)
    azimuth = np.arctan2(rays @ np.cross(forward, pole), rays @ forward)
    elevation = np.arcsin(np.clip(rays @ pole, -1.0, 1.0))
    level = np.abs(elevation) < _LEVEL
    if level.sum() < _FEW:
        return None
    wide, high = neighbour_steps(np.column_stack([azimuth, elevation])[level])
    across, up = _comb(azimuth[level], wide), _comb(elevation, high)
    if across is None or up is None:
        return None
    turn = round(2 * np.pi / across[0])
    if abs(turn * across[0] - 2 * np.pi) < across[0] / 4:
        across = 2 * np.pi / turn, across[1]
    beside = np.cos(elevation) > 2 * up[0]  # at the pole itself every azimuth is as good
    column, azimuths = _numbered(azimuth, *across, beside)
    row, elevations = _numbered(elevation, *up, beside | True)
    if len(azimuths) > turn:  # the seam of a full turn
        column, azimuths = column % turn, azimuths[:turn]
    if min(len(azimuths), len(elevations)) < 2 or np.ptp(azimuths) >= 2 * np.pi + 1e-9:
        return None
    filled = np.zeros((len(elevations), len(azimuths)), np.bool_)
    filled[row, column] = True
    if not is_filled(filled, _FILLED):
        return None
    projection = SphericalProjection(azimuths, elevations[::-1])
    return AngleGrid(pole, projection, forward, len(elevations) - 1 - row, column)


def _numbered(
    angles: FloatArray, step: float, phase: float, telling: BoolArray
) -> tuple[NDArray[np.int64], FloatArray]:
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
    low, high = int(length / (_WIDEST * near)), int(length / (_NARROWEST * near))
    waves = np.arange(max(low, 8), min(high, len(strength) - 1))
    if not len(waves) or strength[waves].max() < _SHARP:
        return None
    first = int(waves[np.argmax(strength[waves] >= _FUNDAMENTAL * strength[waves].max())])
    peak = first + int(np.argmax(strength[first : first + 5]))  # up the slope of the first strong one
    some = angles[:: max(1, len(angles) // (2 * _N_SAMPLE))]

    def at(wave: float) -> complex:
        return complex(np.exp(2j * np.pi * wave / length * some).mean())

    wave = float(
        scipy.optimize.minimize_scalar(
            lambda one: -abs(at(one)), bounds=(peak - 1.0, peak + 1.0), method="bounded"
        ).x
    )
    return length / wave, float(np.angle(at(wave))) * length / (2 * np.pi * wave)
