# SPDX-License-Identifier: MIT
"""How the frames of a folder are found: images by name, and what its files say of each frame."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.io.checks.limits import check_limit
from scenes.io.formats.facts import FormatFacts
from scenes.io.poses.camera import Camera, Intrinsics
from scenes.io.poses.trajectory import natural_key, rounded_pose
from scenes.io.rgbd.depth import DEPTH_SUFFIXES
from scenes.io.rgbd.frames import VIDEOS, RgbdFolder, RgbdFrame
from scenes.pose import Pose

_MAPS = (".geometric.bin", ".photometric.bin")
_SUFFIX = re.compile(
    r"\.(?:png|jpe?g|webp|tiff?|pgm|ppm|bmp|npy|npz|exr|depth|conf|json|txt|pincam|yaml)$", re.IGNORECASE
)
_CAMERA_AXES = np.diag([1.0, -1.0, -1.0, 1.0])  # of OpenGL and ARKit: x right, y up, z backwards


@dataclass(frozen=True, slots=True)
class View:
    """What a file says of a frame: pose (world from sensor), camera and time (seconds), as far as it does."""

    pose: Pose | None = None
    camera: Camera | None = None
    time: float | None = None


@dataclass(frozen=True, slots=True)
class Views:
    """What the files of a folder say of its frames.

    Attributes
    ----------
    by_key : mapping of View
        By `key_of` of the frame's name.
    camera : Camera
        Of all frames that have none of their own.
    warnings : tuple of str
        What holds for all.
    colour_intrinsics : (fx, fy, cx, cy), optional
        See `RgbdFolder`.
    """

    by_key: Mapping[str, View]
    camera: Camera = field(default_factory=Camera)
    warnings: tuple[str, ...] = ()
    colour_intrinsics: Intrinsics | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageLayout:
    """A layout with a file an image.

    Attributes
    ----------
    name : str
        What `unseen info` calls it.
    marks : tuple of tuple of str
        Patterns by which it is known: all of one of these must be there.
    views : function of (Path, sequence of str)
        What the files say, for frames of these keys.
    depth, colour, confidence : tuple of str
        Patterns of the images; the first that any file fits counts. A video is the colour of all frames.
    roots : tuple of str
        Folders inside in which all this may lie.
    depth_scale : float
        Counts a metre.
    facts : FormatFacts
        Its row of docs/format-table.md.
    """

    name: str
    facts: FormatFacts
    marks: tuple[tuple[str, ...], ...]
    views: Callable[[Path, Sequence[str]], Views]
    depth: tuple[str, ...]
    colour: tuple[str, ...] = ()
    confidence: tuple[str, ...] = ()
    roots: tuple[str, ...] = ("",)
    depth_scale: float = 1000.0

    def root(self, folder: Path) -> Path | None:
        """Return the folder in which the layout lies, None where there is none of it."""
        roots = (folder / root for root in self.roots if (folder / root).is_dir())
        return next((root for root in roots if is_marked(root, self.marks)), None)


def is_marked(folder: Path, marks: Sequence[Sequence[str]]) -> bool:
    """Tell whether for all patterns of one of `marks` there is a file or folder."""
    return any(all(any(folder.glob(pattern)) for pattern in patterns) for patterns in marks)


def key_of(name: str) -> str:
    """Return by what the files of a frame belong together: a name without suffix, a number without zeros.

    Examples
    --------
    >>> [key_of(name) for name in ("000120.png", "left/a.jpg.geometric.bin", "41_3386.120.pincam")]
    ['120', 'left/a', '41_3386.120']
    """
    for suffix in _MAPS:
        name = name.removesuffix(suffix)
    key = _SUFFIX.sub("", name)
    return str(int(key)) if key.isascii() and key.isdecimal() else key


def list_frames(layout: ImageLayout, folder: Path) -> RgbdFolder:
    """Return the frames of a folder in that layout, each with what the files say of it.

    Raises InputError: no depth map, two of one name, or poses for none of them.
    """
    depths = _by_key(folder, layout.depth, DEPTH_SUFFIXES)
    colours = _by_key(folder, layout.colour, ())
    confidences = _by_key(folder, layout.confidence, ())
    views = layout.views(folder, list(depths))
    if views.by_key and not set(views.by_key) & set(depths):
        raise InputError(
            f"none of its {len(views.by_key)} poses, as that of {next(iter(views.by_key))!r}, is of one of "
            f"the {len(depths)} depth maps, as {next(iter(depths.values())).name!r}"
        )
    video = next((path for path in colours.values() if path.suffix.lower() in VIDEOS), None)
    frames = []
    for key, depth in depths.items():
        view = views.by_key.get(key, View())
        frames.append(
            RgbdFrame(
                depth,
                colours.get(key, video),
                pose=view.pose,
                time=view.time,
                camera=view.camera,
                confidence=confidences.get(key),
                number=int(key) if key.isdecimal() else 0,
            )
        )
    return RgbdFolder(
        layout.name,
        tuple(frames),
        views.camera,
        layout.depth_scale,
        warnings=views.warnings,
        colour_intrinsics=views.colour_intrinsics,
    )


def keep_complete(folder: RgbdFolder) -> RgbdFolder:
    """Return a folder without the frames that lack a pose or intrinsics where others have them, counted."""
    frames, sentences = folder.frames, list(folder.warnings)
    tests: Mapping[str, Callable[[RgbdFrame], bool]] = {
        "no pose": lambda frame: frame.pose is not None,
        "no intrinsics": lambda frame: (frame.camera or folder.camera).intrinsics is not None,
    }
    for what, has in tests.items():
        kept = tuple(frame for frame in frames if has(frame))
        if 0 < len(kept) < len(frames):
            n_left = len(frames) - len(kept)
            sentences.append(
                f"{n_left} of {len(frames)} frames {'has' if n_left == 1 else 'have'} {what} and "
                f"{'was' if n_left == 1 else 'were'} left out"
            )
            frames = kept
    return replace(folder, frames=frames, warnings=tuple(sentences))


def _by_key(folder: Path, patterns: Sequence[str], suffixes: Sequence[str]) -> dict[str, Path]:
    """The files of the first pattern that any fits, by key, in natural order of their names."""
    for pattern in patterns:
        paths = [
            path
            for path in folder.glob(pattern)
            if path.name[0] != "." and path.is_file() and (not suffixes or path.suffix.lower() in suffixes)
        ]
        check_limit("entries", len(paths), f"files in {pattern}")
        if paths:
            above, stars, _ = pattern.partition("**")  # names below it are those of folder and file
            ordered = sorted(paths, key=lambda path: natural_key(str(path)))
            return _keyed(
                [(path.relative_to(folder / above) if stars else path, path) for path in ordered], folder
            )
    return {}


def _keyed(named: Sequence[tuple[Path, Path]], folder: Path) -> dict[str, Path]:
    keyed: dict[str, Path] = {}
    for name, path in named:
        key = key_of(name.as_posix() if name != path else path.name)
        if key in keyed:
            raise InputError(f"holds two images of one name, {keyed[key].name} and {path.name}; remove one")
        keyed[key] = inside(folder, path.relative_to(folder).as_posix())
    return keyed


def inside(folder: Path, name: str) -> Path:
    """Return a file of the folder, or that its own list names.

    Raises InputError: it, or what a link shows, lies outside of the folder.
    """
    if not isinstance(name, str) or "\0" in name:
        raise InputError(f"names {name!r}, which is no file's name")
    if not (folder / name).resolve().is_relative_to(folder.resolve()):
        raise InputError(f"names {name!r}, which lies outside the folder and is not opened; copy it into it")
    return folder / name


def camera_pose(matrix: Any) -> Pose | None:
    """Return the pose of a camera-to-world matrix (3 or 4, 4) whose camera has OpenGL's or ARKit's axes.

    None where tracking was lost, as `known_pose`.
    """
    whole = np.eye(4)
    whole[:3] = np.asarray(matrix, dtype=np.float64)[:3]
    return known_pose(whole @ _CAMERA_AXES)


def known_pose(matrix: FloatArray) -> Pose | None:
    """Return the pose of a camera-to-world matrix (4, 4), None where tracking was lost: -inf or NaN."""
    return rounded_pose(matrix) if np.isfinite(matrix).all() else None
