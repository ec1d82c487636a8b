# SPDX-License-Identifier: MIT
"""Description of a file for `unseen info`: what it holds, and what is suspicious about it."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scenes.atomic import to_plain
from scenes.checks import InputError
from scenes.describe_image import IMAGE_SUFFIXES, describe_image
from scenes.describe_points import describe_points, describe_poses
from scenes.files import (
    MESH_SUFFIXES,
    SCAN_SUFFIXES,
    Intrinsics,
    ScanSource,
    Units,
    in_metres,
    open_scans,
    split_index,
)
from scenes.formats.guard import check_file
from scenes.loading import open_scene, units_doubt
from scenes.orientation import Axis, axis_in_file, suggest_up
from scenes.points import POINT_SUFFIXES, TEXT_SUFFIXES
from scenes.projection import PinholeProjection, Projection, SphericalProjection
from scenes.range_image import RangeImage
from scenes.scene import Scene

_FAR_M, _NEAR_M = 200.0, 0.05  # median ranges beyond which unit or depth scale are doubted


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
    if text.startswith("builtin:") or suffix in MESH_SUFFIXES or _is_mesh_ply(base):
        return _plain(_describe_scene(open_scene(text, up=up, units=units), text, up))
    if not base.is_dir() and check_file(base) and suffix not in _KNOWN:
        raise InputError(f"{base}: {_stranger(base)}")
    if suffix in IMAGE_SUFFIXES:
        return _plain(describe_image(base))
    if suffix in _POSES and (poses := describe_poses(base, units)):
        return _plain(poses)
    if suffix in _POSES and suffix not in POINT_SUFFIXES:
        raise InputError(f"{base}: {_stranger(base)}")
    try:
        source = open_scans(base, intrinsics=intrinsics, depth_scale=depth_scale)
        if number is not None and not 1 <= number <= len(source.readers):
            raise InputError(f"{text}: there are {len(source.readers)} scans, counted from 1")
        return _plain(_describe_scans(source, number, units))
    except InputError as error:
        if base.is_dir() or suffix not in POINT_SUFFIXES:
            raise
        return _plain(_described_points(text, units, error))


_POSES = (".txt", ".log", ".json", ".tum")
_KNOWN = {*SCAN_SUFFIXES, *POINT_SUFFIXES, *IMAGE_SUFFIXES, *_POSES}


def _described_points(text: str, units: Units, error: InputError) -> dict[str, Any]:
    """What a file holds that is no scan: points, or what is wrong with it."""
    base = split_index(text)[0]
    try:
        found = describe_points(text, units)
    except InputError as trouble:
        if base.suffix.lower() not in TEXT_SUFFIXES:
            raise error from None
        cause = str(trouble).removeprefix(f"{base}: ")
        raise InputError(f"{base}: is text that holds neither poses nor points: {cause}") from trouble
    cause = str(error).removeprefix(f"{base}: ")
    if "no ray can be traced" not in cause:
        found["warnings"] = [f"is no scan: {cause}", *found["warnings"]]
    return found


_LOOKS = {b"PK": "is an archive; unpack it first", b"%P": "is a PDF", b"<?": "is XML", b"{": "is JSON"}


def _stranger(path: Path) -> str:
    """Say what an unknown file looks like, and what is known."""
    with path.open("rb") as file:
        start = file.read(4096)
    looks = "is binary" if b"\0" in start else "is text"
    for mark, words in _LOOKS.items():
        looks = words if start.lstrip().startswith(mark) else looks
    return (
        f"{looks}, of no kind that is known here; known: meshes (.glb .gltf .obj .ply .stl .off), scans and "
        "points (.npz .ply .pcd .ptx .e57 .las .laz .xyz .csv .pts), RGB-D folders, trajectories, images, "
        "and what unseen writes"
    )


def _plain(value: dict[str, Any]) -> dict[str, Any]:
    plain: dict[str, Any] = to_plain(value)
    return plain


def _is_mesh_ply(path: Path) -> bool:
    """A PLY file with faces; organised scans and clouds have none."""
    if path.suffix.lower() != ".ply" or not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(1 << 22).partition(b"end_header")[0]
    return re.search(rb"element\s+face\s+[1-9]", head) is not None


def _describe_scene(scene: Scene, path: str, up: Axis) -> dict[str, Any]:
    mesh = scene.mesh
    bounds = mesh.bounds()
    extent = bounds[1] - bounds[0]
    appearance = mesh.appearance
    suggested = suggest_up(mesh, scene.mode)
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


def _describe_scans(source: ScanSource, number: int | None, units: Units) -> dict[str, Any]:
    picked = range(len(source.readers)) if number is None else [number - 1]
    scans = [in_metres(source.readers[k](), units) for k in picked]
    warnings = [] if source.registered else ["frames have no poses; give --poses FILE or a pose.txt"]
    if len(scans) > 1 and source.registered and _all_at_one_place(scans):
        warnings.append("all scans have the same pose; if they were taken from several places, register them")
    entries = [_describe_scan(scan, k + 1) for scan, k in zip(scans, picked, strict=True)]
    for entry in entries:
        warnings += [f"scan {entry['number']}: {text}" for text in entry.pop("warnings")]
    points = np.vstack([np.reshape(_bounds(scan), (2, 3)) for scan in scans])
    finite = points[np.isfinite(points).all(axis=1)]
    return {
        "kind": "scan" if len(scans) == 1 else "scans",
        "path": str(source.path),
        "format": source.kind,
        "count": len(source.readers),
        "registered": source.registered,
        "bounds_m": [finite.min(axis=0), finite.max(axis=0)] if len(finite) else None,
        "scans": entries,
        "warnings": warnings,
    }


def _bounds(scan: RangeImage) -> Any:
    points = scan.points()[scan.valid]
    if not len(points):
        return np.full((2, 3), np.nan)
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _all_at_one_place(scans: Sequence[RangeImage]) -> bool:
    first = scans[0].world_from_sensor.matrix
    return all(np.allclose(scan.world_from_sensor.matrix, first, atol=1e-9) for scan in scans[1:])


def _describe_scan(scan: RangeImage, number: int) -> dict[str, Any]:
    """One scan: size, share of valid pixels, ranges, projection, pose."""
    ranges = scan.ranges[scan.valid]
    statistics = [float(pick(ranges)) for pick in (np.min, np.median, np.max)] if len(ranges) else [None] * 3
    return {
        "number": number,
        "name": scan.name,
        "rows": scan.shape[0],
        "columns": scan.shape[1],
        "valid_share": float(scan.valid.mean()),
        "range_m": dict(zip(("min", "median", "max"), statistics, strict=True)),
        "bounds_m": None if not len(ranges) else _bounds(scan),
        "projection": describe_projection(scan.projection),
        "has_colour": scan.colour is not None,
        "has_intensity": scan.intensity is not None,
        "has_truth": scan.truth is not None,
        "measured_points_off_rays": scan.sensor_points is not None,
        "grid_residual_px": _grid_residual(scan),
        "sigma_m": scan.sigma_m,
        "sensor": scan.sensor,
        "noise": scan.noise,
        "world_from_sensor": scan.world_from_sensor.matrix,
        "warnings": scan_warnings(scan),
    }


def _grid_residual(scan: RangeImage) -> float | None:
    """Median distance in pixels of the measured points from their own pixels, None where they lie on them."""
    if scan.sensor_points is None or not scan.valid.any():
        return None
    seen = scan.projection.pixels(scan.sensor_points[scan.valid])
    return float(np.nanmedian(np.hypot(*(seen - np.argwhere(scan.valid)).T)))


def scan_warnings(scan: RangeImage) -> list[str]:
    """Say what is doubtful about a scan: its unit or depth scale, and how little came back."""
    if not scan.valid.any():
        return ["nothing came back in any pixel"]
    median, found = float(np.median(scan.ranges[scan.valid])), []
    if median > _FAR_M or median < _NEAR_M:
        found.append(f"the median range is {median:.3g} m; check --units or --depth-scale")
    extent = np.diff(_bounds(scan), axis=0)
    doubt = units_doubt(float(np.linalg.norm(extent)))
    if doubt and not found:
        found.append(doubt)
    if scan.valid.mean() < 0.05:
        found.append(f"only {scan.valid.mean():.1%} of the pixels came back")
    return found


def describe_projection(projection: Projection) -> dict[str, Any]:
    """Return kind, field of view (degrees) and parameters of a projection."""
    rows, columns = projection.shape
    if isinstance(projection, PinholeProjection):
        across = _angle(projection.fx, -0.5 - projection.cx, columns - 0.5 - projection.cx)
        down = _angle(projection.fy, -0.5 - projection.cy, rows - 0.5 - projection.cy)
        names = ("fx", "fy", "cx", "cy")
        details = {name: getattr(projection, name) for name in names}
    elif isinstance(projection, SphericalProjection):
        across = abs(float(np.degrees(projection.azimuths[-1] - projection.azimuths[0])))
        down = abs(float(np.degrees(projection.elevations[-1] - projection.elevations[0])))
        ends = projection.elevations[[0, -1]]
        details = {"first_row_elevation_deg": float(np.degrees(ends[0]))}
        details["last_row_elevation_deg"] = float(np.degrees(ends[1]))
    else:
        across, down, details = float("nan"), float("nan"), {}
    step = float(np.degrees(projection.pixel_angle))
    return {"kind": projection.kind, "fov_deg": [across, down], "pixel_deg": step, **details}


def _angle(focal: float, low: float, high: float) -> float:
    """Angle in degrees between the rays through two image coordinates."""
    return float(np.degrees(np.arctan2(high, abs(focal)) - np.arctan2(low, abs(focal))))
