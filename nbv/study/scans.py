# SPDX-License-Identifier: MIT
"""Study of scans: simulate every scan that is not known yet, tally its errors, and drop it.

A case is one scan. Its record holds tallies and which samples of the surface it measured, a few kilobytes;
what a set of scans measured together is summed up from the records of its scans. So no more than one scan is
in memory, but where a set is completed, which takes all of it at once.
"""

from __future__ import annotations

import base64
import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from completion.registration.pipeline import register_scans
from nbv.coverage.measurement import measured_samples
from nbv.coverage.surface_classes import KnownSurfaces
from nbv.plan.baselines import farthest_poses
from nbv.run.manifest import versions
from nbv.run.workers import ThisProcess, Workers
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import chosen_effects
from nbv.study.archive import RecordArchive, do_missing
from nbv.study.case import CaseSetting, identity_of, load_setting, slug
from nbv.study.scan_errors import tally_errors
from nbv.study.spec import PosesEntry, Sampling, ScanStudySpec, SceneEntry, SensorEntry
from nbv.visibility.visibility import Progress
from scenes.checks import BoolArray, FloatArray, InputError, Value
from scenes.io.poses.trajectory import read_poses
from scenes.io.scan_files import write_scan
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.mesh.triangle_distance import distances
from scenes.pose import Pose
from scenes.run.atomic import json_text, make_folder
from scenes.scan.range_image import RangeImage

_RIGHT_M = 0.02  # from the true surface, as of plans with completion


@dataclass(frozen=True, slots=True)
class ScanCase(Value):
    """One scan of a study; `key` is the SHA-256 of all that its record depends on.

    `true_pose` is where the sensor stood, `pose` where it is said to have stood, rows of 4x4 matrices; `file`
    is where the scan is kept, if it is.
    """

    name: str
    key: str
    scene: SceneEntry
    sensor: SensorEntry
    sampling: Sampling
    number: int
    seed: int
    true_pose: tuple[tuple[float, ...], ...]
    pose: tuple[tuple[float, ...], ...]
    file: Path | None = None


@dataclass(frozen=True, slots=True)
class ScanSet(Value):
    """All scans of one scene by one sensor from one entry of poses with one seed, and what they are for."""

    name: str
    key: str
    scene: SceneEntry
    sensor: SensorEntry
    poses: PosesEntry
    seed: int
    scans: tuple[ScanCase, ...]
    complete: bool = False
    register: bool = False

    def labels(self) -> dict[str, Any]:
        """Return what the set is of, as columns of the results."""
        return {
            "scene": self.scene.label, "sensor": self.sensor.label, "poses": self.poses.label,
            "seed": self.seed,
        }  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class SetRecords(Value):
    """A set, the records of its scans, and that of all together where completion or registration is asked."""

    scans: ScanSet
    records: tuple[Mapping[str, Any], ...]
    together: Mapping[str, Any] | None


def sets_of(spec: ScanStudySpec, folder: Path, first_seed: int = 0) -> tuple[ScanSet, ...]:
    """Return the sets in the order of the study file; all scenes, sensors and files of poses are opened.

    Scans that are kept are written to `folder`.

    Raises
    ------
    InputError
        A scene, sensor or file of poses that cannot be used, errors that a sensor does not have.
    """
    sets = list[ScanSet]()
    contents = {entry: identity_of(entry) for entry in spec.scenes}
    for scene, sensor, poses, seed in product(spec.scenes, spec.sensors, spec.poses, spec.seeds):
        setting = load_setting(scene, sensor, spec.sampling)
        chosen_effects(setting.sensor, sensor.noise)
        common = {
            "versions": versions(),
            "sampling": spec.sampling.model_dump(),
            "scene": {**scene.model_dump(exclude={"name", "scene"}), "content": contents[scene]},
            "sensor": {"profile": setting.sensor.to_json(), "noise": sensor.noise},
            "seed": first_seed + seed,
        }
        stem = "-".join(map(slug, (scene.label, sensor.label, poses.label))) + f"-seed{first_seed + seed}"
        scans = list[ScanCase]()
        for number, true in enumerate(_poses_of(poses, setting, first_seed + seed), start=1):
            pose = _misplaced(true, spec, first_seed + seed, number)
            key = _key(
                {**common, "number": number, "true": true.matrix.tolist(), "pose": pose.matrix.tolist()}
            )
            name = f"{stem}-{number:04d}-{key[:8]}"
            file = None if spec.keep == "none" else folder / f"{name}.{spec.keep}"
            scans.append(
                ScanCase(
                    name=name, key=key, scene=scene, sensor=sensor, sampling=spec.sampling, number=number,
                    seed=first_seed + seed, true_pose=_rows(true), pose=_rows(pose), file=file,
                )
            )  # fmt: skip
        todo = {"complete": spec.complete, "register": spec.register_scans}
        key = _key({"scans": [scan.key for scan in scans], **todo})
        sets.append(
            ScanSet(
                name=f"{stem}-{key[:8]}", key=key, scene=scene, sensor=sensor, poses=poses,
                seed=first_seed + seed, scans=tuple(scans), **todo,
            )
        )  # fmt: skip
    return tuple(sets)


