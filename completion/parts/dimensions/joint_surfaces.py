# SPDX-License-Identifier: MIT
"""Joint surfaces: all surfaces of a part with their joint covariance, and numbers measured of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import accumulate
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.linalg import block_diag

from completion.parts.dimensions.dimension import Kind, Measure, PartDimension
from completion.parts.division.divided_part import RelatedPart
from completion.relations.equations import Placement, place
from scenes.checks import FloatArray, IntArray

_Item = TypeVar("_Item")
_STEP = 1e-6  # radians, and of a part's size: of the differences that derivatives are read from


class Estimate(NamedTuple):
    """Numbers (m,) of surfaces, their covariance (m, m), and that without relations."""

    value: FloatArray
    covariance: FloatArray
    measured_covariance: FloatArray

    @property
    def sd(self) -> float:
        """Standard deviation of the first."""
        return float(np.sqrt(max(self.covariance[0, 0], 0.0)))


class JointSurfaces:
    """The n surfaces of a part where relations hold, with the joint covariance of their parameters.

    Attributes
    ----------
    at : list of Placement
        Where each is.
    size_m : float
        Diagonal of the part, metres.
    """

    def __init__(self, part: RelatedPart) -> None:
        self.part, graph = part, part.relations
        widths = [len(fit.covariance) for fit in part.fits]
        self._first = list(accumulate(widths, initial=0))
        self._origins = [fit.surface for fit in part.fits]
        self._changes = [np.zeros(width) for width in widths]
        self.measured_covariance = block_diag(np.zeros((0, 0)), *(fit.covariance for fit in part.measured))
        self.covariance = block_diag(np.zeros((0, 0)), *(fit.covariance for fit in part.fits))
        if graph is not None:
            for number, change in zip(part.related, graph.changes, strict=True):
                self._origins[number], self._changes[number] = part.measured[number].surface, change
            related = self._columns(part.related)
            self.covariance[np.ix_(related, related)] = graph.covariance
        self.at = [place(origin, change) for origin, change in zip(self._origins, self._changes, strict=True)]
        self.size_m = float(np.linalg.norm(np.ptp(part.points, axis=0))) or 1.0

    def _columns(self, places: Sequence[int]) -> IntArray:
        columns = [np.arange(self._first[k], self._first[k + 1]) for k in places]
        return np.concatenate([np.zeros(0, np.int64), *columns]).astype(np.int64)

    def estimate(self, places: Sequence[int], measure: Callable[[Sequence[Placement]], Any]) -> Estimate:
        """Numbers of some surfaces, to first order: derivatives by central differences."""
        here = [self.at[k] for k in places]
        slopes = []
        for k, number in enumerate(places):
            for parameter, step in enumerate(self._steps(number)):
                sides = []
                for change in (step, -step):
                    changed = self._changes[number].copy()
                    changed[parameter] += change
                    moved = [*here[:k], place(self._origins[number], changed), *here[k + 1 :]]
                    sides.append(np.atleast_1d(np.asarray(measure(moved), dtype=np.float64)))
                slopes.append((sides[0] - sides[1]) / (2 * step))
        jacobian, columns = np.array(slopes).T, self._columns(places)
        spread = (jacobian @ each[np.ix_(columns, columns)] @ jacobian.T
                  for each in (self.covariance, self.measured_covariance))  # fmt: skip
        return Estimate(np.atleast_1d(np.asarray(measure(here), dtype=np.float64)), *spread)

    def _steps(self, number: int) -> FloatArray:
        """Differences (k,) of a surface's parameters: lengths by the part's size, angles in radians."""
        at = self.at[number]
        moves = np.concatenate([at.by_point, at.by_radius, at.by_ring_radius])
        return np.where(np.abs(moves).sum(axis=0) > 0, _STEP * self.size_m, _STEP)

    def dimension(
        self, kind: Kind, places: Sequence[int], measure: Measure,
        *, ends: FloatArray, alike: Sequence[int] = (), note: str = "",
    ) -> PartDimension:  # fmt: skip
        """A dimension of surfaces by their places, with `ends` (2, 3); `alike`: places of all as these."""
        found = self.estimate(places, measure)
        before = float(np.sqrt(max(found.measured_covariance[0, 0], 0.0)))
        labels = tuple(self.part.labels[k] for k in dict.fromkeys(alike or places))
        return PartDimension(
            kind=kind, value=float(found.value[0]), sd=found.sd, measured_sd=before, surfaces=labels,
            ends=ends, count=max(len(alike), 1), note=note, places=tuple(places), measure=measure,
        )  # fmt: skip

    def are_equal(self, first: Sequence[int], second: Sequence[int], measure: Measure) -> bool:
        """Whether relations make a number of some surfaces that of others."""
        n = len(first)
        found = self.estimate([*first, *second], lambda at: measure(at[:n]) - measure(at[n:]))
        before = float(np.sqrt(found.measured_covariance[0, 0]))
        return bool(abs(found.value[0]) <= 1e-2 * before and found.covariance[0, 0] <= 1e-4 * before**2)

    def angle_sd(self, first: int, second: int) -> float:
        """Standard deviation of the angle between two directions, radians, the worst way."""
        across = self.at[first].across
        sign = 1.0 if self.at[first].direction @ self.at[second].direction >= 0 else -1.0
        found = self.estimate((first, second), lambda at: across @ (at[0].direction - sign * at[1].direction))
        return float(np.sqrt(max(np.linalg.eigvalsh(found.covariance)[-1], 0.0)))


def grouped(items: Iterable[_Item], is_one: Callable[[_Item, _Item], bool]) -> list[list[_Item]]:
    """Items in groups, each with those that are one with the group's first."""
    groups: list[list[_Item]] = []
    for item in items:
        group = next((group for group in groups if is_one(group[0], item)), None)
        if group is None:
            groups.append([item])
        else:
            group.append(item)
    return groups
