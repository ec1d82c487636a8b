# SPDX-License-Identifier: MIT
"""Phase: how far the tiles of a texture are out of step with given periods."""

from itertools import pairwise, product

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from texture.analysis.masked_correlation import Correlator

TILES_PER_SIDE = 4
OUT_OF_STEP = 0.5  # periods
N_REPETITIONS = 8


def cut_tiles(within: NDArray[np.bool_], periods: NDArray[np.float64]) -> list[NDArray[np.bool_]]:
    """Return the tiles of a hole, masks (h, w); those of which less than half lies within it are left out.

    Parameters
    ----------
    within : array, shape (h, w), bool
        The hole.
    periods : array, shape (2, 2)
        The lattice's, pixels.
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
    correlator: Correlator,
    values: NDArray[np.float64],
    tiles: list[NDArray[np.bool_]],
    periods: NDArray[np.float64],
) -> float:
    """Return how far tiles are out of step, in periods, on average; NaN where none meets anything known.

    Parameters
    ----------
    correlator : Correlator
        Of what is known.
    values : array, shape (h, w, c)
        8-bit levels.
    tiles : list of arrays, shape (h, w), bool
        As `cut_tiles` gives them.
    periods : array, shape (2, 2)
        The lattice's, pixels.
    """
    errors = np.array([_measure_tile(correlator, values, tile, periods) for tile in tiles])
    errors = errors[~np.isnan(errors)]
    return float(errors.mean()) if errors.size else float("nan")


def _measure_tile(
    correlator: Correlator, values: NDArray[np.float64], tile: NDArray[np.bool_], periods: NDArray[np.float64]
) -> float:
    """Return how far a tile is out of step, in periods; NaN where it meets nothing known."""
    if float(values[tile].std(axis=0).max()) == 0:
        return OUT_OF_STEP
    reach = (tile.shape[0] - 1, tile.shape[1] - 1)
    correlation, counts = correlator.correlate(values, tile, reach)
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


def _list_steps(periods: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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


def _list_repetitions(periods: NDArray[np.float64], reach: tuple[int, int]) -> NDArray[np.float64]:
    """List the displacements k p within reach, none excepted but the first, the shortest first."""
    most = [int(max(reach) / np.hypot(*period)) + 1 for period in periods]
    factors = np.array(list(product(*(range(-n, n + 1) for n in most))), dtype=np.float64)
    repetitions = factors @ periods
    is_within = (np.abs(repetitions) <= np.array(reach)).all(axis=1) & (factors != 0).any(axis=1)
    repetitions = repetitions[is_within]
    return np.asarray(repetitions[np.argsort(np.hypot(*repetitions.T), kind="stable")])
