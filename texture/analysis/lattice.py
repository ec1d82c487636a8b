# SPDX-License-Identifier: MIT
"""The lattice of a repeating texture, and how far a fill is out of step with it.

Joints of brick or tile that do not meet across a hole are what an eye sees first; distances between patches
do not show it, because every patch by itself is right.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import ArrayLike

from texture.analysis.phase import Correlator, cut_tiles, measure_tiles
from texture.analysis.quality import read_levels
from texture.sampling.arguments import check_known, check_mask
from texture.sampling.sample import HIGHEST_LEVEL, BoolArray, FloatArray, IntArray

REPEATED = 0.35  # correlation from which a texture is said to repeat
VALLEY = 0.2  # how far the correlation falls between a pixel and its repetition
ALIKE = 0.85  # of the highest correlation: a shorter repetition that is nearly as good is the period
LEAST_OVERLAP = 0.25  # share of the pixels that must meet others for a correlation to be believed
IN_STEP = 0.1  # of the period: what a lattice may miss its own texture by
ASIDE_DEG = 20.0  # a second period points at least so far away from the first
NEIGHBOURHOOD = 128  # pixels around a hole in which its lattice is looked for, or its own size
_BESIDE = np.array(sorted(product((-1, 0, 1), repeat=2), key=np.linalg.norm))  # itself first


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Displacements after which a texture repeats.

    Attributes
    ----------
    periods : array, shape (n, 2), float64
        Rows and columns, in pixels: none, one (stripes, courses without a bond) or two, the shorter first.
    correlation : float
        Autocorrelation of the texture at the first; 0 without a lattice.
    """

    periods: FloatArray
    correlation: float

    def __post_init__(self) -> None:
        periods = np.array(self.periods, dtype=np.float64).reshape(-1, 2)
        periods.flags.writeable = False
        object.__setattr__(self, "periods", periods)


