# SPDX-License-Identifier: MIT
"""Mutations of bytes of any meaning: bits, values, chunks, integers and reals of every width and order."""

from __future__ import annotations

import struct
from random import Random

_INTEGERS = (
    *(
        0,
        1,
        -1,
        2,
        3,
        7,
        8,
        16,
        100,
        127,
        128,
        255,
        256,
        1000,
        32767,
        32768,
        65535,
        65536,
        10**6,
        2**24,
        2**30,
    ),
    *(2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**40, 2**53, 2**62, 2**63 - 1, -(2**31), -(2**63)),
)
_REALS = (
    *(float("nan"), float("inf"), -float("inf"), 0.0, -0.0, 1e-320, 1e-40, 1e-9, 1.0, -1.0, 1e6, 1e9, 1e10),
    *(1e19, 3.4e38, -3.4e38, 1e100, 1.7e308, -1.7e308),
)


def flip_bit(data: bytes, rng: Random) -> bytes:
    """Turn one bit."""
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]


def set_bytes(data: bytes, rng: Random) -> bytes:
    """Set a few bytes to 0, 255 or anything."""
    at, n = rng.randrange(len(data)), rng.choice((1, 1, 2, 4, 8, 32))
    value = rng.choice((b"\0" * n, b"\xff" * n, rng.randbytes(n)))
    return (data[:at] + value + data[at + n :])[: len(data)]


def _span(data: bytes, rng: Random) -> tuple[int, int]:
    start = rng.randrange(len(data))
    length = rng.choice((1, 2, 4, 8, 16, rng.randint(1, 64), rng.randint(1, len(data))))
    return start, min(start + length, len(data))


def delete(data: bytes, rng: Random) -> bytes:
    """Take a chunk out."""
    start, end = _span(data, rng)
    return data[:start] + data[end:]


def duplicate(data: bytes, rng: Random) -> bytes:
    """Repeat a chunk, at most a few thousand bytes in all."""
    start, end = _span(data, rng)
    chunk = data[start:end]
    return data[:end] + chunk * rng.randint(1, max(1, min(64, 4096 // len(chunk)))) + data[end:]


def swap(data: bytes, rng: Random) -> bytes:
    """Exchange two chunks."""
    a, b, c, d = sorted(rng.randint(0, len(data)) for _ in range(4))
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def insert(data: bytes, rng: Random) -> bytes:
    """Put anything in."""
    at, n = rng.randint(0, len(data)), rng.choice((1, 2, 4, 16, 64))
    return data[:at] + rng.choice((b"\0" * n, b"\xff" * n, rng.randbytes(n))) + data[at:]


def truncate(data: bytes, rng: Random) -> bytes:
    """Cut the end off, often near to it or near to the beginning."""
    n = len(data)
    return data[
        : rng.choice((rng.randrange(n), n - rng.randint(1, min(n, 16)), rng.randint(0, min(n - 1, 64))))
    ]


def splice(data: bytes, rng: Random, donor: bytes) -> bytes:
    """Go on with the end of another file."""
    return data[: rng.randint(0, len(data))] + donor[rng.randint(0, len(donor)) :]


def set_integer(data: bytes, rng: Random) -> bytes:
    """Write an extreme integer over 1, 2, 4 or 8 bytes, mostly where one is aligned or a small one stands."""
    width = rng.choice((1, 2, 4, 4, 4, 8))
    if len(data) < width:
        return data
    at = _place(data, width, rng)
    order = rng.choice(("little", "big"))
    old = int.from_bytes(data[at : at + width], order)
    value = rng.choice((rng.choice(_INTEGERS), old + 1, old - 1, old * 2, -old, rng.getrandbits(8 * width)))
    new = (value % (1 << (8 * width))).to_bytes(width, order)
    return data[:at] + new + data[at + width :]


def _place(data: bytes, width: int, rng: Random) -> int:
    last = len(data) - width
    at = rng.randint(0, last)
    kind = rng.random()
    if kind < 0.5:
        return at - at % width
    if kind < 0.8:  # a count: a small number, so that most of its bytes are zero
        zeros = b"\0" * (width - 1)
        found = data.find(zeros, at)
        if 0 <= found <= last:
            return max(0, min(last, found - rng.choice((0, 1))))
    return at


def set_real(data: bytes, rng: Random) -> bytes:
    """Write an extreme real over 4 or 8 bytes."""
    form = rng.choice(("<f", "<d", ">f", ">d"))
    width = struct.calcsize(form)
    if len(data) < width:
        return data
    at = rng.randint(0, len(data) - width)
    at -= rng.choice((0, at % width))
    value = rng.choice(_REALS)
    if width == 4 and abs(value) > 3.4e38:
        value = float("inf")
    return data[:at] + struct.pack(form, value) + data[at + width :]


def reverse_order(data: bytes, rng: Random) -> bytes:
    """Turn the bytes of every number of a stretch round, as another byte order does."""
    width = rng.choice((2, 4, 8))
    start, end = _span(data, rng)
    words = [data[k : k + width][::-1] for k in range(start, end, width)]
    return data[:start] + b"".join(words)[: end - start] + data[end:]


IN_PLACE = (flip_bit, set_bytes, set_integer, set_integer, set_real, reverse_order)
"""Mutations that leave the length as it is."""
ANY = (*IN_PLACE, delete, duplicate, swap, insert, truncate)


def mutate_bytes(data: bytes, rng: Random, donor: bytes = b"") -> bytes:
    """Return the bytes after one mutation."""
    if not data:
        return rng.randbytes(rng.randint(1, 64))
    if donor and rng.random() < 0.08:
        return splice(data, rng, donor)
    return rng.choice(ANY)(data, rng)


def mutate_in_place(data: bytes, rng: Random) -> bytes:
    """Return as many bytes after one mutation."""
    return rng.choice(IN_PLACE)(data, rng) if data else data
