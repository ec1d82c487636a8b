# SPDX-License-Identifier: MIT
"""Correction: whether poses agree with what scans measured, and the motions that make them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from completion.evidence.sight import Ball, ScanSight, Views, sight_of
from completion.observe.observation import Observation
from completion.observe.rays import rays_of, triple
from completion.observe.tolerance import EvidenceOptions
from completion.registration import limits
from completion.registration.facets import Meetings, ScanFacets, count_agreement, facets_of, meet
from completion.registration.motions import STILL
from completion.registration.prior import FacetLinks, Pair, PoseCorrections, link, meet_all, settle
from completion.registration.station_view import sample_of
from scenes.checks import FloatArray, IntArray, Value
from scenes.pose import Pose
from scenes.run.mapping import NoSpill, Spill, trim


@dataclass(frozen=True, slots=True, eq=False)
class Registration(Value):
    """What n scans say of their poses.

    Attributes
    ----------
    motions : (n, 4, 4) float
        By which each was moved, working frame; the identity where poses are kept.
    moved_m : (n,) float
        Root mean square by which that shifted what each measured, along the normals, metres.
    left_m : (n,) float
        How far each pose may still be off along the normals of what it measured, two standard deviations,
        metres; NaN where no other scan measured the same.
    pairs : tuple of ScanPair
        Those that measured the same surfaces.
    stated_m : float
        How far poses were said to be off, metres.
    refused : frozenset of (int, int)
        Pairs that no motion brings together which their beams approve; the smaller number first.
    """

    motions: FloatArray
    moved_m: FloatArray
    left_m: FloatArray
    pairs: tuple[ScanPair, ...]
    stated_m: float
    refused: frozenset[Pair] = frozenset()

    @property
    def is_moved(self) -> bool:
        """Whether any scan was moved."""
        return bool((self.moved_m > 0).any())

    @property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Scans that beams hold together, two or more a group; groups stay to each other as they came."""
        return tuple(component for component in self._components() if len(component) > 1)

    @property
    def parts(self) -> tuple[tuple[int, ...], ...]:
        """All scans in groups that contradict each other; one group of all where no pair is refused."""
        return self._components() if self.refused else (tuple(range(len(self.motions))),)

    def _components(self) -> tuple[tuple[int, ...], ...]:
        n = len(self.motions)
        held = [
            (pair.first, pair.second) for pair in self.pairs if (pair.first, pair.second) not in self.refused
        ]
        ends = np.array(held, dtype=np.int64).reshape(-1, 2)
        graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n, n))
        component = connected_components(graph, directed=False)[1]
        return tuple(
            tuple(np.flatnonzero(component == k).tolist()) for k in dict.fromkeys(component.tolist())
        )

    def apply(self, observations: Sequence[Observation], errors_m: FloatArray) -> list[Observation]:
        """Return the scans, moved, with the errors (n,) of their poses, metres."""
        return [
            replace(_moved_scan(seen, motion), pose_error_m=error)
            for seen, motion, error in zip(observations, self.motions, errors_m.tolist(), strict=True)
        ]

    def seen_from_first(self, observations: Sequence[Observation]) -> tuple[Observation, ...]:
        """Return scans that were moved as the first one sees them: in the frame in which it did not move."""
        back = np.linalg.inv(self.motions[0])
        return tuple(_moved_scan(seen, back) for seen in observations)

    def moved_world(self, number: int, world_from_reference: Pose) -> Pose:
        """Return by how much a scan moved in the world, seen from the first one."""
        if np.array_equal(self.motions[number], self.motions[0]):
            return Pose.identity()
        motion = np.linalg.inv(self.motions[0]) @ self.motions[number]
        return world_from_reference @ Pose(motion) @ world_from_reference.inverse()


def _moved_scan(seen: Observation, motion: FloatArray) -> Observation:
    """A scan moved, to the bit where it is not."""
    if np.array_equal(motion, np.eye(4)):
        return seen
    scan = seen.scan.with_facts(world_from_sensor=Pose(motion) @ seen.scan.world_from_sensor)
    return replace(seen, scan=scan, rays=rays_of(scan))


