# SPDX-License-Identifier: MIT
"""Ripple: the systematic error of a wall as a Gaussian field, by which heights are whitened."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from completion.flattening import limits
from scenes.checks import BoolArray, FloatArray

_HOP = 8  # cells from one window to the next
_LONGEST = 24  # cells: waves that are longer are not told from slopes
_FALL = 4  # power of the wave length by which longer waves are taken to be stronger


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """Power (size, size // 2 + 1) of each wave in a window, as of white noise of that variance, m^2."""

    power: FloatArray

    def on(self, shape: tuple[int, int], fall: int = _FALL) -> FloatArray:
        """The power on the frequencies of a real transform of a field of `shape`.

        Waves that are longer than half the shortest window cannot be told from a slope there. They are taken
        to be the stronger the longer they are, by the power `fall` of their length: of them no step is
        inferred.
        """
        size = len(self.power)
        rows = fft.fftfreq(shape[0])[:, None] * size
        columns = fft.rfftfreq(shape[1])[None] * size
        waves = np.hypot(rows, columns)
        waves[0, 0] = 0.5 * min(np.abs(rows[1, 0]), columns[0, 1])
        stretch = np.maximum(1.0, size / _LONGEST / waves)
        rows, columns = rows * stretch, columns * stretch
        columns[0, 0] = size / _LONGEST
        log = np.log(self.power)
        at = [rows % size, columns]
        near = ndimage.map_coordinates(np.concatenate([log, log[:1]]), at, order=1, mode="nearest")
        power: FloatArray = np.exp(near) * np.minimum(stretch, 30) ** fall
        return power


def estimate_spectrum(heights: FloatArray, known: BoolArray, quantile: float, window: int) -> Spectrum:
    """The spectrum of heights (rows, columns) that hold relief in fewer than 1 - `quantile` of all windows.

    Of each wave the power in many windows is exponentially distributed where there is ripple and noise alone,
    larger where a step lies in the window. A low quantile sees the former: -log(1 - quantile) of its mean.
    """
    size = min(window, min(heights.shape) // 2 * 2)
    taper = np.hanning(size + 2)[1:-1]
    weight = np.outer(taper, taper)
    weight /= np.sqrt(np.sum(weight**2))
    rows, columns = (np.unique(np.r_[0 : n - size : _HOP, n - size]) for n in heights.shape)
    seen = ndimage.uniform_filter(known.astype(np.float64), size, mode="constant")
    half = size // 2
    corners = [(i, j) for i in rows for j in columns if seen[i + half, j + half] >= limits.MOST_KNOWN]
    if not corners:
        best = np.unravel_index(np.argmax(seen[rows + half][:, columns + half]), (len(rows), len(columns)))
        corners = [(rows[best[0]], columns[best[1]])]
    across = np.linspace(-1, 1, size)
    slopes = np.stack([np.ones((size, size)), *np.broadcast_arrays(across[:, None], across)]).reshape(3, -1)
    squared = weight.ravel() ** 2
    normal = np.linalg.inv((slopes * squared) @ slopes.T)
    powers = np.empty((len(corners), size, size // 2 + 1))
    for power, (i, j) in zip(powers, corners, strict=True):
        part = heights[i : i + size, j : j + size].ravel()
        part = part - (normal @ (slopes @ (squared * part))) @ slopes
        power[:] = np.abs(fft.rfft2(part.reshape(size, size) * weight)) ** 2
    spectrum_values = np.quantile(powers, quantile, axis=0) / -np.log1p(-quantile)
    spectrum_values = np.maximum(spectrum_values, 1e-9 * spectrum_values.max() + 1e-30)
    return Spectrum(spectrum_values * _directional_gain(powers / spectrum_values, quantile))


def _directional_gain(ratios: FloatArray, quantile: float) -> FloatArray:
    """By how much waves of each length are stronger in a usual window than those of a fixed direction.

    In rings, or in stripes that turn, each direction is strong in few windows and the quantile of each wave
    misses them all; but in every window some direction is strong. `ratios` (n, size, size // 2 + 1) is the
    power in each window over that of all. A usual window's strongest wave of a length is compared with the
    largest of as many exponential variates, the mean of its waves with one.
    """
    size = ratios.shape[1]
    rows, columns = np.fft.fftfreq(size)[:, None] * size, np.arange(size // 2 + 1)[None]
    length = np.rint(np.hypot(rows, columns)).astype(np.int64)
    gain = np.ones(length.shape)
    for k in range(1, int(length.max()) + 1):
        waves = ratios[:, length == k]
        most = np.quantile(waves.max(axis=1), quantile) / (np.log(waves.shape[1]) + np.euler_gamma)
        gain[length == k] = max(1.0, most, np.quantile(waves.mean(axis=1), quantile))
    return gain


_NEIGHBOURHOOD = 25  # cells, over which the strength of the error is compared with the rest of the wall
_FILL_STEPS = 10
_AROUND = 64  # cells around an area, beyond which its whitened field is a hundredth of it


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

    def apply_gain(self, field: FloatArray, gain: FloatArray) -> FloatArray:
        """A field (rows, columns) with each wave multiplied by a gain."""
        out: FloatArray = fft.irfft2(fft.rfft2(field) * gain, s=field.shape)
        return out

    def whiten(self, field: FloatArray) -> FloatArray:
        """A field (rows, columns) in which ripple is white noise of unit sd."""
        return self.apply_gain(field, 1 / np.sqrt(self.power)) / self.strength

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
            if np.prod(shape) > limits.MOST_WINDOW * labels.size:
                field = self.apply_gain((labels == number).astype(np.float64), 1 / np.sqrt(self.power))
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
            column[place[cells[seen]]] = (self.apply_gain(area, windows[shape]) * weak.ravel()[cells])[seen]
        return columns

    def noise_power(self) -> float:
        """Variance of the noise of single cells, m^2: the floor of the spectrum."""
        return float(np.quantile(self.spectrum.power, 0.5))

    def smooth(self, field: FloatArray) -> FloatArray:
        """What of a field (rows, columns) is ripple, by its share in each wave (Wiener's filter)."""
        return self.apply_gain(field, np.maximum(1 - self.noise_power() / self.power, 0))

    def step_energy(self) -> float:
        """Whitened energy of a step of one metre for each cell of its border, 1 / m^2."""
        along_columns = np.concatenate(
            [self.power[0], self.power[0, 1 : -(-self.strength.shape[1] // 2)][::-1]]
        )
        return 0.5 * (_step_energy(along_columns) + _step_energy(self.power[:, 0]))

    def extrapolate(self, error: FloatArray, known: BoolArray) -> FloatArray:
        """An error (rows, columns), most probable where it is not known (conjugate gradients)."""
        filled = error.copy()
        inverse = 1 / self.power
        residual = np.where(known, 0.0, -self.apply_gain(filled, inverse))
        along, square = residual.copy(), float(np.sum(residual**2))
        for _ in range(_FILL_STEPS):
            if square == 0:
                break
            ahead = np.where(known, 0.0, self.apply_gain(along, inverse))
            length = square / float(np.sum(along * ahead))
            filled += length * along
            residual -= length * ahead
            square, before = float(np.sum(residual**2)), square
            along = residual + square / before * along
        return filled

    def with_local_strength(self, error: FloatArray, known: BoolArray) -> Ripple:
        """The ripple with a local strength, estimated from an error field; both (rows, columns)."""
        size = np.abs(self.apply_gain(error, 1 / np.sqrt(self.power)))
        size = np.where(known, np.sqrt(np.minimum(size, limits.OUTLIER * np.median(size[known]))), 0.0)
        share = ndimage.uniform_filter(known.astype(np.float64), _NEIGHBOURHOOD, mode="wrap")
        mean = ndimage.uniform_filter(size, _NEIGHBOURHOOD, mode="wrap") / np.maximum(share, 1e-3)
        middle = float(np.median(mean[known]))
        strength = np.where((share > 0.05) & (middle > 0), (mean / max(middle, 1e-30)) ** 2, 1.0)
        return Ripple(self.spectrum, self.power, np.maximum(strength, limits.LEAST_STRENGTH))


def _step_energy(power: FloatArray) -> float:
    """Energy of a unit step that crosses waves of `power` (n,)."""
    turn = np.pi * np.arange(1, len(power)) / len(power)
    return float(np.sum(1 / (4 * np.sin(turn) ** 2 * power[1:])) / len(power))


def _window(sides: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns of the window around an area; few different ones, whose transforms are fast."""
    rows, columns = (fft.next_fast_len(-(-(side + 2 * _AROUND) // 16) * 16, real=True) for side in sides)
    return rows, columns


MARGIN = 48  # cells at least, between one side and the other


def extend(field: FloatArray, *, fades: bool) -> FloatArray:
    """A field (rows, columns) with margins that lead from its last row to its first, and so for columns.

    Behind the end lies its mirror image, before the start too; where they meet one fades into the other, or
    there is a jump.
    """
    return _extend_axis(_extend_axis(field, 0, fades), 1, fades)


def _extend_axis(field: FloatArray, axis: int, fades: bool) -> FloatArray:
    """The field with a margin behind its end along an axis."""
    ahead = np.moveaxis(field, axis, 0)
    n = len(ahead)
    away = np.arange(fft.next_fast_len(n + MARGIN, real=True) - n)
    share = ((away + 1) / (len(away) + 1))[:, None]
    share = share**2 * (3 - 2 * share) if fades else np.where(share > 0.5, 1.0, 0.0)
    behind = (1 - share) * ahead[_mirror(n + away, n)] + share * ahead[_mirror(away - len(away), n)]
    return np.moveaxis(np.concatenate([ahead, behind]), 0, axis)


def _mirror(index: FloatArray, n: int) -> FloatArray:
    """Indices beyond 0 .. n - 1 by mirroring."""
    turned = index % (2 * n)
    return np.where(turned < n, turned, 2 * n - 1 - turned)


def fill_gaps(heights: FloatArray, known: BoolArray) -> FloatArray:
    """Heights (rows, columns) with gaps filled smoothly, from the finest scale that reaches them."""
    values, weights = np.where(known, heights, 0.0), known.astype(np.float64)
    enough = min(
        limits.ENOUGH_KNOWN, 0.5 * float(weights.mean())
    )  # at the coarsest scale it is the mean everywhere
    filled, left = values.copy(), ~known
    scale = 1.0
    while left.any():
        total = ndimage.gaussian_filter(values, scale, mode="reflect", truncate=3)
        weight = ndimage.gaussian_filter(weights, scale, mode="reflect", truncate=3)
        reached = left & (weight > enough)
        filled[reached] = total[reached] / weight[reached]
        left &= ~reached
        scale *= 2
    return filled


def without_jumps(heights: FloatArray) -> FloatArray:
    """Heights (rows, columns) without their jumps.

    They are rebuilt from the differences of neighbours, the outliers among these left out. What is rebuilt
    has the differences nearest to these in least squares, by the cosine transform.
    """
    rows, columns = heights.shape
    down, right = np.diff(heights, axis=0), np.diff(heights, axis=1)
    sources = np.zeros(heights.shape)
    for difference, axis in ((down, 0), (right, 1)):
        usual = limits.JUMP_OUTLIER * 1.4826 * np.median(np.abs(difference - np.median(difference)))
        kept = np.where(np.abs(difference) <= usual, difference, 0.0)
        wide = np.pad(kept, [(1, 1) if k == axis else (0, 0) for k in range(2)])
        sources += np.diff(wide, axis=axis)
    waves = 2 * (
        np.cos(np.pi * np.arange(rows) / rows)[:, None] + np.cos(np.pi * np.arange(columns) / columns) - 2
    )
    waves[0, 0] = 1.0
    potential = fft.dctn(sources, norm="ortho") / waves
    potential[0, 0] = heights.mean() * np.sqrt(heights.size)
    out: FloatArray = fft.idctn(potential, norm="ortho")
    return out


def find_spikes(heights: FloatArray, known: BoolArray) -> BoolArray:
    """Known cells (rows, columns) far from all their neighbours but one: mixed pixels, no surface."""
    wide = np.pad(np.where(known, heights, np.nan), 1, constant_values=np.nan)
    rows, columns = heights.shape
    away = np.stack(
        [
            np.abs(wide[1 + a : 1 + a + rows, 1 + b : 1 + b + columns] - heights)
            for a in (-1, 0, 1)
            for b in (-1, 0, 1)
            if a or b
        ]
    )
    differ = away[:, known]
    differ = differ[differ > 0]  # exactly flat cells say nothing of the noise
    if not len(differ):
        return np.zeros_like(known)
    near = np.sum(away <= limits.SPIKE * np.median(differ), axis=0)
    is_member: BoolArray = known & (near <= 1) & (np.sum(np.isfinite(away), axis=0) >= 3)
    return is_member
