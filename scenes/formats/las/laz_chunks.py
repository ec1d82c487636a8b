# SPDX-License-Identifier: MIT
"""LAZ chunks: what LASzip's record, its table of chunks and its layers announce, checked against the file."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO

from scenes.checks import InputError

_VLR = struct.Struct("<H16sHH32s")
_RECORD = struct.Struct("<HHBBHIIqqH")
_USER, _ID = b"laszip encoded", 22204
_CHUNKED, _LAYERED = 2, 3  # compressors; of the latter a chunk's streams are announced by their sizes
_N_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # of point, colour, colour with near infrared, wave packet
_EXTRA_BYTES = 14  # has a layer for each byte
_POINTS = {_CHUNKED: {6: 20}, _LAYERED: {10: 30}}  # bytes of the first item, by its kind
_MORE = {_CHUNKED: {7: 8, 8: 6, 9: 29, 0: None}, _LAYERED: {11: 6, 12: 8, 13: 29, _EXTRA_BYTES: None}}


@dataclass(frozen=True, slots=True)
class _Packing:
    """What LASzip's record says: how points are packed, and of which items each consists."""

    data: bytes
    compressor: int
    point_bytes: int
    n_layers: int


def check_chunks(lazrs: Any, file: BinaryIO, size: int, length: int, count: int) -> None:
    """Raise InputError where packed points announce more than the file can hold.

    Parameters
    ----------
    lazrs : module
        Knows the packed table of chunks.
    file : binary file
        A LAZ file whose header has been checked.
    size : int
        Its bytes.
    length, count : int
        Bytes of a point, and how many there are, by the header.
    """
    file.seek(94)
    header_size, offset, n_records = struct.unpack("<HII", file.read(10))
    packing = _packing(file, header_size, n_records, length)
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


def _packing(file: BinaryIO, start: int, n_records: int, length: int) -> _Packing:
    """Find and check LASzip's record."""
    records = _records(file, start, n_records)
    data = next((data for user, number, data in records if (user, number) == (_USER, _ID)), b"")
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