def _rows(pose: Pose) -> tuple[tuple[float, ...], ...]:
    """The rows of a pose's matrix."""
    return tuple(map(tuple, pose.matrix.tolist()))


def _key(made_of: Mapping[str, Any]) -> str:
    return hashlib.sha256(json_text(made_of, indent=None).encode()).hexdigest()


def _poses_of(entry: PosesEntry, setting: CaseSetting, seed: int) -> list[Pose]:
    """The true poses of an entry in a scene."""
    if entry.file is not None:
        return list(read_poses(Path(entry.file)))
    if entry.at:
        looks = entry.look * len(entry.at) if len(entry.look) == 1 else entry.look
        return [Pose.looking_at(at, look) for at, look in zip(entry.at, looks, strict=True)]
    candidates = setting.standing.candidates
    start = int(np.random.default_rng(seed).integers(candidates.n_poses))
    chosen = farthest_poses(candidates, start, min(int(entry.farthest or 1), candidates.n_poses))
    return [candidates.pose(number) for number in chosen]


def _misplaced(true: Pose, spec: ScanStudySpec, seed: int, number: int) -> Pose:
    """Where a scan is said to be: off by what the study says of each axis, by normal numbers."""
    if spec.pose_sd_m == 0 and spec.pose_sd_deg == 0:
        return true
    rng = np.random.default_rng([seed, number, 1])
    shift, turn = rng.normal(0, spec.pose_sd_m, 3), np.radians(rng.normal(0, spec.pose_sd_deg, 3))
    rotation = Rotation.from_rotvec(turn).as_matrix() @ true.rotation
    return Pose.from_parts(rotation, true.translation + shift)


def take_scan(case: ScanCase, setting: CaseSetting, n_threads: int | None = None) -> RangeImage:
    """Return the scan of a case, with truth, where it is said to have been taken.

    Its errors are drawn as `unseen scan --poses` draws them: by the seed and the number of the pose.
    """
    true, pose = Pose(np.array(case.true_pose)), Pose(np.array(case.pose))
    scan = scan_scene(
        setting.scene, true, setting.sensor, noise=case.sensor.noise,
        rng=np.random.default_rng([case.seed, case.number]), caster=setting.scene.ray_caster(n_threads),
        n_threads=n_threads, name=f"view {case.number}",
    )  # fmt: skip
    return scan if case.pose == case.true_pose else replace(scan, world_from_sensor=pose)


def run_scan(case: ScanCase, n_threads: int | None = None) -> dict[str, Any]:
    """Take a scan, keep it where it is to be kept, and return its record: tallies, and samples measured."""
    head = {"case": case.name, "key": case.key, "number": case.number}
    begin = time.perf_counter(), time.process_time()
    setting = load_setting(case.scene, case.sensor, case.sampling)
    try:
        scan = take_scan(case, setting, n_threads)
    except InputError as error:
        return {**head, "error": str(error)}
    effects = chosen_effects(setting.sensor, case.sensor.noise)
    tallies = tally_errors(
        scan, setting.scene, setting.sensor, effects, true_pose=Pose(np.array(case.true_pose))
    )
    seen = np.zeros(len(setting.samples), np.bool_)
    seen[measured_samples(scan, setting.samples)[0]] = True
    if case.file is not None:
        make_folder(case.file.parent)
        write_scan(scan, case.file)
    return {
        **head,
        "pixels": int(scan.ranges.size),
        "returns": int(scan.valid.sum()),
        "sigma_m": scan.sigma_m,
        "tallies": {name: tally.to_json() for name, tally in tallies.items()},
        "seen": packed(seen),
        "times": {"seconds": time.perf_counter() - begin[0], "cpu_seconds": time.process_time() - begin[1]},
    }


