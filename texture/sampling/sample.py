# SPDX-License-Identifier: MIT
"""The sample: its 8-bit levels, and the pixels that may be copied, with a margin around them."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]
Pixels: TypeAlias = NDArray[Any]  # uint8, or float in 0..1; the dtype is kept from input to result

HIGHEST_LEVEL = 255
ROUNDING = 1e-5  # how far single-precision arithmetic may carry a colour out of 0..1


def quantise(pixels: Pixels, needed: BoolArray) -> IntArray:
    """Round an image (h, w) or (h, w, c), uint8 or float in 0..1, to 8-bit levels (h, w, c), 0..255.

    Only pixels that are needed (h, w) are read; the others become level 0, whatever they hold. Raises
    ValueError: a needed pixel is not finite or lies outside 0..1.

    Examples
    --------
    >>> quantise(np.array([[0.0, 0.4, np.nan]]), np.array([[True, True, False]]))[..., 0]
    array([[  0, 102,   0]])
    """
    channels = pixels if pixels.ndim == 3 else pixels[..., None]
    read = np.where(needed[..., None], channels, np.zeros((), dtype=pixels.dtype))
    if pixels.dtype == np.uint8:
        levels = read.astype(np.int64)
    else:
        _check_range(read)
        levels = np.rint(np.clip(read.astype(np.float64), 0, 1) * HIGHEST_LEVEL).astype(np.int64)
    levels.flags.writeable = False  # so that a sample may keep it as it is
    return levels


def _check_range(read: Pixels) -> None:
    is_bad = ~np.isfinite(read).all(axis=2)
    if is_bad.any():
        row, column = np.argwhere(is_bad)[0]
        raise ValueError(
            f"image: {np.count_nonzero(is_bad)} of {is_bad.size} pixels are known but not finite (first at "
            f"row {row}, column {column}); mask them, or exclude them by `known` (for grow: by `sample_mask`)"
        )
    lowest, highest = float(read.min()), float(read.max())
    if lowest < -ROUNDING or highest > 1 + ROUNDING:
        raise ValueError(
            f"image: expected float values in 0..1, got {lowest:.4g}..{highest:.4g}; "
            "divide by the largest possible value, or pass 8-bit values as uint8"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """The pixels that may be copied, with a margin around them.

    Parameters
    ----------
    levels : array, shape (h, w, c), int64
        8-bit levels.
    usable : array, shape (h, w), bool
        Which pixels may be copied, and be compared with.
    wrap : (bool, bool)
        Whether rows and columns close on themselves.
    radius : int
        How far a window reaches from its centre, pixels, at least 1.

    Attributes
    ----------
    positions : array, shape (n,), int64
        The usable pixels in raster order, row * w + column.
    margin : int
        Width of the margin: one pixel more than the radius.
    padded_levels : array, shape (h + 2 margin, w + 2 margin, c), int64
        The levels with their margin: the other side's where an axis wraps.
    padded_usable : array, shape (h + 2 margin, w + 2 margin), bool
        Which of them may be compared with: outside the sample none.

    Examples
    --------
    >>> sample = Sample(np.arange(6).reshape(1, 6, 1), np.ones((1, 6), bool), (False, True), radius=1)
    >>> sample.padded_levels[sample.margin, :, 0]
    array([4, 5, 0, 1, 2, 3, 4, 5, 0, 1])
    """

    levels: IntArray
    usable: BoolArray
    wrap: tuple[bool, bool]
    radius: int
    margin: int = field(init=False)
    positions: IntArray = field(init=False)
    padded_levels: IntArray = field(init=False)
    padded_usable: BoolArray = field(init=False)

    def __post_init__(self) -> None:
        margin = self.radius + 1
        rows, is_row = _extend(self.usable.shape[0], margin, self.wrap[0])
        columns, is_column = _extend(self.usable.shape[1], margin, self.wrap[1])
        inside = is_row[:, None] & is_column
        derived = {
            "levels": self.levels.copy() if self.levels.flags.writeable else self.levels,
            "usable": self.usable.copy(),
            "positions": np.flatnonzero(self.usable).astype(np.int64),
            "padded_levels": self.levels[rows[:, None], columns],
            "padded_usable": self.usable[rows[:, None], columns] & inside,
        }
        for name, array in derived.items():
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "margin", margin)


def _extend(size: int, margin: int, wraps: bool) -> tuple[IntArray, BoolArray]:
    """Return the index of each pixel of an axis with its margin, and whether there is such a pixel."""
    indices = np.arange(-margin, size + margin)
    inside = (indices >= 0) & (indices < size)
    return indices % size, inside | wraps


WEIGHT_LEVELS = 2**14 - 1  # 14 bits: distances are exact int64 sums, the same on any machine
SIGMA_PER_WINDOW = 1 / 6.4  # Efros's own page: sigma = window / 6.4


class PixelTemplate(NamedTuple):
    """The window around an unfilled pixel.

    One is read per pixel and never kept, so it is a plain record without copies.

    Parameters
    ----------
    levels : array, shape (window, window, c), int64
        8-bit levels; meaningless where unknown.
    known : array, shape (window, window), bool
        Which pixels of the window hold a value.
    """

    levels: IntArray
    known: BoolArray

    def narrow(self, window: int) -> "PixelTemplate":
        """Return the template with nothing known outside its central `window` x `window` pixels."""
        size = self.known.shape[0]
        rim = (size - window) // 2
        known = np.zeros_like(self.known)
        known[rim : size - rim, rim : size - rim] = self.known[rim : size - rim, rim : size - rim]
        return self._replace(known=known)


class MatchingPlaces(NamedTuple):
    """The places of the sample that resemble a template nearly as much as the best one.

    Parameters
    ----------
    positions : array, shape (n,), int64
        row * width + column in the sample, in raster order.
    distances : array, shape (n,), int64
        Weighted sum of squared differences of 8-bit levels, exact.
    largest_distance : int
        What the distance would be if every known pixel of the template differed by 255.
    """

    positions: IntArray
    distances: IntArray
    largest_distance: int


def gaussian_weights(window: int) -> IntArray:
    """Return the weights (window, window) of a window's pixels, its side odd and at most 99.

    1..16383, largest in the centre; no pixel of the window counts nothing.

    Examples
    --------
    >>> gaussian_weights(3)
    array([[  173,  1683,   173],
           [ 1683, 16383,  1683],
           [  173,  1683,   173]])
    """
    offsets = np.arange(window) - window // 2
    squared = offsets[:, None] ** 2 + offsets**2
    sigma = window * SIGMA_PER_WINDOW
    weights: IntArray = np.rint(WEIGHT_LEVELS * np.exp(-squared / (2 * sigma**2))).astype(np.int64)
    return weights


def find_candidates(template: PixelTemplate, sample: Sample) -> MatchingPlaces:
    """Find the candidates, at least one, for a template (Efros & Leung 1999, section 2.1).

    A position competes when every known pixel of the template has a counterpart among the sample's pixels
    ("template-adaptive": nothing is asked of the unknown ones). If none competes - the sample is smaller than
    the window, or in pieces - the template is narrowed by one ring at a time, down to 3 x 3. If even then
    none does, all sample pixels compete on the 3 x 3 template, and a missing counterpart counts as a
    difference of 255 in each channel.

    Of the template at least one pixel among the eight around its centre is known; the sample has the same
    radius and is not empty.
    """
    for window in range(template.known.shape[0], 1, -2):
        narrowed = template.narrow(window)
        candidates = scan_exhaustively(narrowed, sample)
        if candidates.positions.size:
            return candidates
    distances, missing_weights = measure_distances(narrowed, sample)
    largest_difference = sample.levels.shape[2] * HIGHEST_LEVEL**2
    return _select(distances + missing_weights * largest_difference, narrowed, sample, sample.positions)


def scan_exhaustively(template: PixelTemplate, sample: Sample) -> MatchingPlaces:
    """Return the competing positions with distance <= 1.1 * smallest; none if none competes."""
    distances, missing_weights = measure_distances(template, sample)
    competes = missing_weights == 0
    return _select(distances[competes], template, sample, sample.positions[competes])


def measure_distances(template: PixelTemplate, sample: Sample) -> tuple[IntArray, IntArray]:
    """Measure how much the surroundings of each sample pixel differ from a template.

    Returns
    -------
    distances : array, shape (n,), int64
        For each of `sample.positions`: the sum, over the known pixels that have a counterpart in the sample,
        of Gaussian weight times squared difference over the channels.
    missing_weights : array, shape (n,), int64
        The sum of the weights of the known pixels that have none.
    """
    height, width = sample.usable.shape
    weights = gaussian_weights(template.known.shape[0])
    distances = np.zeros((height, width), dtype=np.int64)
    missing_weights = np.zeros((height, width), dtype=np.int64)
    for row, column in np.argwhere(template.known):
        top, left = row + sample.margin - sample.radius, column + sample.margin - sample.radius
        shifted = np.s_[top : top + height, left : left + width]
        squared = ((sample.padded_levels[shifted] - template.levels[row, column]) ** 2).sum(axis=2)
        has_counterpart = sample.padded_usable[shifted]
        distances += weights[row, column] * np.where(has_counterpart, squared, 0)
        missing_weights += weights[row, column] * ~has_counterpart
    return distances[sample.usable], missing_weights[sample.usable]


def _select(
    distances: IntArray, template: PixelTemplate, sample: Sample, positions: IntArray
) -> MatchingPlaces:
    """Keep what is at most 1.1 times as far as the nearest: 10 d <= 11 d_min, in whole numbers."""
    weights = gaussian_weights(template.known.shape[0])
    largest = int(weights[template.known].sum()) * sample.levels.shape[2] * HIGHEST_LEVEL**2
    is_near = 10 * distances <= 11 * distances.min(initial=largest)
    return MatchingPlaces(positions[is_near], distances[is_near], largest)
