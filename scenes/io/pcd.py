# SPDX-License-Identifier: MIT
"""PCD: point clouds of the Point Cloud Library, read some points at a time, and written."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, ColourArray, FloatArray, InputError
from scenes.io.format import Format, RawPoints, one_cloud, write_single
from scenes.io.grid_fit import AxesFit, fit_axes, fitted_scan, organised_scan
from scenes.io.guard import check_size, import_extra
from scenes.io.header import (
    apply_header,
    from_comments,
    point_warnings,
    projection_from_dict,
    scan_header,
    to_comments,
)
from scenes.io.limits import check_limit, check_unpacked
from scenes.io.station import scan_from_station
from scenes.pose import Pose, quaternion_of, rotation_of
from scenes.run.atomic import write_bytes
from scenes.run.mapping import allocate, release
from scenes.scan.colour import colour_bytes
from scenes.scan.pixels import finite_points, mend_pixels, row_blocks
from scenes.scan.projection import PinholeProjection, Projection
from scenes.scan.range_image import RangeImage

_MAX_HEADER = 1 << 22  # bytes
_MOST_LINES = 10  # of a header, comments apart
_MOST_VALUES = 4096  # of one point; descriptors have a few hundred
_VERSIONS = (".7", "0.7")
_KINDS = {"F": "f", "U": "u", "I": "i"}
_CHUNK = 100_000  # points that are read at a time
_PACKED = 1 << 22  # bytes that are unpacked at a time
_LONGEST = 64  # bytes that an instruction of the packing has at most, and some more


@dataclass(frozen=True, slots=True)
class PcdHeader:
    """What the text in front of the data says.

    Attributes
    ----------
    width, height : int
        Columns and rows; an unorganised cloud has one row.
    point : dtype
        The fields of a point by name; those of several values are name__0000 and so on.
    encoding : str
        "ascii", "binary" or "binary_compressed".
    comments : tuple of str
        The lines that begin with #, without it.
    viewpoint : tuple of seven floats
        tx ty tz qw qx qy qz.
    data_offset : int
        Bytes before the points.
    """

    width: int
    height: int
    point: np.dtype[Any]
    encoding: str
    comments: tuple[str, ...]
    viewpoint: tuple[float, ...]
    data_offset: int


def read_pcd_header(path: Path) -> PcdHeader:
    """Read the text header, and check that the data can be as large as it says.

    Raises InputError: no PCD, of another version, truncated, or a header that contradicts itself.
    """
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
    encoding = words["DATA"][0]
    if encoding not in ("ascii", "binary", "binary_compressed"):
        raise InputError(f"its data are {encoding!r}; ascii, binary and binary_compressed are known")
    if words.get("VERSION", _VERSIONS)[0] not in _VERSIONS:
        raise InputError(f"is PCD of version {words['VERSION'][0]}; 0.7 is known")
    viewpoint = tuple(float(number) for number in words.get("VIEWPOINT", ["0", "0", "0", "1", "0", "0", "0"]))
    if len(viewpoint) != 7:
        raise InputError(f"its VIEWPOINT has {len(viewpoint)} numbers; expected tx ty tz qw qx qy qz")
    header = PcdHeader(
        width=width,
        height=height,
        point=_point_type(words, counts),
        encoding=encoding,
        comments=tuple(line[2:] for line in lines if line.startswith("# ")),
        viewpoint=viewpoint,
        data_offset=end + 1,
    )
    _check_length(header, path.stat().st_size, text[end + 1 : end + 9])
    return header


def _point_type(words: dict[str, list[str]], counts: list[int]) -> np.dtype[Any]:
    """The fields of a point; what is called _ only fills up, and is called by its place."""
    kinds = [_KINDS[kind] + size for kind, size in zip(words["TYPE"], words["SIZE"], strict=True)]
    names = [f"_{k}" if name == "_" else name for k, name in enumerate(words["FIELDS"])]
    fields = list[tuple[str, str]]()
    for name, kind, count in zip(names, kinds, counts, strict=True):
        parts = [name] if count == 1 else [f"{name}__{k:04d}" for k in range(count)]
        fields += [(part, kind) for part in parts]
    return np.dtype(fields)


def _check_length(header: PcdHeader, file_bytes: int, start: bytes) -> None:
    """Raise when the file is shorter than its header says, or would unpack to something else."""
    expected = header.width * header.height * header.point.itemsize
    held = file_bytes - header.data_offset
    check_unpacked(expected, file_bytes, "it")
    if header.encoding == "binary" and held < expected:
        raise InputError(f"truncated: {expected} bytes of points announced, {held} present")
    least = header.width * header.height * len(header.point.names or ()) * 2 - 1  # a digit and a blank each
    if header.encoding == "ascii" and held < least:
        raise InputError(f"truncated: {least} bytes of points at least announced, {held} present")
    if header.encoding == "binary_compressed":
        packed, unpacked = (int(number) for number in np.frombuffer(start.ljust(8, b"\0"), "<u4"))
        if held < 8 + packed or unpacked != expected:
            raise InputError(
                f"truncated or damaged: {packed} packed and {expected} unpacked bytes announced, "
                f"{max(held - 8, 0)} and {unpacked} present"
            )


def pcd_chunks(path: Path, header: PcdHeader) -> Iterator[NDArray[Any]]:
    """Yield the points of a file, in order, as arrays (n,) of `header.point`.

    Raises InputError: damaged, or another number of points than announced.
    """
    n_points, n_found = header.width * header.height, 0
    with path.open("rb") as file:
        file.seek(header.data_offset)
        readers = {"ascii": _lines, "binary": _records, "binary_compressed": _unpacked_records}
        for chunk in readers[header.encoding](file, header.point, n_points):
            n_found += len(chunk)
            yield chunk
    if n_found != n_points:
        raise InputError(
            f"{n_found} points of {n_points} announced for WIDTH {header.width} and HEIGHT {header.height} "
            f"({header.encoding}): is its header damaged?"
        )


def _lines(file: BinaryIO, point: np.dtype[Any], n_points: int) -> Iterator[NDArray[Any]]:
    """Points as text; the file is to end behind them."""
    n_left = n_points
    while lines := list(islice(file, _CHUNK)):
        text = [line.decode("latin-1") for line in lines if line.strip() and line.strip()[:1] != b"#"]
        if text:
            chunk: NDArray[Any] = np.loadtxt(text, point, delimiter=" ", ndmin=1)
            n_left -= len(chunk)
            if n_left < 0:
                raise InputError(f"more than the {n_points} points announced: is its header damaged?")
            yield chunk


def _records(file: BinaryIO, point: np.dtype[Any], n_points: int) -> Iterator[NDArray[Any]]:
    for start in range(0, n_points, _CHUNK):
        n_bytes = min(_CHUNK, n_points - start) * point.itemsize
        yield np.frombuffer(file.read(n_bytes), point)


def _unpacked_records(file: BinaryIO, point: np.dtype[Any], n_points: int) -> Iterator[NDArray[Any]]:
    """Points whose fields stand one behind the other, packed as a whole."""
    whole = _unpack_lzf(file, n_points * point.itemsize)
    names = point.names or ()
    starts = n_points * np.cumsum([0, *(point[name].itemsize for name in names)])
    for first in range(0, n_points, _CHUNK):
        chunk = np.empty(min(_CHUNK, n_points - first), point)
        for name, start in zip(names, starts.tolist(), strict=False):
            size = point[name].itemsize
            part = whole[start + first * size : start + (first + len(chunk)) * size]
            chunk[name] = part.view(point[name])
        release(whole)
        yield chunk


def _unpack_lzf(file: BinaryIO, n_bytes: int) -> NDArray[np.uint8]:
    """Unpack (LZF) what follows in a file, whose two sizes come first."""
    from scenes.io.lzf import unpack_some  # compiled code, which only this encoding needs

    n_packed = int(np.frombuffer(file.read(8), "<u4")[0])
    out, n_out, remainder = allocate((n_bytes,), np.uint8), 0, b""
    while n_packed or remainder:
        read = file.read(min(_PACKED, n_packed))
        n_packed = n_packed - len(read) if read else 0
        held = np.frombuffer(remainder + read, np.uint8)
        n_used, n_out = unpack_some(held, out, n_out, len(held) - (_LONGEST if n_packed else 0))
        if n_used < 0:
            raise InputError(f"damaged: its packed points break off after {n_out} of {n_bytes} bytes")
        remainder = held[n_used:].tobytes()
        release(out)
    if n_out != n_bytes:
        raise InputError(f"damaged: its packed points are {n_out} bytes, {n_bytes} are announced")
    return out


_NORMALS = ("normal_x", "normal_y", "normal_z")
_COLOURS = ("rgb", "rgba")
_INTENSITIES = ("intensity", "Intensity", "intensities")


class _PcdColumns(NamedTuple):
    """What a file holds of its points: read-only images (rows, columns, ...), None for what it does not."""

    points: NDArray[Any]
    normals: NDArray[Any] | None
    colour: ColourArray | None
    intensity: NDArray[np.float32] | None


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
    return _organised_scan(_columns(path, header), header, intrinsics, path.stem)


def _organised_scan(
    held: _PcdColumns,
    header: PcdHeader,
    intrinsics: tuple[float, float, float, float] | None,
    name: str,
) -> RangeImage:
    """An organised cloud as a scan."""
    shape = (header.height, header.width)
    points = mend_pixels(held.points, held.points.dtype, _is_nowhere, np.nan)
    pose, ours = _viewpoint(header.viewpoint), from_comments(header.comments)
    projection: Projection
    if intrinsics is not None:
        projection = PinholeProjection(header.width, header.height, *intrinsics)
    elif ours is not None:
        projection = projection_from_dict(ours["projection"])
    elif not any(np.isfinite(points[rows]).any() for rows in row_blocks(shape, points)):
        raise InputError("no point in it is finite; give --intrinsics FX,FY,CX,CY to read an empty scan")
    else:
        return _told_scan(points, pose, held, name)
    if projection.shape != shape:
        raise InputError(f"its comments describe {projection.shape}, WIDTH and HEIGHT say otherwise")
    scan = organised_scan(points, projection, pose, held.colour, name, intensity=held.intensity)
    return apply_header(scan, ours)


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
    left_out = tuple(text for text in cloud.warnings if "left out" in text)
    scan = scan_from_station(cloud.points, cloud.origins, path.stem, cloud.colour)
    return scan.add_warnings(left_out)


def read_pcd_points(path: Path) -> RawPoints:
    """Return the points in the world, where the sensor stood, normals, colours and warnings.

    Organised clouds are read as scans where a projection explains them; others are moved by VIEWPOINT.
    Normals and place are None where the file does not tell; without a grid a default VIEWPOINT says nothing.
    """
    header = read_pcd_header(path)
    cloud, pose = _columns(path, header), _viewpoint(header.viewpoint)
    points = np.asarray(cloud.points.reshape(-1, 3), dtype=np.float64)
    kept = np.isfinite(points).all(axis=1)
    left_out = () if header.height > 1 else point_warnings(points)
    if header.height > 1:  # an organised cloud says "nothing came back" by NaN or by zeros
        kept &= (points != 0).any(axis=1)
    held = RawPoints(
        points[kept],
        None if cloud.normals is None else cloud.normals.reshape(-1, 3)[kept].astype(np.float64),
        colour=None if cloud.colour is None else cloud.colour.reshape(-1, 3)[kept],
        warnings=left_out,
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
        warnings=(*left_out, "moved from the sensor's frame to the world by VIEWPOINT"),
    )


def _columns(path: Path, header: PcdHeader) -> _PcdColumns:
    """Read all points, some at a time, into images.

    Raises InputError: without x, y, z; as `pcd_chunks`.
    """
    names, shape = header.point.names or (), (header.height, header.width)
    if not {"x", "y", "z"} <= set(names):
        raise InputError(f"has the fields {', '.join(names)}; x, y, z are needed")
    packed = next((name for name in _COLOURS if name in names and header.point[name].itemsize == 4), None)
    light = next((name for name in _INTENSITIES if name in names), None)
    has_normals = set(_NORMALS) <= set(names)
    are_single = all(header.point[axis] == np.float32 for axis in "xyz")
    points = allocate((*shape, 3), np.float32 if are_single else np.float64)
    normals = allocate((*shape, 3), np.float64) if has_normals else None
    colour = None if packed is None else allocate((*shape, 3), np.uint8)
    intensity = None if light is None else allocate(shape, np.float32)
    start = 0
    for chunk in pcd_chunks(path, header):
        part = slice(start, start + len(chunk))
        points.reshape(-1, 3)[part] = np.stack([chunk[axis] for axis in "xyz"], axis=-1)
        if normals is not None:
            normals.reshape(-1, 3)[part] = np.stack([chunk[axis] for axis in _NORMALS], axis=-1)
        if colour is not None:
            bits = np.ascontiguousarray(chunk[packed]).view(np.uint32)
            colour.reshape(-1, 3)[part] = np.stack([bits >> 16 & 255, bits >> 8 & 255, bits & 255], axis=-1)
        if intensity is not None:
            intensity.ravel()[part] = chunk[light]
        start = part.stop
        release(points, normals, colour, intensity)
    for image in (points, normals, colour, intensity):
        if image is not None:
            image.setflags(write=False)
    return _PcdColumns(points, normals, colour, intensity)


def _viewpoint(viewpoint: tuple[float, ...]) -> Pose:
    """Pose of a VIEWPOINT tx ty tz qw qx qy qz."""
    w, x, y, z = viewpoint[3:7]
    rotation = rotation_of([x, y, z, w], "VIEWPOINT")
    return Pose.from_parts(rotation, np.array(viewpoint[:3], dtype=np.float64))


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
)
