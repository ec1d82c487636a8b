# SPDX-License-Identifier: MIT
"""LAS headers, records and tables of chunks, checked before a decoder believes them; its messages muted."""

from __future__ import annotations

import math
import os
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO

from scenes.checks import InputError
from scenes.io.checks.limits import check_limit, check_unpacked
from scenes.run.libraries import import_extra

_ONE_AT_A_TIME = Lock()  # the descriptor is the whole process's


@contextmanager
def libraries_muted() -> Iterator[None]:
    """Drop what is written to file descriptor 2; what it says, the caller raises as an error of one line.

    Rust prints a panic and its trace there before Python hears of it.
    """
    with _ONE_AT_A_TIME:
        with suppress(OSError, ValueError):  # there may be none
            sys.stderr.flush()
        try:
            kept = os.dup(2)
        except OSError:
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(nowhere)
            os.close(kept)


_START = 375  # bytes of the longest header, LAS 1.4
_EXTENDED_LENGTH = 20  # where an extended record tells its length
_LEAST_VLR, _LEAST_EVLR = 54, 60  # least bytes of a record, and of an extended one
_LEAST_CHUNK = 2  # least bytes of a packed chunk's entry and data
_PACKED = 0xC0  # bits of the point format that say the points are compressed
_VLR = struct.Struct("<H16sHH32s")
_RECORD = struct.Struct("<HHBBHIIqqH")
_LASZIP_USER, _ID = b"laszip encoded", 22204
_CHUNKED, _LAYERED = 2, 3  # compressors; of the latter a chunk's streams are announced by their sizes
_N_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # of point, colour, colour with near infrared, wave packet
_EXTRA_BYTES = 14  # has a layer for each byte
_POINTS = {_CHUNKED: {6: 20}, _LAYERED: {10: 30}}  # bytes of the first item, by its kind
_MORE = {_CHUNKED: {7: 8, 8: 6, 9: 29, 0: None}, _LAYERED: {11: 6, 12: 8, 13: 29, _EXTRA_BYTES: None}}


def check_las(path: Path) -> None:
    """Raise InputError where a LAS or LAZ file announces more than it can hold.

    Decoders allocate what the header says; some end the process when that fails.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(_START)
        if len(start) < 227 or start[:4] != b"LASF":
            raise InputError("not a LAS file: it does not begin with LASF and a header")
        offset, n_records = struct.unpack_from("<II", start, 96)
        point_format, length, count = struct.unpack_from("<BHI", start, 104)
        _check_steps(struct.unpack_from("<6d", start, 131))
        n_extended = first_extended = 0
        if start[25] >= 4 and len(start) >= 255:
            first_extended, n_extended, count = struct.unpack_from("<QIQ", start, 235)
        if offset > size or n_records * _LEAST_VLR > offset:
            raise InputError(f"damaged: {n_records} records before points at byte {offset} of {size}")
        if n_extended and (first_extended > size or n_extended * _LEAST_EVLR > size):
            raise InputError(f"damaged: {n_extended} records from byte {first_extended} of {size}")
        _check_extended(file, first_extended, n_extended, size)
        is_packed, unpacked = bool(point_format & _PACKED), count * length
        if is_packed:
            file.seek(offset)
            _check_chunks(file, size)
            check_chunks(import_extra("lazrs", "las"), file, size, length, count)
    if not is_packed and unpacked > size - offset:
        raise InputError(f"truncated: {count:,} points of {length} bytes announced, {size} bytes present")
    check_limit("points", count, "its points")
    check_unpacked(unpacked, size, "it")


def _check_steps(numbers: tuple[float, ...]) -> None:
    """Look at the steps in which coordinates are counted, and at where they are counted from."""
    if not all(map(math.isfinite, numbers)) or 0.0 in numbers[:3]:
        raise InputError(f"damaged: its coordinates count in steps of {numbers[:3]} from {numbers[3:]}")


def _check_extended(file: BinaryIO, start: int, n_records: int, size: int) -> None:
    """Look at the lengths of the records behind the points."""
    for number in range(1, n_records + 1):
        file.seek(start + _EXTENDED_LENGTH)
        length = int.from_bytes(file.read(8), "little")
        start += _LEAST_EVLR + length
        if start > size:
            raise InputError(f"truncated: extended record {number} ends at byte {start:,} of {size}")


def _check_chunks(file: BinaryIO, size: int) -> None:
    """Look at the table of packed chunks, whose place stands before the points."""
    pointer = file.read(8)
    if len(pointer) < 8:
        raise InputError("truncated: there are no packed points")
    (where,) = struct.unpack("<q", pointer)
    if where == -1:  # written without seeking: the place stands at the end
        file.seek(size - 8)
        (where,) = struct.unpack("<q", file.read(8))
    if not 0 <= where <= size - 8:
        raise InputError(f"damaged: its table of chunks is at byte {where} of {size}")
    file.seek(where)
    _, n_chunks = struct.unpack("<II", file.read(8))
    if n_chunks * _LEAST_CHUNK > size:
        raise InputError(f"damaged: {n_chunks} chunks announced in {size} bytes")


@dataclass(frozen=True, slots=True)
class _Packing:
    """What LASzip's record says: how points are packed, and of which items each consists."""

    data: bytes
    compressor: int
    point_bytes: int
    n_layers: int


