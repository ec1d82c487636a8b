# SPDX-License-Identifier: MIT
"""RGB-D folders, written: plain, as TUM's or as Redwood's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image

from scenes.checks import FloatArray, InputError
from scenes.io.poses.trajectory import write_poses, write_timed_poses
from scenes.pose import Pose
from scenes.run.atomic import Stage, atomic_path, make_folder, write_json, write_text
from scenes.scan.colour import colour_bytes
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage

Layout = Literal["plain", "tum", "redwood"]
_SCALES: Mapping[Layout, tuple[int, ...]] = {
    "plain": (10000, 5000, 2000, 1000, 500, 200, 100),  # depth values a metre: the finest that holds all
    "tum": (5000,),
    "redwood": (1000,),
}
_COLOURS: Mapping[Layout, str] = {"plain": "color", "tum": "rgb", "redwood": "color"}
_LARGEST = 65535  # of 16 bits


def write_rgbd(scans: Sequence[RangeImage], folder: Path, layout: Layout = "plain") -> None:
    """Write pinhole scans of one camera as a folder of 16 bit depth and 8 bit colour images.

    * plain: `color/`, `depth/`, `pose.txt`; depth is rounded to 1 / depth_scale metres, of 10000 ... 100
      values a metre the finest that holds the largest depth.
    * tum: `rgb/`, `depth/` named by their times (a second apart), `rgb.txt`, `depth.txt`,
      `groundtruth.txt`; 5000 values a metre, up to 13.1 m.
    * redwood: `color/`, `depth/`, `trajectory.log`; 1000 values a metre, up to 65.5 m.

    `camera.json` holds intrinsics and scale in all of them.

    Raises InputError: no scan, spherical scans, different cameras, depths beyond 16 bits, or tum without
    colours; or the folder holds other frames, which would then have no poses.
    """
    if layout not in _SCALES:
        raise InputError(f"{folder}: layout must be one of {', '.join(_SCALES)}, got {layout!r}")
    if not scans:
        raise InputError("there is no scan to write")
    frames = [_Frame.of(scans[k], folder) for k in range(len(scans))]  # an iterator would hold two scans
    camera = frames[0].camera
    if any(frame.camera != camera for frame in frames):
        raise _several_cameras(folder)
    scale = _scale(max(frame.largest_m for frame in frames), folder, layout)
    has_colour = all(frame.has_colour for frame in frames)
    if layout == "tum" and not has_colour:
        raise InputError(f"{folder}: a TUM folder holds colours, and not all scans have any; write it plain")
    check_no_other_frames(folder, len(scans), layout)
    names = _names(len(scans), layout)
    with Stage(make_folder(folder)) as stage:
        for k, name in enumerate(names):
            colours = stage.path(f"{_COLOURS[layout]}/{name}.png") if has_colour else None
            _write_images(scans[k], scale, stage.path(f"depth/{name}.png"), colours)
        _write_places(stage.folder, layout, [frame.pose for frame in frames], names)
        values = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
        write_json(stage.path("camera.json"), values | {"depth_scale": scale})
        stage.commit()


def check_no_other_frames(folder: Path, n_scans: int, layout: Layout = "plain") -> None:
    """Raise InputError where a folder holds depth images that `n_scans` scans would not replace."""
    known = {f"{name}.png" for name in _names(n_scans, layout)}
    others = sorted(file.name for file in folder.glob("depth/[!.]*") if file.name not in known)
    if others:
        raise InputError(
            f"{folder}: holds {len(others)} depth images of another recording, depth/{others[0]} the first; "
            "give another folder, or remove them"
        )


def _names(n_scans: int, layout: Layout) -> list[str]:
    """Return what the images are called; of TUM's layout that is when they were taken."""
    return [f"{k:.6f}" if layout == "tum" else f"{k:05d}" for k in range(1, n_scans + 1)]


@dataclass(frozen=True, slots=True)
class _Frame:
    """What the folder's common files say of a scan: its pixels are not kept."""

    camera: PinholeProjection
    pose: Pose
    largest_m: float
    has_colour: bool

    @classmethod
    def of(cls, scan: RangeImage, folder: Path) -> _Frame:
        camera = scan.projection
        if not isinstance(camera, PinholeProjection):
            raise _several_cameras(folder)
        return cls(camera, scan.world_from_sensor, float(_depths(scan).max()), scan.colour is not None)


def _several_cameras(folder: Path) -> InputError:
    return InputError(f"{folder}: an RGB-D folder holds scans of one pinhole camera; use .npz or .e57")


def _depths(scan: RangeImage) -> FloatArray:
    """Return the depths of a scan, 0 where nothing came back."""
    return np.nan_to_num(scan.points_in_sensor()[..., 2], nan=0.0)


def _write_images(scan: RangeImage, scale: int, depths: Path, colours: Path | None) -> None:
    """Write the depth image, and that of colours where it is asked for."""
    _save_png(np.rint(_depths(scan) * scale).astype(np.uint16), depths)
    if colours is not None and scan.colour is not None:
        _save_png(colour_bytes(scan.colour), colours)


def _scale(largest: float, folder: Path, layout: Layout) -> int:
    """Return the depth values a metre that hold the largest depth, metres."""
    scale = next((scale for scale in _SCALES[layout] if largest * scale < _LARGEST), None)
    if scale is None:
        instead = "use .npz or .e57" if layout == "plain" else "write it plain, or use .npz or .e57"
        raise InputError(
            f"{folder}: depths up to {largest:.0f} m do not fit into 16 bits at {_SCALES[layout][-1]} values "
            f"a metre; {instead}"
        )
    return scale


def _write_places(folder: Path, layout: Layout, poses: Sequence[Pose], names: Sequence[str]) -> None:
    """Write the poses, and of TUM's layout the lists of images."""
    if layout == "plain":
        write_poses(folder / "pose.txt", poses)
    elif layout == "tum":
        write_timed_poses(folder / "groundtruth.txt", [float(name) for name in names], poses)
        for kind in ("depth", "rgb"):
            write_text(folder / f"{kind}.txt", "".join(f"{name} {kind}/{name}.png\n" for name in names))
    else:
        blocks = [f"{k} {k} {k + 1}\n{_rows(pose)}" for k, pose in enumerate(poses)]
        write_text(folder / "trajectory.log", "".join(blocks))


def _rows(pose: Pose) -> str:
    """The pose's matrix, a line a row."""
    return "".join(" ".join(repr(float(number)) for number in row) + "\n" for row in pose.matrix)


def _save_png(values: Any, path: Path) -> None:
    with atomic_path(path) as temporary:
        Image.fromarray(values).save(temporary)
