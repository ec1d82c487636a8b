# SPDX-License-Identifier: MIT
"""Looking ahead: the next views planned together, of which the first is taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray

_MOST_SWEEPS = 5  # through the views, exchanging one at a time


class Poses(Protocol):
    """Poses to choose from, each with what it sees of what its position sees in any direction."""

    def best(self, worth: Sequence[FloatArray]) -> int | None:
        """Return the number of the pose that sees the largest worth, given for each position (k,)."""
        ...

    def inside(self, number: int) -> tuple[int, BoolArray]:
        """Return the position of a pose, and which (k,) of what that sees the pose sees."""
        ...


def plan_ahead(
    poses: Poses,
    *,
    worth: Sequence[FloatArray],
    share: Sequence[FloatArray],
    target: Sequence[NDArray[np.int64]],
    n_views: int,
) -> int | None:
    """Return the pose to take first of the `n_views` that together see most; None where none sees anything.

    A maximum coverage (G. L. Nemhauser, L. A. Wolsey, M. L. Fisher, "An analysis of approximations for
    maximizing submodular set functions", 1978): greedily, then exchanging one view at a time while it helps.
    Of the plan that view is taken first which sees most by itself.

    Parameters
    ----------
    poses : Poses
        To choose from.
    worth, share, target : sequences of (k,) float, float, int
        For each position what it sees in any direction: its worth from there, the part 0..1 of it that one
        look from there settles, and its number, the same from every position.
    n_views : int
        Views planned together; 1 is the greedy choice.
    """
    coverage = _Coverage(poses, worth, share, target, 1 + max(int(t.max(initial=-1)) for t in target))
    plan: list[int] = []
    while len(plan) < n_views and (number := coverage.best_after(plan)) is not None:
        plan.append(number)
    if len(plan) < 2:
        return plan[0] if plan else None
    total = coverage.total(plan)
    for _ in range(_MOST_SWEEPS):
        before = total
        for k in range(len(plan)):
            others = plan[:k] + plan[k + 1 :]
            number = coverage.best_after(others)
            if number is not None and (new := coverage.total([*others, number])) > total * (1 + 1e-9):
                plan[k], total = number, new
        if total == before:
            break
    alone = [coverage.total([number]) for number in plan]
    return plan[int(np.argmax(alone))]


@dataclass(frozen=True, slots=True, eq=False)
class _Coverage:
    """What sets of views see; the fields are those of `plan_ahead`."""

    poses: Poses
    worth: Sequence[FloatArray]
    share: Sequence[FloatArray]
    target: Sequence[NDArray[np.int64]]
    n_targets: int

    def best_after(self, plan: Sequence[int]) -> int | None:
        """Return the pose that sees most of what the poses of a plan leave."""
        left = np.ones(self.n_targets)
        for number in plan:
            self._see(number, left)
        return self.poses.best([w * left[t] for w, t in zip(self.worth, self.target, strict=True)])

    def total(self, plan: Sequence[int]) -> float:
        """Return what the poses of a plan see together."""
        left = np.ones(self.n_targets)
        return sum(self._see(number, left) for number in plan)

    def _see(self, number: int, left: FloatArray) -> float:
        """Take away what a pose settles of what is `left` (n_targets,), and return what it was worth."""
        i, inside = self.poses.inside(number)
        seen, share = self.target[i][inside], self.share[i][inside]
        gain = float((self.worth[i][inside] * left[seen]).sum())
        kept = np.ones(self.n_targets)
        np.minimum.at(kept, seen, 1.0 - share)
        left *= kept
        return gain
