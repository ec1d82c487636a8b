# SPDX-License-Identifier: MIT
"""Registering: scans of a request without poses that hold, placed by their beams, and what to tell of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from completion.observe.tolerance import POSE_BOUND, REGISTRATION_M
from completion.registration.network import Network
from completion.registration.pipeline import register_scans
from completion.registration.registered import Registered, pose_doubts
from completion.registration.verdict import Verdict
from nbv.online.limits import NOTICED_SHARE
from nbv.run.wording import count
from nbv.scans.upright import find_up_of
from scenes.checks import FloatArray, InputError
from scenes.io.scan_request import GivenScans, ScanRequest, read_request
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.run.steps import Progress
from scenes.scan.doubts import merge_warnings
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True, eq=False)
class PlacedScans:
    """Scans that were placed to each other, in the world of the first, and how well each pose is known.

    Attributes
    ----------
    given : GivenScans
        The scans, and what is to be told of them.
    deviations_m : tuple of float
        By how much the error of each pose shifts its scan's facets, metres.
    summary : str
        A sentence on what was placed, how well, and what was left alone.
    """

    given: GivenScans
    deviations_m: tuple[float, ...]
    summary: str


def register_request(
    request: ScanRequest,
    *,
    n_threads: int | None = None,
    progress: Progress | None = None,
    journal: Journal = NO_JOURNAL,
) -> PlacedScans:
    """Read scans, whatever poses they have, and place those that their beams can place to each other.

    Those of the largest group are taken, the first one where groups are alike; what is left out is told. Of
    scans that are the same, the first alone counts: that a scan fits its copy says nothing of either.

    Raises
    ------
    InputError
        No two scans can be placed to each other.
    """
    given, told_of = without_copies(read_request(request, posed=False))
    if told_of and len(given.scans) == 1:
        given = replace(given, doubts=(*given.doubts, *told_of))
        return PlacedScans(given, (), "placed    1 scan, by itself")
    registration = register_scans(
        given.scans,
        started=request.poses is not None,
        n_threads=n_threads,
        progress=progress,
        journal=journal,
    )
    names = [Path(name).name for name in given.names]
    if not registration.groups:
        why = "; ".join(dict.fromkeys(f"{pair.verdict.value}: {pair.reason}" for pair in registration.pairs))
        raise InputError(
            f"--register: no two of {len(names)} scans can be placed to each other ({why}); see the "
            "alternatives by `unseen register`, or give --poses FILE"
        )
    group = max(registration.groups, key=lambda network: len(network.group.poses))
    kept = list(group.group.poses)
    poses = registration.world_poses(given.scans)
    others = [names[k] for k in range(len(names)) if k not in group.group.poses]
    if others:
        told_of.append(
            f"{count(len(others), 'scan is', 'scans are')} left out, since beams do not place "
            f"{'it' if len(others) == 1 else 'them'} to the other {len(kept)}: {', '.join(others)}"
        )
    placed = replace(
        given.pick(kept),
        scans=tuple(given.scans[k].with_facts(world_from_sensor=poses[k]) for k in kept),
        doubts=(*given.doubts, *doubts_of_poses(registration, names), *told_of),
    )
    sentence = placement_told(registration, group, names)
    return PlacedScans(placed, tuple(_deviation(registration, k) for k in kept), sentence)


def _deviation(registration: Registered, scan: int) -> float:
    """Standard deviation of a scan's pose, metres; the stated pose error where registration has none."""
    deviation = registration.pose_deviation(scan)
    return deviation if np.isfinite(deviation) else REGISTRATION_M / POSE_BOUND


def ups_of(scans: Sequence[RangeImage], *, n_threads: int | None = None) -> tuple[FloatArray, list[str]]:
    """Estimate which way is up (n, 3) for scans with a world each, and return what to tell of it."""
    ups = [find_up_of([scan], n_threads) for scan in scans]
    told = [up.describe("poses are sought with this upright") for up in ups]
    named = [(scan.name, [text] if text else []) for scan, text in zip(scans, told, strict=True)]
    return np.array([up.direction for up in ups]), merge_warnings(named)


def copies_of(scans: Sequence[RangeImage]) -> dict[int, int]:
    """Return for each scan that an earlier one equals, ray by ray and range by range, that one's number."""
    return {
        second: first
        for first, second in reversed(list(combinations(range(len(scans)), 2)))
        if scans[first].shape == scans[second].shape
        and np.array_equal(scans[first].ranges, scans[second].ranges, equal_nan=True)
        and np.array_equal(scans[first].projection.directions(), scans[second].projection.directions())
    }


