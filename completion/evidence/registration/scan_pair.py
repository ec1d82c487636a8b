# SPDX-License-Identifier: MIT
"""Scan pair: how far two scans' poses contradict what both measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from completion.evidence.registration.facets import Facets
from completion.evidence.registration.meetings import Meetings
from completion.evidence.registration.settling import LEAST_MEETINGS, Links, Pair, Settling, link
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


def scan_pairs(
    facets: Sequence[Facets],
    given: Mapping[Pair, Meetings],
    used: Mapping[Pair, Meetings],
    settled: Settling,
    is_moved: bool,
) -> list[ScanPair]:
    """Return a pair of scans for each two of which enough facets met.

    Parameters
    ----------
    facets : sequence of Facets
        Of each scan.
    given, used : mapping
        What the facets of the second of two scans met in the first, by poses as given and as settled.
    settled : Settling
        The motions between these.
    is_moved : bool
        Whether the scans are moved, or keep the poses as given.
    """
    found = []
    for i, j in sorted({(min(pair), max(pair)) for pair in given}):
        both = [pair for pair in ((i, j), (j, i)) if pair in given]
        still = np.tile(np.eye(4), (len(facets), 1, 1))
        links = [link(pair, given[pair], facets, still, settled.pivots) for pair in both]
        after = [link(pair, used[pair], facets, settled.motions, settled.pivots) for pair in both]
        if sum(len(one.offset) for one in after) < LEAST_MEETINGS:
            continue
        if sum(len(one.offset) for one in links) < LEAST_MEETINGS:
            links = after
        offset, sd = _spread(both, links, settled)
        known = float(np.hypot(sd, _excess(after)))
        passed, depth = _passed(facets, {pair: given[pair] for pair in both})
        still_passed, _ = _passed(facets, {pair: used[pair] for pair in both})
        found.append(
            ScanPair(
                first=i,
                second=j,
                overlap_m2=sum(float(facets[k].area[used[h, k].met].sum()) for h, k in both) / len(both),
                offset_m=offset,
                offset_sd_m=sd,
                left_m=known if is_moved else float(np.hypot(offset, known)),
                contradicted_m2=passed,
                depth_m=depth,
                still_contradicted_m2=still_passed if is_moved else passed,
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
