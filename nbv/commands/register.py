# SPDX-License-Identifier: MIT
"""`unseen register`: poses of scans from any start, or what their poses contradict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from completion.registration.facets import count_agreement
from completion.registration.pipeline import check_poses, register_scans
from completion.registration.registered import PairVerdict, Registered, registration_record
from completion.registration.verdict import Verdict
from nbv.commands.options.scans import RegisterOptions
from nbv.commands.options.shared import Shared
from nbv.commands.process import start_run
from nbv.run.wording import count
from nbv.scans.registering import copies_of, copies_told, doubts_of_poses, pose_deviations, ups_of
from scenes.inclination import Up
from scenes.io.formats.format import written_suffixes
from scenes.io.scan_files import split_index, write_scan, write_scans
from scenes.io.scan_request import GivenScans, read_request
from scenes.pose import Pose
from scenes.run.atomic import write_json
from scenes.scan.range_image import RangeImage


def run_register(shared: Shared, how: RegisterOptions) -> None:
    """Register scans, or check their poses; write registration.json, scans and report."""
    request = how.request()
    with start_run("register", shared, default="out/register", is_folder=True) as run:
        run.watch.enter("load")
        run.read(request.inputs)
        given = read_request(request, posed=how.checks)
        asked = {**request.options(), **how.record()}
        run.warn(given.doubts)
        said, doubts = Up.along(how.up), list[str]()
        upward = None if said is None else said.direction
        if how.upright and upward is None and not how.checks:
            run.watch.enter("up")
            upward, doubts = ups_of(given.scans, n_threads=shared.threads)
        run.will_call(count_agreement, 20)
        if how.checks:
            poses = check_poses(given.scans, n_threads=shared.threads, progress=run.progress)
        else:
            poses = register_scans(
                given.scans,
                level=how.level,
                upright=how.upright,
                up=upward,
                started=request.poses is not None,
                n_threads=shared.threads,
                progress=run.progress,
                journal=run.journal(asked),
            )
        names = given.names
        short = [Path(name).name for name in names]
        same = copies_told(short, copies_of(given.scans))
        warnings = [*given.doubts, *doubts, *same, *doubts_of_poses(poses, short)]
        run.warn(warnings[len(given.doubts) :])
        run.watch.enter("save")
        record = {**registration_record(poses, given.scans, names), "warnings": warnings}
        write_json(run.stage.path("registration.json"), record)
        if not how.checks:
            _write_posed(run.stage.folder, given, poses.world_poses(given.scans))
        run.watch.enter("report")
        from nbv.report.registration_report import registration_page

        page = registration_page(poses, given.scans, names, request.title)
        run.report(replace(page, warnings=tuple(warnings)), asked)
        run.finish(asked, {**summary_of(poses), "warnings": warnings}, lines_of(poses, names))


def summary_of(registration: Registered) -> dict[str, Any]:
    """Return the headline numbers."""
    verdicts = [pair.verdict for pair in registration.pairs]
    deviations = _deviations(registration)
    return {
        "scans": len(registration.views),
        "groups": [list(group.group.poses) for group in registration.groups],
        "by_themselves": [k for k in range(len(registration.views)) if registration.group_of(k) is None],
        "pairs": {verdict.value: verdicts.count(verdict) for verdict in Verdict},
        "largest_deviation_m": max((shift for shift, _ in deviations.values()), default=None),
        "most_contradicted": max((pair.violations for pair in registration.pairs), default=0.0),
    }


def lines_of(registration: Registered, names: Sequence[str]) -> list[str]:
    """Return the headline numbers for people."""
    if registration.level is None:
        held = sum(pair.verdict is Verdict.REGISTERED for pair in registration.pairs)
        return [
            f"poses      beams hardly contradict {held} of {count(len(registration.pairs), 'pair', 'pairs')}",
            *_line_of_contradiction(registration.pairs, names),
        ]
    lines = [
        f"group {number + 1}    {count(len(group.group.poses), 'scan', 'scans')}: "
        + ", ".join(Path(names[scan]).name for scan in group.group.poses)
        for number, group in enumerate(registration.groups)
    ]
    alone = [Path(names[k]).name for k in range(len(names)) if registration.group_of(k) is None]
    lines += [f"alone      {', '.join(alone)}"] if alone else []
    deviations = _deviations(registration)
    if deviations:
        scan = max(deviations, key=lambda one: deviations[one])
        turn = max(turn for _, turn in deviations.values())
        lines.append(
            f"deviation  standard deviation of a pose: {1000 * deviations[scan][0]:.2g} mm at most "
            f"({Path(names[scan]).name}), {np.degrees(turn):.2g} deg at most"
        )
    within = [pair for pair in registration.pairs if pair.verdict is Verdict.REGISTERED]
    return lines + _line_of_contradiction(within, names)


def _deviations(registration: Registered) -> dict[int, tuple[float, float]]:
    """Return how well the pose of each scan is known, to the first one of its group."""
    placed = [scan for group in registration.groups for scan in list(group.group.poses)[1:]]
    return pose_deviations(registration, placed)


def _line_of_contradiction(pairs: Sequence[PairVerdict], names: Sequence[str]) -> list[str]:
    """Return the pair whose beams contradict each other most; nothing where there is none."""
    if not pairs:
        return []
    worst = max(pairs, key=lambda pair: pair.violations)
    first, second = (Path(names[number]).name for number in worst.scans)
    return [f"worst      {first} and {second}: {100 * worst.violations:.1f} % contradicted"]


def _write_posed(folder: Path, given: GivenScans, poses: Sequence[Pose | None]) -> None:
    """Write the scans that have poses as posed/NAME, those of one file together where it can hold them."""
    target = folder / "posed"
    taken: set[str] = set()
    for path in dict.fromkeys(given.paths):
        images = [
            scan.with_facts(world_from_sensor=pose)
            for scan, of, pose in zip(given.scans, given.paths, poses, strict=True)
            if of == path and pose is not None
        ]
        if not images:
            continue
        target.mkdir(parents=True, exist_ok=True)
        base, number = split_index(path)
        name = base.name if number is None else f"{base.stem}-{number}{base.suffix}"
        if base.suffix.lower() == ".e57" and name not in taken:
            write_scans(images, target / name)
        elif base.suffix.lower() in written_suffixes() and len(images) == 1 and name not in taken:
            write_scan(images[0], target / name)
        else:
            stem = Path(name).stem
            _write_numbered(images, target, stem, taken)
            continue
        taken.add(name)


def _write_numbered(scans: Sequence[RangeImage], target: Path, stem: str, taken: set[str]) -> None:
    """Write scans as .npz of names that are not taken."""
    number = 0
    for scan in scans:
        while True:
            number += 1
            name = f"{stem}-{number}.npz"
            if name not in taken:
                break
        taken.add(name)
        write_scan(scan, target / name)
