# SPDX-License-Identifier: MIT
"""Points of an E57 scan, a chunk at a time, so that no scan is ever held whole as the file has it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.formats.guard import import_extra
from scenes.scan.pixels import finite_points

_CHUNK = 100_000  # points: read as fast as more, in 5 MB
_COLOURS = tuple(f"color{name}" for name in ("Red", "Green", "Blue"))
_CARTESIAN = tuple(f"cartesian{axis}" for axis in "XYZ")
_LIGHT = "intensity"
_PIXELS = ("rowIndex", "columnIndex")
_SPHERICAL = tuple(f"spherical{part}" for part in ("Range", "Azimuth", "Elevation"))


@dataclass(frozen=True, slots=True, eq=False)
class PointChunk:
    """The valid ones among some consecutive points of a scan.

    Attributes
    ----------
    points : (n, 3) float32 or float64
        In the scanner's frame, metres, finite and not zero; float32 where the file has them so.
    pixels : (2, n) int64
        Rows and columns of the grid, as in the file; (0, n) where there is none.
    colour : (n, 3) uint8, optional
        sRGB.
    intensity : (n,) float32, optional
        On the instrument's scale.
    n_read, n_bad : int
        Points of the file that this stands for, and how many of them are not finite.
    """

    points: NDArray[Any]
    pixels: NDArray[np.int64]
    colour: ColourArray | None
    intensity: NDArray[np.float32] | None
    n_read: int
    n_bad: int


def point_chunks(file: Any, index: int, *, places_alone: bool = False) -> Iterator[PointChunk]:
    """Yield the points of scan `index` of an open pye57 file, at most `_CHUNK` of them at a time.

    With `places_alone` without colour and intensity, which is faster.

    Raises InputError: without coordinates; what the library raises: damaged.
    """
    module = import_extra("pye57", "e57")
    header = file.get_header(index)
    fields = [field for field in header.point_fields if field in module.e57.SUPPORTED_POINT_FIELDS]
    fields = [field for field in fields if field not in (*_COLOURS, _LIGHT) or not places_alone]
    kind = np.float32 if _is_single(header.points, fields, module.libe57) else np.float64
    held, buffers = file.make_buffers(fields, min(_CHUNK, max(header.point_count, 1)))
    with closing(header.points.reader(buffers)) as reader:
        while n_read := reader.read():
            yield _valid({field: column[:n_read] for field, column in held.items()}, n_read, kind)


def _is_single(points: Any, names: list[str], lib: Any) -> bool:
    """Tell whether a file has its coordinates in single precision."""
    record = lib.StructureNode(points.prototype())
    nodes = [record[name] for name in names if name in _CARTESIAN]
    return bool(nodes) and all(
        isinstance(node, lib.FloatNode) and node.precision() == lib.E57_SINGLE for node in nodes
    )


def _valid(data: dict[str, Any], n_read: int, kind: Any) -> PointChunk:
    """The valid points of some columns of numbers, which are copied."""
    points = _points(data)
    finite, kept = finite_points(points), (points[:, 0] != 0) | (points[:, 1] != 0) | (points[:, 2] != 0)
    kept &= finite
    state = data.get("cartesianInvalidState" if _CARTESIAN[0] in data else "sphericalInvalidState")
    if state is not None:
        kept &= state == 0
    grid = _PIXELS if all(name in data for name in _PIXELS) else ()
    has_colour = all(name in data for name in _COLOURS)
    return PointChunk(
        points=points[kept].astype(kind),
        pixels=np.array([data[name][kept] for name in grid], np.int64).reshape(len(grid), kept.sum()),
        colour=np.stack([data[name][kept] for name in _COLOURS], axis=-1) if has_colour else None,
        intensity=data[_LIGHT][kept] if _LIGHT in data else None,
        n_read=n_read,
        n_bad=int((~finite).sum()),
    )


def _points(data: dict[str, Any]) -> FloatArray:
    """Points (n, 3) in the scanner's frame."""
    if _CARTESIAN[0] in data:
        return np.stack([data[name] for name in _CARTESIAN], axis=-1)
    if _SPHERICAL[0] in data:
        reach, azimuth, elevation = (data[name] for name in _SPHERICAL)
        across = reach * np.cos(elevation)
        sides = [across * np.cos(azimuth), across * np.sin(azimuth), reach * np.sin(elevation)]
        return np.stack(sides, axis=-1)
    raise InputError("has neither cartesian nor spherical coordinates")
