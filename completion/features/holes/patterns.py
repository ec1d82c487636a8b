# SPDX-License-Identifier: MIT
"""Patterns: where the holes of a row, a grid or a bolt circle are, by few parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scenes.checks import BoolArray, FloatArray, IntArray

ROW, GRID, CIRCLE = "hole-row", "hole-grid", "bolt-circle"
KINDS = (ROW, GRID, CIRCLE)
LEAST_SEEN = {ROW: 3, GRID: 4, CIRCLE: 3}  # holes of a pattern that must be seen
PARAMETERS = {
    ROW: ("u", "v", "angle", "pitch"),
    GRID: ("u", "v", "angle", "pitch", "pitch_2"),
    CIRCLE: ("u", "v", "angle", "circle_radius"),
}
SYMMETRIES = {ROW: 2, GRID: 4, CIRCLE: 2}  # times the count of a circle, which begins anywhere


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """Equal holes at regular places of a chart.

    Attributes
    ----------
    kind : str
        "hole-row", "hole-grid" or "bolt-circle".
    shape : (int, int)
        Holes along and across; across is 1 but for grids.
    x : (p,) float
        Its middle (two numbers), the angle of its direction or first hole, its pitches or circle's radius.
    radius : float
        Of each hole.
    """

    kind: str
    shape: tuple[int, int]
    x: FloatArray
    radius: float

    @property
    def count(self) -> int:
        """Return how many holes it has."""
        return self.shape[0] * self.shape[1]

    @property
    def steps(self) -> FloatArray:
        """Return pitches (count, 2) from the middle, along and across; angles from the first on a circle."""
        i, j = np.divmod(np.arange(self.count), self.shape[1])
        if self.kind == CIRCLE:
            return np.column_stack([2 * np.pi * i / self.count, np.zeros(self.count)])
        return np.column_stack([i - (self.shape[0] - 1) / 2, j - (self.shape[1] - 1) / 2])

    @property
    def centres(self) -> FloatArray:
        """Return the centres (count, 2)."""
        return self._placed()[0]

    @property
    def slopes(self) -> FloatArray:
        """Return the derivatives (count, 2, p) of the centres."""
        return self._placed()[1]

    def _placed(self) -> tuple[FloatArray, FloatArray]:
        middle, angle, steps = self.x[:2], self.x[2], self.steps
        slopes = np.zeros((self.count, 2, len(self.x)))
        slopes[:, 0, 0] = slopes[:, 1, 1] = 1.0
        if self.kind == CIRCLE:
            turn = angle + steps[:, 0]
            out = np.column_stack([np.cos(turn), np.sin(turn)])
            slopes[:, :, 2] = self.x[3] * np.column_stack([-out[:, 1], out[:, 0]])
            slopes[:, :, 3] = out
            return middle + self.x[3] * out, slopes
        along = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-along[1], along[0]])
        offset = steps[:, :1] * self.x[3] * along
        slopes[:, :, 2] = steps[:, :1] * self.x[3] * across
        slopes[:, :, 3] = steps[:, :1] * along
        if self.kind == GRID:
            offset = offset + steps[:, 1:] * self.x[4] * across
            slopes[:, :, 2] -= steps[:, 1:] * self.x[4] * along
            slopes[:, :, 4] = steps[:, 1:] * across
        return middle + offset, slopes

    def resized(self, low: tuple[int, int], shape: tuple[int, int]) -> Pattern:
        """Return the same lattice with another part of it: from the hole `low`, which may be negative, on."""
        if self.kind == CIRCLE:
            return self
        begin = np.array(low) + (np.array(shape) - 1) / 2 - (np.array(self.shape) - 1) / 2
        along = np.array([np.cos(self.x[2]), np.sin(self.x[2])])
        x = self.x.copy()
        x[:2] += begin[0] * self.x[3] * along
        if self.kind == GRID:
            x[:2] += begin[1] * self.x[4] * np.array([-along[1], along[0]])
        return replace(self, shape=shape, x=x)


def fitted(
    begun: Pattern, places: IntArray, centres: FloatArray, held: BoolArray, n_rounds: int = 4
) -> Pattern:
    """Fit a pattern to centres (m, 2) of some of its holes by Gauss-Newton; `held` (p,) stay as they are."""
    x, free = begun.x.copy(), ~held
    for _ in range(n_rounds):
        now = replace(begun, x=x)
        error = (centres - now.centres[places]).ravel()
        slopes = now.slopes[places][:, :, free].reshape(len(error), -1)
        x[free] += np.linalg.lstsq(slopes, error, rcond=None)[0]
    return replace(begun, x=x)
