# SPDX-License-Identifier: MIT
"""Shared errors: what moves the parameters of several surfaces alike, and the covariance that comes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class SharedErrors:
    """Independent errors of deviation one, each of which moves several surfaces.

    Attributes
    ----------
    sizes : tuple of int
        Parameters k of each surface.
    shifts : tuple of mapping
        For some errors e together what they do to the parameters (k, e) of each surface they move, by its
        number. A covariance of all parameters would grow with the square of the surfaces; these do not.
    """

    sizes: tuple[int, ...]
    shifts: tuple[Mapping[int, FloatArray], ...]

    def covariance_of(self, numbers: Sequence[int]) -> FloatArray:
        """Return the covariance (q, q) of all parameters of some surfaces, in their order."""
        first = np.cumsum([0, *(self.sizes[number] for number in numbers)])
        total = np.zeros((first[-1], first[-1]))
        for one in self.shifts:
            held = [(k, one[number]) for k, number in enumerate(numbers) if number in one]
            if not held:
                continue
            where = np.concatenate([np.arange(first[k], first[k + 1]) for k, _ in held])
            every = np.concatenate([shift for _, shift in held])
            if len(where) == len(total):
                total += every @ every.T
            else:
                total[np.ix_(where, where)] += every @ every.T
        return total
