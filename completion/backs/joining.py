# SPDX-License-Identifier: MIT
"""Joining: parts of one thing in one scan or several, cut apart by occluders or seen from several places."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from completion.backs import separation_limits as limits
from completion.backs.separation import Part
from completion.evidence.evidence import Scans
from completion.extension.patch import Patch
from scenes.checks import BoolArray, FloatArray, IntArray


def join_parts(
    parts: Sequence[Part], patches: Sequence[Patch], scans: Scans, is_room: BoolArray
) -> list[list[Part]]:
    """Return the parts of each thing, the largest first in each.

    Two parts are one where a completed surface has pixels in both: it was joined behind what stands before
    it. Parts of different scans are one where they share space.

    Parameters
    ----------
    parts : sequence of Part
        Of all scans.
    patches : sequence of Patch
        The completed surfaces.
    scans : Scans
        The scans, with the surface of each pixel.
    is_room : (1 + surfaces,) bool
        Which numbers of surfaces, from 1, are of the room.
    """
    if not parts:
        return []
    support = np.array([part.support for part in parts])
    graph = _by_surface(parts, patches, scans, is_room, support) + _by_space(parts, scans, support)
    _, number = connected_components(graph, directed=False)
    size = np.array([len(part.pixels) for part in parts])
    order = np.lexsort((np.arange(len(parts)), -size))
    joined: dict[int, list[Part]] = {}
    for k in order.tolist():
        joined.setdefault(int(number[k]), []).append(parts[k])
    return list(joined.values())


def _by_surface(
    parts: Sequence[Part], patches: Sequence[Patch], scans: Scans, is_room: BoolArray, support: IntArray
) -> csr_array:
    """Which parts (n, n) hold pixels of one surface that goes on between them, and stand on the same."""
    rows, keys = list[int](), list[int]()
    pieces: dict[int, IntArray] = {}
    n_keys = 0
    first: dict[int, int] = {}
    for k, part in enumerate(parts):
        owners = scans.owners[part.scan].ravel()[part.pixels]
        found, count = np.unique(owners, return_counts=True)
        for number in found[(count >= limits.LEAST_PIXELS // 4) & ~is_room[found] & (found > 0)].tolist():
            patch = patches[number - 1]
            if number not in pieces:
                pieces[number] = ndimage.label(patch.observed | patch.hypothesised, np.ones((3, 3)))[0]
                first[number], n_keys = n_keys, n_keys + int(pieces[number].max()) + 1
            points = scans.observations[part.scan].points_at(part.pixels[owners == number])
            _, cell = patch.grid.cells_of(points)
            if len(cell):
                piece = int(np.bincount(pieces[number].ravel()[cell]).argmax())
                rows.append(k)
                keys.append((first[number] + piece) * (int(support.max()) + 2) + part.support + 1)
    return _shared(np.array(rows, np.int64), np.array(keys, np.int64), len(parts))


def _by_space(parts: Sequence[Part], scans: Scans, support: IntArray) -> csr_array:
    """Which parts (n, n) of different scans take up the same cells."""
    n = len(parts)
    if len({part.scan for part in parts}) < 2:
        return csr_array((n, n), dtype=np.int64)
    spread = [max(2 * part.spacing_m, limits.N_SIGMA * part.sigma_m) for part in parts]
    cell_m = max(limits.CELL_M, float(np.median(spread)), 2 * scans.tolerance.registration_m)
    points, rows = (
        np.concatenate([part.points for part in parts]),
        np.repeat(np.arange(n), [len(part.points) for part in parts]),
    )
    cells = _cells(points, cell_m)
    keys = np.unique(np.stack([rows, cells]), axis=1)
    shared = _shared(keys[0], keys[1], n).tocoo()
    own = np.bincount(keys[0], minlength=n)
    scan = np.array([part.scan for part in parts])
    i, j = shared.row, shared.col
    least = np.where(support[i] == support[j], limits.OVERLAP, 0.5) * np.minimum(own[i], own[j])
    kept = (scan[i] != scan[j]) & (shared.data >= np.maximum(least, 2))
    return csr_array(coo_array((np.ones(int(kept.sum()), np.int64), (i[kept], j[kept])), shape=(n, n)))


def _cells(points: FloatArray, cell_m: float) -> IntArray:
    """Number (n,) of the cubic cell of each point (n, 3), equal for equal cells."""
    place = np.floor(points / cell_m).astype(np.int64)
    place -= place.min(axis=0)
    size = place.max(axis=0) + 1
    return np.asarray((place[:, 0] * size[1] + place[:, 1]) * size[2] + place[:, 2])


def _shared(rows: IntArray, keys: IntArray, n: int) -> csr_array:
    """How many keys (k,) rows (n, n) have in common, by the row (k,) of each."""
    found, column = np.unique(keys, return_inverse=True)
    held = csr_array(coo_array((np.ones(len(rows), np.int64), (rows, column)), shape=(n, max(len(found), 1))))
    return csr_array(held @ held.T)