@dataclass(frozen=True, slots=True)
class ScanPair(Value):
    """What two scans that measured the same surfaces say of each other's poses.

    Attributes
    ----------
    first, second : int
        Their numbers, from 0.
    overlap_m2 : float
        Area that both measured, square metres.
    offset_m : float
        Root mean square, along the normals of what both measured, by which the poses as given set the scans
        apart: the rigid motion alone, which range noise and things that moved have no part in.
    offset_sd_m : float
        Standard deviation of that.
    left_m : float
        The same for the poses as they were used: what is not known of the motion, and offsets beyond noise
        that no motion explains.
    contradicted_m2 : float
        Area that one measured and that the other's beams went through, by more than noise allows and with the
        poses as given.
    depth_m : float
        Median distance along the normal by which those beams went on; 0 without any.
    still_contradicted_m2 : float
        The same area with the poses as they were used: what moved, or is measured wrongly.
    """

    first: int
    second: int
    overlap_m2: float
    offset_m: float
    offset_sd_m: float
    left_m: float
    contradicted_m2: float
    depth_m: float
    still_contradicted_m2: float

    def left_alone(self) -> ScanPair:
        """Return what they say where no scan was moved."""
        left = float(np.hypot(self.offset_m, self.left_m))
        return replace(self, left_m=left, still_contradicted_m2=self.contradicted_m2)


def scan_pairs(
    facets: Sequence[ScanFacets],
    sights: Sequence[ScanSight],
    pairs: Sequence[Pair],
    corrections: PoseCorrections,
) -> list[ScanPair]:
    """Return a pair of scans for each two of which enough facets met, moved as they settled.

    Parameters
    ----------
    facets, sights : sequences
        Of each scan.
    pairs : sequence of (int, int)
        Which scans' facets (the second) are held against which scan (the first).
    corrections : PoseCorrections
        The motions from the poses as given.
    """
    scan_pair, asked = [], set(pairs)
    still = np.tile(np.eye(4), (len(facets), 1, 1))
    for i, j in sorted({(min(pair), max(pair)) for pair in pairs}):
        both = [pair for pair in ((i, j), (j, i)) if pair in asked]
        given = dict(meet_all(facets, sights, both, still))
        used = dict(meet_all(facets, sights, both, corrections.motions))
        links = [link(pair, given[pair], facets, still, corrections.pivots) for pair in both]
        after = [link(pair, used[pair], facets, corrections.motions, corrections.pivots) for pair in both]
        if sum(len(links.offset) for links in after) < limits.LEAST_MEETINGS:
            continue
        if sum(len(scan_links.offset) for scan_links in links) < limits.LEAST_MEETINGS:
            links = after
        offset, sd = _spread(both, links, corrections)
        known = float(np.hypot(sd, _excess(after)))
        passed, depth = _area_passed(facets, given)
        still_passed, _ = _area_passed(facets, used)
        scan_pair.append(
            ScanPair(
                first=i,
                second=j,
                overlap_m2=sum(float(facets[k].area[used[h, k].met].sum()) for h, k in both) / len(both),
                offset_m=offset,
                offset_sd_m=sd,
                left_m=known,
                contradicted_m2=passed,
                depth_m=depth,
                still_contradicted_m2=still_passed,
            )
        )
    return scan_pair


def _spread(
    both: Sequence[Pair], links: Sequence[FacetLinks], corrections: PoseCorrections
) -> tuple[float, float]:
    """How far the motions shift the facets of two scans apart, root mean square, and its deviation."""
    parts = [
        corrections.shift_between(pair, scan_links) for pair, scan_links in zip(both, links, strict=True)
    ]
    shift, variance = (np.concatenate(several) for several in zip(*parts, strict=True))
    return float(np.sqrt(np.mean(np.square(shift)))), float(np.sqrt(np.mean(variance)))


def _excess(links: Sequence[FacetLinks]) -> float:
    """By how much offsets are larger than noise makes them, robust, metres."""
    offset = np.concatenate([scan_links.offset for scan_links in links])
    deviation = np.concatenate([scan_links.deviation for scan_links in links])
    spread = limits.MAD_TO_SD * float(np.median(np.abs(offset)))
    return float(np.sqrt(max(spread**2 - float(np.mean(np.square(deviation))), 0.0)))


