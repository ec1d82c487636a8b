# SPDX-License-Identifier: MIT
"""Phase: how far the tiles of a texture are out of step with given periods, by masked correlation."""

from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from texture.sampling.sample import BoolArray, FloatArray

_LEAST_SPREAD = 1e-6  # 8-bit levels: less is the transforms' rounding
TILES_PER_SIDE = 4
OUT_OF_STEP = 0.5  # periods
N_REPETITIONS = 8


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
        least = _LEAST_SPREAD * n
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
        least = max(float(np.hypot(*periods.T).max()), size / TILES_PER_SIDE)
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
        return OUT_OF_STEP
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
        if n_used == N_REPETITIONS:
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
        is_near = np.abs(shares).max(axis=1) <= OUT_OF_STEP
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
