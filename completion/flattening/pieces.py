# SPDX-License-Identifier: MIT
"""Pieces: a field of steps cut into areas of one level each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from completion.flattening.ripple import Ripple
from scenes.checks import FloatArray
from texture.engine.compiled import compiled

Labels = NDArray[np.int64]

_FLAT = 1 / 15  # of the step that pays for its border: less is none
_EVIDENCE = 0.5  # nats a cell of border, up to which two pieces are one
_MOST_PIECES = 250
_RISES = np.concatenate([np.geomspace(1e-3, 1, 8), 2.0 ** np.arange(1, 200)])
CROSSED = np.pi / 4
"""Length of a border for each pair of neighbouring cells that it crosses, on the mean of all directions."""


def cut_pieces(steps: FloatArray, ripple: Ripple) -> Labels:
    """Labels (rows, columns) from 0 of the pieces of a field of steps, at most some 250.

    Cells without a step between them are together. Then pieces are joined, each with the neighbour from which
    it differs with the least evidence for its border, the least first: half the whitened square of the step,
    bounded by that of the smaller piece's cells.
    """
    energy, noise = ripple.step_energy(), ripple.noise_power()
    labels = flat_zones(steps, _FLAT * np.sqrt(2 / energy))
    area = np.bincount(labels.ravel()).astype(np.float64)
    total = np.bincount(labels.ravel(), steps.ravel())
    soft: FloatArray = np.bincount(labels.ravel(), ripple.strength.ravel()) / area
    first, second, border = borders_of(labels)
    now = np.arange(len(area))
    for most in _RISES:
        if most > 1 and len(area) <= _MOST_PIECES:
            break
        while len(first):
            step = total[first] / area[first] - total[second] / area[second]
            both = area[first] * area[second] / (area[first] + area[second])
            square = (
                np.minimum(energy * border, both / noise)
                * (step / np.maximum(soft[first], soft[second])) ** 2
            )
            price = square / 2 / (_EVIDENCE * border + 1)
            cheap = np.flatnonzero(price < most)
            if not len(cheap):
                break
            onto = np.arange(len(area))
            _merge(first, second, cheap[np.argsort(price[cheap], kind="stable")], area, onto)
            left, onto = np.unique(onto, return_inverse=True)
            soft = np.bincount(onto, soft * area) / np.bincount(onto, area)
            area, total, now = (
                np.bincount(onto, area).astype(np.float64),
                np.bincount(onto, total).astype(np.float64),
                onto[now],
            )
            first, second, border = _together(onto[first], onto[second], border, len(left))
    return now[labels]


@compiled
def _merge(first: Labels, second: Labels, order: Labels, area: FloatArray, onto: Labels) -> None:
    """Let pieces go to larger neighbours, by pairs in order; none that goes takes others, or goes on."""
    takes = np.zeros(len(area), np.bool_)
    for pair in order:
        big, small = first[pair], second[pair]
        if area[small] > area[big]:
            big, small = small, big
        if onto[big] == big and onto[small] == small and not takes[small]:
            onto[small] = big
            takes[big] = True


def flat_zones(field: FloatArray, most: float) -> Labels:
    """Labels (rows, columns) from 0 of cells joined by steps of at most `most` between neighbours."""
    index = np.arange(field.size).reshape(field.shape)
    down, right = np.abs(np.diff(field, axis=0)) <= most, np.abs(np.diff(field, axis=1)) <= most
    one = np.concatenate([index[:-1][down], index[:, :-1][right]])
    other = np.concatenate([index[1:][down], index[:, 1:][right]])
    return joined(one, other, field.size)[1].reshape(field.shape)


def borders_of(labels: Labels) -> tuple[Labels, Labels, FloatArray]:
    """Neighbouring pieces (n,), (n,), the lower label first, and the lengths of their borders (n,), cells."""
    one = np.concatenate([labels[:-1].ravel(), labels[:, :-1].ravel()])
    other = np.concatenate([labels[1:].ravel(), labels[:, 1:].ravel()])
    return _together(one, other, np.full(len(one), CROSSED), int(labels.max()) + 1)


def _together(one: Labels, other: Labels, length: FloatArray, n: int) -> tuple[Labels, Labels, FloatArray]:
    """Pairs of different pieces, each once, their lengths added."""
    apart = one != other
    one, other, length = one[apart], other[apart], length[apart]
    key, place = np.unique(np.minimum(one, other) * n + np.maximum(one, other), return_inverse=True)
    return key // n, key % n, np.bincount(place, length, minlength=len(key)).astype(np.float64)


def joined(one: Labels, other: Labels, n: int) -> tuple[int, Labels]:
    """How many remain of n when pairs are joined, and which each becomes."""
    graph = coo_matrix((np.ones(len(one)), (one, other)), shape=(n, n))
    count, onto = connected_components(graph, directed=False)
    return int(count), onto.astype(np.int64)