def _area_passed(facets: Sequence[ScanFacets], meetings: Mapping[Pair, Meetings]) -> tuple[float, float]:
    """Area of facets that beams of the other scan went through, square metres, and how far these went on."""
    area, depths = 0.0, [np.zeros(0)]
    for (_, j), meeting in meetings.items():
        passed = meeting.depth > 0
        area += float(facets[j].area[passed].sum())
        depths.append(meeting.depth[passed])
    depth: FloatArray = np.concatenate(depths)
    return area, float(np.median(depth)) if len(depth) else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class AdjustedScans:
    """Scans moved so that their facets come together, and what each pair says of that.

    Attributes
    ----------
    motions : (n, 4, 4) float
        Of each scan, working frame.
    shifts : (n,) float
        Root mean square by which each motion shifts the scan's facets along their normals, metres.
    pairs : tuple of ScanPair
        Those whose facets took part.
    """

    motions: FloatArray
    shifts: FloatArray
    pairs: tuple[ScanPair, ...]

    @property
    def is_off(self) -> bool:
        """Whether the poses as they came are off by more than the flatness of surfaces and chance explain."""
        return any(
            pair.offset_m > max(limits.NOTICED_M, limits.SURE * pair.offset_sd_m) for pair in self.pairs
        )


def deviations_left(pairs: Sequence[ScanPair], n: int) -> FloatArray:
    """Return how far each pose may still be off (n,) by the pairs that it is in, metres; NaN without any.

    A pose that is off disagrees with all others, one that is right with those alone that are off: it is as
    far off as its best pair says.
    """
    left = np.full(n, np.nan)
    for pair in pairs:
        for number in (pair.first, pair.second):
            left[number] = np.fmin(left[number], limits.BOUND * pair.left_m)
    return left


class _CorrectionGroup(NamedTuple):
    """Some scans that settle, and behind them those that they are held against, settled before."""

    scans: tuple[int, ...]
    pairs: tuple[Pair, ...]  # by their place in the group
    corrections: PoseCorrections


