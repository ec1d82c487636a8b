# SPDX-License-Identifier: MIT
"""The lattice of a repeating texture, and how far a fill is out of step with it.

Joints of brick or tile that do not meet across a hole are what an eye sees first; distances between patches
do not show it, because every patch by itself is right.
"""

from dataclasses import dataclass
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import ArrayLike, NDArray

from texture.quality import read_levels
from texture.sampling import limits
from texture.sampling.arguments import check_known, check_mask
from texture.sampling.sample import HIGHEST_LEVEL, BoolArray, FloatArray, IntArray

HALF_PERIOD = 0.5  # nothing is farther out of step


class _Transforms(NamedTuple):
    """The transforms of where an image counts, of each channel's values, and of the sum of their squares."""

    counts: NDArray[np.complex128]
    sums: NDArray[np.complex128]  # (c, ...)
    squares: NDArray[np.complex128]


class Correlator:
    """An image (h, w, c) of 8-bit levels, transformed once, that others of its shape can be correlated with.

    Pixels within the mask (h, w) count. `reach` are the largest displacements, rows and columns, that are
    looked at; default: all.
    """

    def __init__(self, values: FloatArray, within: BoolArray, reach: tuple[int, int] | None = None) -> None:
        self._middle = values[within].mean(axis=0) if within.any() else np.zeros(values.shape[2])
        self.reach = reach or (within.shape[0] - 1, within.shape[1] - 1)
        sizes = (size + far + 1 for size, far in zip(within.shape, self.reach, strict=True))
        # at such a size nothing meets itself round the edge
        self._size = tuple(int(scipy.fft.next_fast_len(size, real=True)) for size in sizes)
        self._transforms = self._transform(values, within)

    def correlate_itself(self) -> tuple[FloatArray, FloatArray]:
        """Correlate the image with itself; shape (2 * reach + 1, 2 * reach + 1), twice, as of `correlate`."""
        return self._meet(self._transforms)

    def correlate(self, values: FloatArray, within: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Correlate another image with this one (Padfield 2012, "Masked object registration", section 3).

        Parameters
        ----------
        values, within : arrays, shapes (h, w, c) and (h, w)
            The other image.

        Returns
        -------
        correlation : array, shape (2 reach + 1, 2 reach + 1), float64
            At [reach + d]: the correlation, over all channels, of the other's pixels at x with this one's at
            x + d, where both count; 0 where either does not vary.
        counts : array, same shape, float64
            How many pairs that is.
        """
        return self._meet(self._transform(values, within))

    def _meet(self, others: _Transforms) -> tuple[FloatArray, FloatArray]:
        itself = others is self._transforms
        rows, columns = (np.arange(-far, far + 1) for far in self.reach)

        def meet(other: NDArray[np.complex128], here: NDArray[np.complex128]) -> FloatArray:
            product = np.conj(other) * here
            if other.ndim == here.ndim == 3:  # channel by channel
                product = product.sum(axis=0)
            full = scipy.fft.irfft2(product, s=self._size)
            return np.asarray(full[..., rows[:, None], columns])

        n_pairs = np.rint(meet(others.counts, self._transforms.counts))
        n = np.maximum(n_pairs, 1)
        theirs = meet(others.sums, self._transforms.counts)
        ours = theirs[:, ::-1, ::-1] if itself else meet(others.counts, self._transforms.sums)
        their_squares = meet(others.squares, self._transforms.counts)
        our_squares = their_squares[::-1, ::-1] if itself else meet(others.counts, self._transforms.squares)
        products = meet(others.sums, self._transforms.sums)
        covariance = products - (theirs * ours).sum(axis=0) / n
        their_spread = their_squares - (theirs**2).sum(axis=0) / n
        our_spread = our_squares - (ours**2).sum(axis=0) / n
        least = limits.LEAST_SPREAD * n
        varies = (their_spread > least) & (our_spread > least)
        scale = np.sqrt(np.where(varies, their_spread * our_spread, 1))
        return np.where(varies, covariance / scale, 0), n_pairs

    def _transform(self, values: FloatArray, within: BoolArray) -> _Transforms:
        centred = np.moveaxis(np.where(within[..., None], values - self._middle, 0), 2, 0)
        return _Transforms(
            counts=scipy.fft.rfft2(within.astype(np.float64), s=self._size),
            sums=scipy.fft.rfft2(centred, s=self._size),
            squares=scipy.fft.rfft2((centred**2).sum(axis=0), s=self._size),
        )


def cut_tiles(within: BoolArray, periods: FloatArray) -> list[BoolArray]:
    """Return the tiles, masks (h, w), of a hole (h, w) for a lattice's periods (2, 2) in pixels.

    Those of which less than half lies within it are left out.
    """
    rows, columns = np.nonzero(within)
    spans = [np.linspace(0, 0, 1)] * 2
    for axis, places in enumerate((rows, columns)):
        first, size = int(places.min()), int(np.ptp(places)) + 1
        least = max(float(np.hypot(*periods.T).max()), size / limits.TILES_PER_SIDE)
        spans[axis] = np.linspace(first, first + size, max(1, int(size / least)) + 1).round().astype(int)
    tiles = []
    for (top, bottom), (left, right) in product(*(pairwise(span) for span in spans)):
        tile = np.zeros_like(within)
        tile[top:bottom, left:right] = within[top:bottom, left:right]
        tiles.append(tile)
    sizes = [int(np.count_nonzero(tile)) for tile in tiles]
    return [tile for tile, size in zip(tiles, sizes, strict=True) if 2 * size >= max(sizes)]


def measure_tiles(
    correlator: Correlator, values: FloatArray, tiles: list[BoolArray], periods: FloatArray
) -> float:
    """Return how far tiles are out of step, in periods, on average; NaN where none meets anything known.

    The correlator is of what is known; values (h, w, c) are 8-bit levels, tiles (h, w) as `cut_tiles` gives
    them for the lattice's periods (2, 2) in pixels.
    """
    errors = np.array([_measure_tile(correlator, values, tile, periods) for tile in tiles])
    errors = errors[~np.isnan(errors)]
    return float(errors.mean()) if errors.size else float("nan")


def _measure_tile(correlator: Correlator, values: FloatArray, tile: BoolArray, periods: FloatArray) -> float:
    """Return how far a tile is out of step, in periods; NaN where it meets nothing known."""
    if float(values[tile].std(axis=0).max()) == 0:
        return HALF_PERIOD
    reach = correlator.reach
    correlation, counts = correlator.correlate(values, tile)
    is_met = counts >= np.count_nonzero(tile) / 2
    shares, steps = _list_steps(periods)
    total, weight, n_used = np.zeros(len(steps)), np.zeros(len(steps)), 0
    for repetition in _list_repetitions(periods, reach):
        places = (repetition + steps + np.array(reach)).T
        meets = scipy.ndimage.map_coordinates(is_met.astype(np.float64), places, order=1) == 1
        if meets.any():
            total += np.where(meets, scipy.ndimage.map_coordinates(correlation, places, order=1), 0)
            weight += meets
            n_used += 1
        if n_used == limits.N_REPETITIONS:
            break
    if not n_used:
        return float("nan")
    best = np.argmax(np.where(weight > 0, total / np.maximum(weight, 1), -np.inf))
    return float(np.abs(shares[best]).max())


def _list_steps(periods: FloatArray) -> tuple[FloatArray, FloatArray]:
    """List the displacements within a cell, in periods (m, n) and in pixels (m, 2), the shortest first."""
    if len(periods) == 1:
        length = float(np.hypot(*periods[0]))
        shares = np.arange(-int(length / 2), int(length / 2) + 1)[:, None] / length
        steps = shares @ periods
    else:
        far = np.ceil(np.abs(periods).sum(axis=0) / 2).astype(int)
        steps = np.stack(np.meshgrid(*(np.arange(-k, k + 1) for k in far), indexing="ij"), axis=-1)
        steps = steps.reshape(-1, 2).astype(np.float64)
        shares = steps @ np.linalg.inv(periods)
        is_near = np.abs(shares).max(axis=1) <= HALF_PERIOD
        steps, shares = steps[is_near], shares[is_near]
    nearest = np.argsort(np.abs(shares).max(axis=1), kind="stable")
    return shares[nearest], steps[nearest]


def _list_repetitions(periods: FloatArray, reach: tuple[int, int]) -> FloatArray:
    """List the displacements k p within reach, none excepted but the first, the shortest first."""
    most = [int(max(reach) / np.hypot(*period)) + 1 for period in periods]
    factors = np.array(list(product(*(range(-n, n + 1) for n in most))), dtype=np.float64)
    repetitions = factors @ periods
    is_within = (np.abs(repetitions) <= np.array(reach)).all(axis=1) & (factors != 0).any(axis=1)
    repetitions = repetitions[is_within]
    return np.asarray(repetitions[np.argsort(np.hypot(*repetitions.T), kind="stable")])


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

    def __repr__(self) -> str:
        return f"Lattice(periods={self.periods.tolist()}, correlation={self.correlation:.3g})"


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
    is_believed = counts >= limits.LEAST_OVERLAP * np.count_nonzero(within)
    correlation = np.where(is_believed, correlation.round(6), -1.0)  # what is equal shall be so
    choices = _list_choices(correlation, reach)
    if not choices:
        return Lattice(np.empty((0, 2)), 0.0)
    correlator = Correlator(values, within)
    for chosen in choices:
        periods = np.array([_refine(correlation, reach, period) for period in chosen])
        if measure_tiles(correlator, values, cut_tiles(within, periods)[::2], periods) <= limits.IN_STEP:
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
        near = _box_around(within, max(limits.NEIGHBOURHOOD, *np.ptp(np.argwhere(within), axis=0)))
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
        shortest = _shortest_repetition(other, peaks[0])
        if _is_aside(peaks[0], other) and _is_beyond_valley(correlation, reach, shortest):
            return [(peaks[0], shortest), (peaks[0],), (shortest,)]
    return [(peak,) for peak in peaks[:1]]


def _list_peaks(correlation: FloatArray, reach: tuple[int, int]) -> IntArray:
    """Return displacements at maxima beyond a valley, one of each pair of opposites, the shortest first."""
    inner = correlation[1:-1, 1:-1]
    is_peak = inner >= limits.REPEATED
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
    return np.asarray(places[heights >= limits.NEARLY_AS_GOOD * heights.max(initial=0)])


def _is_beyond_valley(correlation: FloatArray, reach: tuple[int, int], place: IntArray) -> bool:
    """Say whether the correlation falls on the straight way to a displacement, and rises again."""
    steps = np.linspace(0, 1, 2 * int(np.abs(place).max()) + 1)
    places = np.outer(place, steps) + np.array(reach)[:, None]
    way = scipy.ndimage.map_coordinates(correlation, places, order=1)
    return bool(way.min() <= way[-1] - limits.VALLEY)


def _is_aside(first: IntArray, other: IntArray) -> bool:
    turn = abs(int(first[0] * other[1] - first[1] * other[0]))
    return bool(turn > np.sin(np.deg2rad(limits.ASIDE_DEG)) * np.hypot(*first) * np.hypot(*other))


def _shortest_repetition(place: IntArray, period: IntArray) -> IntArray:
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
        position = (expected - np.array(reach) + _BESIDE[int(np.argmax(around))]) / (n + 1)
        if around.max() < limits.REPEATED or np.abs(position - period).max() > 1:
            break
        refined, n = position, n + 1
    return refined
