# SPDX-License-Identifier: MIT
"""Description of a file for `unseen info`: what it holds, and what is doubtful about it."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.io.checks.guard import check_file
from scenes.io.checks.image import open_image
from scenes.io.formats.format import (
    METRES_PER_UNIT,
    Intrinsics,
    Units,
    format_of,
    point_suffixes,
    text_suffixes,
)
from scenes.io.meshes.mesh_file import MESH_SUFFIXES, is_mesh
from scenes.io.point_files import read_points
from scenes.io.poses.trajectory import read_poses
from scenes.io.rgbd.depth import depth_warnings, suspected_encoding
from scenes.io.scan_files import ScanSource, open_scans, split_index
from scenes.io.scene_files import open_scene, units_doubt
from scenes.io.walk import open_walk
from scenes.limits import FAR_M, SMALL_M, SPHERICAL_LIMIT_PX
from scenes.mesh.design import Design
from scenes.mesh.orientation import Axis, axis_in_file, suggest_up
from scenes.run.atomic import to_plain
from scenes.run.mapping import trim
from scenes.scan.convention import convention_doubt
from scenes.scan.doubts import merge_warnings
from scenes.scan.projection import PinholeProjection, Projection, SphericalProjection
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

_NO_RAYS = "no ray can be traced: to use these points as a scan say where the scanner stood (--origin X,Y,Z)"
_TIMED = "its points have times: to use those of a moving scanner as scans give --trajectory FILE"


def describe_scans(source: ScanSource, number: int | None, units: Units) -> dict[str, Any]:
    """Return what the scans of a file or folder hold, or its scan `number` from 1."""
    picked = source.pick(number)
    scans = [source.in_metres(source.readers[k](), units) for k in picked]
    warnings = list(source.warnings) if number is None else []
    if not source.registered:
        warnings.append("frames have no poses; give --poses FILE or a pose.txt")
    if len(scans) > 1 and source.registered and _all_at_one_place(scans):
        warnings.append("all scans have the same pose; if they were taken from several places, register them")
    if source.registered and (doubt := convention_doubt(scans)):
        warnings.append(doubt)
    measured = [_measure(scan) for scan in scans]
    entries = []
    doubts = []
    for scan, k, sizes in zip(scans, picked, measured, strict=True):
        entries.append(_describe_scan(scan, source.number(k), sizes))
        doubts.append((f"scan {source.number(k)}", _doubts(scan, sizes)))
    warnings += merge_warnings(doubts)
    points = np.vstack([sizes.bounds for sizes in measured])
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


class _Measures(NamedTuple):
    """Bounds (2, 3) of the points of a scan, metres, and their residual from the pixel grid."""

    bounds: FloatArray
    grid_residual: float | None


def _measure(scan: RangeImage) -> _Measures:
    points = scan.points()[scan.valid]
    if not len(points):
        return _Measures(np.full((2, 3), np.nan), None)
    bounds = np.array(
        [[pick(coordinates) for coordinates in points.T] for pick in (np.min, np.max)]
    )  # faster than by axis
    return _Measures(bounds, _grid_residual(scan))


def _all_at_one_place(scans: Sequence[RangeImage]) -> bool:
    first = scans[0].world_from_sensor.matrix
    return all(np.allclose(scan.world_from_sensor.matrix, first, atol=1e-9) for scan in scans[1:])


def _describe_scan(scan: RangeImage, number: int, measured: _Measures) -> dict[str, Any]:
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
        "bounds_m": None if not len(ranges) else measured.bounds,
        "projection": describe_projection(scan.projection),
        "has_colour": scan.colour is not None,
        "has_intensity": scan.intensity is not None,
        "has_truth": scan.truth is not None,
        **({} if scan.echoes is None else {"further_returns": len(scan.echoes)}),
        "measured_points_off_rays": scan.sensor_points is not None,
        "grid_residual_px": measured.grid_residual,
        "sigma_m": scan.sigma_m,
        "sensor": scan.sensor,
        "noise": scan.noise,
        "world_from_sensor": scan.world_from_sensor.matrix,
    }


def _grid_residual(scan: RangeImage) -> float | None:
    """Median distance in pixels of the measured points from their own pixels, None where they lie on them."""
    if scan.sensor_points is None:
        return None
    seen = scan.projection.pixels(scan.points_in_sensor()[scan.valid])
    off = np.hypot(*(seen - np.argwhere(scan.valid)).T)
    return float(np.median(off[np.isfinite(off)])) if np.isfinite(off).any() else None


def scan_warnings(scan: RangeImage) -> list[str]:
    """Return what is doubtful about a scan: what was left out, its unit or depth scale, its grid."""
    return _doubts(scan, _measure(scan))


def _doubts(scan: RangeImage, measured: _Measures) -> list[str]:
    trim()
    warnings = list(scan.warnings)
    if not scan.valid.any():
        return [*warnings, "nothing came back in any pixel"]
    median, n_before = float(np.median(scan.ranges[scan.valid])), len(warnings)
    if median > FAR_M or median < SMALL_M:
        warnings.append(f"the median range is {median:.3g} m; check --units or --depth-scale")
    diagonal = float(np.linalg.norm(np.diff(measured.bounds, axis=0)))
    doubt = units_doubt(diagonal) if diagonal > 0 else ""
    if doubt and len(warnings) == n_before:
        warnings.append(doubt)
    if scan.valid.mean() < 0.05:
        warnings.append(f"only {scan.valid.mean():.1%} of the pixels came back")
    return warnings + [text for text in (_grid_doubt(measured.grid_residual), _camera_doubt(scan)) if text]


def _grid_doubt(residual: float | None) -> str:
    """A warning where measured points lie off their own pixels, "" otherwise."""
    if residual is None or residual <= SPHERICAL_LIMIT_PX:
        return ""
    return (
        f"half of its points lie {residual:.3g} pixels or more from their own pixels; are rows and columns "
        "swapped, or the intrinsics another camera's?"
    )


def _camera_doubt(scan: RangeImage) -> str:
    """A warning where the principal point is that of an image on its side, "" otherwise."""
    camera = scan.projection
    if not isinstance(camera, PinholeProjection) or camera.width == camera.height:
        return ""
    middle = np.array([camera.width - 1, camera.height - 1]) / 2
    off, turned = (np.abs([camera.cx, camera.cy] - centre).sum() for centre in (middle, middle[::-1]))
    if not turned < off / 4:
        return ""
    return (
        f"its principal point ({camera.cx:g}, {camera.cy:g}) is the middle of {camera.height} x "
        f"{camera.width} pixels, not of {camera.width} x {camera.height}: are rows and columns swapped?"
    )


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


def describe_points(path: str, units: Units) -> dict[str, Any]:
    """Return what a file of points holds; lengths in metres.

    Raises InputError: unusable file.
    """
    cloud = read_points(path, units)
    low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    stood = None if cloud.origins is None else np.unique(cloud.origins, axis=0)
    doubt = units_doubt(diagonal) if diagonal > 0 else ""
    rays = [] if stood is not None else [_NO_RAYS if cloud.times is None else _TIMED]
    return {
        "kind": "points",
        "path": path,
        "format": split_index(path)[0].suffix[1:].lower(),
        "points": len(cloud.points),
        "bounds_m": [low, high],
        "extent_m": high - low,
        "diagonal_m": diagonal,
        "has_normals": cloud.normals is not None,
        "has_colour": cloud.colour is not None,
        "scanner_places_m": [] if stood is None else stood,
        "has_times": cloud.times is not None,
        "warnings": [*cloud.warnings, *rays, *([doubt] if doubt else [])],
    }


def describe_poses(path: Path, units: Units) -> dict[str, Any] | None:
    """Return what a file of poses holds, None where it holds none; lengths in metres."""
    try:
        poses = read_poses(path)
    except InputError:
        return None
    if not poses:
        return None
    places = np.array([pose.translation for pose in poses]) * METRES_PER_UNIT[units]
    legs = np.linalg.norm(np.diff(places, axis=0), axis=1)
    warnings = []
    if path.name == "images.txt":
        warnings.append("the unit of a COLMAP model is arbitrary unless it was scaled")
    return {
        "kind": "poses",
        "path": str(path),
        "poses": len(poses),
        "bounds_m": [places.min(axis=0), places.max(axis=0)],
        "way_m": float(legs.sum()),
        "first_world_from_sensor": poses[0].matrix,
        "warnings": warnings,
    }


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
    up: Axis | None = None,
    units: Units = "m",
    intrinsics: Intrinsics | None = None,
    depth_scale: float | None = None,
    trajectory: str | None = None,
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
    trajectory : str, optional
        A file of times and places of the moving scanner that measured the points.

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
        return _plain(_describe_scene(open_scene(text, up=up, units=units), text))
    if (
        not base.is_dir()
        and check_file(base)
        and format_of(suffix) is None
        and suffix not in (*_IMAGES, *_POSES)
    ):
        raise InputError(f"{base}: {_stranger(base)}")
    if trajectory is not None:
        return _plain(describe_scans(open_walk(base, trajectory, units), number, units))
    if suffix in _IMAGES:
        return _plain(describe_image(base))
    if suffix in _POSES and (poses := describe_poses(base, units)):
        return _plain(poses)
    if suffix in _POSES and suffix not in point_suffixes():
        raise InputError(f"{base}: {_stranger(base)}")
    try:
        source = open_scans(base, intrinsics=intrinsics, depth_scale=depth_scale)
        return _plain(describe_scans(source, number, units))
    except InputError as error:
        if base.is_dir() or suffix not in point_suffixes():
            raise
        return _plain(_described_points(text, units, error))


def _described_points(text: str, units: Units, error: InputError) -> dict[str, Any]:
    """What a file holds that is no scan: points, or what is wrong with it."""
    base = split_index(text)[0]
    try:
        points = describe_points(text, units)
    except InputError as trouble:
        if base.suffix.lower() not in text_suffixes():  # where only the place is missing, points are wrong
            raise (trouble if "--origin" in str(error) else error) from None
        cause = str(trouble).removeprefix(f"{base}: ")
        raise InputError(f"{base}: is text that holds neither poses nor points: {cause}") from trouble
    cause = str(error).removeprefix(f"{base}: ")
    if "no ray can be traced" not in cause:
        points["warnings"] = [f"is no scan: {cause}", *points["warnings"]]
    return points


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


def _describe_scene(scene: Scene, path: str) -> dict[str, Any]:
    mesh = scene.mesh
    bounds = mesh.bounds()
    extent = bounds[1] - bounds[0]
    appearance = mesh.appearance
    is_known = path.startswith("builtin:") or bool(scene.design and scene.design.schema)
    suggested = "z" if is_known else suggest_up(mesh, scene.mode)
    in_file = None if suggested is None else axis_in_file(suggested, scene.file_up)
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
        "up": scene.file_up,
        "suggested_up": in_file,
        **_describe_design(scene.design),
        "warnings": warnings,
    }


def _describe_design(design: Design | None) -> dict[str, Any]:
    """What a file of a design tells beside its geometry: elements by class and storey, unit, map."""
    if design is None or not design.schema:
        return {}
    counts = {
        name: dict(sorted(Counter(getattr(one, field) or "none" for one in design.elements).items()))
        for name, field in (("classes", "ifc_class"), ("storeys", "storey"))
    }
    moved = None if design.conversion is None else asdict(design.conversion)
    return {"schema": design.schema, **counts, "unit": design.unit or None, "map_conversion": moved}


def describe_image(path: Path) -> dict[str, Any]:
    """Return size, channels and values of an image; for depth images which unit is plausible.

    Raises InputError: no image, or too large.
    """
    with open_image(path) as image:
        mode, size, values = image.mode, image.size, np.asarray(image)
    is_depth = mode.startswith(("I", "F"))
    record: dict[str, Any] = {
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
        return record | _depth(values.astype(np.float64)) if is_depth else record


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
