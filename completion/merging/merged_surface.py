# SPDX-License-Identifier: MIT
"""Merged surface: one surface with all its pixels in all scans."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.fitting.result import SurfaceFit
from completion.observe.observation import Observation, ScanPixels
from scenes.checks import FloatArray, IntArray, Value
from scenes.run.mapping import trim


@dataclass(frozen=True, slots=True, eq=False)
class MergedSurface(Value):
    """One surface with all its pixels in all scans.

    Attributes
    ----------
    fit : SurfaceFit
        Fit to all its points, covariance inflated for correlated residuals; working frame.
    pixels : ScanPixels
        Its pixels in each scan.
    n_parts : int
        How many regions were joined.
    """

    fit: SurfaceFit
    pixels: ScanPixels
    n_parts: int

    @property
    def n_pixels(self) -> int:
        """Pixels in all scans together."""
        return self.pixels.n_pixels

    def sample_pixels(self, most: int) -> tuple[tuple[int, IntArray], ...]:
        """Return each scan that measured it, and every k-th of its flat pixels (n,) there.

        They are counted on from scan to scan; all of them, if there are fewer than twice `most`.
        """
        step, pairs, before = max(1, self.n_pixels // most), [], 0
        for scan, held in self.pixels.held:
            pairs.append((scan, held.flat[-before % step :: step]))
            before += len(held)
        return tuple(pairs)

    def sampled_by(
        self, observations: Sequence[Observation], most: int
    ) -> Iterator[tuple[Observation, IntArray]]:
        """Yield each scan that measured it, and its `sampled` pixels (n,) there."""
        for scan, subset in self.sample_pixels(most):
            if len(subset):
                yield observations[scan], subset

    def points(self, observations: Sequence[Observation], most: int | None = None) -> FloatArray:
        """Its measured points (n, 3) in the working frame, or a sample of them."""
        points = [np.zeros((0, 3))]
        for seen, subset in self.sampled_by(observations, self.n_pixels + 1 if most is None else most):
            points.append(seen.points_at(subset))
            trim()
        return np.concatenate(points)


def largest_shares(surfaces: Sequence[MergedSurface]) -> FloatArray:
    """Share of each surface (n,) of all surfaces' pixels in a scan, in the scan in which it has most."""
    n_scans = max((scan + 1 for surface in surfaces for scan, _ in surface.pixels.held), default=0)
    counts = np.zeros((len(surfaces), n_scans))
    for number, surface in enumerate(surfaces):
        for scan, pixels in surface.pixels.held:
            counts[number, scan] = len(pixels)
    return np.asarray((counts / np.maximum(counts.sum(axis=0), 1.0)).max(axis=1, initial=0.0))


def number_pixels(
    surfaces: Sequence[MergedSurface], scan: int, observation: Observation
) -> NDArray[np.int32]:
    """Number the pixels (rows, columns) of one scan by the surface that they are of, from 1; 0 for none."""
    owners = np.zeros(observation.scan.shape, np.int32)
    for number, surface in enumerate(surfaces, start=1):
        owners.ravel()[surface.pixels[scan].flat] = number
    return owners
