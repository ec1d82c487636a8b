# SPDX-License-Identifier: MIT
"""Joint errors: the variance of any number that several surfaces together give, such as a room's width."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.special import ndtri, stdtrit

from scenes.checks import BoolArray, FloatArray, Value


@dataclass(frozen=True, slots=True, eq=False)
class SharedErrors(Value):
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
        for shift_columns in self.shifts:
            held = [(k, shift_columns[number]) for k, number in enumerate(numbers) if number in shift_columns]
            if not held:
                continue
            where = np.concatenate([np.arange(first[k], first[k + 1]) for k, _ in held])
            every = np.concatenate([shift for _, shift in held])
            if len(where) == len(total):
                total += every @ every.T
            else:
                total[np.ix_(where, where)] += every @ every.T
        return total


Contrast = Mapping[int, FloatArray]
"""By surface, from 0, the derivative (k,) of a number by the surface's parameters."""


@dataclass(frozen=True, slots=True, eq=False)
class RelatedErrors(Value):
    """Errors of surfaces that were related to each other.

    Attributes
    ----------
    numbers : tuple of int
        Which surfaces (q,).
    first : (q + 1,) int
        Where the parameters of each begin.
    covariance : (p, p) float
        Of all their parameters, given the relations that hold.
    is_moved : (q,) bool
        Which of them are where the relations hold; the others stayed where they were measured. The covariance
        of one that was moved with one that was not is the same: what a surface gains by the relations is
        independent of what is left.
    """

    numbers: tuple[int, ...]
    first: tuple[int, ...]
    covariance: FloatArray
    is_moved: tuple[bool, ...]


UNRELATED = RelatedErrors((), (0,), np.zeros((0, 0)), ())


@dataclass(frozen=True, slots=True, eq=False)
class JointErrors(Value):
    """Errors of n surfaces, jointly.

    Attributes
    ----------
    separate : tuple of (k, k) float
        Covariance of each surface by all its errors.
    shared : SharedErrors
        What surfaces share, before relations.
    related : RelatedErrors
        What relations made of some of them.
    ranges : tuple of (k, 2) float
        What an offset and a scale of all ranges do to each surface, which relations between directions do not
        know of.
    freedom : tuple of float
        Degrees of freedom (n,) of each covariance.
    shares : (n, s) float
        Share of each surface's pixels that each of s scans measured.
    pose_sd : (s,) float
        Standard deviation of each scan's place, along any direction, metres.
    is_known : bool
        Whether anything is known of how wrong the scans are. Of a mesh that somebody else made it is not.
    """

    separate: tuple[FloatArray, ...]
    shared: SharedErrors
    related: RelatedErrors
    ranges: tuple[FloatArray, ...]
    freedom: tuple[float, ...]
    shares: FloatArray
    pose_sd: FloatArray
    is_known: bool = True

    def variance(self, contrast: Contrast, shifts: Mapping[int, FloatArray]) -> float:
        """Variance of a number that depends on some surfaces.

        Parameters
        ----------
        contrast : mapping
            By surface, the derivative (k,) of the number by the surface's parameters.
        shifts : mapping
            By surface, the derivative (3,) of the number by a shift of all the surface's points, which is
            what the error of a scan's place does; those of one scan shift together.
        """
        numbers = sorted(contrast)
        total = sum(float(contrast[k] @ self.separate[k] @ contrast[k]) for k in numbers)
        for first, second in combinations(numbers, 2):
            among = self._among(first, second)
            if among is None:  # not known: as bad as it can be
                spread = [float(contrast[k] @ self.separate[k] @ contrast[k]) for k in (first, second)]
                total += 2.0 * float(np.sqrt(max(spread[0], 0.0) * max(spread[1], 0.0)))
            else:
                total += 2.0 * float(contrast[first] @ among @ contrast[second])
        by_range = np.sum([contrast[k] @ self.ranges[k] for k in numbers], axis=0)
        by_scan = sum(np.outer(self.shares[k], shifts[k]) for k in numbers)
        placed = np.square(self.pose_sd) @ np.square(by_scan).sum(axis=1) if numbers else 0.0
        return max(total, 0.0) + float(np.sum(np.square(by_range))) + float(placed)

    def half_interval(
        self, contrast: Contrast, shifts: Mapping[int, FloatArray], *, more_sd: float = 0.0, level: float
    ) -> float:
        """Half of the interval in which a number lies with a probability of `level` (Student 1908).

        `contrast` gives the derivative (k,) by each surface, `shifts` the one (3,) by its place; `more_sd`
        is the standard deviation of what no surface has a part in. Infinite where errors
        or a covariance are not known.
        """
        freedom = min((self.freedom[k] for k in contrast), default=np.inf)
        above = (1 + level) / 2
        factor = float(stdtrit(freedom, above) if np.isfinite(freedom) else ndtri(above))
        half = factor * float(np.hypot(np.sqrt(self.variance(contrast, shifts)), more_sd))
        return half if self.is_known and np.isfinite(half) else np.inf

    def only(self, chosen: Sequence[bool] | BoolArray) -> JointErrors:
        """Return it for the surfaces (n,) that are `chosen` alone, counted anew."""
        kept = np.flatnonzero(np.asarray(chosen, dtype=np.bool_))
        if len(kept) == len(self.separate):
            return self
        anew = {int(old): new for new, old in enumerate(kept)}
        shifts = [{anew[k]: by for k, by in shift.items() if k in anew} for shift in self.shared.shifts]
        numbers = tuple(anew.get(k, -1) for k in self.related.numbers)
        return replace(
            self,
            separate=tuple(self.separate[k] for k in kept),
            shared=SharedErrors(tuple(self.shared.sizes[k] for k in kept), tuple(shifts)),
            related=replace(self.related, numbers=numbers),
            ranges=tuple(self.ranges[k] for k in kept),
            freedom=tuple(self.freedom[k] for k in kept),
            shares=self.shares[kept],
        )

    def and_own(self, covariances: Sequence[FloatArray]) -> JointErrors:
        """Return it with further surfaces, of which only their own covariances (k, k) are known."""
        if not covariances:
            return self
        sizes = tuple(len(covariance) for covariance in covariances)
        return replace(
            self,
            separate=(*self.separate, *covariances),
            shared=replace(self.shared, sizes=(*self.shared.sizes, *sizes)),
            ranges=(*self.ranges, *(np.zeros((size, 2)) for size in sizes)),
            freedom=(*self.freedom, *(np.inf for _ in sizes)),
            shares=np.vstack([self.shares, np.zeros((len(sizes), self.shares.shape[1]))]),
        )

    def _among(self, first: int, second: int) -> FloatArray | None:
        """Covariance (k, l) of two surfaces; None where one was moved and the other not related."""
        related = self.related
        place = [related.numbers.index(k) if k in related.numbers else None for k in (first, second)]
        moved = [at is not None and related.is_moved[at] for at in place]
        if not any(moved):
            size = len(self.separate[first])
            return self.shared.covariance_of([first, second])[:size, size:]
        if place[0] is None or place[1] is None:
            return None
        rows, columns = (slice(related.first[at], related.first[at + 1]) for at in place if at is not None)
        return related.covariance[rows, columns]


NO_ERRORS = JointErrors(
    separate=(),
    shared=SharedErrors((), ()),
    related=UNRELATED,
    ranges=(),
    freedom=(),
    shares=np.zeros((0, 0)),
    pose_sd=np.zeros(0),
)
"""Of no surfaces."""
