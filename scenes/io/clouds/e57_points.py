# SPDX-License-Identifier: MIT
"""E57 points: the fields of a scan's points as numbers, some points at a time; colours by their limits."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, ColourArray, FloatArray, InputError
from scenes.pose import Pose, stated_rotation
from scenes.run.libraries import import_extra
from scenes.scan.pixels import finite_points

_MOST_INDEX = 2**62
_CHUNK = 100_000  # points: read as fast as more, in 5 MB
_COLOURS = tuple(f"color{name}" for name in ("Red", "Green", "Blue"))
_CARTESIAN = tuple(f"cartesian{axis}" for axis in "XYZ")
_LIGHT = "intensity"
_PIXELS = ("rowIndex", "columnIndex")
_RETURN = "returnIndex"
_TIME, _START = "timeStamp", "acquisitionStart"
_SPHERICAL = tuple(f"spherical{part}" for part in ("Range", "Azimuth", "Elevation"))
_ENDS = ("Minimum", "Maximum")
_BYTES = np.array([[0.0] * 3, [255.0] * 3])
_NO_COLOUR, _NO_LIGHT = "isColorInvalid", "isIntensityInvalid"
_STATES = ("cartesianInvalidState", "sphericalInvalidState", _NO_COLOUR, _NO_LIGHT)
_NUMBERS = {
    **dict.fromkeys((*_CARTESIAN, *_SPHERICAL, _TIME), "d"),
    **dict.fromkeys((*_PIXELS, _RETURN), "q"),
    **dict.fromkeys(_STATES, "b"),
    _LIGHT: "f",
}
"""The numbers that each field is read as, but colours, in the letters of numpy."""
_TOPS = (1.0, 255.0, 65535.0)  # of colours that have no limits, the least that none is above counts
_UNBOUNDED = 2.0**32
_NEGLIGIBLE_M = 1e-6  # steps
_FULL_TURN = 2 * np.pi + 0.01  # of an azimuth; some count elevations, as zenith angles, up to half of it
_TYPICAL = 100_000  # points that tell how far they are


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
    is_coloured : (n,) bool, optional
        Which of them have a colour; None where all have.
    intensity : (n,) float32, optional
        On the instrument's scale, 0 where the file calls it invalid.
    returns : (n,) int64, optional
        Number of each among the returns of its pulse, from 0.
    times : (n,) float, optional
        When each was measured, seconds from the start of the scan.
    n_read, n_bad : int
        Points of the file that this stands for, and how many of them are not finite.
    """

    points: NDArray[Any]
    pixels: NDArray[np.int64]
    colour: ColourArray | None
    intensity: NDArray[np.float32] | None
    n_read: int
    n_bad: int
    is_coloured: BoolArray | None = None
    returns: NDArray[np.int64] | None = None
    times: FloatArray | None = None


@dataclass(slots=True)
class GridExtent:
    """What is seen of points that pass: their number, and the least and largest row and column."""

    n_kept: int = 0
    n_read: int = 0
    n_bad: int = 0
    low: NDArray[np.int64] = field(default_factory=lambda: np.full(2, _MOST_INDEX))
    high: NDArray[np.int64] = field(default_factory=lambda: np.zeros(2, np.int64))

    def see(self, chunk: PointChunk) -> None:
        """Count the points of a chunk that has pixels."""
        self.n_kept, self.n_read = self.n_kept + len(chunk.points), self.n_read + chunk.n_read
        self.n_bad += chunk.n_bad
        self.low = np.minimum(self.low, chunk.pixels.min(axis=1, initial=_MOST_INDEX))
        self.high = np.maximum(self.high, chunk.pixels.max(axis=1, initial=0))


def announced_size(header: Any) -> GridExtent:
    """Return rows and columns as the file's header tells them, none where it does not."""
    survey = GridExtent(header.point_count)
    if "indexBounds" in header.scan_fields:
        bounds = header["indexBounds"]
        names = [[f"{axis}{end}" for axis in ("row", "column")] for end in ("Minimum", "Maximum")]
        if all(bounds.isDefined(name) for pair in names for name in pair):
            low, high = ([int(bounds[name].value()) for name in pair] for pair in names)
            survey.low, survey.high = np.array(low), np.array(high)
    return survey


def point_chunks(file: Any, index: int, *, places_alone: bool = False) -> Iterator[PointChunk]:
    """Yield the points of scan `index` of an open pye57 file, at most `_CHUNK` of them at a time.

    With `places_alone` without colour and intensity, which is faster.

    Raises InputError: without coordinates, or angles that are no radians; what the library raises: damaged.
    """
    lib = import_extra("pye57", "e57").libe57
    header = file.get_header(index)
    if not header.point_count:
        return
    names = set(header.point_fields)
    has_colour = names.issuperset(_COLOURS) and not places_alone
    limits = _colour_limits(file, header, lib) if has_colour else np.zeros((2, 3))
    numbers = {name: letter for name, letter in _NUMBERS.items() if name in names}
    if places_alone:
        numbers = {
            name: letter
            for name, letter in numbers.items()
            if name not in (_LIGHT, _NO_LIGHT, _NO_COLOUR, _TIME)
        }
    if has_colour:
        numbers |= dict.fromkeys(_COLOURS, "B" if _are_bytes(header, lib, limits) else "d")
    kind = np.float32 if _is_single(header.points, [*numbers], lib) else np.float64
    for columns in _columns(file, header, lib, numbers):
        yield _valid(columns, limits, kind)


