# SPDX-License-Identifier: MIT
"""Registration: whether the poses of scans agree with what they measured, and small motions that cure it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from completion.evidence.field_of_view import Ball, Views
from completion.evidence.registration.facets import Facets, facets_of
from completion.evidence.registration.meetings import meet
from completion.evidence.registration.registration import Registration
from completion.evidence.registration.scan_pair import ScanPair, scan_pairs
from completion.evidence.registration.settling import LEAST_MEETINGS, Pair, Settling, settle
from completion.evidence.sight import Sight, sight_of
from completion.observe.observation import Observation
from completion.observe.tolerance import EvidenceOptions
from completion.observe.triple import triple
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.run.spill import NO_SPILL, NoSpill, Spill

_SURE = 3.0  # standard deviations by which poses are to be off before they are moved
_NOTICED_M = 0.001  # and metres: surfaces are no flatter
_BOUND = 2.0  # standard deviations within which a pose is taken to be known
_PARTNERS = 8  # scans that each one is held against, those that it shares most with
_THINNED = 8  # facets of which one tells what scans share
_TOGETHER = 64  # scans that settle together; the others then settle, each by itself, among these
_STILL: FloatArray = np.eye(4)[:3].copy()


def register(
    observations: Sequence[Observation],
    keys: Sequence[int],
    *,
    stated_m: float,
    moves: bool = True,
    spill: Spill | NoSpill = NO_SPILL,
) -> Registration:
    """Measure how far the poses of scans contradict what they measured, and move scans so that they agree.

    Flat tiles of each scan are held against those of the scans that it shares most with. What a rigid motion
    of each scan brings together was the poses' error: scans are moved by it where it is more than a
    millimetre and more than three standard deviations in some pair of them, otherwise all poses stay as they
    are, to the bit. What moved between two scans does not come together; it is counted as contradicted area.

    Parameters
    ----------
    observations : sequence of Observation
        The scans.
    keys : sequence of int
        Numbers of the key frames. Up to 64 of them settle together, and the others among these.
    stated_m : float
        How far poses were said to be off, metres.
    moves : bool
        Whether scans may be moved at all.
    spill : Spill or NoSpill
        Where facets are kept.
    """
    n = len(observations)
    still = np.tile(np.eye(4), (n, 1, 1))
    if n < 2:
        return Registration(still, np.zeros(n), np.full(n, np.nan), (), stated_m)
    held, motions, shifts = _Held.of(observations, spill), still.copy(), np.zeros(n)
    together = tuple(range(n)) if n <= _TOGETHER else tuple(keys)[:: -(-len(keys) // _TOGETHER)]
    groups = []
    for some in (together, *((number,) for number in range(n) if number not in together)):
        group = held.settled(some, together, motions)
        motions[[*some]], shifts[[*some]] = (one[: len(some)] for one in group.found)
        groups.append(group)
        trim()
    pairs = [one for group in groups for one in held.pairs(group)]
    is_off = any(one.offset_m > max(_NOTICED_M, _SURE * one.offset_sd_m) for one in pairs)
    if moves and is_off:
        return Registration(motions, shifts, _left(pairs, n), tuple(pairs), stated_m)
    pairs = [one.left_alone() for one in pairs]
    return Registration(still, np.zeros(n), _left(pairs, n), tuple(pairs), stated_m)


def _left(pairs: Sequence[ScanPair], n: int) -> FloatArray:
    """How far each of n poses may still be off by the pairs that it is in, metres; NaN without any.

    A pose that is off disagrees with all others, one that is right with those alone that are off: it is as
    far off as its best pair says.
    """
    left = np.full(n, np.nan)
    for one in pairs:
        for number in (one.first, one.second):
            left[number] = np.fmin(left[number], _BOUND * one.left_m)
    return left


class _Group(NamedTuple):
    """Some scans that settle, and behind them those that they are held against, settled before."""

    scans: tuple[int, ...]
    pairs: tuple[Pair, ...]  # by their place in the group
    settled: Settling

    @property
    def found(self) -> tuple[FloatArray, FloatArray]:
        """The motions (n, 4, 4) of the scans, and the shifts (n,) of what they measured, metres."""
        return self.settled.motions, self.settled.shifts


@dataclass(frozen=True, slots=True, eq=False)
class _Held:
    """The facets of all scans, and how each scan sees a place."""

    facets: tuple[Facets, ...]
    sights: tuple[Sight, ...]

    @classmethod
    def of(cls, observations: Sequence[Observation], spill: Spill | NoSpill) -> _Held:
        """Return the facets of scans, kept where `spill` keeps them."""
        tolerance, facets = EvidenceOptions().tolerance(), []
        for seen in observations:
            facets.append(spill.keep(facets_of(seen)))
            trim()
        return cls(tuple(facets), tuple(sight_of(seen, tolerance) for seen in observations))

    def settled(self, scans: Sequence[int], others: Sequence[int], motions: FloatArray) -> _Group:
        """Settle scans among others, whose `motions` (n, 4, 4) are known where these are not among them."""
        pairs = self._partners(scans, others)
        several = (*scans, *sorted({number for pair in pairs for number in pair} - set(scans)))
        place = {number: k for k, number in enumerate(several)}
        own = tuple((place[i], place[j]) for i, j in pairs)
        known = {place[number]: motions[number] for number in several[len(scans) :]}
        return _Group(several, own, settle(*self._of(several), own, known))

    def pairs(self, group: _Group) -> list[ScanPair]:
        """Return what the scans of a group say of each other's poses, moved as they settled."""
        found = scan_pairs(*self._of(group.scans), group.pairs, group.settled)
        numbers = [sorted((group.scans[one.first], group.scans[one.second])) for one in found]
        return [
            replace(one, first=first, second=second)
            for one, (first, second) in zip(found, numbers, strict=True)
        ]

    def _of(self, scans: Sequence[int]) -> tuple[list[Facets], list[Sight]]:
        return [self.facets[k] for k in scans], [self.sights[k] for k in scans]

    def _partners(self, scans: Sequence[int], others: Sequence[int]) -> list[Pair]:
        """The pairs of scans and those of the others that they share most with, both ways round."""
        views = Views.of((self.sights[k].eye for k in others), np.zeros(len(others)))
        found: set[Pair] = set()
        for scan in scans:
            own, shared = self.facets[scan], []
            if not len(own.centre):
                continue
            low, high = own.centre.min(axis=0), own.centre.max(axis=0)
            ball = Ball(triple((low + high) / 2), float(np.linalg.norm(high - low)) / 2)
            for other in (others[k] for k in np.flatnonzero(views.may_see(ball)).tolist()):
                if other != scan:
                    met = meet(own, _STILL, self.sights[other], self.facets[other], _THINNED).met
                    shared.append((-_THINNED * int(met.sum()), other))
            best = [other for count, other in sorted(shared)[:_PARTNERS] if -count >= LEAST_MEETINGS]
            found |= {pair for other in best for pair in ((scan, other), (other, scan))}
        return sorted(found)