def find_lattice(image: ArrayLike, mask: ArrayLike | None = None) -> Lattice:
    """Find the periods of a repeating texture from its autocorrelation.

    The correlation r(d) is that of all pairs of pixels at displacement d within the mask, over all channels,
    each centred on the mean of its own partners. A period is the shortest d at a maximum of r, not less than
    0.35 and 0.85 of the highest, with a valley at least 0.2 deep on the way to it. The second is the next
    shortest, at least 20 degrees aside; of its repetitions by the first the shortest must lie beyond a
    valley too, because along stripes everything repeats. A lattice is believed when the texture itself is in
    step with it, every second of its tiles taken, to a tenth of the period on average
    (`measure_phase_error`): otherwise one period alone is tried, or there is none.

    Parameters
    ----------
    image : array, shape (h, w) or (h, w, c)
        uint8, or float in 0..1.
    mask : array, shape (h, w), optional
        Non-zero where the image belongs to the texture; default: everywhere.

    Returns
    -------
    Lattice
        Periods are refined to fractions of a pixel by their repetitions; up to a third of the image's
        sides is looked at: what does not come three times is no lattice.

    Examples
    --------
    >>> stripes = np.tile(np.repeat([20, 220], 4).astype(np.uint8), (40, 5))
    >>> find_lattice(stripes).periods
    array([[0., 8.]])
    """
    values, within = read_levels(image, mask, "image")
    if not within.any():
        return Lattice(np.empty((0, 2)), 0.0)
    reach = (within.shape[0] // 3, within.shape[1] // 3)
    correlation, counts = Correlator(values, within, reach).correlate_itself()
    is_believed = counts >= LEAST_OVERLAP * np.count_nonzero(within)
    correlation = np.where(is_believed, correlation.round(6), -1.0)  # what is equal shall be so
    choices = _list_choices(correlation, reach)
    if not choices:
        return Lattice(np.empty((0, 2)), 0.0)
    correlator = Correlator(values, within)
    for chosen in choices:
        periods = np.array([_refine(correlation, reach, period) for period in chosen])
        if measure_tiles(correlator, values, cut_tiles(within, periods)[::2], periods) <= IN_STEP:
            at = tuple(chosen[0] + np.array(reach))
            return Lattice(periods, float(correlation[at]))
    return Lattice(np.empty((0, 2)), 0.0)


def measure_phase_error(
    image: ArrayLike, hole: ArrayLike, known: ArrayLike | None = None, lattice: Lattice | None = None
) -> float:
    """Measure how far a fill is out of step with the lattice around it, as a fraction of the period.

    The hole is cut into tiles, each at least a period and a quarter of the hole wide. For a tile T and a
    displacement s within one cell of the lattice, A(s) is the mean correlation of T with what is known at
    k p + s, over the eight nearest repetitions k p at which at least half of T meets known pixels. The tile
    is out of step by the s of the highest A, in periods: s = a p1 + b p2 with `|a|, |b| <= 1/2`, and the
    larger of `|a|` and `|b|` counts. With one period, s lies along it.

    Parameters
    ----------
    image : array, shape (h, w) or (h, w, c)
        Filled.
    hole : array, shape (h, w)
        Non-zero where it was filled.
    known : array, shape (h, w), optional
        Non-zero where the image held a value; default: everywhere outside the hole.
    lattice : Lattice, optional
        Of the texture; default: that of the known part within 128 pixels, or as
        far as the hole is wide.

    Returns
    -------
    float
        0..1/2, the mean over the tiles, to one pixel: 0 in step, at random 1/4 (one period) or 1/3 (two). A
        tile without any contrast counts as 1/2. NaN where the known part has no lattice, or lies nowhere
        whole periods away.

    Raises
    ------
    ValueError
        When an argument has a wrong shape, type or range.

    Examples
    --------
    >>> stripes = np.tile(np.repeat([20, 220], 4).astype(np.uint8), (40, 5))
    >>> hole = np.zeros(stripes.shape, bool)
    >>> hole[12:28, 12:28] = True
    >>> measure_phase_error(np.where(hole, np.roll(stripes, 2, axis=1), stripes), hole)
    0.25
    """
    values, everywhere = read_levels(image, None, "image")
    within = check_mask(hole, everywhere.shape, "hole")
    around = check_known(known, within)
    if not within.any():
        return float("nan")
    if lattice is None:
        near = _box_around(within, max(NEIGHBOURHOOD, *np.ptp(np.argwhere(within), axis=0)))
        lattice = find_lattice(np.clip(values[near] / HIGHEST_LEVEL, 0, 1), around[near])
    if not len(lattice.periods):
        return float("nan")
    tiles = cut_tiles(within, lattice.periods)
    side = max(int(np.ptp(np.argwhere(tile), axis=0).max()) for tile in tiles)
    near = _box_around(within, side + 2 * int(np.abs(lattice.periods).max()) + 2)
    correlator = Correlator(values[near], around[near])
    return measure_tiles(correlator, values[near], [tile[near] for tile in tiles], lattice.periods)


def _box_around(within: BoolArray, margin: int) -> tuple[slice, slice]:
    """Return the box of a mask, with a margin as far as the image goes."""
    rows, columns = np.nonzero(within)
    first = max(0, int(rows.min()) - margin), max(0, int(columns.min()) - margin)
    return np.s_[first[0] : int(rows.max()) + margin + 1, first[1] : int(columns.max()) + margin + 1]


def _list_choices(correlation: FloatArray, reach: tuple[int, int]) -> list[tuple[IntArray, ...]]:
    """List what the periods may be, the best guess first: two, or one of them."""
    peaks = _list_peaks(correlation, reach)
    for other in peaks[1:]:
        shortest = _shorten(other, peaks[0])
        if _is_aside(peaks[0], other) and _is_beyond_valley(correlation, reach, shortest):
            return [(peaks[0], shortest), (peaks[0],), (shortest,)]
    return [(peak,) for peak in peaks[:1]]


def _list_peaks(correlation: FloatArray, reach: tuple[int, int]) -> IntArray:
    """Return displacements at maxima beyond a valley, one of each pair of opposites, the shortest first."""
    inner = correlation[1:-1, 1:-1]
    is_peak = inner >= REPEATED
    for down, right in product((-1, 0, 1), repeat=2):
        height, width = correlation.shape
        is_peak &= inner >= correlation[1 + down : height - 1 + down, 1 + right : width - 1 + right]
    places = np.argwhere(is_peak) + 1 - np.array(reach)
    is_half = (places[:, 0] > 0) | ((places[:, 0] == 0) & (places[:, 1] > 0))
    places = places[is_half]
    places = places[np.argsort(np.hypot(*places.T), kind="stable")]
    beyond = np.array([_is_beyond_valley(correlation, reach, place) for place in places], dtype=np.bool_)
    places = places[beyond] if len(places) else places
    heights = correlation[places[:, 0] + reach[0], places[:, 1] + reach[1]]
    return np.asarray(places[heights >= ALIKE * heights.max(initial=0)])


def _is_beyond_valley(correlation: FloatArray, reach: tuple[int, int], place: IntArray) -> bool:
    """Say whether the correlation falls on the straight way to a displacement, and rises again."""
    steps = np.linspace(0, 1, 2 * int(np.abs(place).max()) + 1)
    places = np.outer(place, steps) + np.array(reach)[:, None]
    way = scipy.ndimage.map_coordinates(correlation, places, order=1)
    return bool(way.min() <= way[-1] - VALLEY)


def _is_aside(first: IntArray, other: IntArray) -> bool:
    turn = abs(int(first[0] * other[1] - first[1] * other[0]))
    return bool(turn > np.sin(np.deg2rad(ASIDE_DEG)) * np.hypot(*first) * np.hypot(*other))


def _shorten(place: IntArray, period: IntArray) -> IntArray:
    """Return the shortest of a displacement's repetitions by a period."""
    return np.asarray(place - round(float(place @ period) / float(period @ period)) * period)


def _refine(correlation: FloatArray, reach: tuple[int, int], period: IntArray) -> FloatArray:
    """Return a period to fractions of a pixel: that of its furthest repetition, followed pixel by pixel.

    What lies more than a pixel off the period is no repetition of it: of a short period it may be the one
    before.
    """
    refined, n = period.astype(np.float64), 1
    while (np.abs(np.rint((n + 1) * refined)) < np.array(reach)).all():
        expected = np.rint((n + 1) * refined).astype(np.int64) + np.array(reach)
        around = np.array([correlation[tuple(expected + step)] for step in _BESIDE])
        found = (expected - np.array(reach) + _BESIDE[int(np.argmax(around))]) / (n + 1)
        if around.max() < REPEATED or np.abs(found - period).max() > 1:
            break
        refined, n = found, n + 1
    return refined