def times_of(header: Any, stamps: FloatArray) -> FloatArray | None:
    """Return the times (n,) of points, seconds, from those after the scan's start; None where all are one.

    ASTM E2807 counts `timeStamp` from `acquisitionStart`, GPS seconds, where a scan has that.
    """
    known = stamps[np.isfinite(stamps)]
    if not len(known) or np.ptp(known) == 0:
        return None
    start = header[_START]["dateTimeValue"].value() if _START in header.scan_fields else 0.0
    return np.asarray(stamps + float(start), dtype=np.float64)


def _columns(file: Any, header: Any, lib: Any, numbers: dict[str, str]) -> Iterator[dict[str, Any]]:
    """Some fields of at most `_CHUNK` points at a time, in the same memory, as the numbers that are given."""
    n_most = min(_CHUNK, header.point_count)
    held, buffers = (
        {name: np.empty(n_most, letter) for name, letter in numbers.items()},
        lib.VectorSourceDestBuffer(),
    )
    for name, column in held.items():
        buffers.append(lib.SourceDestBuffer(file.image_file, name, column, n_most, True, True))
    with closing(header.points.reader(buffers)) as reader:
        while n_read := reader.read():
            yield {name: column[:n_read] for name, column in held.items()}


def _colour_nodes(header: Any, lib: Any) -> list[Any]:
    record = lib.StructureNode(header.points.prototype())
    return [record[name] for name in _COLOURS]


def _are_bytes(header: Any, lib: Any, limits: FloatArray) -> bool:
    """Tell whether colours are whole numbers of 0..255 as they stand."""
    bounds = [_bounds(node, lib) for node in _colour_nodes(header, lib) if isinstance(node, lib.IntegerNode)]
    return (
        len(bounds) == 3 and np.min(bounds) >= 0 and np.max(bounds) <= 255 and np.array_equal(limits, _BYTES)
    )


def _bounds(node: Any, lib: Any) -> tuple[float, float]:
    """The least and the largest number of a field that its record admits."""
    if isinstance(node, lib.ScaledIntegerNode):
        return node.scaledMinimum(), node.scaledMaximum()
    return node.minimum(), node.maximum()


def _colour_limits(file: Any, header: Any, lib: Any) -> FloatArray:
    """Numbers (2, 3) that stand for black and for full red, green and blue.

    The file's colorLimits; else the fields' bounds, 0..255 for those within; else the largest number.
    """
    if "colorLimits" in header.scan_fields:
        stated, names = header["colorLimits"], [[f"{name}{end}" for name in _COLOURS] for end in _ENDS]
        if all(stated.isDefined(name) for pair in names for name in pair):
            limits = np.array([[stated[name].value() for name in pair] for pair in names], np.float64)
            if (limits[1] > limits[0]).all():
                return limits
    nodes = _colour_nodes(header, lib)
    limits = np.array([_bounds(node, lib) for node in nodes], np.float64).T
    if isinstance(nodes[0], lib.IntegerNode) and limits.min() >= 0 and limits.max() <= 255:
        return _BYTES
    if (np.ptp(limits, axis=0) < _UNBOUNDED).all() and (limits[1] > limits[0]).all():
        return limits
    numbers = dict.fromkeys(_COLOURS, "d")
    parts = _columns(file, header, lib, numbers)
    largest = max(float(np.nan_to_num([*part.values()], posinf=0.0).max()) for part in parts)
    return np.array([[0.0] * 3, [next((top for top in _TOPS if largest <= top), largest)] * 3])


def _as_bytes(colour: NDArray[Any], limits: FloatArray) -> ColourArray:
    """Colours (n, 3) as bytes: those of one byte as they are, others by the numbers of black and full."""
    if colour.dtype == np.uint8:
        return colour
    share = (np.nan_to_num(colour) - limits[0]) / (limits[1] - limits[0])
    return np.asarray(np.rint(255 * np.clip(share, 0.0, 1.0)), np.uint8)


