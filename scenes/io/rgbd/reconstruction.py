# SPDX-License-Identifier: MIT
"""Depth maps of reconstructions from photographs: COLMAP's dense ones, and renders of radiance fields.

* COLMAP: a dense workspace (`stereo/depth_maps`, `sparse`, `images`; colmap.github.io/format.html).
* nerfstudio, Instant-NGP: `transforms.json` with `depth_file_path` a frame (docs.nerf.studio, "Data
  conventions"; `depth_unit_scale_factor` as in its `nerfstudio_dataparser.py`): OpenGL's camera axes.
* Gaussian splatting (3DGS, 2DGS, gsplat): depth renders beside a COLMAP model, or beside `cameras.json`
  as `utils/camera_utils.py` of graphdeco-inria/gaussian-splatting writes it: rotation and place of the
  camera in the world, axes as ours, principal point in the middle.

Pixel centres lie at halves in all of them: half a pixel is subtracted from the principal point.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import InputError
from scenes.io.checks.documents import read_json
from scenes.io.checks.guard import guard_reading
from scenes.io.checks.limits import check_limit
from scenes.io.formats.facts import FormatFacts
from scenes.io.poses.camera import Camera, check_model, distortion_of
from scenes.io.poses.colmap import read_model
from scenes.io.poses.trajectory import rounded_pose
from scenes.io.rgbd.frames import RgbdFolder, RgbdFrame
from scenes.io.rgbd.listing import ImageLayout, View, Views, camera_pose, inside, key_of, known_pose

_UNIT = (
    "the unit of the reconstruction is arbitrary unless it was scaled: lengths are in that unit, not metres"
)
_MODELS = ("sparse/0", "sparse")
_MILLIMETRES = 0.001  # of nerfstudio's depth images


def _colmap(folder: Path, _: Sequence[str]) -> Views:
    """Poses and cameras of the model by the names of its images."""
    models = (folder / name for name in _MODELS)
    model = next(path for path in models if any(path.glob("images.txt")) or any(path.glob("images.bin")))
    images, cameras = read_model(model)
    views: dict[str, View] = {}
    for name, image in images.items():
        if image.camera not in cameras:
            raise InputError(f"image {name!r} is of camera {image.camera}, which {model.name} does not hold")
        key = key_of(name)
        if key in views:
            raise InputError(f"several images of its model are named {key!r}; give one camera's")
        views[key] = View(rounded_pose(image.matrix), cameras[image.camera])
    return Views(views, warnings=(_UNIT,))


def _cameras_json(folder: Path, keys: Sequence[str]) -> Views:
    """Cameras by the names of their images, or in their order where there are as many maps as cameras."""
    path = folder / "cameras.json"
    with guard_reading(path, "the cameras of Gaussian splatting"):
        entries = read_json(path, list)
        check_limit("entries", len(entries), "its cameras")
        named = {key_of(str(entry["img_name"])): _splat_view(entry) for entry in entries}
    if set(named) & set(keys):
        return Views(named, warnings=(_UNIT,))
    if len(entries) != len(keys):
        raise InputError(
            f"cameras.json holds {len(entries)} cameras for {len(keys)} depth maps that are named otherwise; "
            "name each map as its image"
        )
    return Views(dict(zip(keys, named.values(), strict=True)), warnings=(_UNIT,))


def _splat_view(entry: Mapping[str, Any]) -> View:
    width, height = int(entry["width"]), int(entry["height"])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = entry["rotation"], entry["position"]
    pixels = float(entry["fx"]), float(entry["fy"]), (width - 1) / 2, (height - 1) / 2
    return View(known_pose(matrix), Camera(pixels, image_size=(width, height)))


def open_transforms(folder: Path) -> RgbdFolder:
    """Return the frames of a `transforms.json` that have a depth map, images of the list in its order.

    Whole numbers are millimetres unless `depth_unit_scale_factor` says otherwise; floats are metres.

    Raises InputError: no frame has a depth map, no intrinsics, or a fisheye's.
    """
    path = folder / "transforms.json"
    with guard_reading(path, "the frames of nerfstudio"):
        held = read_json(path, dict)
        entries = held["frames"]
        check_limit("entries", len(entries), "its frames")
        if not any(entry.get("depth_file_path") for entry in entries):
            raise InputError(
                f"its {len(entries)} frames have no depth_file_path: photographs alone are no scans; render "
                "or estimate depth maps and name them there"
            )
        found = [_frame(folder, entry, held) for entry in entries if entry.get("depth_file_path")]
    frames = tuple(frame for frame in found if frame.depth.is_file())
    n_left = len(entries) - len(frames)
    sentences = (f"{n_left} of {len(entries)} frames have no depth map and were left out",) if n_left else ()
    return RgbdFolder("transforms.json", frames, depth_scale=1.0 / _MILLIMETRES, warnings=sentences)


def _frame(folder: Path, entry: Mapping[str, Any], held: Mapping[str, Any]) -> RgbdFrame:
    colour = inside(folder, entry["file_path"]) if entry.get("file_path") else None
    return RgbdFrame(
        inside(folder, entry["depth_file_path"]),
        colour if colour is not None and colour.is_file() else None,
        camera_pose(entry["transform_matrix"]),
        camera=_camera({**held, **entry}),
    )


def _camera(held: Mapping[str, Any]) -> Camera:
    """The camera of a frame: its own values before those of all."""
    check_model(held.get("camera_model"), "camera_model")
    size = (int(held["w"]), int(held["h"])) if "w" in held and "h" in held else None
    fx, fy = held.get("fl_x"), held.get("fl_y")
    if fx is None and size is not None and "camera_angle_x" in held:
        fx = size[0] / 2 / np.tan(float(held["camera_angle_x"]) / 2)
    if fx is None:
        raise InputError("it states no focal length: fl_x, or w, h and camera_angle_x")
    middle = (None, None) if size is None else (size[0] / 2, size[1] / 2)
    cx, cy = held.get("cx", middle[0]), held.get("cy", middle[1])
    if cx is None or cy is None:
        raise InputError("it states no principal point: cx and cy, or w and h")
    stated = held.get("depth_unit_scale_factor")
    return Camera(
        (float(fx), float(fx if fy is None else fy), float(cx) - 0.5, float(cy) - 0.5),
        depth_scale=None if stated is None else 1.0 / float(stated),
        image_size=size,
        distortion=distortion_of(held),
    )


LAYOUTS = (
    ImageLayout(
        name="COLMAP",
        facts=FormatFacts(
            title="COLMAP dense workspace",
            read="`stereo/depth_maps`, geometric, else photometric",
            lost="images that are not registered, with a count; fisheye models are refused",
            poses="`sparse`, text or binary, by image name",
            units="those of the model, which are arbitrary: said",
            colours="`images`",
            noise="estimated; a step of depth that hides it is shared by all points",
        ),
        marks=(("stereo/depth_maps", "sparse"),),
        roots=("", "dense", "dense/0"),
        views=_colmap,
        depth=("stereo/depth_maps/**/*.geometric.bin", "stereo/depth_maps/**/*.photometric.bin"),
        colour=("images/**/*",),
    ),
    ImageLayout(
        name="COLMAP model with depth",
        facts=FormatFacts(
            title="COLMAP model with renders in `depth/`",
            read="depth as floats or 16 bits, named as the images",
            lost="images that are not registered, with a count",
            poses="from the model, by name",
            units="metres of the model: said",
            colours="`images`",
            noise="estimated; a step of depth that hides it is shared by all points",
        ),
        marks=tuple(
            (f"{model}/images.{kind}", f"{depth}/*")
            for model in ("sparse/0", "sparse")
            for kind in ("txt", "bin")
            for depth in ("depth", "depths")
        ),
        views=_colmap,
        depth=("depth/**/*", "depths/**/*"),
        colour=("images/**/*",),
    ),
    ImageLayout(
        name="cameras.json with depth",
        facts=FormatFacts(
            title="`cameras.json` (3-D Gaussian splatting) with renders in `depth/`",
            read="depth as floats or 16 bits",
            lost="the Gaussians",
            poses="`cameras.json`, by name, else in order",
            units="metres of the model: said",
            colours="`images`",
            noise="estimated; a step of depth that hides it is shared by all points",
        ),
        marks=tuple(("cameras.json", f"{depth}/*") for depth in ("depth", "depths", "train/ours_*/vis")),
        views=_cameras_json,
        depth=("depth/*", "depths/*", "train/ours_*/vis/depth_*"),
        colour=("images/*", "train/ours_*/renders/*"),
    ),
)
