# SPDX-License-Identifier: MIT
"""E57 files taken apart and put together: pages with checksums, and the XML that describes the rest."""

from __future__ import annotations

import re
from random import Random

import numpy as np

from tests.robustness.fuzzing.bytewise import mutate_bytes, mutate_in_place
from tests.robustness.fuzzing.jsonwise import mutate_json_within
from tests.robustness.fuzzing.textwise import mutate_text, set_number

_PAGE, _CHECKED = 1024, 1020
_POLYNOMIAL = 0x82F63B78  # CRC-32C, reflected
_HEADER = 48


def _table() -> np.ndarray:
    """What byte value v at position k of a page adds to the checksum, which is linear: (1020, 256) uint32."""
    step = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        step = np.where(step & 1, (step >> 1) ^ np.uint32(_POLYNOMIAL), step >> 1)
    table = np.empty((_CHECKED, 256), np.uint32)
    table[-1] = step
    for k in range(_CHECKED - 2, -1, -1):
        table[k] = (table[k + 1] >> 8) ^ step[table[k + 1] & 255]
    return table


_TABLE = _table()
_PLACES = np.arange(_CHECKED)


def _start() -> int:
    """The checksum of a page of zeros: what the initial value becomes."""
    step, value = _TABLE[-1], 0xFFFFFFFF
    for _ in range(_CHECKED):
        value = (value >> 8) ^ int(step[value & 255])
    return value


_START = _start()


def checksum(page: bytes) -> int:
    """Return the CRC-32C of 1020 bytes."""
    values = np.frombuffer(page, np.uint8)
    return int(np.bitwise_xor.reduce(_TABLE[_PLACES, values])) ^ _START ^ 0xFFFFFFFF


def payload(data: bytes) -> bytes:
    """Return the bytes of a file without its checksums."""
    return b"".join(data[k : k + _CHECKED] for k in range(0, len(data), _PAGE))


def paged(logical: bytes) -> bytes:
    """Return a file of these bytes, filled up to whole pages, with right checksums."""
    logical += b"\0" * (-len(logical) % _CHECKED)
    pages = [logical[k : k + _CHECKED] for k in range(0, len(logical), _CHECKED)]
    return b"".join(page + checksum(page).to_bytes(4, "big") for page in pages)


def _physical(logical: int) -> int:
    return logical // _CHECKED * _PAGE + logical % _CHECKED


def _logical(physical: int) -> int:
    return physical // _PAGE * _CHECKED + min(physical % _PAGE, _CHECKED)


def with_xml(logical: bytes, change: object) -> bytes:
    """Return the file with its XML, which stands at its end, changed by a function; header made right."""
    start = _logical(int.from_bytes(logical[24:32], "little"))
    length = int.from_bytes(logical[32:40], "little")
    xml = change(logical[start : start + length])  # type: ignore[operator]
    body = logical[:start] + xml
    size = -(-len(body) // _CHECKED) * _PAGE
    head = body[:16] + size.to_bytes(8, "little") + body[24:32] + len(xml).to_bytes(8, "little") + body[40:]
    return paged(head)


def mutate_e57(data: bytes, rng: Random) -> bytes:
    """Change the XML, the binary sections or the header of an E57 file whose checksums then are right."""
    logical = payload(data)
    if len(logical) < _HEADER + 16:
        return mutate_bytes(data, rng)
    kind = rng.random()
    if kind < 0.6:
        try:
            return with_xml(logical, lambda xml: _mutate_xml(xml, rng))
        except Exception:
            return paged(mutate_in_place(logical, rng))
    xml_start = min(_logical(int.from_bytes(logical[24:32], "little")), len(logical) - 1)
    if kind < 0.9 and xml_start > _HEADER:  # headers and packets of the points
        head = min(xml_start, _HEADER + rng.choice((32, 64, 128, xml_start)))
        return paged(logical[:_HEADER] + mutate_in_place(logical[_HEADER:head], rng) + logical[head:])
    if kind < 0.95:
        return paged(mutate_in_place(logical[:_HEADER], rng) + logical[_HEADER:])
    return paged(mutate_bytes(logical, rng))


def _mutate_xml(xml: bytes, rng: Random) -> bytes:
    kind = rng.random()
    if kind < 0.45:
        return _set_attribute(xml, rng)
    if kind < 0.6:
        return _change_element(xml, rng)
    if kind < 0.7:
        return mutate_json_within(xml, rng)
    if kind < 0.85:
        return set_number(xml, rng)
    return mutate_text(xml, rng, ".e57")


def _set_attribute(xml: bytes, rng: Random) -> bytes:
    found = list(re.finditer(rb'(\w+)="([^"]*)"', xml))
    if not found:
        return xml
    one = rng.choice(found)
    other = rng.choice(found).group(2)
    value = rng.choice(
        (other, set_number(one.group(2) or b"0", rng), b"", mutate_text(one.group(2), rng, ".e57"))
    )
    return xml[: one.start(2)] + value + xml[one.end(2) :]


def _change_element(xml: bytes, rng: Random) -> bytes:
    """Take an element out, repeat it, or put it into another place."""
    found = list(re.finditer(rb"<(\w+)[^>]*?(?:/>|>(?:(?!<\1[ >]).)*?</\1>)", xml, re.DOTALL))
    if not found:
        return xml
    one = rng.choice(found)
    kind = rng.random()
    if kind < 0.5:
        return xml[: one.start()] + xml[one.end() :]
    if kind < 0.75:
        return xml[: one.end()] + one.group() * rng.choice((1, 1, 30)) + xml[one.end() :]
    at = rng.choice(found).start()
    return xml[:at] + one.group() + xml[at:]
