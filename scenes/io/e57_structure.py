# SPDX-License-Identifier: MIT
"""Structure of E57: header and XML held against the file before its library believes them.

The library expands whatever entities the XML defines and makes room for as many points as it announces.
ASTM E2807-11, sections 5 and 8: a file is pages of 1020 bytes and a checksum, its XML stands at an offset.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO, NoReturn
from xml.parsers import expat

from scenes.checks import InputError
from scenes.io.limits import check_limit, check_unpacked

_HEADER = struct.Struct("<8sIIQQQQ")
_PAGE, _CHECKSUM = 1024, 4
_DEEPEST = 64  # elements within each other; the standard's own are 8
_FIELD_BYTES = 8  # that each field of a point takes once it is read


def check_e57(path: Path) -> None:
    """Raise InputError where an E57 file announces more than it can hold, or its XML defines entities.

    Raises InputError: no E57, cut short, XML that is damaged, too large, too deep or with definitions of its
    own, more points or unpacked bytes than the limits allow.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(_HEADER.size)
        if len(start) < _HEADER.size or start[:8] != b"ASTM-E57":
            raise InputError("not an E57 file: it does not begin with ASTM-E57 and a header")
        _, _, _, length, offset, xml_length, page = _HEADER.unpack(start)
        if length != size or page != _PAGE:
            raise InputError(
                f"truncated or damaged E57: {length:,} bytes in pages of {page} announced, {size:,} present"
            )
        if offset >= size or xml_length > size:
            raise InputError(f"damaged E57: {xml_length:,} bytes of XML from byte {offset:,} of {size:,}")
        check_limit("json_bytes", xml_length, "bytes of its XML")
        xml = _logical(file, offset, xml_length)
    counts = _Counts()
    counts.read(xml)
    check_limit("points", sum(counts.points), "its points")
    check_unpacked(sum(counts.points) * counts.fields * _FIELD_BYTES, size, "it")


def _logical(file: BinaryIO, offset: int, length: int) -> bytes:
    """Return bytes from a physical offset on, the pages' checksums left out."""
    file.seek(offset)
    first = _PAGE - _CHECKSUM - offset % _PAGE
    if first <= 0:
        raise InputError(f"damaged E57: its XML begins within a checksum, at byte {offset:,}")
    n_pages = max(length - first, 0) // (_PAGE - _CHECKSUM) + 2
    raw = file.read(n_pages * _PAGE)
    parts = [raw[:first]]
    parts += [raw[at : at + _PAGE - _CHECKSUM] for at in range(first + _CHECKSUM, len(raw), _PAGE)]
    xml = b"".join(parts)[:length]
    if len(xml) < length:
        raise InputError(f"truncated E57: {length:,} bytes of XML announced, {len(xml):,} present")
    return xml


class _Counts:
    """Points of each scan, and fields of a point, as the XML announces them."""

    def __init__(self) -> None:
        self.points: list[int] = []
        self.fields = 1
        self._open: list[str] = []
        self._fields_here = 0

    def read(self, xml: bytes) -> None:
        parser = expat.ParserCreate()
        parser.StartElementHandler, parser.EndElementHandler = self._begin, self._end
        parser.StartDoctypeDeclHandler = _refuse
        try:
            parser.Parse(xml, True)
        except expat.ExpatError as error:
            raise InputError(f"its XML is damaged: {error}") from error

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        if self._open[-1:] == ["prototype"]:
            self._fields_here += 1
        self._open.append(name)
        if len(self._open) > _DEEPEST:
            raise InputError(f"its XML is nested more than {_DEEPEST} deep")
        if name == "points":
            self._fields_here = 0
            text = attributes.get("recordCount", "0")
            if not (text.isascii() and text.isdigit() and len(text) < 19):
                raise InputError(f"announces {text[:40]!r} points")
            self.points.append(int(text))
            check_limit("entries", len(self.points), "its scans")

    def _end(self, name: str) -> None:
        self._open.pop()
        if name == "points":
            self.fields = max(self.fields, self._fields_here)


def _refuse(*_: object) -> NoReturn:
    raise InputError("its XML has definitions of its own (DOCTYPE), which E57 does not know")
