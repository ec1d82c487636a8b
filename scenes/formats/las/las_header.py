# SPDX-License-Identifier: MIT
"""LAS header: counts and offsets checked against the file before a decoder believes them and allocates."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import BinaryIO

from scenes.checks import InputError
from scenes.formats.guard import import_extra
from scenes.formats.las.laz_chunks import check_chunks
from scenes.run.file_limits import check_limit, check_unpacked

_START = 375  # bytes of the longest header, LAS 1.4
_EXTENDED_LENGTH = 20  # where an extended record tells its length
_VLR, _EVLR, _CHUNK = 54, 60, 2  # least bytes of a record, an extended one, a packed chunk's entry and data
_PACKED = 0xC0  # bits of the point format that say the points are compressed


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
        if offset > size or n_records * _VLR > offset:
            raise InputError(f"damaged: {n_records} records before points at byte {offset} of {size}")
        if n_extended and (first_extended > size or n_extended * _EVLR > size):
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
        start += _EVLR + length
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
    if n_chunks * _CHUNK > size:
        raise InputError(f"damaged: {n_chunks} chunks announced in {size} bytes")
