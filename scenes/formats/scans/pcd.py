# SPDX-License-Identifier: MIT
"""PCD scans: organised point clouds of the Point Cloud Library, read and written with pypcd4."""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import InputError
from scenes.formats.guard import check_size, import_extra
from scenes.formats.header import (
    colour_bytes,
    colour_from_bytes,
    described,
    from_comments,
    point_warnings,
    projection_from_dict,
    scan_header,
    to_comments,
)
from scenes.formats.scans.cloud import RawPoints
from scenes.formats.scans.grid_fit import fit_grid, organised_scan
from scenes.formats.scans.station import scan_from_station
from scenes.pose import Pose, quaternion_of, rotation_of
from scenes.run.atomic import write_bytes
from scenes.run.file_limits import check_limit, check_unpacked
from scenes.scan.pixels import finite_points, points_type
from scenes.scan.projection import PinholeProjection, Projection
from scenes.scan.range_image import RangeImage

_MAX_HEADER = 1 << 22  # bytes
_MOST_LINES = 10  # of a header, comments apart: pypcd4 reads no more
_MOST_VALUES = 4096  # of one point; descriptors have a few hundred
_NORMALS = ("normal_x", "normal_y", "normal_z")
_INTENSITIES = ("intensity", "Intensity", "intensities")


@dataclass(frozen=True, slots=True)
class _PcdHeader:
    """What the text in front of the data says."""

    width: int
    height: int
    point_bytes: int
    point_values: int
    encoding: str
    comments: tuple[str, ...]
    data_offset: int


def read_pcd(path: Path, intrinsics: tuple[float, float, float, float] | None = None) -> RangeImage:
    """Return the organised scan of a .pcd file.

    Points are in the sensor frame and VIEWPOINT is `world_from_sensor`, as PCL shows them; where the points
    fit a projection only after VIEWPOINT is taken off them, they are taken as world coordinates. An
    unorganised cloud with a VIEWPOINT becomes the spherical image that `scan_from_station` makes of it. The
    projection comes from `intrinsics`, a file of ours states it, else it is estimated from the points.

    Raises InputError: unorganised (HEIGHT 1) without a VIEWPOINT, truncated, or no known projection.
    """
    header = _read_header(path)
    if header.height == 1:
        return _projected(path, header)
    return _organised(_read_cloud(path, header), header, intrinsics, path.stem)


def _organised(
    cloud: Any, header: _PcdHeader, intrinsics: tuple[float, float, float, float] | None, name: str
) -> RangeImage:
    """An organised cloud as a scan."""
    values, shape = cloud.pc_data, (header.height, header.width)
    missing = {"x", "y", "z"} - set(values.dtype.names)
    if missing:
        raise InputError(f"has points with fields {values.dtype.names}, expected x, y, z for {shape}")
    held = _columns(values, "xyz")
    points = held.astype(points_type(held), copy=False).reshape(*shape, 3)
    points[~finite_points(points) | (points == 0).all(axis=-1)] = np.nan
    colour = _unpack_colour(values, shape)
    light = [values[field].reshape(shape) for field in _INTENSITIES if field in values.dtype.names]
    pose, ours = _viewpoint(cloud.metadata.viewpoint), from_comments(header.comments)
    projection: Projection
    if intrinsics is not None:
        projection = PinholeProjection(header.width, header.height, *intrinsics)
    elif ours is not None:
        projection = projection_from_dict(ours["projection"])
    elif not np.isfinite(points).any():
        raise InputError("no point in it is finite; give --intrinsics FX,FY,CX,CY to read an empty scan")
    else:
        try:
            projection = fit_grid(points).projection
        except InputError:
            points = pose.inverse().apply(points)
            projection = fit_grid(points).projection
    if projection.shape != shape:
        raise InputError(f"its comments describe {projection.shape}, WIDTH and HEIGHT say otherwise")
    intensity = light[0] if light else None
    scan = organised_scan(points, projection, pose, colour, name, intensity=intensity)
    return described(scan, ours)


def _projected(path: Path, header: _PcdHeader) -> RangeImage:
    """An unorganised cloud as the image that a scanner in the place of VIEWPOINT would have taken."""
    cloud = read_pcd_points(path)
    if cloud.origins is None:
        raise InputError(
            f"the cloud is unorganised (HEIGHT 1, {header.width} points): its pixel grid is lost; save the "
            "organised cloud of the sensor (HEIGHT > 1, NaN where nothing came back), or say where the "
            "scanner stood (--origin X,Y,Z)"
        )
    left_out = tuple(text for text in cloud.warnings if "left out" in text)
    colour = None if cloud.colour is None else colour_from_bytes(cloud.colour)
    return replace(scan_from_station(cloud.points, cloud.origins, path.stem, colour), warnings=left_out)


