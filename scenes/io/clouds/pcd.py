# SPDX-License-Identifier: MIT
"""PCD: point clouds of the Point Cloud Library, read as scans or points, and written."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, ColourArray, FloatArray, InputError
from scenes.io.clouds.pcd_chunks import PcdHeader, pcd_chunks, read_pcd_header
from scenes.io.formats.columns import AXES, COLOURS, NORMALS, columns_of
from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import Format, RawPoints, one_cloud, write_single
from scenes.io.formats.grid_fit import AxesFit, fit_axes, fitted_scan, organised_scan
from scenes.io.formats.header import (
    apply_header,
    from_comments,
    point_warnings,
    projection_from_dict,
    scan_header,
    to_comments,
)
from scenes.io.formats.station import scan_from_station
from scenes.pose import Pose, quaternion_of, stated_rotation
from scenes.run.atomic import write_bytes
from scenes.run.libraries import import_extra
from scenes.run.mapping import allocate, release
from scenes.scan.colour import colour_bytes, colour_points, colour_warnings, scaled_bytes
from scenes.scan.pixels import finite_points, mend_pixels, row_blocks
from scenes.scan.projection import PinholeProjection, Projection
from scenes.scan.range_image import RangeImage

_PACKED_COLOURS = ("rgb", "rgba")
_NOT_A_NUMBER, _SIGNLESS = 0x7FC00000, 0x7FFFFFFF  # bits of the float that text calls nan, with either sign


class _PcdColumns(NamedTuple):
    """What a file holds of its points: read-only images (rows, columns, ...), None for what it does not."""

    points: NDArray[Any]
    normals: NDArray[Any] | None
    colour: ColourArray | None
    intensity: NDArray[np.float32] | None
    doubts: tuple[str, ...] = ()


def read_pcd(path: Path, intrinsics: tuple[float, float, float, float] | None = None) -> RangeImage:
    """Return the organised scan of a .pcd file.

    Points are in the sensor frame and VIEWPOINT is `world_from_sensor`, as PCL shows them; where the points
    fit a projection only after VIEWPOINT is taken off them, they are taken as world coordinates. Axes of
    OpenGL, ARKit and Blender (y up, z backwards) and of vehicles (x forward, z up) are recognised, and the
    scan has a warning that names them; the points keep the coordinates that they have in the file. An
    unorganised cloud with a VIEWPOINT becomes the spherical image that `scan_from_station` makes of it. The
    projection comes from `intrinsics`, a file of ours states it, else it is estimated from the points.

    Raises InputError: unorganised (HEIGHT 1) without a VIEWPOINT, truncated, or no known projection.
    """
    header = read_pcd_header(path)
    if header.height == 1:
        return _project_unorganised(path, header)
    held = _columns(path, header)
    return _organised_scan(held, header, intrinsics, path.stem).add_warnings(held.doubts)


def _organised_scan(
    held: _PcdColumns,
    header: PcdHeader,
    intrinsics: tuple[float, float, float, float] | None,
    name: str,
) -> RangeImage:
    """An organised cloud as a scan."""
    shape = (header.height, header.width)
    points = mend_pixels(held.points, held.points.dtype, _is_nowhere, np.nan)
    (pose, doubts), ours = _viewpoint(header.viewpoint), from_comments(header.comments)
    projection: Projection
    if intrinsics is not None:
        projection = PinholeProjection(header.width, header.height, *intrinsics)
    elif ours is not None:
        projection = projection_from_dict(ours["projection"])
    elif not any(np.isfinite(points[rows]).any() for rows in row_blocks(shape, points)):
        raise InputError("no point in it is finite; give --intrinsics FX,FY,CX,CY to read an empty scan")
    else:
        return _told_scan(points, pose, held, name).add_warnings(doubts)
    if projection.shape != shape:
        raise InputError(f"its comments describe {projection.shape}, WIDTH and HEIGHT say otherwise")
    scan = organised_scan(points, projection, pose, held.colour, name, intensity=held.intensity)
    return apply_header(scan, ours).add_warnings(doubts)


def _told_scan(points: FloatArray, pose: Pose, held: _PcdColumns, name: str) -> RangeImage:
    """The scan of organised points whose projection, and whose sensor's axes, they tell themselves."""
    images: dict[str, Any] = {"colour": held.colour, "name": name, "intensity": held.intensity}
    try:
        fit = fit_axes(points, pose)
    except InputError as unfit:
        with suppress(InputError):  # columns after a full turn, or rows over the zenith
            return fitted_scan(points, pose, **images, file_from_sensor=Pose.identity())
        raise unfit
    if fit.axes:
        scan = organised_scan(fit.points, fit.projection, pose @ fit.theirs_from_ours, **images)
    else:
        scan = fitted_scan(fit.points, pose, **images, known=fit.projection)
    return scan.add_warnings(_axes_doubts(fit))


