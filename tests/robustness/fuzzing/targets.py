# SPDX-License-Identifier: MIT
"""Targets: every reader, its valid files, and a function that reads a path and touches all it returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from completion.edits.file import read_edits
from nbv.commands.info import _lines, describe_output, with_states
from nbv.commands.texture import read_image, read_mask
from nbv.plan.plan import read_plan
from nbv.scanning.sensor_profile import load_profile
from nbv.study.spec import read_study
from nbv.visibility.viewpoints import load_candidates
from scenes.io.describe import describe, describe_image
from scenes.io.point_files import read_points
from scenes.io.poses.trajectory import read_poses, read_timed_poses
from scenes.io.rgbd.depth import read_depth_image
from scenes.io.scan_files import read_scans
from scenes.io.scene_files import load_scene
from tests.robustness.fuzzing import invariants, seeds_of_scans, seeds_of_scenes
from tests.robustness.fuzzing.case import Case
from tests.robustness.fuzzing.invariants import hold


@dataclass(frozen=True)
class Target:
    """A reader.

    Attributes
    ----------
    name : str
        Unique.
    seeds : function
        Returns its valid files.
    read : function
        Reads a path and checks what comes back.
    n_examples : int
        Mutants that the gate tries.
    """

    name: str
    seeds: Callable[[], list[Case]]
    read: Callable[[Path], object]
    n_examples: int = 20


def read_scene(path: Path) -> None:
    """A mesh file as a scene."""
    invariants.check_scene(load_scene(path))


def read_every_scan(path: Path) -> None:
    """All scans of a file or folder."""
    scans = read_scans(path)
    hold(scans, "no scan")
    for scan in scans:
        invariants.check_scan(scan)


def read_cloud(path: Path) -> None:
    """Points of a file."""
    invariants.check_points(read_points(path))


def read_trajectory(path: Path) -> None:
    """Poses of a file, and their times where it has some."""
    for pose in read_poses(path):
        invariants.check_pose(pose)
    if path.name == "tum.txt":
        times, poses = read_timed_poses(path)
        hold(len(times) == len(poses) and np.isfinite(times).all(), "a time is not finite")


def read_picture(path: Path) -> None:
    """An image to be textured, and as a mask."""
    pixels = read_image(str(path))
    hold(pixels.dtype == np.uint8 and pixels.ndim in (2, 3) and pixels.size, "no image")
    hold(read_mask(str(path)).shape == pixels.shape[:2], "its mask has another size")


def read_depth(path: Path) -> None:
    """An image of depths, and what is said of it."""
    counts = read_depth_image(path)
    hold(counts.ndim == 2 and counts.size, "no image")
    invariants.check_description(describe_image(path))


def read_description(path: Path) -> None:
    """What `unseen info` says of a file."""
    held = describe_output(path)
    held = with_states(describe(path)) if held is None else held
    invariants.check_description(held)
    _lines(held)


def read_sensor(path: Path) -> None:
    """A sensor profile."""
    sensor = load_profile(path).sensor
    invariants.check_description(sensor.to_json() | {"kind": sensor.kind})


def read_spec(path: Path) -> None:
    """A study."""
    spec = read_study(path)
    hold(spec.scenes and spec.planners and spec.seeds, "nothing to do")
    for entry in spec.requirements:
        entry.requirement()
    spec.model_dump_json()


def read_views(path: Path) -> None:
    """A plan."""
    plan = read_plan(path)
    invariants.check_plan(plan)
    plan.to_json()


def read_choice(path: Path) -> None:
    """Candidates."""
    invariants.check_candidates(load_candidates(path))


def read_sayings(path: Path) -> None:
    """Edits."""
    invariants.check_edits(read_edits(path))


_scans, _scenes = seeds_of_scans, seeds_of_scenes
_SCANS: dict[str, Callable[[], list[Case]]] = {
    "npz": lambda: [*_scans.scan_files(".npz"), _scans.tenth_mm_npz()],
    "ply": partial(_scans.scan_files, ".ply"),
    "pcd ascii": partial(_scans.pcd_files, "ascii"),
    "pcd binary": lambda: [*_scans.scan_files(".pcd"), *_scans.pcd_files("binary")],
    "pcd compressed": partial(_scans.pcd_files, "binary_compressed"),
    "ptx": partial(_scans.scan_files, ".ptx"),
    "e57": _scans.e57_files,
    "las": partial(_scans.scan_files, ".las"),
    "laz": partial(_scans.scan_files, ".laz"),
    "sweep": _scans.sweep_files,
    "text": lambda: [*_scans.scan_files(".csv"), *_scans.scan_files(".xyz")],
    "rgbd plain": partial(_scans.rgbd_folders, "plain"),
    "rgbd tum": partial(_scans.rgbd_folders, "tum"),
    "rgbd redwood": partial(_scans.rgbd_folders, "redwood"),
    "rgbd align3d": partial(_scans.rgbd_folders, "align3d"),
}
_MESHES: dict[str, Callable[[], list[Case]]] = {
    "glb": _scenes.glb_files,
    "gltf": _scenes.gltf_files,
    "obj": _scenes.obj_files,
    "ply binary": _scenes.ply_binary_files,
    "ply text": _scenes.ply_text_files,
    "stl binary": _scenes.stl_binary_files,
    "stl text": _scenes.stl_text_files,
    "off": _scenes.off_files,
}
_IFC = {"ifc": _scenes.ifc_files} if find_spec("ifcopenshell") else {}  # a process each
_POINTS: dict[str, Callable[[], list[Case]]] = {
    "npz": lambda: [_scans.points_npz(), *_SCANS["npz"]()],
    "ply": lambda: [*_scenes.ply_binary_files(), *_scenes.ply_text_files(), *_SCANS["ply"]()],
    "pcd": lambda: [case for form in ("ascii", "binary", "compressed") for case in _SCANS[f"pcd {form}"]()],
    "las": partial(_scans.las_files, ".las"),
    "laz": partial(_scans.las_files, ".laz"),
    "sweep": _scans.sweep_files,
    "vtk": _scans.vtk_files,
    "text": _scans.text_files,
    **{name: _SCANS[name] for name in ("ptx", "e57", "rgbd plain")},
}


def _anything() -> list[Case]:
    """A file of every kind."""
    makers = [
        *_MESHES.values(),
        *_IFC.values(),
        *_SCANS.values(),
        *_POINTS.values(),
        _scans.pose_files,
        _scenes.depth_images,
        _scenes.colour_images,
    ]
    makers += [_scenes.sensor_files, _scenes.candidate_files, _scenes.record_files]
    return [case for maker in makers for case in maker()]


TARGETS: dict[str, Target] = {
    target.name: target
    for target in (
        *(Target(f"mesh {name}", seeds, read_scene) for name, seeds in _MESHES.items()),
        *(Target(f"mesh {name}", seeds, read_scene, n_examples=4) for name, seeds in _IFC.items()),
        *(Target(f"scan {name}", seeds, read_every_scan) for name, seeds in _SCANS.items()),
        *(Target(f"points {name}", seeds, read_cloud) for name, seeds in _POINTS.items()),
        Target("poses", _scans.pose_files, read_trajectory),
        Target("image colour", _scenes.colour_images, read_picture),
        Target("image depth", _scenes.depth_images, read_depth),
        Target("sensor toml", _scenes.sensor_files, read_sensor),
        Target("study toml", _scenes.study_files, read_spec),
        Target("plan json", _scenes.plan_files, read_views),
        Target("candidates npz", _scenes.candidate_files, read_choice),
        Target("edits json", _scenes.edit_files, read_sayings),
        Target("info", _anything, read_description),
    )
}
