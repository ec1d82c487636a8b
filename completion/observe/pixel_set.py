# SPDX-License-Identifier: MIT
"""Pixel set: some pixels of a scan by their numbers; a mask would cost each surface a byte a pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

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