def run_together(scans: ScanSet, n_threads: int | None = None) -> dict[str, Any]:
    """Complete and register all scans of a set, as it asks; return what came of it."""
    setting = load_setting(scans.scene, scans.sensor, scans.scans[0].sampling)
    record: dict[str, Any] = {"case": scans.name, "key": scans.key}
    try:
        taken = [take_scan(case, setting, n_threads) for case in scans.scans]
        if scans.complete:
            record["completed"] = _completed(taken, setting, n_threads)
        if scans.register and len(taken) > 1:
            record["registered"] = _registered(taken, scans, n_threads)
    except InputError as error:
        record["error"] = str(error)
    return record


def _completed(scans: Sequence[RangeImage], setting: CaseSetting, n_threads: int | None) -> dict[str, Any]:
    """Which samples completion models and infers, and how much of what it infers is right."""
    samples = setting.samples
    known = replace(KnownSurfaces.of(scans, n_threads=n_threads), min_confidence=0.0)  # every claim
    vertices, faces, _ = known.inferred_mesh()
    corners = vertices[faces]
    areas = triangle_areas(corners)
    right = distances(corners.mean(axis=1), setting.scene.mesh.corners) <= _RIGHT_M
    return {
        "modelled": packed(known.on_modelled(samples.points, samples.normals, _RIGHT_M)),
        "inferred": packed(known.on_inferred(samples.points, samples.normals, _RIGHT_M)),
        "inferred_m2": float(areas.sum()),
        "right_m2": float(areas[right].sum()),
    }


def _registered(
    scans: Sequence[RangeImage], asked: ScanSet, n_threads: int | None
) -> dict[str, float | int | None]:
    """How many scans were placed to others, and how far each is off beside the first of its group.

    Root mean squares, metres and degrees; what the poses said counts as a start, no more.
    """
    found = register_scans(scans, started=True, n_threads=n_threads)
    placed, shifts, turns = 0, list[float](), list[float]()
    for group in found.groups:
        numbers = sorted(group.group.poses)
        placed += len(numbers)
        first = numbers[0]
        true = [Pose(np.array(case.true_pose)) for case in asked.scans]
        for number in numbers[1:]:
            told = _in_first(group.group.poses[first], group.group.poses[number])
            off = (true[first].inverse() @ true[number]).inverse() @ told
            shifts.append(float(np.linalg.norm(off.translation)))
            turns.append(float(np.degrees(np.linalg.norm(Rotation.from_matrix(off.rotation).as_rotvec()))))
    return {
        "placed": placed,
        "shift_m": float(np.sqrt(np.mean(np.square(shifts)))) if shifts else None,
        "turn_deg": float(np.sqrt(np.mean(np.square(turns)))) if turns else None,
    }


def _in_first(first: FloatArray, other: FloatArray) -> Pose:
    """Pose of a scan in the frame of the first, of two poses (3, 4) in one frame."""
    a, b = (Pose.from_parts(pose[:, :3], pose[:, 3]) for pose in (first, other))
    return a.inverse() @ b


def packed(mask: BoolArray) -> str:
    """Return a mask (n,) as text."""
    return base64.b64encode(np.packbits(mask).tobytes()).decode("ascii")


def unpacked(text: str, n: int) -> BoolArray:
    """Return the mask (n,) of a text."""
    bits = np.frombuffer(base64.b64decode(text), np.uint8)
    return np.asarray(np.unpackbits(bits, count=n), np.bool_)


def run_scan_study(
    spec: ScanStudySpec,
    folder: Path,
    *,
    first_seed: int = 0,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> tuple[SetRecords, ...]:
    """Run a study of scans and return the records of each set, in the order of the study file.

    Parameters
    ----------
    spec : ScanStudySpec
        What to scan.
    folder : Path
        Keeps `records`, and the `scans` that are kept; what is there already and was made of the same is not
        made again.
    first_seed : int
        Added to every seed of the study.
    workers : Workers, optional
        Who scans; this process when not given. The records do not depend on it.
    progress : callable, optional
        Called with ("cases", done, total).

    Raises
    ------
    InputError
        What cannot be used; nothing has been scanned then.
    """
    sets, archive = sets_of(spec, folder / "scans", first_seed), RecordArchive(folder / "records")
    workers = workers or ThisProcess()
    do_missing(
        [case for one in sets for case in one.scans], archive, run_scan, workers=workers, progress=progress
    )
    if spec.joins_scans:
        do_missing(sets, archive, run_together, workers=workers, progress=progress)
    return tuple(
        SetRecords(
            one,
            tuple(archive.read(case) for case in one.scans),
            archive.read(one) if spec.joins_scans else None,
        )
        for one in sets
    )
