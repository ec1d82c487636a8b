# SPDX-License-Identifier: MIT
"""Chunks of PCD files: the header, and the points, some at a time, of the Point Cloud Library's clouds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.io.guard import check_size
from scenes.io.limits import check_limit, check_unpacked
from scenes.run.mapping import allocate, release

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