def read_pcd_points(path: Path) -> RawPoints:
    """Return the points in the world, where the sensor stood, normals, colours and warnings.

    Organised clouds are read as scans where a projection explains them; others are moved by VIEWPOINT.
    Normals and place are None where the file does not tell; without a grid a default VIEWPOINT says nothing.
    """
    header = _read_header(path)
    cloud = _read_cloud(path, header)
    values, pose = cloud.pc_data, _viewpoint(cloud.metadata.viewpoint)
    missing = {"x", "y", "z"} - set(values.dtype.names)
    if missing:
        raise InputError(f"has the fields {', '.join(values.dtype.names)}; x, y, z are needed")
    points = _columns(values, "xyz").astype(np.float64)
    kept = np.isfinite(points).all(axis=1)
    left_out = () if header.height > 1 else point_warnings(points)
    if header.height > 1:  # an organised cloud says "nothing came back" by NaN or by zeros
        kept &= (points != 0).any(axis=1)
    normals, colour = _columns(values, _NORMALS), _unpack_colour(values, (1, len(values)))
    held = RawPoints(
        points[kept],
        None if normals is None else normals.astype(np.float64)[kept],
        colour=None if colour is None else np.asarray(np.rint(colour[0] * 255), dtype=np.uint8)[kept],
        warnings=left_out,
    )
    if np.allclose(pose.matrix, np.eye(4)):
        return replace(held, origins=pose.translation if header.height > 1 else None)
    try:
        scan = _organised(cloud, header, None, path.stem) if header.height > 1 and normals is None else None
    except InputError:
        scan = None
    if scan is not None:  # knows whether the points are already in the world
        seen = None if colour is None else colour.reshape(*scan.shape, 3)[scan.valid]
        return replace(
            held,
            points=scan.points()[scan.valid],
            origins=scan.world_from_sensor.translation,
            colour=None if seen is None else np.asarray(np.rint(seen * 255), dtype=np.uint8),
        )
    return replace(
        held,
        points=pose.apply(held.points),
        normals=None if held.normals is None else pose.rotate(held.normals),
        origins=pose.translation,
        warnings=(*left_out, "moved from the sensor's frame to the world by VIEWPOINT"),
    )


def _read_cloud(path: Path, header: _PcdHeader) -> Any:
    """The cloud as pypcd4 reads it, which must have understood the header as we do."""
    cloud = import_extra("pypcd4", "pcd").PointCloud.from_path(path)
    held, n_points = cloud.metadata, header.width * header.height
    found = (held.width, held.height, held.points, held.data.value, len(cloud.pc_data))
    if found != (header.width, header.height, n_points, header.encoding, n_points):
        raise InputError(
            f"{len(cloud.pc_data)} points of {held.points} announced for WIDTH {header.width} and HEIGHT "
            f"{header.height} ({header.encoding}): is its header damaged?"
        )
    return cloud


def _columns(values: Any, names: Iterable[str]) -> Any:
    """Fields side by side, None where one is missing."""
    if not set(names) <= set(values.dtype.names):
        return None
    return np.stack([values[name] for name in names], axis=-1)


def _read_header(path: Path) -> _PcdHeader:
    """Read the text header, and check that the data can be as large as it says."""
    with path.open("rb") as file:
        text = file.read(_MAX_HEADER)
    start = 0 if text.startswith(b"DATA") else text.find(b"\nDATA") + 1
    end = text.find(b"\n", start)
    if start <= 0 or end < 0:
        raise InputError("not a PCD file: there is no DATA line")
    lines = text[: end + 1].decode("ascii", errors="replace").splitlines()
    words = {line.split()[0].upper(): line.split()[1:] for line in lines if line.strip() and line[0] != "#"}
    width, height = int(words["WIDTH"][0]), int(words.get("HEIGHT", ["1"])[0])
    check_limit("points", width * height, "its points")
    if height != 1:
        check_size(height, width)
    elif width < 1:
        raise InputError("announces no point")
    counts = [int(count) for count in words.get("COUNT", ["1"] * len(words["SIZE"]))]
    if min(counts) < 1 or set(words["SIZE"]) - {"1", "2", "4", "8"}:
        raise InputError(f"its fields have the sizes {words['SIZE']} and counts {counts}")
    if sum(counts) > _MOST_VALUES or len(words) > _MOST_LINES:
        raise InputError(
            f"its header has {len(words)} lines and gives a point {sum(counts)} values; expected at most "
            f"{_MOST_LINES} lines and {_MOST_VALUES} values"
        )
    announced = int(words.get("POINTS", [str(width * height)])[0])
    if announced != width * height:
        raise InputError(f"announces {announced} points in {width} x {height}: are rows or columns missing?")
    point_bytes = sum(int(size) * count for size, count in zip(words["SIZE"], counts, strict=True))
    encoding = words["DATA"][0].lower()
    header = _PcdHeader(
        width=width,
        height=height,
        point_bytes=point_bytes,
        point_values=sum(counts),
        encoding=encoding,
        comments=tuple(line[2:] for line in lines if line.startswith("# ")),
        data_offset=end + 1,
    )
    _check_length(header, path.stat().st_size, text[end + 1 : end + 9])
    return header


