# SPDX-License-Identifier: MIT
"""OpenEXR images of one part in lines, unpacked or packed by ZIP: the channel that holds depth.

Layout and packing are those of the "OpenEXR File Layout" (openexr.com) and of its library's `ImfZip.cpp`.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.io.checks.guard import check_file, check_size
from scenes.io.checks.limits import check_unpacked

_MAGIC, _NOT_PLAIN = 20000630, 0x200 | 0x800 | 0x1000  # tiles, deep data, several parts
_PACKINGS = ("none", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
_LINES = {"none": 1, "ZIPS": 1, "ZIP": 16}  # lines of a block
_KINDS = ("<u4", "<f2", "<f4")
_DEPTH_NAMES = ("Z", "DEPTH", "Y", "V", "R")


def read_exr(path: Path) -> NDArray[Any]:
    """Return the depth (rows, columns) that an OpenEXR file holds, as it stands there.

    It is the channel Z, depth, Y, V or R, or the only one.

    Raises InputError: damaged, tiled, of several parts, of another packing, or without such a channel.
    """
    data = check_file(path).read_bytes()
    magic, version = struct.unpack_from("<ii", data)
    if magic != _MAGIC:
        raise InputError("is no OpenEXR image")
    if version & _NOT_PLAIN:
        raise InputError("is an OpenEXR image in tiles, of several parts or deep; save it in plain lines")
    header, start = _header(data)
    packing = _PACKINGS[header["compression"][0]]
    if packing not in _LINES:
        raise InputError(f"is an OpenEXR image packed by {packing}; save it packed by ZIP, or unpacked")
    left, top, right, bottom = struct.unpack("<4i", header["dataWindow"])
    height, width = bottom - top + 1, right - left + 1
    check_size(height, width)
    channels = _channels(header["channels"])
    n_bytes = width * sum(np.dtype(kind).itemsize for _, kind in channels)
    check_unpacked(height * n_bytes, len(data), "the image")
    rows, lines = np.zeros((height, n_bytes), np.uint8), _LINES[packing]
    for offset in struct.unpack_from(f"<{-(-height // lines)}Q", data, start):
        line, size = struct.unpack_from("<ii", data, offset)
        block = rows[line - top : line - top + lines]
        block[:] = _unpacked(data[offset + 8 : offset + 8 + size], block.size).reshape(block.shape)
    return _depth(rows, channels, width)


def _header(data: bytes) -> tuple[dict[str, bytes], int]:
    """The attributes by name, and where the table of offsets begins."""
    values, at = {}, 8
    while data[at]:
        end = data.index(b"\0", data.index(b"\0", at) + 1)  # of name and kind
        (size,) = struct.unpack_from("<I", data, end + 1)
        values[data[at : data.index(b"\0", at)].decode("latin-1")] = data[end + 5 : end + 5 + size]
        at = end + 5 + size
    return values, at + 1


def _channels(data: bytes) -> list[tuple[str, str]]:
    """Name and kind of each channel, in the order in which a line holds them."""
    channels, at = [], 0
    while data[at]:
        end = data.index(b"\0", at)
        kind, _, across, down = struct.unpack_from("<4i", data, end + 1)
        if (across, down) != (1, 1):
            raise InputError("has channels of different resolution; save it with one value per pixel")
        channels.append((data[at:end].decode("latin-1"), _KINDS[kind]))
        at = end + 17
    return channels


def _unpacked(data: bytes, size: int) -> NDArray[np.uint8]:
    """The bytes of a block: packed ones are differences from 128, the odd bytes behind the even ones."""
    if len(data) == size:  # as it is also where packing would not have helped
        return np.frombuffer(data, np.uint8)
    packed = np.frombuffer(zlib.decompressobj().decompress(data, size), np.uint8)
    if len(packed) != size:
        raise InputError(f"truncated: a block has {len(packed)} bytes instead of {size}")
    steps = packed.astype(np.int64)
    steps[1:] -= 128
    plain, half = np.cumsum(steps).astype(np.uint8), (size + 1) // 2
    mixed = np.empty(size, np.uint8)
    mixed[0::2], mixed[1::2] = plain[:half], plain[half:]
    return mixed


def _depth(rows: NDArray[np.uint8], channels: Sequence[tuple[str, str]], width: int) -> NDArray[Any]:
    names = [name.rpartition(".")[2].upper() for name, _ in channels]
    picked = next((name for name in _DEPTH_NAMES if name in names), names[0] if len(names) == 1 else None)
    if picked is None:
        raise InputError(f"has the channels {', '.join(names)}; depth is expected as Z, depth, Y, V or R")
    at = names.index(picked)
    before = width * sum(np.dtype(kind).itemsize for _, kind in channels[:at])
    kind = np.dtype(channels[at][1])
    return np.ascontiguousarray(rows[:, before : before + width * kind.itemsize]).view(kind)
