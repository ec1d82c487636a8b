# SPDX-License-Identifier: MIT
"""Joint surfaces: all surfaces of a part with their joint covariance, and numbers measured of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from completion.parts.dimensions.dimension import NORMAL_95, Basis, Kind, Measure, PartDimension, Unit
from completion.parts.dimensions.related_part import RelatedPart
from completion.relations.equations import Placement, place
from scenes.checks import FloatArray

_STEP = 1e-6  # radians, and of a part's size: of the differences that derivatives are read from
BETTER = 0.98  # of the deviation without relations, below which these have made a number better known


class Estimate(NamedTuple):
    """Numbers (m,) of surfaces, their covariance (m, m), and that without relations."""

    value: FloatArray
    covariance: FloatArray
    measured_covariance: FloatArray


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

    def _columns(self, places: Sequence[int]) -> Any:
        return np.concatenate(
            [np.zeros(0, np.int64), *(np.arange(self._first[k], self._first[k + 1]) for k in places)]
        ).astype(np.int64)

    def estimate(self, places: Sequence[int], measure: Callable[[Sequence[Placement]], Any]) -> Estimate:
        """Numbers of some surfaces, to first order: derivatives by central differences."""
        here = [self.at[k] for k in places]
        value = np.atleast_1d(np.asarray(measure(here), dtype=np.float64))
        slopes = []
        for k, number in enumerate(places):
            for parameter, step in enumerate(self._steps(number)):
                sides = []
                for sign in (1.0, -1.0):
                    change = self._changes[number].copy()
                    change[parameter] += sign * step
                    moved = [*here[:k], place(self._origins[number], change), *here[k + 1 :]]
                    sides.append(np.atleast_1d(np.asarray(measure(moved), dtype=np.float64)))
                slopes.append((sides[0] - sides[1]) / (2 * step))
        jacobian, columns = np.array(slopes).T, self._columns(places)
        among = np.ix_(columns, columns)
        return Estimate(
            value,
            jacobian @ self.covariance[among] @ jacobian.T,
            jacobian @ self.measured_covariance[among] @ jacobian.T,
        )

    def _steps(self, number: int) -> FloatArray:
        """Differences (k,) of a surface's parameters: lengths by the part's size, angles in radians."""
        at = self.at[number]
        is_length = (
            (np.abs(at.by_point).sum(axis=0) > 0)
            | (np.abs(at.by_radius[0]) > 0)
            | (np.abs(at.by_ring_radius[0]) > 0)
        )
        return np.where(is_length, _STEP * self.size_m, _STEP)

    def dimension(
        self,
        kind: Kind,
        places: Sequence[int],
        measure: Measure,
        *,
        unit: Unit = "m",
        ends: FloatArray | None = None,
        alike: Sequence[int] = (),
        note: str = "",
    ) -> PartDimension:
        """A dimension of surfaces by their places; `alike` are places of all that are as these."""
        found = self.estimate(places, measure)
        sd, before = (
            float(np.sqrt(max(each[0, 0], 0.0))) for each in (found.covariance, found.measured_covariance)
        )
        value = float(found.value[0])
        basis: Basis = "relations" if sd < BETTER * before else "measured"
        of = alike or places
        return PartDimension(
            kind=kind,
            value=value,
            low=value - NORMAL_95 * sd,
            high=value + NORMAL_95 * sd,
            sd=sd,
            measured_sd=before,
            unit=unit,
            surfaces=tuple(self.part.labels[k] for k in dict.fromkeys(of)),
            ends=np.zeros((2, 3)) if ends is None else ends,
            count=max(len(alike), 1),
            basis=basis,
            note=note,
            places=tuple(places),
            measure=measure,
        )

    def are_equal(self, first: int, second: int, measure: Callable[[Placement], float]) -> bool:
        """Whether relations make a number of two surfaces one."""
        found = self.estimate((first, second), lambda at: measure(at[0]) - measure(at[1]))
        before = float(np.sqrt(found.measured_covariance[0, 0]))
        return bool(abs(found.value[0]) <= 1e-2 * before and found.covariance[0, 0] <= 1e-4 * before**2)

    def angle_sd(self, first: int, second: int) -> float:
        """Standard deviation of the angle between two directions, radians, the worst way."""
        across = self.at[first].across
        sign = 1.0 if self.at[first].direction @ self.at[second].direction >= 0 else -1.0
        found = self.estimate((first, second), lambda at: across @ (at[0].direction - sign * at[1].direction))
        return float(np.sqrt(max(np.linalg.eigvalsh(found.covariance)[-1], 0.0)))
