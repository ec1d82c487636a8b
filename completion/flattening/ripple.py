# SPDX-License-Identifier: MIT
"""Ripple: the systematic error of a wall as a Gaussian field, by which heights are whitened."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from completion.flattening.spectrum import Spectrum
from scenes.checks import BoolArray, FloatArray

_NEIGHBOURHOOD = 25  # cells, over which the strength of the error is compared with the rest of the wall
_LEAST_STRENGTH = 0.7
_OUTLIER = 8  # times the middle size
_FILL_STEPS = 10
_AROUND = 64  # cells around an area, beyond which its whitened field is a hundredth of it
_MOST_WINDOW = 0.5  # of the canvas: areas with larger windows are whitened on all of it


@dataclass(frozen=True, slots=True, eq=False)
class Ripple:
    """Ripple and noise on a canvas.

    Attributes
    ----------
    spectrum : Spectrum
        Of it, as it was estimated.
    power : (rows, columns // 2 + 1) float
        The same on the waves of the canvas, m^2.
    strength : (rows, columns) float
        Local strength of the whitened error, 1 in the middle.
    """

    spectrum: Spectrum
    power: FloatArray
    strength: FloatArray

    @classmethod
    def of(cls, spectrum: Spectrum, shape: tuple[int, int]) -> Ripple:
        """Alike everywhere."""
        return cls(spectrum, spectrum.on(shape), np.ones(shape))

    def filtered(self, field: FloatArray, gain: FloatArray) -> FloatArray:
        """A field (rows, columns) with each wave multiplied by a gain."""
        out: FloatArray = fft.irfft2(fft.rfft2(field) * gain, s=field.shape)
        return out

    def whitened(self, field: FloatArray) -> FloatArray:
        """A field (rows, columns) in which ripple is white noise of unit sd."""
        return self.filtered(field, 1 / np.sqrt(self.power)) / self.strength

    def whitened_areas(self, labels: NDArray[np.int64], known: BoolArray) -> NDArray[np.float32]:
        """Fields (n, m) that are 1 in the area of a label (rows, columns) from 0, whitened, at `known` cells.

        Small areas are whitened in a window around them, beyond which hardly anything is left of them.
        """
        boxes = ndimage.find_objects(labels + 1)
        place = np.cumsum(known.ravel()) - 1
        weak = 1 / self.strength
        columns = np.zeros((len(boxes), int(known.sum())), np.float32)
        windows = dict[tuple[int, int], FloatArray]()
        for number, (column, box) in enumerate(zip(columns, boxes, strict=True)):
            inside = labels[box] == number
            shape = _window(inside.shape)
            if np.prod(shape) > _MOST_WINDOW * labels.size:
                field = self.filtered((labels == number).astype(np.float64), 1 / np.sqrt(self.power))
                column[:] = (field * weak)[known]
                continue
            if shape not in windows:
                windows[shape] = 1 / np.sqrt(self.spectrum.on(shape))
            area = np.zeros(shape)
            area[: inside.shape[0], : inside.shape[1]] = inside
            at = [
                (np.where((along := np.arange(n)) < (n + m) // 2, along, along - n) + side.start) % most
                for n, m, side, most in zip(shape, inside.shape, box, labels.shape, strict=True)
            ]
            cells = at[0][:, None] * labels.shape[1] + at[1]
            seen = known.ravel()[cells]
            column[place[cells[seen]]] = (self.filtered(area, windows[shape]) * weak.ravel()[cells])[seen]
        return columns

    def noise_power(self) -> float:
        """Variance of the noise of single cells, m^2: the floor of the spectrum."""
        return float(np.quantile(self.spectrum.power, 0.5))

    def smoothed(self, field: FloatArray) -> FloatArray:
        """What of a field (rows, columns) is ripple, by its share in each wave (Wiener's filter)."""
        return self.filtered(field, np.maximum(1 - self.noise_power() / self.power, 0))

    def step_energy(self) -> float:
        """Whitened energy of a step of one metre for each cell of its border, 1 / m^2."""
        along_columns = np.concatenate(
            [self.power[0], self.power[0, 1 : -(-self.strength.shape[1] // 2)][::-1]]
        )
        return 0.5 * (_step_energy(along_columns) + _step_energy(self.power[:, 0]))

    def continued(self, error: FloatArray, known: BoolArray) -> FloatArray:
        """An error (rows, columns), most probable where it is not known (conjugate gradients)."""
        filled = error.copy()
        inverse = 1 / self.power
        rest = np.where(known, 0.0, -self.filtered(filled, inverse))
        along, square = rest.copy(), float(np.sum(rest**2))
        for _ in range(_FILL_STEPS):
            if square == 0:
                break
            ahead = np.where(known, 0.0, self.filtered(along, inverse))
            length = square / float(np.sum(along * ahead))
            filled += length * along
            rest -= length * ahead
            square, before = float(np.sum(rest**2)), square
            along = rest + square / before * along
        return filled

    def uneven(self, error: FloatArray, known: BoolArray) -> Ripple:
        """The ripple, with its strength from place to place in a field of error (rows, columns)."""
        size = np.abs(self.filtered(error, 1 / np.sqrt(self.power)))
        size = np.where(known, np.sqrt(np.minimum(size, _OUTLIER * np.median(size[known]))), 0.0)
        share = ndimage.uniform_filter(known.astype(np.float64), _NEIGHBOURHOOD, mode="wrap")
        mean = ndimage.uniform_filter(size, _NEIGHBOURHOOD, mode="wrap") / np.maximum(share, 1e-3)
        middle = float(np.median(mean[known]))
        strength = np.where((share > 0.05) & (middle > 0), (mean / max(middle, 1e-30)) ** 2, 1.0)
        return Ripple(self.spectrum, self.power, np.maximum(strength, _LEAST_STRENGTH))


def _step_energy(power: FloatArray) -> float:
    """Energy of a unit step that crosses waves of `power` (n,)."""
    turn = np.pi * np.arange(1, len(power)) / len(power)
    return float(np.sum(1 / (4 * np.sin(turn) ** 2 * power[1:])) / len(power))


def _window(sides: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns of the window around an area; few different ones, whose transforms are fast."""
    rows, columns = (fft.next_fast_len(-(-(side + 2 * _AROUND) // 16) * 16, real=True) for side in sides)
    return rows, columns
