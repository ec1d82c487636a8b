# SPDX-License-Identifier: MIT
"""Registration on one page: from scans without poses to groups, poses with covariance, and verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from completion.observe.observation import Observation, find_key_frames, observe
from completion.observe.tolerance import REGISTRATION_M
from completion.registration.correction import PosedScans, Registration, ScanPair, deviations_left
from completion.registration.hypotheses import Hypothesis, find_hypotheses
from completion.registration.motions import in_units
from completion.registration.network import ScanGroup, group_scans, settle_group
from completion.registration.registered import Registered, held_poses, verdicts_of
from completion.registration.station_view import StationView, unit_of
from completion.registration.verdict import with_images
from scenes.checks import FloatArray, InputError, check_directions
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.run.mapping import NO_SPILL, NoSpill, Spill
from scenes.run.steps import Progress, Steps
from scenes.scan.range_image import RangeImage

LEVEL = 0.01
"""Accepted probability of a false claim."""


def register_scans(
    scans: Sequence[RangeImage],
    *,
    level: float = LEVEL,
    upright: bool = False,
    up: FloatArray | None = None,
    started: bool = False,
    n_threads: int | None = None,
    progress: Progress | None = None,
    journal: Journal = NO_JOURNAL,
) -> Registered:
    """Find the poses of scans to each other from any start (after Robertson & Fisher 2002), or say why not.

    What the scans say of their own poses is not looked at, unless it is to be started from.

    Parameters
    ----------
    scans : sequence of RangeImage
        At least two.
    level : float
        Accepted probability of a false claim, above 0 and below 1.
    upright : bool
        Whether the scans' own poses know what is up: levelled scanners. Only turns about it are tried.
    up : (3,) or (n, 3) float, optional
        The direction of their worlds that is up, of all or of each; z when not given.
    started : bool
        Whether the scans' own poses are tried too. What beams approve more is never given up for them.
    n_threads : int, optional
        Threads; results do not depend on it.
    progress : callable, optional
        Called with a stage's name, steps done and steps in all.
    journal : Journal
        Remembers what steps came to, so that a run that was killed goes on.

    Raises
    ------
    InputError
        Fewer than two scans, a level that is no probability, or an up that is no direction.
    """
    if len(scans) < 2:
        raise InputError(f"registration needs at least two scans, got {len(scans)}")
    if not 0 < level < 1:
        raise InputError(f"the level must lie between 0 and 1, got {level}")
    with Steps.over([scan.ranges.size for scan in scans], n_threads, progress, journal) as steps:
        # 1. View: the facets and planes of each scan, in its own frame; small objects in smaller units.
        unit = unit_of(scans)
        axes = check_directions("up", (0.0, 0.0, 1.0) if up is None else up, len(scans)) if upright else None
        views = steps.each(
            "facets",
            lambda k: StationView.of(scans[k], up=None if axes is None else axes[k], unit_m=unit),
            range(len(scans)),
            remember=False,
        )

        # 2. Propose: the poses of each pair of scans that beams of both approve.
        def propose(pair: tuple[int, int]) -> list[Hypothesis]:
            first, second = (scans[number].world_from_sensor for number in pair)
            start = in_units((first.inverse() @ second).matrix[:3], unit) if started else None
            a, b = views[pair[0]], views[pair[1]]
            return with_images(find_hypotheses(a, b, start, are_objects=unit < 1.0), a, b)

        pairs = list(combinations(range(len(scans)), 2))
        proposed = steps.each("pairs", propose, pairs)
        hypotheses = dict(zip(pairs, proposed, strict=True))

        # 3. Group: join what may be claimed, the surest first, against all that is placed already.
        def settle(group: ScanGroup) -> ScanGroup:
            return settle_group(group, views).group

        groups = steps.one("groups", lambda: group_scans(views, hypotheses, level, settle))

        # 4. Settle: all scans of a group by all that they share, with the covariance of their poses.
        networks = [settle_group(group, views, by_planes=True) for group in groups]

        # 5. Judge: what is known of each pair of scans, and by how much beams contradict it.
        verdicts = verdicts_of(hypotheses, networks, views, level)
        return Registered(tuple(networks), verdicts, tuple(views), level=level).in_metres(unit)


def correct_poses(
    observations: Sequence[Observation],
    keys: Sequence[int],
    *,
    stated_m: float,
    moves: bool = True,
    spill: Spill | NoSpill = NO_SPILL,
) -> Registration:
    """Register scans that come with poses: the prior is that these are right but for some scans.

    Scans are moved where that brings together what they measured, by more than a millimetre and more than
    three standard deviations in some pair, and where their beams approve the poses so corrected no less than
    those that came. Otherwise poses stay as they are, to the bit. Scans that no motion brings together which
    their beams approve are of different groups, which stay to each other as they came. What moved between two
    scans does not come together either; it is counted as contradicted area.

    Parameters
    ----------
    observations : sequence of Observation
        The n scans, in one frame by their poses.
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
    # 1. View: the facets of each scan. 2. Propose: the poses that came, of scans that share most.
    scans = PosedScans.of(observations, spill)
    partners = scans.partners(keys)
    # 3. Refine all scans together. 4. Judge: beams refuse pairs that came together only for it; refine again.
    refused: dict[tuple[int, int], ScanPair] = {}
    adjusted = scans.adjust(partners, refused.keys())
    while adjusted.is_off and (worse := scans.contradicted_pairs(adjusted)):
        refused |= {
            pair: scan_pair
            for scan_pair in adjusted.pairs
            if (pair := (scan_pair.first, scan_pair.second)) in worse
        }
        adjusted = scans.adjust(partners, refused.keys())
    # 5. Settle: how far each pose may still be off, by the pairs that hold; poses that are right stay.
    is_moved = moves and adjusted.is_off
    held = adjusted.pairs if is_moved else tuple(pair.left_alone() for pair in adjusted.pairs)
    apart = tuple(pair.left_alone() for pair in refused.values())
    return Registration(
        motions=adjusted.motions if is_moved else still,
        moved_m=adjusted.shifts if is_moved else np.zeros(n),
        left_m=deviations_left(held, n),
        pairs=tuple(sorted((*held, *apart), key=lambda pair: (pair.first, pair.second))) if apart else held,
        stated_m=stated_m,
        refused=frozenset(refused),
    )


def check_poses(
    scans: Sequence[RangeImage], *, n_threads: int | None = None, progress: Progress | None = None
) -> Registered:
    """Compare the poses that scans came with to what their beams say; no pose is changed.

    Groups and contradictions are those of `correct_poses`, which `complete` asks; the verdict of every pair
    stands beside its overlap and its contradictions.

    Raises
    ------
    InputError
        Fewer than two scans.
    """
    if len(scans) < 2:
        raise InputError(f"poses of at least two scans can be checked, got {len(scans)}")
    with Steps.over([scan.ranges.size for scan in scans], n_threads, progress, NO_JOURNAL) as steps:
        unit = unit_of(scans)
        views = steps.each("facets", lambda scan: StationView.of(scan, unit_m=unit), scans, remember=False)
        first = scans[0].world_from_sensor.inverse()
        poses = [in_units((first @ scan.world_from_sensor).matrix[:3], unit) for scan in scans]
        observations = steps.each(
            "noise", lambda scan: observe(scan, scans[0].world_from_sensor), scans, remember=False
        )
        keys = find_key_frames(observations)
        checked = correct_poses(observations, keys, stated_m=REGISTRATION_M, moves=False)
        return held_poses(views, poses, checked).in_metres(unit)