def copies_told(names: Sequence[str], copies: Mapping[int, int]) -> list[str]:
    """What to tell of scans that are the same as others, a sentence each."""
    return [
        f"{names[second]} is the same scan as {names[first]}: that they fit says nothing"
        for second, first in sorted(copies.items())
    ]


def without_copies(given: GivenScans) -> tuple[GivenScans, list[str]]:
    """Return what was given without scans that are the same as others, and a sentence on each of these."""
    copies = copies_of(given.scans)
    kept = [k for k in range(len(given.scans)) if k not in copies]
    sentences = [
        f"{text}; it is taken once" for text in copies_told([Path(n).name for n in given.names], copies)
    ]
    return given.pick(kept), sentences


def pose_deviations(registration: Registered, scans: Sequence[int]) -> dict[int, tuple[float, float]]:
    """Return by scan the standard deviation of its pose where it is largest: shift (metres), turn (radians).

    Scans whose covariance is not known are left out.
    """
    deviations = {}
    for scan in scans:
        covariance = registration.covariance_of(scan)
        if covariance is not None and np.isfinite(covariance).all():
            shift, turn = (
                float(np.sqrt(max(np.linalg.eigvalsh(covariance[part, part])[-1], 0.0)))
                for part in (slice(3, 6), slice(0, 3))
            )
            deviations[scan] = shift, turn
    return deviations


def placement_told(registration: Registered, group: Network, names: Sequence[str]) -> str:
    """Return one sentence: which scans of a group were placed, how well, and what was left alone and why."""
    first, *others = group.group.poses
    deviations = pose_deviations(registration, others)
    sentence = f"placed    {count(len(others), 'scan')} to {names[first]}"
    if deviations:
        shifts, turns = np.transpose(list(deviations.values()))
        each = "its pose" if len(others) == 1 else "their poses"
        sentence += f", {each} with a standard deviation of {_range(np.multiply(shifts, 1000.0), 'mm')} and "
        sentence += _range(np.degrees(turns), "deg")
    alone = [
        f"{names[k]} ({_why_alone(registration, k)})" for k in range(len(names)) if k not in group.group.poses
    ]
    return f"{sentence}; left alone: {', '.join(alone)}" if alone else sentence


def placed_of(sentences: Sequence[str]) -> dict[str, str]:
    """Return what a summary says of scans that were placed first; nothing where none were."""
    return {"placed": sentences[0].removeprefix("placed").strip()} if sentences else {}


def _range(values: Sequence[float] | FloatArray, unit: str) -> str:
    """From the least to the largest of some values, two digits."""
    low, high = (f"{float(f'{value:.2g}'):g}" for value in (min(values), max(values)))
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def _why_alone(registration: Registered, scan: int) -> str:
    """Why a scan is not in the group that is taken."""
    if registration.group_of(scan) is not None:
        return "placed to others, but not to these"
    verdicts = [pair for pair in registration.pairs if scan in pair.scans]
    best = min(verdicts, key=lambda verdict: list(Verdict).index(verdict.verdict))
    return f"{best.verdict.value}: {best.reason}"


def doubts_of_poses(registration: Registered, names: Sequence[str]) -> list[str]:
    """What is not known of the poses, a sentence each."""
    doubts = []
    if registration.level is None:
        doubts += [
            f"{names[pair.scans[0]]} and {names[pair.scans[1]]}: {pair.reason}"
            for pair in registration.pairs
            if pair.verdict is Verdict.AMBIGUOUS
        ]
        return doubts + ([] if registration.checked is None else pose_doubts(registration.checked, names))
    for number, name in enumerate(names):
        if registration.group_of(number) is None:
            doubts.append(f"{name} has no pose: {_why_alone(registration, number)}")
    for network in registration.groups:
        for scan in list(network.group.poses)[1:]:
            covariance = registration.covariance_of(scan)
            if covariance is None:
                continue
            largest = float(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:]).max()))
            if largest > 0.05:
                doubts.append(
                    f"{names[scan]}: its pose is known to {100 * largest:.0f} cm only in one direction"
                )
    for pair in registration.pairs:
        if pair.verdict is Verdict.REGISTERED and pair.violations > NOTICED_SHARE:
            first, second = (names[number] for number in pair.scans)
            doubts.append(
                f"{first} and {second} are placed together, but beams contradict "
                f"{100 * pair.violations:.1f} % of what they share: things were moved between them, or "
                "they are two places that look alike"
            )
    return doubts
