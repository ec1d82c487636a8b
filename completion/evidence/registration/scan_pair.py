# SPDX-License-Identifier: MIT
"""Scan pair: how far two scans' poses contradict what both measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from completion.evidence.registration.facets import Facets
from completion.evidence.registration.meetings import Meetings
from completion.evidence.registration.settling import LEAST_MEETINGS, Links, Pair, Settling, link, meet_all
from completion.evidence.sight import Sight
from scenes.checks import FloatArray

_NORMAL = 1.4826  # standard deviations of a normal distribution to its median absolute deviation


@dataclass(frozen=True, slots=True)
class ScanPair:
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
    facets: Sequence[Facets], sights: Sequence[Sight], pairs: Sequence[Pair], settled: Settling
) -> list[ScanPair]:
    """Return a pair of scans for each two of which enough facets met, moved as they settled.

    Parameters
    ----------
    facets, sights : sequences
        Of each scan.
    pairs : sequence of (int, int)
        Which scans' facets (the second) are held against which scan (the first).
    settled : Settling
        The motions from the poses as given.
    """
    found, asked = [], set(pairs)
    still = np.tile(np.eye(4), (len(facets), 1, 1))
    for i, j in sorted({(min(pair), max(pair)) for pair in pairs}):
        both = [pair for pair in ((i, j), (j, i)) if pair in asked]
        given = dict(meet_all(facets, sights, both, still))
        used = dict(meet_all(facets, sights, both, settled.motions))
        links = [link(pair, given[pair], facets, still, settled.pivots) for pair in both]
        after = [link(pair, used[pair], facets, settled.motions, settled.pivots) for pair in both]
        if sum(len(one.offset) for one in after) < LEAST_MEETINGS:
            continue
        if sum(len(one.offset) for one in links) < LEAST_MEETINGS:
            links = after
        offset, sd = _spread(both, links, settled)
        known = float(np.hypot(sd, _excess(after)))
        passed, depth = _passed(facets, given)
        still_passed, _ = _passed(facets, used)
        found.append(
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
    return found


def _spread(both: Sequence[Pair], links: Sequence[Links], settled: Settling) -> tuple[float, float]:
    """How far the motions shift the facets of two scans apart, root mean square, and its deviation."""
    parts = [settled.between(pair, one) for pair, one in zip(both, links, strict=True)]
    shift, variance = (np.concatenate(several) for several in zip(*parts, strict=True))
    return float(np.sqrt(np.mean(np.square(shift)))), float(np.sqrt(np.mean(variance)))


def _excess(links: Sequence[Links]) -> float:
    """By how much offsets are larger than noise makes them, robust, metres."""
    offset = np.concatenate([one.offset for one in links])
    deviation = np.concatenate([one.deviation for one in links])
    spread = _NORMAL * float(np.median(np.abs(offset)))
    return float(np.sqrt(max(spread**2 - float(np.mean(np.square(deviation))), 0.0)))


def _passed(facets: Sequence[Facets], meetings: Mapping[Pair, Meetings]) -> tuple[float, float]:
    """Area of facets that beams of the other scan went through, square metres, and how far these went on."""
    area, depths = 0.0, [np.zeros(0)]
    for (_, j), one in meetings.items():
        passed = one.depth > 0
        area += float(facets[j].area[passed].sum())
        depths.append(one.depth[passed])
    depth: FloatArray = np.concatenate(depths)
    return area, float(np.median(depth)) if len(depth) else 0.0
