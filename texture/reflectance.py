# SPDX-License-Identifier: MIT
"""Reflectance: the shading of a surface's image apart, and plain reflectance recognised and filled.

A texture that is lit from one side matches nothing on the other; what is matched should be reflectance. The
logarithm of brightness is fitted by a quadratic of the place (log-quadratic shading); along an axis that
closes on itself by one wave, so that it closes too.

A plain surface has one colour, and its pixels differ by noise alone. Matching noise chooses what resembles it
by chance, which grows garbage: such a surface is filled by its robust mean and its noise, each pixel a random
one of the sample's usual pixels.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from texture.sampling.canvas import Canvas
from texture.sampling.limits import DARKEST, IRRELEVANT, UNUSUAL
from texture.sampling.randomness import Purpose, random_words
from texture.sampling.sample import BoolArray, FloatArray, IntArray, Sample

_ROUNDS = 10  # of reweighting
_MOST_PIXELS = 20_000  # that are fitted


@dataclass(frozen=True, slots=True, eq=False)
class Shading:
    """How bright a surface is lit at each pixel, relative to its mean: pixel = reflectance * gain.

    Attributes
    ----------
    gain : array, shape (h, w) or (h, w, c), float32
        Its geometric mean over the known pixels is 1. Beyond their convex hull it is that of the nearest
        place on it, and nowhere beyond what is seen among them: what fits well need not go on so.
    """

    gain: NDArray[np.float32]

    def __post_init__(self) -> None:
        gain = np.array(self.gain)
        gain.flags.writeable = False
        object.__setattr__(self, "gain", gain)

    def __repr__(self) -> str:
        low, high = self.gain.min(initial=1.0), self.gain.max(initial=1.0)
        return f"Shading(gain of {self.gain.shape} pixels, {low:.3g} to {high:.3g})"


def fit_shading(
    brightness: NDArray[np.floating[Any]], known: BoolArray, wrap: tuple[bool, bool] = (False, False)
) -> Shading:
    """Fit log-quadratic shading to the known pixels, robustly (Huber's weights).

    Parameters
    ----------
    brightness : array, shape (h, w) or (h, w, c), float
        0..1 where known; each channel is fitted by itself.
    known : array, shape (h, w), bool
        Pixels to fit.
    wrap : (bool, bool)
        Whether rows and columns close on themselves.

    Returns
    -------
    Shading
        1 everywhere when fewer pixels are known than the fit has parameters.

    Examples
    --------
    >>> light = np.exp(np.linspace(-0.5, 0.5, 50) * np.ones((40, 1)))
    >>> fitted = fit_shading(0.4 * light, np.ones(light.shape, bool)).gain
    >>> bool(np.abs(fitted / light - 1).max() < 1e-6)
    True
    """
    height, width = known.shape
    down, across = _list_waves(height, wrap[0]), _list_waves(width, wrap[1])
    places = np.flatnonzero(known)
    places = places[:: -(-places.size // _MOST_PIXELS)] if places.size else places
    row, column = np.divmod(places, width)
    design = np.stack(
        [np.ones(places.size), *(wave[row] for wave in down), *(wave[column] for wave in across)]
        + [down[0][row] * across[0][column]],
        axis=1,
    )
    channels = brightness.reshape(known.size, -1)
    gain = np.ones((height, width, channels.shape[1]), np.float32)
    if places.size >= design.shape[1]:
        there = _nearest_within_hull(known, wrap)
        for channel in range(channels.shape[1]):
            logarithms = np.log(np.maximum(channels[places, channel], DARKEST))
            mean, b1, two, three, four, both = _fit_robustly(design, logarithms)
            logs = (mean + b1 * down[0] + two * down[1])[:, None] + three * across[0] + four * across[1]
            logs += both * down[0][:, None] * across[0]
            seen = logs[known]
            gain[..., channel] = np.exp(np.clip(logs[there], seen.min(), seen.max()) - seen.mean())
    return Shading(gain.reshape(brightness.shape))


def _nearest_within_hull(known: BoolArray, wrap: tuple[bool, bool]) -> tuple[IntArray, ...]:
    """Return the row and column of each pixel's nearest within the known pixels' hull: there its own.

    The hull of what closes on itself is taken along the other axis alone.
    """
    if wrap[0] or wrap[1]:
        hull = np.ones(known.shape, dtype=np.bool_)
        rows, columns = np.asarray(known.any(axis=1)), np.asarray(known.any(axis=0))
        hull &= wrap[0] | _span(rows)[:, None]
        hull &= wrap[1] | _span(columns)
    else:
        from skimage.morphology import convex_hull_image  # slow to load: only where something is filled

        hull = np.asarray(convex_hull_image(known), dtype=np.bool_) | known
    return tuple(scipy.ndimage.distance_transform_edt(~hull, return_distances=False, return_indices=True))


def _span(marked: BoolArray) -> BoolArray:
    """Return what lies between the first and the last marked place."""
    return np.asarray(np.logical_or.accumulate(marked) & np.logical_or.accumulate(marked[::-1])[::-1])


def _list_waves(size: int, wraps: bool) -> list[FloatArray]:
    """Return the two functions of an axis: x and x**2 for x in -1..1, or a sine and a cosine."""
    if wraps:
        angle = 2 * np.pi * np.arange(size) / size
        return [np.sin(angle), np.cos(angle)]
    place = np.linspace(-1, 1, size) if size > 1 else np.zeros(1)
    return [place, place**2]


def _fit_robustly(design: FloatArray, values: FloatArray) -> FloatArray:
    """Return the parameters of a linear fit in which pixels far off count less."""
    weights = np.ones(values.size)
    for _ in range(_ROUNDS):
        roots = np.sqrt(weights)
        parameters = np.linalg.lstsq(design * roots[:, None], values * roots, rcond=None)[0]
        residuals = np.abs(values - design @ parameters)
        scale = 1.345 * 1.4826 * _median(residuals)
        weights = np.minimum(1.0, scale / np.maximum(residuals, 1e-12)) if scale > 0 else weights
    return np.asarray(parameters, dtype=np.float64)


def _median(values: FloatArray) -> float:
    """Return what `np.median` does of finite values, at half its cost where there are few."""
    middle = values.size // 2
    if values.size % 2:
        return float(np.partition(values, middle)[middle])
    return float(np.partition(values, (middle - 1, middle))[middle - 1 : middle + 1].mean())


LAGS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0))


def is_plain(levels: IntArray, usable: BoolArray) -> bool:
    """Say whether a sample's pixels differ by noise alone: no correlation between close ones.

    Levels (h, w, c) are of 8 bits; usable (h, w) are the sample's pixels. Those further than 3 robust
    standard deviations from the median count as that far, so that a few specks hide nothing. Correlated means
    by more than 4 standard errors, 4 / sqrt(pairs), and by more than 0.05.

    Examples
    --------
    >>> noise = np.random.default_rng(0).normal(90, 5, (60, 60, 1)).astype(np.int64)
    >>> everywhere = np.ones((60, 60), bool)
    >>> is_plain(noise, everywhere), is_plain(noise.cumsum(axis=1) % 256, everywhere)
    (True, False)
    """
    limits = _list_limits(levels[usable])
    clipped = np.clip(levels, *limits)
    return all(
        _is_uncorrelated(clipped[..., channel].astype(np.float64), usable)
        for channel in range(levels.shape[2])
    )


def fill_plainly(canvas: Canvas, sample: Sample, key: int) -> None:
    """Fill all that is unfilled with random ones of the sample's usual pixels; nothing is compared."""
    width = sample.usable.shape[1]
    chosen = sample.levels[sample.usable]
    low, high = _list_limits(chosen)
    usual = sample.positions[((chosen >= low) & (chosen <= high)).all(axis=1)]
    usual = usual if usual.size else sample.positions
    unfilled = np.flatnonzero(canvas.unfilled)
    words = random_words(key, Purpose.PICK, 0, unfilled)
    picks = (words >> np.uint64(32)) * np.uint64(usual.size) >> np.uint64(32)
    for pixel, source in zip(unfilled.tolist(), usual[picks.astype(np.int64)].tolist(), strict=True):
        row, column = divmod(pixel, canvas.unfilled.shape[1])
        canvas.write(row, column, source, sample.levels[divmod(source, width)], 0.0)


def _list_limits(chosen: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest usual level of each channel; at least one level apart."""
    middle = np.median(chosen, axis=0)
    spread = np.maximum(1.4826 * np.median(np.abs(chosen - middle), axis=0), 1.0)
    return middle - UNUSUAL * spread, middle + UNUSUAL * spread


def _is_uncorrelated(values: FloatArray, usable: BoolArray) -> bool:
    height, width = values.shape
    centred = values - values[usable].mean()
    variance = (centred[usable] ** 2).mean()
    for down, right in LAGS:
        first = np.s_[: height - down, max(0, -right) : width - max(0, right)]
        second = np.s_[down:, max(0, right) : width + min(0, right)]
        both = usable[first] & usable[second]
        n_pairs = np.count_nonzero(both)
        if n_pairs and variance > 0:
            correlation = (centred[first] * centred[second])[both].mean() / variance
            if abs(correlation) > max(IRRELEVANT, 4 / np.sqrt(n_pairs)):
                return False
    return True
