# SPDX-License-Identifier: MIT
"""Echoes: the further returns of the beams of a range image, whose pixels hold the first one of each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, InputError, IntArray, Value, frozen_copy

ECHO_CHANNELS = {"pixel": np.int64, "ranges": np.float64, "intensity": np.float32, "n_rays": np.uint8}


@dataclass(frozen=True, slots=True, eq=False)
class Echoes(Value):
    """Further returns of a scan, (m,) each, pixel after pixel and near to far within a pixel.

    Parameters
    ----------
    pixel : (m,) int
        Row times columns plus column of the beam, ascending.
    ranges : (m,) float
        Metres along the beam, through the measured point of its first return.
    intensity : (m,) float32, optional
        Light that came back, on the instrument's scale.
    n_rays : (m,) uint8, optional
        How many rays of the beam make the echo, where a simulation tells.

    Raises
    ------
    InputError
        Arrays of different lengths, pixels that do not ascend, ranges or intensities that are not finite.

    Examples
    --------
    >>> echoes = Echoes(np.array([7, 7, 9]), np.array([2.0, 3.5, 4.0]))
    >>> echoes.number.tolist(), echoes.count.tolist()
    ([2, 3, 2], [3, 3, 2])
    """

    pixel: IntArray
    ranges: FloatArray
    intensity: NDArray[np.float32] | None = None
    n_rays: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        for name, kind in ECHO_CHANNELS.items():
            array = getattr(self, name)
            if array is None:
                continue
            if np.shape(array) != np.shape(self.pixel) or np.ndim(array) != 1:
                raise InputError(
                    f"{name} of echoes has shape {np.shape(array)}, pixel {np.shape(self.pixel)}"
                )
            object.__setattr__(self, name, frozen_copy(array, kind))
        if (np.diff(self.pixel) < 0).any():
            raise InputError("echoes must be sorted by their pixels")
        if not (np.isfinite(self.ranges) & (self.ranges > 0)).all():
            raise InputError("ranges of echoes must be finite and above 0; leave out those without")
        if self.intensity is not None and not np.isfinite(self.intensity).all():
            raise InputError("intensities of echoes are not finite; leave them out")

    def __len__(self) -> int:
        return len(self.pixel)

    @property
    def number(self) -> IntArray:
        """Number (m,) of each among the returns of its beam; the first, in the image, is 1."""
        _, start, count = np.unique(self.pixel, return_index=True, return_counts=True)
        return np.arange(len(self)) - np.repeat(start, count) + 2

    @property
    def count(self) -> IntArray:
        """How many returns (m,) the beam of each has, with the one in the image."""
        _, count = np.unique(self.pixel, return_counts=True)
        return np.repeat(count + 1, count)

    def within(self, valid: NDArray[np.bool_]) -> Echoes:
        """Return those of the pixels (rows, columns) that have a first return.

        Raises InputError: pixels beyond the image.
        """
        if len(self) and not 0 <= self.pixel[0] <= self.pixel[-1] < valid.size:
            raise InputError(f"echoes refer to pixel {self.pixel[-1]}, but the image has {valid.size} pixels")
        kept = valid.reshape(-1)[self.pixel]
        return self if kept.all() else self.pick(kept)

    def pick(self, chosen: Any) -> Echoes:
        """Return some of them, by a mask or by ascending indices."""
        held = {name: getattr(self, name) for name in ECHO_CHANNELS}
        return replace(self, **{name: array[chosen] for name, array in held.items() if array is not None})

    def scale(self, factor: float | FloatArray) -> Echoes:
        """Return them with ranges `factor` times as long, one for all or one (m,) for each."""
        return replace(self, ranges=self.ranges * factor)
