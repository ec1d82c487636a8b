# SPDX-License-Identifier: MIT
"""Splits: whether parts of one surface, cut apart by an occluder, were found to be one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True)
class PairCounts:
    """Pairs of parts, or things found: right, wrong and missed ones."""

    right: int = 0
    wrong: int = 0
    missed: int = 0

    def __add__(self, other: PairCounts) -> PairCounts:
        return PairCounts(self.right + other.right, self.wrong + other.wrong, self.missed + other.missed)

    @property
    def precision(self) -> float:
        """Share of what was found that is right, NaN where nothing was found."""
        found = self.right + self.wrong
        return self.right / found if found else float("nan")

    @property
    def recall(self) -> float:
        """Share of what there is that was found, NaN where there is nothing."""
        there = self.right + self.missed
        return self.right / there if there else float("nan")

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall, NaN where there is and was found nothing."""
        weight = 2 * self.right + self.wrong + self.missed
        return 2 * self.right / weight if weight else float("nan")


def merge_counts(
    scans: Sequence[RangeImage],
    owners: Sequence[NDArray[np.int32]],
    scored: Sequence[bool],
    min_pixels: int = 200,
) -> PairCounts:
    """Count pairs of visible parts by whether they are one surface and were found to be one.

    A part is a connected piece of a true surface's pixels in one scan. Right pairs are of one true and one
    found surface, wrong ones of one found but two true surfaces, missed ones the other way round.

    Parameters
    ----------
    scans : sequence of RangeImage
        With truth.
    owners : sequence of (rows, columns) int
        Number of the found surface of each pixel, from 1; 0 for none.
    scored : sequence of bool
        Which true surfaces count.
    min_pixels : int
        Smaller parts do not count.
    """
    true, found = [], []
    for scan, owner in zip(scans, owners, strict=True):
        if scan.truth is None:
            continue
        for surface in np.unique(scan.truth.surface[scan.truth.surface >= 0]):
            if not scored[surface]:
                continue
            part, n_parts = ndimage.label(scan.truth.surface == surface, structure=np.ones((3, 3)))
            sizes = np.bincount(part.ravel(), minlength=n_parts + 1)
            for number in 1 + np.flatnonzero(sizes[1:] >= min_pixels):
                true.append(int(surface))
                found.append(int(np.bincount(owner[part == number]).argmax()))
    same_true = np.equal.outer(true, true)
    same_found = np.equal.outer(found, found) & (np.array(found, dtype=np.int64) > 0)[:, None]
    pair = np.triu(np.ones_like(same_true), 1).astype(np.bool_)
    return PairCounts(
        int((pair & same_true & same_found).sum()),
        int((pair & ~same_true & same_found).sum()),
        int((pair & same_true & ~same_found).sum()),
    )
