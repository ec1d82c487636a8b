# SPDX-License-Identifier: MIT
"""`unseen scan`: simulated scans of a scene, from one place or from each pose of a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from nbv.commands.options.planning import ScanOptions
from nbv.commands.options.shared import Shared
from nbv.commands.process import Run, start_run
from nbv.commands.scan_along import run_scan_along
from nbv.run.wording import count
from nbv.run.workers import workers_of
from nbv.scanning.beam import Returns
from nbv.scanning.effects import Effects
from nbv.scanning.sensor import PinholeSensor, Sensor, chosen_effects, missing_errors
from nbv.scanning.sensor_profile import load_profile
from nbv.study.archive import RecordArchive, do_missing, part_of
from nbv.study.bulk import KEPT, BulkScan, KeptScans, ScanTask, write_bulk_scan
from scenes.checks import InputError
from scenes.io.formats.format import all_return_suffixes
from scenes.io.poses.trajectory import read_poses
from scenes.io.rgbd.writer import check_no_other_frames
from scenes.io.scan_files import split_index, write_scans, writer_for
from scenes.pose import Pose
from scenes.run.atomic import make_folder

_EMPTY = "does it look away from the scene, or from within something? The sensor measures"


def poses_of(asked: ScanOptions) -> dict[int, Pose]:
    """Return the poses to scan from by their numbers, from 1.

    Raises
    ------
    InputError
        Unusable file or number, or a place that looks at itself.
    """
    if asked.poses is None:
        if asked.at is None or asked.look is None or np.allclose(asked.at, asked.look):
            raise InputError(
                f"--at and --look are the same point {list(asked.at or ())}; a direction needs two"
            )
        return {1: Pose.looking_at(asked.at, asked.look)}
    path, number = split_index(asked.poses)
    poses = dict(enumerate(read_poses(path), start=1))
    if number is None:
        return poses
    if number not in poses:
        raise InputError(f"{asked.poses}: there are {len(poses)} poses, counted from 1")
    return {number: poses[number]}


def run_scan(shared: Shared, asked: ScanOptions) -> None:
    """Scan a scene from where the sensor stands and write the scans; or along a track."""
    if asked.trajectory is not None:
        run_scan_along(shared, asked)
        return
    default = Path("scan.npz")
    is_folder = asked.poses is not None and not (shared.out or default).suffix
    with start_run(
        "scan", shared, default=str(default), is_folder=is_folder, writes=asked.part is None
    ) as run:
        run.watch.enter("load")
        part = None if asked.part is None else part_of(asked.part)
        run.read([asked.scene, asked.sensor, *([asked.poses] if asked.poses else [])])
        poses = poses_of(asked)
        profile = load_profile(asked.sensor)
        suffix = _suffix(run, asked, profile.sensor)
        _check_returns(run.out, suffix, chosen_effects(profile.sensor, asked.noise), asked.returns)
        _check_target(run.out, suffix, poses)
        options = {
            "at": asked.at, "look": asked.look, "poses": asked.poses and Path(asked.poses).name,
            "sensor": profile.sensor.to_json(), "sources": dict(profile.sources), "noise": asked.noise,
            "returns": asked.returns, "truth": asked.truth, "format": suffix[1:] or "rgbd", "up": asked.up,
            "units": asked.units,
        }  # fmt: skip
        cases = _cases(run, asked, poses, suffix=suffix, key=run.key(options))
        scene, sensor = cases[0].task.open()
        run.watch.enter("scan")
        records = _take(run, asked, cases, part)
        if records is None:
            return
        run.watch.enter("write")
        _place(run, cases, suffix)
        warnings = [*scene.warnings, *missing_errors(sensor, asked.noise)]
        run.warn(warnings)
        reach = f"{sensor.min_range_m:g} to {sensor.max_range_m:g} m"
        empty = [record["name"] for record in records if not record["returns"]]
        run.warn(f"{name} has no returns: {_EMPTY} {reach}" for name in empty)
        one = sensor.scan_time_s
        time_s = None if one is None else one * len(records)
        summary = {"scene": scene.name, "sensor": sensor.name, **_summary(records), "scan_time_s": time_s}
        noise = records[0]["noise"]
        errors = "exact ranges" if noise == "none" else f"range errors: {noise}"
        speed = "" if time_s is None else f"; {time_s:.3g} s or more of measuring"
        lines = [_line(summary), f"{sensor.name}: {errors}{speed}"]
        run.finish({**options, "effects": noise}, {**summary, "warnings": warnings}, lines)


def _suffix(run: Run, asked: ScanOptions, sensor: Sensor) -> str:
    """Return the suffix of the files, "" for a folder of RGB-D images.

    Raises InputError: a format of files in a folder beside the name of a file.
    """
    if not run.is_folder:
        if asked.format is not None:
            raise InputError(
                f"{run.out}: --format is of the files in a folder; give -o a name without suffix"
            )
        return run.out.suffix.lower()
    if asked.format is not None:
        return f".{asked.format}"
    return "" if isinstance(sensor, PinholeSensor) else ".npz"


def _check_target(out: Path, suffix: str, poses: Mapping[int, Pose]) -> None:
    """Raise InputError, before anything is scanned, where the scans could not be written in the end."""
    if out.suffix:
        writer_for(out, len(poses))
    if not out.suffix and not suffix:
        check_no_other_frames(out, len(poses))
    others = sorted({file.name for file in out.glob(f"view-*{suffix}")} - {_name(k, suffix) for k in poses})
    if not out.suffix and suffix and others:
        raise InputError(
            f"{out}: holds {count(len(others), 'scan')} of another run, {others[0]} the first; give another "
            "folder, or remove them"
        )


def _name(number: int, suffix: str) -> str:
    return f"view-{number:04d}{suffix}"


def _cases(
    run: Run, asked: ScanOptions, poses: Mapping[int, Pose], *, suffix: str, key: str
) -> list[BulkScan]:
    """The scans to take, and where each is kept until all are there; without poses it is staged at once."""
    is_joined = not suffix if run.is_folder else len(poses) > 1
    folder = run.progress_folder.resolve()
    task = ScanTask(
        scene=_absolute(asked.scene), sensor=_absolute(asked.sensor), content=key, up=asked.up,
        units=asked.units, noise=asked.noise, returns=asked.returns,
        truth=asked.truth and not is_joined,
    )  # fmt: skip
    cases = []
    for number, pose in poses.items():
        own = sha256(f"{key} {number}".encode()).hexdigest()
        name = f"view-{number:04d}-{own[:8]}"
        kept = folder / "scans" / f"{name}{KEPT if is_joined else suffix}"
        cases.append(
            BulkScan(
                name=name, key=own, task=task, number=number if asked.poses else 0, seed=run.shared.seed,
                pose=tuple(map(tuple, pose.matrix.tolist())),
                file=kept if asked.poses else run.path(),
            )
        )  # fmt: skip
    return cases


def _absolute(given: str) -> str:
    """The path as all workers see it; a name as it is."""
    return str(Path(given).resolve()) if Path(given).exists() else given


def _take(
    run: Run, asked: ScanOptions, cases: Sequence[BulkScan], part: tuple[int, int] | None
) -> list[dict[str, Any]] | None:
    """Take all scans that are not there yet and return their records; of a part, say so and return None."""
    if asked.poses is None:
        return [write_bulk_scan(cases[0], run.shared.threads)]
    archive = RecordArchive(run.progress_folder / "records")
    make_folder(cases[0].file.parent)
    own = cases if part is None else cases[part[0] - 1 :: part[1]]
    with workers_of(asked.scheduler, run.shared.threads) as workers:
        times = do_missing(
            own, archive, write_bulk_scan, workers=workers, progress=run.progress, stage="scan"
        )
    run.costs.update({name: dict(spent) for name, spent in times.items()})
    if part is None:
        return [archive.read(case) for case in cases]
    line = (
        f"part {part[0]} of {part[1]}: {count(len(own), 'scan')} of {len(cases)} are there; run the command "
        "without --part when all parts are, to put them in place"
    )
    run.say({"part": list(part), "scans": len(own), "scans_of_all_parts": len(cases)}, [line])
    return None


def _place(run: Run, cases: Sequence[BulkScan], suffix: str) -> None:
    """Stage what was taken: files as they are, or all scans joined, one after the other."""
    files = [case.file for case in cases if case.number]
    if files and files[0].name.endswith(KEPT):
        write_scans(KeptScans(files), run.stage.folder if run.is_folder else run.path())
        return
    names = [_name(case.number, suffix) if run.is_folder else run.out.name for case in cases]
    run.waiting.update(zip(names, files, strict=False))


def _check_returns(out: Path, suffix: str, effects: Effects, returns: Returns | None) -> None:
    """Raise InputError where all returns are asked for of a format that holds the first alone."""
    held = all_return_suffixes()
    if (returns == "all" or effects.keeps_all_returns) and suffix not in held:
        kind = suffix or "a folder"
        raise InputError(f"{out}: {kind} holds one return a beam; write all returns to {', '.join(held)}")


def _summary(records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Headline numbers of all scans together."""
    first, spans = records[0], [record["range_m"] for record in records if record["range_m"]]
    further = [record["further_returns"] for record in records if record["further_returns"] is not None]
    return {
        "scans": len(records),
        **{name: first[name] for name in ("noise", "sigma_m", "rows", "columns")},
        "valid_share": float(np.mean([r["returns"] / (r["rows"] * r["columns"]) for r in records])),
        "range_m": [min(span[0] for span in spans), max(span[1] for span in spans)] if spans else None,
        **({"further_returns": sum(further)} if further else {}),
    }


def _line(summary: Mapping[str, Any]) -> str:
    """Return the summary in one line."""
    n_scans, span = summary["scans"], summary["range_m"]
    scans = "" if n_scans == 1 else f"{count(n_scans, 'scan')} of "
    line = (
        f"{scans}{summary['rows']} x {summary['columns']} pixels, {summary['valid_share']:.1%} with a return"
    )
    line = line if span is None else f"{line}, ranges {span[0]:.2f} to {span[1]:.2f} m"
    n_further = summary.get("further_returns")
    return line if n_further is None else f"{line}, {count(n_further, 'further return')}"
