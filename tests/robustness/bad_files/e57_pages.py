# SPDX-License-Identifier: MIT
"""Pages of E57: the XML of a sound file changed, its checksums and lengths put right again."""

from __future__ import annotations

import struct
from collections.abc import Callable

_TABLE = []
for _byte in range(256):
    _value = _byte
    for _ in range(8):
        _value = (_value >> 1) ^ (0x82F63B78 if _value & 1 else 0)
    _TABLE.append(_value)


def crc32c(data: bytes) -> int:
    """The checksum of a page (Castagnoli)."""
    value = 0xFFFFFFFF
    for byte in data:
        value = _TABLE[(value ^ byte) & 255] ^ (value >> 8)
    return value ^ 0xFFFFFFFF


def with_xml(data: bytes, change: Callable[[bytes], bytes], page: int, checksum: int) -> bytes:
    """Return the file with its XML, which stands last, changed."""
    body = page - checksum
    logical = b"".join(data[at : at + body] for at in range(0, len(data), page))
    offset, length = struct.unpack_from("<QQ", data, 24)
    start = offset // page * body + offset % page
    xml = change(logical[start : start + length])
    held = logical[:start] + xml
    held += b"\0" * (-len(held) % body)
    size = len(held) // body * page
    held = held[:16] + struct.pack("<QQQ", size, offset, len(xml)) + held[40:]
    pages = (held[at : at + body] for at in range(0, len(held), body))
    return b"".join(one + struct.pack(">I", crc32c(one)) for one in pages)
