# SPDX-License-Identifier: MIT
"""Registering: scans of a request without poses that hold, placed by their beams, and what to tell of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from completion.registration.pipeline import register_scans
from completion.registration.registered import Registered
from completion.registration.verdict import Verdict
from nbv.run.wording import count
from scenes.checks import InputError
from scenes.files.scan_request import GivenScans, ScanRequest, read_request, turn_to_z
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.run.steps import Progress
from scenes.scan.upright import SignedAxis

_NOTICED = 0.005
"""Share of contradicted facets of scans that are placed together from which on a person is told."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedScans:
    """Scans that were placed to each other, in a world whose z is up, and how well each pose is known."""

    given: GivenScans
    deviations_m: tuple[float, ...]


def register_request(
    request: ScanRequest,
    up: SignedAxis,
    *,
    n_threads: int | None = None,
    progress: Progress | None = None,
    journal: Journal = NO_JOURNAL,
) -> PlacedScans:
    """Read scans, whatever poses they have, and place those that their beams can place to each other.

    Those of the largest group are taken, the first one where groups are alike; what is left out is told.

    Raises
    ------
    InputError
        No two scans can be placed to each other.
    """
    given = read_request(request, "z", posed=False)
    found = register_scans(
        given.scans,
        started=request.poses is not None,
        n_threads=n_threads,
        progress=progress,
        journal=journal,
    )
    names = [Path(name).name for name in given.names]
    if not found.groups:
        why = "; ".join(dict.fromkeys(f"{one.verdict.value}: {one.reason}" for one in found.pairs))
        raise InputError(
            f"--register: no two of {len(names)} scans can be placed to each other ({why}); see the "
            "alternatives by `unseen register`, or give --poses FILE"
        )
    group = max(found.groups, key=lambda one: len(one.group.poses))
    kept = list(group.group.poses)
    poses = found.world_poses(given.scans)
    scans = [given.scans[k].restated(world_from_sensor=poses[k]) for k in kept]
    turn, told = turn_to_z(scans, up, of_points=bool(request.origins))
    told_of = [told] if told else []
    others = [names[k] for k in range(len(names)) if k not in group.group.poses]
    if others:
        told_of.append(
            f"{count(len(others), 'scan is', 'scans are')} left out, since beams do not place "
            f"{'it' if len(others) == 1 else 'them'} to the other {len(kept)}: {', '.join(others)}"
        )
    placed = replace(
        given,
        scans=tuple(scan.transformed(turn) for scan in scans),
        doubts=(*given.doubts, *doubts_of_poses(found, names), *told_of),
        paths=tuple(given.paths[k] for k in kept),
    )
    return PlacedScans(placed, tuple(found.pose_deviation(k) for k in kept))


def doubts_of_poses(found: Registered, names: Sequence[str]) -> list[str]:
    """What is not known of the poses, a sentence each."""
    told = []
    if found.level is None:
        return [
            f"{names[one.scans[0]]} and {names[one.scans[1]]}: {one.reason}"
            for one in found.pairs
            if one.verdict is Verdict.AMBIGUOUS
        ]
    for number, name in enumerate(names):
        if found.group_of(number) is None:
            own = [one for one in found.pairs if number in one.scans]
            best = min(own, key=lambda one: list(Verdict).index(one.verdict))
            told.append(f"{name} has no pose: {best.verdict.value}: {best.reason}")
    for network in found.groups:
        for scan in list(network.group.poses)[1:]:
            covariance = found.covariance_of(scan)
            if covariance is None:
                continue
            largest = float(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:]).max()))
            if largest > 0.05:
                told.append(
                    f"{names[scan]}: its pose is known to {100 * largest:.0f} cm only in one direction"
                )
    for one in found.pairs:
        if one.verdict is Verdict.REGISTERED and one.violations > _NOTICED:
            first, second = (names[number] for number in one.scans)
            told.append(
                f"{first} and {second} are placed together, but beams contradict "
                f"{100 * one.violations:.1f} % of what they share: things were moved between them, or "
                "they are two places that look alike"
            )
    return told
