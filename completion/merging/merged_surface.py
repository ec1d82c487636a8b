# SPDX-License-Identifier: MIT
"""Merged surface: one surface with all its pixels in all scans."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.observe.observation import Observation
from completion.observe.pixel_set import PixelSet
from scenes.checks import FloatArray, IntArray
from scenes.run.mapping import trim


@dataclass(frozen=True, slots=True, eq=False)
class MergedSurface:
    """One surface with all its pixels in all scans.

    Attributes
    ----------
    fit : SurfaceFit
        Fit to all its points, covariance inflated for correlated residuals; working frame.
    pixels : tuple of PixelSet
        Its pixels in each scan.
    n_parts : int
        How many regions were joined.
    """

    fit: SurfaceFit
    pixels: tuple[PixelSet, ...]
    n_parts: int

    @property
    def n_pixels(self) -> int:
        """Pixels in all scans together."""
        return sum(map(len, self.pixels))

    def sampled(self, most: int) -> tuple[IntArray, ...]:
        """Return every k-th of its flat pixels (n,) in each scan, counted on from scan to scan.

        All of them, if there are fewer than twice `most`.
        """
        step, before = max(1, self.n_pixels // most), np.cumsum([0, *map(len, self.pixels)]).tolist()
        return tuple(
            held.flat[-start % step :: step] for held, start in zip(self.pixels, before, strict=False)
        )

    def sampled_by(
        self, observations: Sequence[Observation], most: int
    ) -> Iterator[tuple[Observation, IntArray]]:
        """Yield each scan that measured it, and its `sampled` pixels (n,) there."""
        for seen, some in zip(observations, self.sampled(most), strict=True):
            if len(some):
                yield seen, some

    def points(self, observations: Sequence[Observation], most: int | None = None) -> FloatArray:
        """Its measured points (n, 3) in the working frame, or a sample of them."""
        points = [np.zeros((0, 3))]
        for seen, some in self.sampled_by(observations, self.n_pixels + 1 if most is None else most):
            points.append(seen.points_at(some))
            trim()
        return np.concatenate(points)