def _check_length(header: _PcdHeader, file_bytes: int, start: bytes) -> None:
    """Raise when the file is shorter than its header says, or would unpack to something else."""
    expected = header.width * header.height * header.point_bytes
    held = file_bytes - header.data_offset
    check_unpacked(expected, file_bytes, "it")
    if header.encoding == "binary" and held < expected:
        raise InputError(f"truncated: {expected} bytes of points announced, {held} present")
    least = header.width * header.height * header.point_values * 2 - 1  # a digit and a blank each
    if header.encoding == "ascii" and held < least:
        raise InputError(f"truncated: {least} bytes of points at least announced, {held} present")
    if header.encoding == "binary_compressed":
        packed, unpacked = (int(number) for number in np.frombuffer(start.ljust(8, b"\0"), "<u4"))
        if held < 8 + packed or unpacked != expected:
            raise InputError(
                f"truncated or damaged: {packed} packed and {expected} unpacked bytes announced, "
                f"{max(held - 8, 0)} and {unpacked} present"
            )


def _viewpoint(viewpoint: tuple[float, ...]) -> Pose:
    """Pose of a VIEWPOINT tx ty tz qw qx qy qz."""
    w, x, y, z = viewpoint[3:7]
    rotation = rotation_of([x, y, z, w], "VIEWPOINT")
    return Pose.from_parts(rotation, np.array(viewpoint[:3], dtype=np.float64))


def _unpack_colour(values: Any, shape: tuple[int, int]) -> Any:
    """Colours (rows, columns, 3) of a packed rgb or rgba field (float or integer), None without."""
    for name in ("rgb", "rgba"):
        if name in values.dtype.names and values.dtype[name].itemsize == 4:
            packed = np.ascontiguousarray(values[name]).view(np.uint32)
            channels = np.stack([packed >> 16 & 255, packed >> 8 & 255, packed & 255], axis=-1)
            return colour_from_bytes(channels).reshape(*shape, 3)
    return None


def write_pcd(scan: RangeImage, path: Path) -> None:
    """Write `scan` as an organised binary PCD: float32 points in the sensor frame, VIEWPOINT the pose.

    float32 is what PCL and its kin read; it costs 6e-8 of the distance. Projection, noise and name are
    kept in comment lines that only `read_pcd` heeds.
    """
    module = import_extra("pypcd4", "pcd")
    points = scan.points_in_sensor().reshape(-1, 3).astype(np.float32)
    columns, fields, types = list(points.T), ["x", "y", "z"], [np.float32] * 3
    colour = colour_bytes(scan)
    if colour is not None:
        red, green, blue = colour.reshape(-1, 3).astype(np.uint32).T
        columns.append((red << 16 | green << 8 | blue).view(np.float32))
        fields, types = [*fields, "rgb"], [*types, np.float32]
    if scan.intensity is not None:
        columns.append(scan.intensity.ravel())
        fields, types = [*fields, "intensity"], [*types, np.float32]
    cloud = module.PointCloud.from_points(columns, fields, types)
    x, y, z, w = quaternion_of(scan.world_from_sensor.rotation)
    viewpoint = (*(float(part) for part in scan.origin), w, x, y, z)
    rows, width = scan.shape
    cloud.metadata = cloud.metadata.derive(width=width, height=rows, viewpoint=viewpoint)
    buffer = io.BytesIO()
    cloud.save(buffer, module.Encoding.BINARY)
    comments = [".PCD v0.7 - Point Cloud Data file format", *to_comments(scan_header(scan))]
    write_bytes(path, "".join(f"# {line}\n" for line in comments).encode("ascii") + buffer.getvalue())
