# SPDX-License-Identifier: MIT
"""Correlation of one masked image with another at every displacement, by Fourier transforms."""

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

_LEAST_SPREAD = 1e-6  # 8-bit levels: less is the transforms' rounding


class Correlator:
    """An image, transformed once, that others of its shape can be correlated with.

    Parameters
    ----------
    values : array, shape (h, w, c), float64
        8-bit levels.
    within : array, shape (h, w), bool
        Pixels that count.
    """

    def __init__(self, values: NDArray[np.float64], within: NDArray[np.bool_]) -> None:
        self._middle = values[within].mean(axis=0) if within.any() else np.zeros(values.shape[2])
        self._counts, self._sums, self._squares = self._transform(values, within)

    def correlate(
        self, values: NDArray[np.float64], within: NDArray[np.bool_], reach: tuple[int, int]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Correlate another image with this one (Padfield 2012, "Masked object registration", section 3).

        Parameters
        ----------
        values, within : arrays, shapes (h, w, c) and (h, w)
            The other image.
        reach : (int, int)
            Largest displacement looked at, rows and columns.

        Returns
        -------
        correlation : array, shape (2 reach + 1, 2 reach + 1), float64
            At [reach + d]: the correlation, over all channels, of the other's pixels at x with this one's at
            x + d, where both count; 0 where either does not vary.
        counts : array, same shape, float64
            How many pairs that is.
        """
        counts, sums, squares = self._transform(values, within)

        def meet(
            other: NDArray[np.complex128], here: NDArray[np.complex128], is_summed: bool = False
        ) -> NDArray[np.float64]:
            product = np.conj(other) * here
            full = scipy.fft.irfft2(product.sum(axis=0) if is_summed else product, s=self._size(within.shape))
            rows, columns = (np.arange(-far, far + 1) for far in reach)
            return np.asarray(full[..., rows[:, None], columns])

        n_pairs = np.rint(meet(counts, self._counts))
        n = np.maximum(n_pairs, 1)
        theirs, ours = meet(sums, self._counts), meet(counts, self._sums)
        products = meet(sums, self._sums, is_summed=True)
        covariance = products - (theirs * ours).sum(axis=0) / n
        their_spread = meet(squares, self._counts) - (theirs**2).sum(axis=0) / n
        our_spread = meet(counts, self._squares) - (ours**2).sum(axis=0) / n
        least = _LEAST_SPREAD * n
        varies = (their_spread > least) & (our_spread > least)
        scale = np.sqrt(np.where(varies, their_spread * our_spread, 1))
        return np.where(varies, covariance / scale, 0), n_pairs

    def _transform(
        self, values: NDArray[np.float64], within: NDArray[np.bool_]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the transforms of what counts, of each channel's values, of the sum of their squares."""
        centred = np.moveaxis(np.where(within[..., None], values - self._middle, 0), 2, 0)
        size = self._size(within.shape)
        counts = scipy.fft.rfft2(within.astype(np.float64), s=size)
        return counts, scipy.fft.rfft2(centred, s=size), scipy.fft.rfft2((centred**2).sum(axis=0), s=size)

    @staticmethod
    def _size(shape: tuple[int, ...]) -> tuple[int, int]:
        """Return a size at which nothing meets itself round the edge."""
        rows, columns = (scipy.fft.next_fast_len(2 * size, real=True) for size in shape)
        return rows, columns
