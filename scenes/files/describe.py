# SPDX-License-Identifier: MIT
"""Description of a file for `unseen info`: what it holds, and what is suspicious about it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import InputError
from scenes.files.describe_scans import describe_points, describe_poses, describe_scans
from scenes.files.scan_files import open_scans, split_index
from scenes.files.scene_files import open_scene
from scenes.formats.format import Intrinsics, Units
from scenes.formats.guard import check_file
from scenes.formats.image import open_image
from scenes.formats.meshes.mesh_file import MESH_SUFFIXES, is_mesh
from scenes.formats.registry import format_of, point_suffixes, text_suffixes
from scenes.formats.rgbd.rgbd import depth_warnings, suspected_encoding
from scenes.mesh.orientation import Axis, axis_in_file, suggest_up
from scenes.run.atomic import to_plain
from scenes.world.scene import Scene

_IMAGES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm")
_POSES = (".txt", ".log", ".json", ".tum")
_LOOKS = {
    b"PK": "is an archive; unpack it first",
    b"%P": "is a PDF",
    b"<?": "is XML",
    b"{": "is JSON without its manifest",
}
_METRES = {1000: "millimetres (Kinect, RealSense)", 5000: "1/5000 m (TUM, ICL-NUIM)"}


def describe(
    path: str | os.PathLike[str],
    *,
    up: Axis = "z",
    units: Units = "m",
    intrinsics: Intrinsics | None = None,
    depth_scale: float | None = None,
) -> dict[str, Any]:
    """Return what a file holds, as plain values for JSON; lengths in metres, angles in degrees.

    Parameters
    ----------
    path : str or path
        A mesh file, `builtin:NAME`, a scan file, an RGB-D folder, `PATH#k`, points, poses, or an image.
    up, units
        As for `load_scene` and `read_scans`.
    intrinsics, depth_scale
        As for `read_scans`.

    Returns
    -------
    dict
        `kind` is "scene", "scan", "scans", "points", "poses", "image" or "depth image"; `warnings` is a list
        of sentences, empty when all is well.

    Raises
    ------
    InputError
        Nothing there, damaged, or of no known kind.

    Examples
    --------
    >>> describe("builtin:two_occluders")["mode"]
    'room'
    """
    text = os.fspath(path)
    base, number = split_index(text)
    suffix = base.suffix.lower()
    if text.startswith("builtin:") or is_mesh(base):
        return _plain(_describe_scene(open_scene(text, up=up, units=units), text, up))
    if (
        not base.is_dir()
        and check_file(base)
        and format_of(suffix) is None
        and suffix not in (*_IMAGES, *_POSES)
    ):
        raise InputError(f"{base}: {_stranger(base)}")
    if suffix in _IMAGES:
        return _plain(describe_image(base))
    if suffix in _POSES and (poses := describe_poses(base, units)):
        return _plain(poses)
    if suffix in _POSES and suffix not in point_suffixes():
        raise InputError(f"{base}: {_stranger(base)}")
    try:
        source = open_scans(base, intrinsics=intrinsics, depth_scale=depth_scale)
        if number is not None and not 1 <= number <= len(source.readers):
            raise InputError(f"{text}: there are {len(source.readers)} scans, counted from 1")
        return _plain(describe_scans(source, number, units))
    except InputError as error:
        if base.is_dir() or suffix not in point_suffixes():
            raise
        return _plain(_described_points(text, units, error))


def _described_points(text: str, units: Units, error: InputError) -> dict[str, Any]:
    """What a file holds that is no scan: points, or what is wrong with it."""
    base = split_index(text)[0]
    try:
        found = describe_points(text, units)
    except InputError as trouble:
        if base.suffix.lower() not in text_suffixes():
            raise error from None
        cause = str(trouble).removeprefix(f"{base}: ")
        raise InputError(f"{base}: is text that holds neither poses nor points: {cause}") from trouble
    cause = str(error).removeprefix(f"{base}: ")
    if "no ray can be traced" not in cause:
        found["warnings"] = [f"is no scan: {cause}", *found["warnings"]]
    return found


def _stranger(path: Path) -> str:
    """Say what an unknown file looks like, and what is known."""
    with path.open("rb") as file:
        start = file.read(4096)
    looks = "is binary" if b"\0" in start else "is text"
    for mark, words in _LOOKS.items():
        looks = words if start.lstrip().startswith(mark) else looks
    return (
        f"{looks}, of no kind that is known here; known: meshes ({' '.join(MESH_SUFFIXES)}), scans and "
        f"points ({' '.join(point_suffixes())}), RGB-D folders, trajectories, images, and what unseen writes "
        "(its JSON with the manifest beside it)"
    )


def _plain(value: dict[str, Any]) -> dict[str, Any]:
    plain: dict[str, Any] = to_plain(value)
    return plain


def _describe_scene(scene: Scene, path: str, up: Axis) -> dict[str, Any]:
    mesh = scene.mesh
    bounds = mesh.bounds()
    extent = bounds[1] - bounds[0]
    appearance = mesh.appearance
    suggested = "z" if path.startswith("builtin:") else suggest_up(mesh, scene.mode)  # there it is known
    in_file = None if suggested is None else axis_in_file(suggested, up)
    warnings = list(scene.warnings)
    kinds = [surface.kind for surface in scene.surfaces if surface is not None]
    return {
        "kind": "scene",
        "path": path,
        "name": scene.name,
        "mode": scene.mode,
        "triangles": len(mesh.faces),
        "vertices": len(mesh.vertices),
        "area_m2": float(mesh.face_areas().sum()),
        "bounds_m": bounds,
        "extent_m": extent,
        "diagonal_m": float(np.linalg.norm(extent)),
        "surfaces": len(scene.surfaces),
        "surface_names": scene.surface_names,
        "known_surfaces": {kind: kinds.count(kind) for kind in sorted(set(kinds))},
        "textures": [] if appearance is None else [list(image.shape[1::-1]) for image in appearance.images],
        "has_colour": appearance is not None,
        "up": up,
        "suggested_up": in_file,
        "warnings": warnings,
    }


def describe_image(path: Path) -> dict[str, Any]:
    """Return size, channels and values of an image; for depth images which unit is plausible.

    Raises InputError: no image, or too large.
    """
    with open_image(path) as image:
        mode, size, values = image.mode, image.size, np.asarray(image)
    is_depth = mode.startswith(("I", "F"))
    found: dict[str, Any] = {
        "kind": "depth image" if is_depth else "image",
        "path": str(path),
        "width": size[0],
        "height": size[1],
        "mode": mode,
        "channels": 1 if values.ndim == 2 else values.shape[2],
        "bits": values.dtype.itemsize * 8,
        "warnings": [],
    }
    with np.errstate(invalid="ignore"):  # counts may be of any kind
        return found | _depth(values.astype(np.float64)) if is_depth else found


def _depth(counts: Any) -> dict[str, Any]:
    """What the counts of a depth image say."""
    known = counts[np.isfinite(counts) & (counts > 0)]
    if not len(known):
        return {"valid_share": 0.0, "counts": None, "warnings": ["no pixel holds a depth"]}
    low, middle, high = (float(pick(known)) for pick in (np.min, np.median, np.max))
    plausible = [f"median {middle / scale:.2f} m if {text}" for scale, text in _METRES.items()]
    suspected = suspected_encoding(counts)
    return {
        "valid_share": float(len(known) / counts.size),
        "counts": {"min": low, "median": middle, "max": high},
        "depth": [] if suspected else plausible,
        "warnings": [*depth_warnings(counts), *([suspected] if suspected else [])],
    }