def coordinate_step(header: Any, reach: FloatArray) -> float:
    """Return the step between coordinates that a scan's record admits, metres; 0 for double precision.

    Scaled integers (ASTM E2807-11, 8.3.8) count in their scale; so do spherical ones, whose angles' steps
    grow with the range. Single precision has the steps of its largest number.

    Parameters
    ----------
    header : Header
        Of the scan, as pye57 gives it.
    reach : (n,) or (rows, columns) float
        How far its points are from the scanner, metres, not finite where there is none.
    """
    lib = import_extra("pye57", "e57").libe57
    few = reach[:: -(-reach.size // _TYPICAL) or 1]  # of an image whole rows, so that few pages are read
    known = few[np.isfinite(few)]
    typical, largest = (float(pick(known)) if len(known) else 0.0 for pick in (np.median, np.max))
    record, names = lib.StructureNode(header.points.prototype()), set(header.point_fields)
    if "cartesianBounds" in header.scan_fields:
        stated = header["cartesianBounds"]
        bounds = [f"{axis}{end}" for axis in "xyz" for end in _ENDS]
        largest = max(abs(stated[name].value()) if stated.isDefined(name) else largest for name in bounds)
    parts = _CARTESIAN if _CARTESIAN[0] in names else _SPHERICAL
    steps = []
    for name in parts:
        node, is_angle = record[name], name in _SPHERICAL[1:]
        step = 0.0
        if isinstance(node, lib.ScaledIntegerNode):
            step = node.scale()
        elif isinstance(node, lib.IntegerNode):
            step = 1.0
        elif node.precision() == lib.E57_SINGLE:
            step = float(np.spacing(np.float32(np.pi if is_angle else largest)))
        steps.append(abs(step) * (typical if is_angle else 1.0))
    return max(steps) if max(steps) > _NEGLIGIBLE_M else 0.0


def _is_single(points: Any, names: list[str], lib: Any) -> bool:
    """Tell whether a file has its coordinates in single precision."""
    record = lib.StructureNode(points.prototype())
    nodes = [record[name] for name in names if name in _CARTESIAN]
    return bool(nodes) and all(
        isinstance(node, lib.FloatNode) and node.precision() == lib.E57_SINGLE for node in nodes
    )


def _valid(data: dict[str, Any], limits: FloatArray, kind: Any) -> PointChunk:
    """The valid points of some columns of numbers, which are copied."""
    points = _points(data)
    finite, kept = finite_points(points), (points[:, 0] != 0) | (points[:, 1] != 0) | (points[:, 2] != 0)
    kept &= finite
    state = data.get("cartesianInvalidState" if _CARTESIAN[0] in data else "sphericalInvalidState")
    if state is not None:
        kept &= state == 0
    grid = _PIXELS if all(name in data for name in _PIXELS) else ()
    colour = is_coloured = None
    if _COLOURS[0] in data:
        given = np.stack([data[name][kept] for name in _COLOURS], axis=-1)
        colour = _as_bytes(given, limits)
        if _NO_COLOUR in data or given.dtype != np.uint8:
            is_coloured = np.isfinite(given).all(axis=-1) & (
                data[_NO_COLOUR][kept] == 0 if _NO_COLOUR in data else True
            )
    intensity = data[_LIGHT][kept] if _LIGHT in data else None
    if intensity is not None and _NO_LIGHT in data:
        intensity[data[_NO_LIGHT][kept] != 0] = 0
    return PointChunk(
        points=points[kept].astype(kind),
        pixels=np.array([data[name][kept] for name in grid], np.int64).reshape(len(grid), kept.sum()),
        colour=colour,
        intensity=intensity,
        n_read=len(points),
        n_bad=int((~finite).sum()),
        is_coloured=is_coloured,
        returns=data[_RETURN][kept] if _RETURN in data else None,
        times=data[_TIME][kept] if _TIME in data else None,
    )


def _points(data: dict[str, Any]) -> FloatArray:
    """Points (n, 3) in the scanner's frame."""
    if _CARTESIAN[0] in data:
        return np.stack([data[name] for name in _CARTESIAN], axis=-1)
    if _SPHERICAL[0] in data:
        reach, azimuth, elevation = (data[name] for name in _SPHERICAL)
        known = reach > 0
        turns = [np.nan_to_num(abs(angle[known])).max(initial=0) for angle in (azimuth, elevation)]
        if turns[0] > _FULL_TURN or turns[1] > _FULL_TURN / 2:
            raise InputError(
                f"its azimuths reach {turns[0]:.4g} and its elevations {turns[1]:.4g}, which are no radians "
                "as E57 has them; export it with cartesian coordinates, or with angles in radians"
            )
        across = reach * np.cos(elevation)
        sides = [across * np.cos(azimuth), across * np.sin(azimuth), reach * np.sin(elevation)]
        return np.stack(sides, axis=-1)
    raise InputError("has neither cartesian nor spherical coordinates")


def read_pose(header: Any) -> tuple[Pose, tuple[str, ...]]:
    """Return world from scanner, the identity where the file has none, and what is doubtful about it."""
    if not header.has_pose():
        return Pose.identity(), ()
    node, doubts = header["pose"], tuple[str, ...]()
    rotation, translation = np.eye(3), np.zeros(3)
    if node.isDefined("rotation"):
        quaternion = np.array([node["rotation"][part].value() for part in "xyzw"], dtype=np.float64)
        rotation, doubts = stated_rotation(quaternion, "its pose")
    if node.isDefined("translation"):
        translation = np.array([node["translation"][part].value() for part in "xyz"], dtype=np.float64)
    return Pose.from_parts(rotation, translation), doubts