def _axes_doubts(fit: AxesFit) -> Iterator[str]:
    """What is unusual about the axes of an organised cloud's sensor."""
    if fit.axes:
        yield f"its points have {fit.axes}: they are read so and keep their coordinates"
    camera = fit.projection
    if isinstance(camera, PinholeProjection) and camera.fx * camera.fy < 0:
        order = "columns run right to left" if camera.fx < 0 else "rows run from bottom to top"
        yield (
            f"its {order}: either its image was flipped, or its axes are left-handed and the scene is "
            "mirrored; if so, change the sign of one coordinate"
        )


def _is_nowhere(_: slice, points: NDArray[Any]) -> BoolArray:
    """Tell which points (rows, columns, 3) say that nothing came back."""
    known = finite_points(points) & ((points[..., 0] != 0) | (points[..., 1] != 0) | (points[..., 2] != 0))
    return np.asarray(~known, dtype=np.bool_)


def _project_unorganised(path: Path, header: PcdHeader) -> RangeImage:
    """An unorganised cloud as the image that a scanner in the place of VIEWPOINT would have taken."""
    cloud = read_pcd_points(path)
    if cloud.origins is None:
        raise InputError(
            f"the cloud is unorganised (HEIGHT 1, {header.width} points): its pixel grid is lost; save the "
            "organised cloud of the sensor (HEIGHT > 1, NaN where nothing came back), or say where the "
            "scanner stood (--origin X,Y,Z)"
        )
    left_out = tuple(text for text in cloud.warnings if "left out" in text or "colour" in text)
    scan = scan_from_station(cloud.points, cloud.origins, path.stem, cloud.colour)
    return scan.add_warnings(left_out)


def read_pcd_points(path: Path) -> RawPoints:
    """Return the points in the world, where the sensor stood, normals, colours and warnings.

    Organised clouds are read as scans where a projection explains them; others are moved by VIEWPOINT.
    Normals and place are None where the file does not tell; without a grid a default VIEWPOINT says nothing.
    """
    header = read_pcd_header(path)
    cloud, (pose, doubts) = _columns(path, header), _viewpoint(header.viewpoint)
    points = np.asarray(cloud.points.reshape(-1, 3), dtype=np.float64)
    kept = np.isfinite(points).all(axis=1)
    left_out = () if header.height > 1 else point_warnings(points)
    if header.height > 1:  # an organised cloud says "nothing came back" by NaN or by zeros
        kept &= (points != 0).any(axis=1)
    held = RawPoints(
        points[kept],
        None if cloud.normals is None else cloud.normals.reshape(-1, 3)[kept].astype(np.float64),
        colour=None if cloud.colour is None else cloud.colour.reshape(-1, 3)[kept],
        warnings=(*left_out, *cloud.doubts, *doubts),
    )
    if np.allclose(pose.matrix, np.eye(4)):
        return replace(held, origins=pose.translation if header.height > 1 else None)
    is_scan = header.height > 1 and cloud.normals is None
    try:
        scan = _organised_scan(cloud, header, None, path.stem) if is_scan else None
    except InputError:
        scan = None
    if scan is not None:  # knows whether the points are already in the world
        return replace(
            held,
            points=scan.points()[scan.valid],
            origins=scan.world_from_sensor.translation,
            colour=None if cloud.colour is None else cloud.colour[scan.valid],
        )
    return replace(
        held,
        points=pose.apply(held.points),
        normals=None if held.normals is None else pose.rotate(held.normals),
        origins=pose.translation,
        warnings=(
            *left_out,
            *cloud.doubts,
            *doubts,
            "moved from the sensor's frame to the world by VIEWPOINT",
        ),
    )


