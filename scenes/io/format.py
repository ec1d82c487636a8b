# SPDX-License-Identifier: MIT
"""A format of points and scans: its suffixes, and how its files are read and written."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, Protocol

from scenes.checks import InputError
from scenes.io.cloud import RawPoints, joined
from scenes.scan.colour import colour_bytes
from scenes.scan.range_image import RangeImage

Units = Literal["mm", "cm", "m", "in"]
Intrinsics = tuple[float, float, float, float]
ScanReader = Callable[[], RangeImage]
METRES_PER_UNIT = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254}


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
        Returns a reader for each scan of a file; intrinsics (pixels) go before the file's own.
    write : function of (sequence of RangeImage, Path)
        Writes scans; raises InputError for more than the format holds.
    is_text : bool
        Whether its files are lines of numbers, which may also be poses.
    unit : "mm", "cm", "m" or "in", optional
        Of its lengths, where the format fixes one: its readers give metres.
    marks_misses : bool
        Whether its files mark beams without return otherwise than by a number that is full.
    """

    suffixes: tuple[str, ...]
    name: str = ""
    points: Callable[[Path, int | None], RawPoints] | None = None
    scans: Callable[[Path, Intrinsics | None], Sequence[ScanReader]] | None = None
    write: Callable[[Sequence[RangeImage], Path], None] | None = None
    is_text: bool = False
    unit: Units | None = None
    marks_misses: bool = False


class ScanFile(Protocol):
    """An open file of several scans, counted from 0."""

    def __len__(self) -> int:
        """How many scans there are."""

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
    """Raise InputError where another than the first cloud of a file that holds one is asked for."""
    if number not in (None, 1):
        raise InputError(f"holds one cloud, so there is no #{number}")


def each_cloud(opened: Callable[[Path], ScanFile]) -> Callable[[Path, int | None], RawPoints]:
    """Return the `points` of a format whose files hold several scans."""

    def points(path: Path, number: int | None) -> RawPoints:
        file = opened(path)
        return joined([file.points(index) for index in picked(len(file), number)])

    return points


def picked(n_scans: int, number: int | None) -> Sequence[int]:
    """Return the indices, from 0, of all scans or of scan `number` from 1; raise InputError for no scan."""
    if number is not None and not 1 <= number <= n_scans:
        raise InputError(f"there is no #{number}: there are {n_scans} scans, counted from 1")
    return range(n_scans) if number is None else [number - 1]


def one_scan(read: Callable[[Path], RangeImage]) -> Callable[[Path, Intrinsics | None], list[ScanReader]]:
    """Return the `scans` of a format whose files hold one scan and know their camera."""
    return lambda path, _: [partial(read, path)]


def each_scan(opened: Callable[[Path], ScanFile]) -> Callable[[Path, Intrinsics | None], list[ScanReader]]:
    """Return the `scans` of a format whose files hold several."""

    def scans(path: Path, _: Intrinsics | None) -> list[ScanReader]:
        file = opened(path)
        return [partial(file.scan, index) for index in range(len(file))]

    return scans


def loaded(scans: Sequence[RangeImage]) -> list[ScanReader]:
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
    """Return all valid points of organised scans, in the world."""
    clouds = []
    for scan in scans:
        colour = None if scan.colour is None else colour_bytes(scan.colour[scan.valid])
        clouds.append(RawPoints(scan.points()[scan.valid], origins=scan.origin, colour=colour))
    return joined(clouds)
