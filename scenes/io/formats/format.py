# SPDX-License-Identifier: MIT
"""Formats of points and scans: suffixes, readers and writers, clouds as files hold them, and their registry.

A new format is a module with a `FORMAT`, and its name in `_MODULES`. Messages, the lists of known suffixes
and the command line's texts follow from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from scenes.checks import ArrayValue, ColourArray, FloatArray, InputError
from scenes.io.formats.crs import LengthUnit
from scenes.io.formats.facts import FormatFacts
from scenes.limits import FINE_M
from scenes.scan.colour import colour_bytes
from scenes.scan.doubts import merge_warnings
from scenes.scan.range_image import RangeImage

NO_RAYS = (
    "holds points without a pixel grid or sensor position, so no ray can be traced; say where the scanner "
    "stood (--origin X,Y,Z) or moved (--trajectory FILE), or export the scan as structured .e57, .ptx, or "
    "organised .pcd"
)


@dataclass(frozen=True, slots=True, eq=False)
class RawPoints(ArrayValue):
    """Points as a file holds them.

    Attributes
    ----------
    points : (n, 3) float
        In the world, NaN where the file says so.
    normals : (n, 3) float, optional
        As in the file.
    origins : (3,) or (n, 3) float, optional
        Where the scanner stood, once or for each point; None where the file does not tell.
    colour : (n, 3) uint8, optional
        sRGB.
    warnings : tuple of str
        What was left out or assumed.
    label : (n,) float, optional
        What the file calls the surface of each point, as in the file.
    unit : LengthUnit, optional
        What the file states of its coordinates.
    step : float
        Between the values that coordinates can take, in the file's unit; 0 where they are not rounded.
    times : (n,) float, optional
        When each point was measured, seconds on the file's own clock.
    """

    points: FloatArray
    normals: FloatArray | None = None
    origins: FloatArray | None = None
    colour: ColourArray | None = None
    warnings: tuple[str, ...] = ()
    label: FloatArray | None = None
    unit: LengthUnit | None = None
    step: float = 0.0
    times: FloatArray | None = None


def join_points(parts: Sequence[RawPoints]) -> RawPoints:
    """Return the points of several scans one after the other; what not all of them know is left out."""
    if len(parts) == 1:
        return parts[0]
    points = np.concatenate([np.zeros((0, 3)), *(part.points for part in parts)])
    stood = [np.broadcast_to(part.origins, part.points.shape) for part in parts if part.origins is not None]
    colour = [part.colour for part in parts if part.colour is not None]
    times = [part.times for part in parts if part.times is not None]
    return RawPoints(
        points,
        None,
        np.concatenate(stood) if stood and len(stood) == len(parts) else None,
        np.concatenate(colour) if colour and len(colour) == len(parts) else None,
        tuple(merge_warnings([(f"scan {k}", part.warnings) for k, part in enumerate(parts, start=1)])),
        times=np.concatenate(times) if times and len(times) == len(parts) else None,
        step=max((part.step for part in parts), default=0.0),
    )


def step_warnings(step_m: float) -> tuple[str, ...]:
    """Return a sentence where coordinates are rounded more coarsely than scanners measure."""
    if step_m <= FINE_M:
        return ()
    return (
        f"coordinates are rounded to steps of {1000 * step_m:.3g} mm, an error that all points of a plane "
        "share; export more decimals for narrower intervals",
    )


Units = Literal["mm", "cm", "m", "in", "ft", "us-ft"]
Intrinsics = tuple[float, float, float, float]
ScanReader = Callable[[], RangeImage]
METRES_PER_UNIT = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254, "ft": 0.3048, "us-ft": 1200 / 3937}


def check_own_unit(path: Path, kind: str, unit: Units, given: Units) -> None:
    """Raise InputError where another unit is given than the one that a format fixes; metres is none given."""
    if given not in ("m", unit):
        raise InputError(f"{path}: {kind} is in {unit} by its format; leave out --units")


def check_units(units: Units) -> float:
    """Return the metres of a unit.

    Raises InputError: an unknown one.
    """
    if units not in METRES_PER_UNIT:
        raise InputError(f"unknown units {units!r}; known: {', '.join(METRES_PER_UNIT)}")
    return METRES_PER_UNIT[units]


def metres_of(unit: LengthUnit | None, units: Units) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the metres (3,) of a unit along x, y, z, the file's own before `units`, and what to tell."""
    given = np.full(3, METRES_PER_UNIT[units])
    if unit is None or (unit.metres and np.allclose(unit.metres, given, rtol=1e-7, atol=0.0)):
        return given, ()
    if unit.metres:
        ignored = "" if units == "m" else f"; --units {units} was not applied"
        text = f"the file states its unit, {unit.name}: converted to metres{ignored}"
        return np.array(unit.metres), (text,)
    if units != "m":
        return given, ()
    return given, (
        f"the file names {unit.name} without the length of its unit: read as metres; if it is in feet give "
        "--units us-ft or ft",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """A format of files; what it does not offer is None.

    Attributes
    ----------
    name : str
        What `unseen info` calls it; the suffix itself where it is empty.
    suffixes : tuple of str
        Lower case, each with its dot.
    points : function of (Path, int or None)
        Returns the points of a file, or of its k-th scan, from 1.
    scans : function of (Path, Intrinsics or None)
        Returns a reader for each scan of a file, None for one without points; intrinsics (pixels) go before
        the file's own.
    write : function of (sequence of RangeImage, Path)
        Writes scans, asking for one after the other; raises InputError for more than the format holds.
    several : bool
        Whether its files hold several scans.
    is_text : bool
        Whether its files are lines of numbers, which may also be poses.
    unit : str, optional
        Of its lengths, where the format fixes one: its readers give metres.
    marks_misses : bool
        Whether its files mark beams without return otherwise than by a number that is full.
    refusal : str
        Why files of a known format are not read, and the cure.
    is_local : bool
        Whether its coordinates are about the instrument, so that poses are those of the file's own axes.
    all_returns : bool
        Whether its files hold all returns of a beam; others hold the first.
    facts : FormatFacts, optional
        Its row of docs/format-table.md; None of formats that are refused.
    """

    suffixes: tuple[str, ...]
    name: str = ""
    points: Callable[[Path, int | None], RawPoints] | None = None
    scans: Callable[[Path, Intrinsics | None], Sequence[ScanReader | None]] | None = None
    write: Callable[[Sequence[RangeImage], Path], None] | None = None
    several: bool = False
    is_text: bool = False
    unit: Units | None = None
    marks_misses: bool = False
    refusal: str = ""
    is_local: bool = False
    all_returns: bool = False
    facts: FormatFacts | None = None


class ScanFile(Protocol):
    """An open file of several scans, counted from 0."""

    def __len__(self) -> int:
        """How many scans there are."""

    def is_empty(self, index: int) -> bool:
        """Tell whether a scan has no points at all."""

    def scan(self, index: int) -> RangeImage:
        """Return a scan."""

    def points(self, index: int) -> RawPoints:
        """Return the valid points of a scan in the world, whether or not it has a pixel grid."""


def one_cloud(read: Callable[[Path], RawPoints]) -> Callable[[Path, int | None], RawPoints]:
    """Return the `points` of a format whose files hold one cloud."""

    def points(path: Path, number: int | None) -> RawPoints:
        check_single(number)
        return read(path)

    return points


def check_single(number: int | None) -> None:
    """Raise InputError unless `number` is None or 1: the file holds a single cloud."""
    if number not in (None, 1):
        raise InputError(f"holds one cloud, so there is no #{number}")


def each_cloud(opened: Callable[[Path], ScanFile]) -> Callable[[Path, int | None], RawPoints]:
    """Return the `points` of a format whose files hold several scans."""

    def points(path: Path, number: int | None) -> RawPoints:
        file = opened(path)
        picked = pick_indices(len(file), number)
        empty = [index for index in picked if file.is_empty(index)]
        cloud = join_points([file.points(index) for index in picked if index not in empty])
        left_out = empty_warnings([index + 1 for index in empty], len(file))
        return replace(cloud, warnings=(*left_out, *cloud.warnings))

    return points


def empty_warnings(empty: Sequence[int], n_scans: int) -> tuple[str, ...]:
    """Return a warning which scans of a file, by numbers from 1, have no points, nothing where all have."""
    if not empty:
        return ()
    if len(empty) == 1:
        return (f"scan {empty[0]} of {n_scans} in the file has no points and was left out",)
    which = ", ".join(map(str, empty))
    return (f"scans {which} of {n_scans} in the file have no points and were left out",)


def pick_indices(n_scans: int, number: int | None) -> Sequence[int]:
    """Return the indices, from 0, of all scans or of scan `number` from 1; raise InputError for no scan."""
    if number is not None and not 1 <= number <= n_scans:
        raise InputError(f"there is no #{number}: there are {n_scans} scans, counted from 1")
    return range(n_scans) if number is None else [number - 1]


def one_scan(read: Callable[[Path], RangeImage]) -> Callable[[Path, Intrinsics | None], list[ScanReader]]:
    """Return the `scans` of a format whose files hold one scan and know their camera."""
    return lambda path, _: [partial(read, path)]


def each_scan(
    opened: Callable[[Path], ScanFile],
) -> Callable[[Path, Intrinsics | None], list[ScanReader | None]]:
    """Return the `scans` of a format whose files hold several."""

    def scans(path: Path, _: Intrinsics | None) -> list[ScanReader | None]:
        file = opened(path)
        return [None if file.is_empty(k) else partial(file.scan, k) for k in range(len(file))]

    return scans


def readers_of(scans: Sequence[RangeImage]) -> list[ScanReader]:
    """Return readers of scans that are in memory."""

    def readers() -> Iterator[ScanReader]:
        for scan in scans:
            yield lambda scan=scan: scan  # type: ignore[misc]  # defaults have no type

    return list(readers())


def write_single(write: Callable[[RangeImage, Path], None]) -> Callable[[Sequence[RangeImage], Path], None]:
    """Return the `write` of a format whose files hold one scan."""

    def write_first(scans: Sequence[RangeImage], path: Path) -> None:
        if len(scans) != 1:
            raise InputError(f"{path}: holds one scan, not {len(scans)}; write an .e57 file or a folder")
        write(scans[0], path)

    return write_first


def points_of(scans: Sequence[RangeImage]) -> RawPoints:
    """Return all valid points of organised scans, in the world, those of further returns last."""
    clouds = []
    for scan in scans:
        pixel = np.flatnonzero(scan.valid)
        if scan.echoes is not None:
            pixel = np.concatenate([pixel, scan.echoes.pixel])
        colour = None if scan.colour is None else colour_bytes(scan.colour.reshape(-1, 3)[pixel])
        points = np.concatenate([scan.points()[scan.valid], scan.echo_points()])
        clouds.append(RawPoints(points, origins=scan.origin, colour=colour, step=scan.step_m))
    return join_points(clouds)


_MODULES = (
    *(f"clouds.{name}" for name in ("npz", "ply_scan", "pcd", "ptx", "e57_writer", "uos", "las", "sweep")),
    *("clouds.vtk", "clouds.text", "rgbd.layouts"),
)


@cache
def formats() -> tuple[Format, ...]:
    """Return all formats, in the order in which messages name them."""
    held: list[Format] = []
    for module in _MODULES:
        value = import_module(f"scenes.io.{module}").FORMAT
        held += value if isinstance(value, tuple) else (value,)
    return (*held, *(_offered(point) for point in entry_points(group="unseen.readers")))


def _offered(point: EntryPoint) -> Format:
    """A format that another package reads, named by suffix: a function from a path to a scan or several."""

    def read(path: Path) -> list[RangeImage]:
        scans = point.load()(path)
        return [scans] if isinstance(scans, RangeImage) else list(scans)

    return Format(
        suffixes=(f".{point.name.lower()}",),
        points=lambda path, number: points_of(read(path)[slice(number and number - 1, number)]),
        scans=lambda path, _: [partial(RangeImage.with_facts, scan) for scan in read(path)],
        several=True,
        marks_misses=True,
    )


def format_of(suffix: str) -> Format | None:
    """Return the format of a suffix, in lower or upper case, None where there is none."""
    return next((known for known in formats() if suffix.lower() in known.suffixes), None)


def point_suffixes() -> tuple[str, ...]:
    """Return the suffixes of files whose points can be read."""
    return tuple(suffix for known in formats() if known.points for suffix in known.suffixes)


def scan_suffixes() -> tuple[str, ...]:
    """Return the suffixes of files that may hold scans."""
    return tuple(suffix for known in formats() if known.scans for suffix in known.suffixes)


def written_suffixes() -> tuple[str, ...]:
    """Return the suffixes of files that scans can be written to."""
    return tuple(suffix for known in formats() if known.write for suffix in known.suffixes)


def all_return_suffixes() -> tuple[str, ...]:
    """Return the suffixes of files that hold all returns of a beam."""
    return tuple(suffix for known in formats() if known.all_returns for suffix in known.suffixes)


def text_suffixes() -> tuple[str, ...]:
    """Return the suffixes of text that may hold points."""
    return tuple(suffix for known in formats() if known.is_text for suffix in known.suffixes)