def _columns(path: Path, header: PcdHeader) -> _PcdColumns:
    """Read all points, some at a time, into images.

    Raises InputError: without x, y, z; as `pcd_chunks`.
    """
    names, shape = list(header.point.names or ()), (header.height, header.width)
    held = {role: names[k] for role, k in columns_of(names).items()}
    if "x" not in held:
        raise InputError(f"has the fields {', '.join(names)}; x, y, z are needed")
    axes, sides, channels = ([held.get(role, "") for role in group] for group in (AXES, NORMALS, COLOURS))
    is_packed = [name in names and header.point[name].itemsize == 4 for name in _PACKED_COLOURS]
    packed = next((name for name, is_held in zip(_PACKED_COLOURS, is_packed, strict=True) if is_held), None)
    light = held.get("intensity")
    are_single = all(header.point[axis] == np.float32 for axis in axes)
    points = allocate((*shape, 3), np.float32 if are_single else np.float64)
    normals = allocate((*shape, 3), np.float64) if "nx" in held else None
    colour = None if packed is None and "red" not in held else allocate((*shape, 3), np.uint8)
    is_coloured = np.ones(shape, np.bool_)
    intensity = None if light is None else allocate(shape, np.float32)
    start = 0
    for chunk in pcd_chunks(path, header):
        part = slice(start, start + len(chunk))
        points.reshape(-1, 3)[part] = np.stack([chunk[axis] for axis in axes], axis=-1)
        if normals is not None:
            normals.reshape(-1, 3)[part] = np.stack([chunk[axis] for axis in sides], axis=-1)
        if colour is not None and packed is not None:
            bits, is_coloured.ravel()[part] = _packed_bits(np.ascontiguousarray(chunk[packed]))
            colour.reshape(-1, 3)[part] = np.stack([bits >> 16 & 255, bits >> 8 & 255, bits & 255], axis=-1)
        elif colour is not None:
            colour.reshape(-1, 3)[part] = scaled_bytes(np.stack([chunk[name] for name in channels], axis=-1))
        if intensity is not None:
            intensity.ravel()[part] = chunk[light]
        start = part.stop
        release(points, normals, colour, intensity)
    doubts: tuple[str, ...] = ()
    if colour is not None and not is_coloured.all():
        known = finite_points(points)
        n_without, filled = int((known & ~is_coloured).sum()), np.zeros_like(colour)
        painted = colour_points(colour[known], is_coloured[known], points[known])
        if painted is not None:
            filled[known] = painted
        colour, doubts = None if painted is None else filled, colour_warnings(n_without, int(known.sum()))
    for image in (points, normals, colour, intensity):
        if image is not None:
            image.setflags(write=False)
    return _PcdColumns(points, normals, colour, intensity, doubts)


def _packed_bits(column: NDArray[Any]) -> tuple[NDArray[np.uint32], BoolArray]:
    """Colours (n,) as 0xRRGGBB, and which of them are known.

    PCL keeps the bits of that number in a float; some programs write the number itself, which no such bits
    make (they are tiny, or no number). Text that says nan has the bits of none.
    """
    bits = column.view(np.uint32)
    if column.dtype.kind != "f":
        return bits, np.ones(len(bits), np.bool_)
    is_known = np.asarray((bits & _SIGNLESS) != _NOT_A_NUMBER, dtype=np.bool_)
    some = np.asarray(column[is_known & (bits != 0)], np.float64)
    with np.errstate(invalid="ignore"):
        are_numbers = len(some) and ((some >= 1) & (some < 2**32) & (some == np.rint(some))).all()
    if are_numbers:
        bits = np.where(is_known, column, 0).astype(np.uint32)
    return bits, is_known


def _viewpoint(viewpoint: tuple[float, ...]) -> tuple[Pose, tuple[str, ...]]:
    """Pose of a VIEWPOINT tx ty tz qw qx qy qz, and what is doubtful about it."""
    w, x, y, z = viewpoint[3:7]
    rotation, doubts = stated_rotation([x, y, z, w], "VIEWPOINT")
    return Pose.from_parts(rotation, np.array(viewpoint[:3], dtype=np.float64)), doubts


def write_pcd(scan: RangeImage, path: Path) -> None:
    """Write `scan` as an organised binary PCD: float32 points in the sensor frame, VIEWPOINT the pose.

    float32 is what PCL and its kin read; it costs 6e-8 of the distance. Projection, noise and name are
    kept in comment lines that only `read_pcd` heeds.
    """
    module = import_extra("pypcd4", "pcd")
    points = scan.points_in_sensor().reshape(-1, 3).astype(np.float32)
    columns, fields, types = list(points.T), ["x", "y", "z"], [np.float32] * 3
    if scan.colour is not None:
        red, green, blue = colour_bytes(scan.colour).reshape(-1, 3).astype(np.uint32).T
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


FORMAT = Format(
    suffixes=(".pcd",),
    points=one_cloud(read_pcd_points),
    scans=lambda path, intrinsics: [partial(read_pcd, path, intrinsics)],
    write=write_single(write_pcd),
    facts=FormatFacts(
        title="`.pcd`",
        read=(
            "ascii, binary, binary_compressed; organised clouds as scans, HEIGHT 1 as points or from its "
            "VIEWPOINT"
        ),
        lost="descriptors and other fields",
        written="binary: 7e-7 m (float32 in the sensor frame)",
        poses=(
            "VIEWPOINT; world coordinates under it, and axes of cameras and vehicles, are recognised; "
            "`--origin`"
        ),
        colours="rgb, rgba, or r g b; intensity",
        noise="in files of ours, else estimated from the points",
    ),
)
