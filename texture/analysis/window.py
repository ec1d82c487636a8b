# SPDX-License-Identifier: MIT
"""The window's size, chosen from the sample when the caller names none."""

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

SMALLEST_CHOICE, LARGEST_CHOICE = 7, 23
UNRELATED, REPEATED = 0.2, 0.5  # autocorrelation where a feature ends, and where it returns


def choose_window(levels: NDArray[np.int64], usable: NDArray[np.bool_]) -> int:
    """Choose a window that holds the largest regular feature of a sample.

    Along each axis the feature is as long as the sample's period, if its autocorrelation has a peak above 0.5
    within 23 pixels; otherwise twice the lag at which the autocorrelation falls below 0.2, plus one. An axis
    whose autocorrelation stays above that says nothing; if both do, the sample changes slowly, and they are
    looked for in what is left of it without its means over 47 x 47 pixels. The window is the longer feature,
    made odd and kept within 7..23. (Efros & Leung 1999: the window should be on the scale of
    the largest regular feature.) scikit-image's brick, grass and gravel get about 11, 13 and 15.

    Parameters
    ----------
    levels : array, shape (h, w, c), int64
        8-bit levels.
    usable : array, shape (h, w), bool
        Which pixels belong to the sample.

    Returns
    -------
    int
        Odd, 7..23.

    Examples
    --------
    >>> stripes = np.tile(np.repeat([0, 255], 6), (30, 4))[..., None]
    >>> choose_window(stripes, np.ones(stripes.shape[:2], bool))
    13
    """
    grey = levels.sum(axis=2)  # whole numbers: a constant sample varies by exactly nothing
    centred = np.where(usable, grey - grey[usable].mean(), 0.0) if usable.any() else np.zeros(grey.shape)
    feature = _find_feature(centred, usable)
    if not feature:
        weight = np.maximum(_smooth(usable.astype(np.float64)), 1e-9)
        feature = _find_feature(np.where(usable, centred - _smooth(centred) / weight, 0.0), usable)
    return int(np.clip((feature or LARGEST_CHOICE) // 2 * 2 + 1, SMALLEST_CHOICE, LARGEST_CHOICE))


def _find_feature(centred: NDArray[np.float64], usable: NDArray[np.bool_]) -> int:
    """Return the length of the longer axis's feature; 0 if neither ends."""
    down, across = _autocorrelate(centred.T, usable.T), _autocorrelate(centred, usable)
    return max(_measure_feature(down), _measure_feature(across))


def _smooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
    side = 2 * LARGEST_CHOICE + 1
    return np.asarray(scipy.ndimage.uniform_filter(values, side, mode="constant"), dtype=np.float64)


def _autocorrelate(centred: NDArray[np.float64], usable: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the autocorrelation along the columns at lags 0, 1, ..., 23 or less; 0 where nothing varies."""
    lags = range(min(LARGEST_CHOICE + 1, centred.shape[1]))
    correlations = np.zeros(len(lags))
    for lag in lags:
        first, second = np.s_[:, : centred.shape[1] - lag], np.s_[:, lag:]
        both = usable[first] & usable[second]
        products = (centred[first] * centred[second])[both]
        scale = np.sqrt((centred[first][both] ** 2).sum() * (centred[second][both] ** 2).sum())
        correlations[lag] = products.sum() / scale if scale > 0 else 0.0
    return correlations


def _measure_feature(correlations: NDArray[np.float64]) -> int:
    """Return the length in pixels of the feature that an autocorrelation shows; 0 if it never ends."""
    below = np.flatnonzero(correlations < UNRELATED)
    if not below.size:
        return 0
    inner = np.arange(below[0] + 1, correlations.size - 1)
    is_peak = (correlations[inner] >= correlations[inner - 1]) & (
        correlations[inner] >= correlations[inner + 1]
    )
    peaks = inner[is_peak & (correlations[inner] > REPEATED)]
    return int(peaks[0]) if peaks.size else int(2 * below[0] + 1)
