# SPDX-License-Identifier: MIT
"""Pixel set: some pixels of a scan, or of several, by their numbers; a mask would cost a byte a pixel."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class PixelSet:
    """Some pixels of an image of `shape`, (rows, columns)."""

    flat: NDArray[np.int32]  # (n,) row * columns + column, ascending
    shape: tuple[int, int]

    @classmethod
    def of(cls, mask: BoolArray) -> PixelSet:
        """Return the pixels of a mask (rows, columns)."""
        return cls(np.flatnonzero(mask).astype(np.int32), (mask.shape[0], mask.shape[1]))

    @classmethod
    def by_label(cls, labels: NDArray[np.int32], n_labels: int) -> list[PixelSet]:
        """Return the pixels of each label 1..n_labels of an image (rows, columns), in one pass."""
        narrow = labels.ravel().astype(
            np.uint16 if n_labels < 2**16 else np.uint32
        )  # 16 bits sort in linear time
        order = np.argsort(narrow, kind="stable").astype(np.int32)
        ends = np.cumsum(np.bincount(narrow, minlength=n_labels + 1))
        shape = (labels.shape[0], labels.shape[1])
        return [cls(order[ends[k - 1] : ends[k]].copy(), shape) for k in range(1, n_labels + 1)]

    @classmethod
    def union(cls, sets: Sequence[PixelSet], shape: tuple[int, int]) -> PixelSet:
        """Return the pixels (n,) of all sets of one image, of whose pixels none is in two."""
        none = np.zeros(0, np.int32)
        return cls(np.sort(np.concatenate([none, *(one.flat for one in sets)])), shape)

    def __len__(self) -> int:
        """How many there are."""
        return len(self.flat)

    @property
    def mask(self) -> BoolArray:
        """Where they are, (rows, columns)."""
        mask = np.zeros(self.shape, dtype=np.bool_)
        mask.ravel()[self.flat] = True
        return mask

    def pick(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return their values (n, ...) of an image (rows, columns, ...)."""
        return np.asarray(image.reshape(-1, *image.shape[2:])[self.flat])


@dataclass(frozen=True, slots=True, eq=False)
class ScanPixels(Sequence[PixelSet]):
    """Some pixels in each of n scans, of which only those are kept that have any."""

    held: tuple[tuple[int, PixelSet], ...]  # by scan, ascending
    shapes: NDArray[np.int32]  # (n, 2) rows and columns of each scan

    @classmethod
    def of(cls, sets: Sequence[PixelSet]) -> ScanPixels:
        """Return the pixels of all scans, from those of each."""
        shapes = np.array([one.shape for one in sets], np.int32).reshape(-1, 2)
        return cls(tuple((scan, one) for scan, one in enumerate(sets) if len(one)), shapes)

    @property
    def n_pixels(self) -> int:
        """How many there are in all scans together."""
        return sum(len(one) for _, one in self.held)

    def __len__(self) -> int:
        """How many scans there are."""
        return len(self.shapes)

    @overload
    def __getitem__(self, scan: int) -> PixelSet: ...

    @overload
    def __getitem__(self, scan: slice) -> tuple[PixelSet, ...]: ...

    def __getitem__(self, scan: int | slice) -> PixelSet | tuple[PixelSet, ...]:
        """Return the pixels of a scan by its number, or of several."""
        if isinstance(scan, slice):
            return tuple(self[number] for number in range(len(self))[scan])
        number = range(len(self))[scan]
        place = bisect_left(self.held, number, key=lambda pair: pair[0])
        if place < len(self.held) and self.held[place][0] == number:
            return self.held[place][1]
        rows, columns = self.shapes[number].tolist()
        return PixelSet(np.zeros(0, np.int32), (rows, columns))