@dataclass(frozen=True, slots=True, eq=False)
class PosedScans:
    """The facets of scans with poses, and how each scan sees a place."""

    facets: tuple[ScanFacets, ...]
    sights: tuple[ScanSight, ...]

    @classmethod
    def of(cls, observations: Sequence[Observation], spill: Spill | NoSpill) -> PosedScans:
        """Return the facets of scans, kept where `spill` keeps them."""
        tolerance, facets = EvidenceOptions().tolerance(), []
        for seen in observations:
            facets.append(spill.keep(facets_of(seen)))
            trim()
        return cls(tuple(facets), tuple(sight_of(seen, tolerance) for seen in observations))

    def partners(self, keys: Sequence[int]) -> list[tuple[tuple[int, ...], list[Pair]]]:
        """Return scans that settle at once, and the pairs by which they do, in the order of settling.

        Up to 64 of the `keys` settle together, and all other scans, each by itself, among these.
        """
        n = len(self.facets)
        together = (
            tuple(range(n)) if n <= limits.N_TOGETHER else tuple(keys)[:: -(-len(keys) // limits.N_TOGETHER)]
        )
        alone = ((number,) for number in range(n) if number not in together)
        return [(scans, self._partners(scans, together)) for scans in (together, *alone)]

    def adjust(
        self, partners: Sequence[tuple[tuple[int, ...], list[Pair]]], refused: Set[Pair]
    ) -> AdjustedScans:
        """Return the scans moved so that the facets of all partners come together but those `refused`."""
        n, pairs = len(self.facets), []
        motions, shifts = np.tile(np.eye(4), (n, 1, 1)), np.zeros(n)
        for scans, several in partners:
            group = self._settle(
                scans, [numbers for numbers in several if _in_order(numbers) not in refused], motions
            )
            motions[[*scans]] = group.corrections.motions[: len(scans)]
            shifts[[*scans]] = group.corrections.shifts[: len(scans)]
            pairs += self._pairs(group)
            trim()
        return AdjustedScans(motions, shifts, tuple(pairs))

    def contradicted_pairs(self, adjusted: AdjustedScans) -> set[Pair]:
        """Return the pairs whose beams approve the poses as adjusted less than the poses as they came.

        Beams may lose what makes a pose worth a word (`LEAST_SCORE`), summed over the pairs of a scan, before
        any pair is contradicted: a correction by several scans costs some pair a little.
        """
        numbers = [(pair.first, pair.second) for pair in adjusted.pairs]
        still = np.tile(np.eye(4), (len(self.facets), 1, 1))
        samples = [sample_of(facet.normal) for facet in self.facets]
        before, after = (self._scores(numbers, motions, samples) for motions in (still, adjusted.motions))
        losses = {pair: before[pair] - after[pair] for pair in numbers}
        by_scan = [sum(loss for pair, loss in losses.items() if k in pair) for k in range(len(self.facets))]
        worse = {k for k, loss in enumerate(by_scan) if loss > limits.LEAST_SCORE}
        if not worse:
            return set()
        among = {pair: loss for pair, loss in losses.items() if worse & {*pair}}
        return {pair for pair, loss in among.items() if loss > limits.LEAST_SCORE} or {
            max(among, key=among.__getitem__)
        }

    def _scores(
        self, pairs: Sequence[Pair], motions: FloatArray, samples: Sequence[IntArray]
    ) -> dict[Pair, float]:
        """Of each pair the facets that agree less those that beams contradict, as in `Hypothesis.score`."""
        scores, back = dict.fromkeys(pairs, 0.0), np.linalg.inv(motions)
        for pair in pairs:
            for i, j in (pair, pair[::-1]):
                motion = np.ascontiguousarray((back[i] @ motions[j])[None, :3])
                agree, violated, _ = count_agreement(
                    self.facets[j], samples[j], motion, self.sights[i], self.facets[i], limits.FINE_M
                )[0]
                scores[pair] += float(agree - limits.VIOLATION * violated) / max(len(samples[j]), 1)
        return scores

    def _settle(self, scans: Sequence[int], pairs: Sequence[Pair], motions: FloatArray) -> _CorrectionGroup:
        """Settle scans by pairs with others, whose `motions` (n, 4, 4) are known where not among them."""
        several = (*scans, *sorted({number for pair in pairs for number in pair} - set(scans)))
        place = {number: k for k, number in enumerate(several)}
        members = tuple((place[i], place[j]) for i, j in pairs)
        known = {place[number]: motions[number] for number in several[len(scans) :]}
        return _CorrectionGroup(several, members, settle(*self._of(several), members, known))

    def _pairs(self, group: _CorrectionGroup) -> list[ScanPair]:
        """Return what the scans of a group say of each other's poses, moved as they settled."""
        pairs = scan_pairs(*self._of(group.scans), group.pairs, group.corrections)
        numbers = [sorted((group.scans[pair.first], group.scans[pair.second])) for pair in pairs]
        return [
            replace(pair, first=first, second=second)
            for pair, (first, second) in zip(pairs, numbers, strict=True)
        ]

    def _of(self, scans: Sequence[int]) -> tuple[list[ScanFacets], list[ScanSight]]:
        return [self.facets[k] for k in scans], [self.sights[k] for k in scans]

    def _partners(self, scans: Sequence[int], others: Sequence[int]) -> list[Pair]:
        """The pairs of scans and those of the others that they share most with, both ways round."""
        views = Views.of((self.sights[k].eye for k in others), np.zeros(len(others)))
        partners: set[Pair] = set()
        for scan in scans:
            facets, shared = self.facets[scan], []
            if not len(facets.centre):
                continue
            low, high = facets.centre.min(axis=0), facets.centre.max(axis=0)
            ball = Ball(triple((low + high) / 2), float(np.linalg.norm(high - low)) / 2)
            for other in (others[k] for k in np.flatnonzero(views.may_see(ball)).tolist()):
                if other != scan:
                    met = meet(facets, STILL, self.sights[other], self.facets[other], limits.THINNED).met
                    shared.append((-limits.THINNED * int(met.sum()), other))
            best = [
                other
                for count, other in sorted(shared)[: limits.N_PARTNERS]
                if -count >= limits.LEAST_MEETINGS
            ]
            partners |= {pair for other in best for pair in ((scan, other), (other, scan))}
        return sorted(partners)


def _in_order(pair: Pair) -> Pair:
    return min(pair), max(pair)