def check_chunks(lazrs: Any, file: BinaryIO, size: int, length: int, count: int) -> None:
    """Raise InputError where packed points announce more than the file can hold.

    The header of the file of `size` bytes has been checked, and says that there are `count` points of
    `length` bytes; the module `lazrs` knows the packed table of chunks.
    """
    file.seek(94)
    header_size, offset, n_records = struct.unpack("<HII", file.read(10))
    packing = _laszip_record(file, header_size, n_records, length)
    file.seek(offset)
    chunks = lazrs.read_chunk_table(file, lazrs.LazVlr(packing.data))
    start = offset + 8
    if start + sum(n_bytes for _, n_bytes in chunks) > size:
        raise InputError(f"truncated: its chunks take more than the {size - start} bytes that are present")
    if sum(n_points for n_points, _ in chunks) < count:
        raise InputError(f"truncated: {count:,} points announced, its {len(chunks)} chunks hold less")
    for _, n_bytes in chunks if packing.compressor == _LAYERED else ():
        _check_layers(file, start, n_bytes, packing)
        start += n_bytes


def _laszip_record(file: BinaryIO, start: int, n_records: int, length: int) -> _Packing:
    """Find and check LASzip's record."""
    records = _records(file, start, n_records)
    data = next((data for user, number, data in records if (user, number) == (_LASZIP_USER, _ID)), b"")
    if len(data) < _RECORD.size:
        raise InputError("damaged: there is no record that says how its points are packed")
    compressor, *_, n_items = _RECORD.unpack_from(data)
    if compressor not in (_CHUNKED, _LAYERED):
        raise InputError(f"its points are packed in way {compressor}; 2 and 3, in chunks, are known")
    if n_items < 1 or len(data) < _RECORD.size + 6 * n_items:
        raise InputError(
            f"damaged: its points are packed as {n_items} items in a record of {len(data)} bytes"
        )
    items = [struct.unpack_from("<HHH", data, _RECORD.size + 6 * k) for k in range(n_items)]
    point_bytes = sum(n_bytes for _, n_bytes, _ in items)
    if point_bytes != length or not _are_known(items, compressor):
        raise InputError(f"damaged: a point has {length} bytes, its packed items {items} have {point_bytes}")
    n_layers = sum(n_bytes if kind == _EXTRA_BYTES else _N_LAYERS.get(kind, 0) for kind, n_bytes, _ in items)
    return _Packing(data, compressor, point_bytes, n_layers)


def _are_known(items: list[tuple[int, int, int]], compressor: int) -> bool:
    """Tell whether these are a point and what may follow it, each of its own length and no kind twice."""
    kinds = [kind for kind, *_ in items]
    known: dict[int, int | None] = {**_POINTS[compressor], **_MORE[compressor]}
    lengths = all(kind in known and known[kind] in (None, n_bytes) for kind, n_bytes, _ in items)
    return lengths and kinds[0] in _POINTS[compressor] and len(set(kinds)) == len(kinds)


def _records(file: BinaryIO, start: int, n_records: int) -> Iterator[tuple[bytes, int, bytes]]:
    """User, number and data of every record before the points."""
    file.seek(start)
    for _ in range(n_records):
        head = file.read(_VLR.size)
        if len(head) < _VLR.size:
            return
        _, user, number, n_bytes, _ = _VLR.unpack(head)
        yield user.rstrip(b"\0"), number, file.read(n_bytes)


def _check_layers(file: BinaryIO, start: int, n_bytes: int, packing: _Packing) -> None:
    """Look at the sizes of a chunk's layers, which stand behind its first point and its number of points."""
    head = packing.point_bytes + 4 + 4 * packing.n_layers
    file.seek(start + packing.point_bytes + 4)
    sizes = struct.unpack(f"<{packing.n_layers}I", file.read(4 * packing.n_layers)) if head <= n_bytes else ()
    if head > n_bytes or head + sum(sizes) > n_bytes:
        raise InputError(f"damaged: layers of {sum(sizes):,} bytes in a chunk of {n_bytes:,}")
