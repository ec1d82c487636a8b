# SPDX-License-Identifier: MIT
"""Mutations of text: its numbers, words and lines, and the keywords of its format."""

from __future__ import annotations

import re
from random import Random

from tests.robustness.fuzzing.dictionary import KEYWORDS, NUMBERS, PIECES

_NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def set_number(data: bytes, rng: Random) -> bytes:
    """Replace a number."""
    found = _some(list(_NUMBER.finditer(data)), rng)
    if found is None:
        return set_piece(data, rng)
    old = found.group()
    near = [b"-" + old.lstrip(b"-"), old + b"0", b"1" + old, old[:-1]]
    return data[: found.start()] + rng.choice((*NUMBERS, *near)) + data[found.end() :]


def _some(found: list[re.Match[bytes]], rng: Random) -> re.Match[bytes] | None:
    """One of the matches, the first ones more often: counts stand in headers."""
    if not found:
        return None
    return rng.choice(found[:12] if rng.random() < 0.5 else found)


def set_number_in_place(data: bytes, rng: Random) -> bytes:
    """Replace a number by one that is written in as many characters."""
    found = _some(list(_NUMBER.finditer(data)), rng)
    if found is None:
        return data
    n = found.end() - found.start()
    digits = bytes(rng.choice(b"0123456789") for _ in range(n))
    new = rng.choice((b"9" * n, b"0" * n, b"-" + b"9" * (n - 1), b"nan".ljust(n)[:n], digits))
    return data[: found.start()] + new + data[found.end() :]


def set_piece(data: bytes, rng: Random) -> bytes:
    """Put something that parsers stumble over into the text, or over it."""
    at, piece = rng.randint(0, len(data)), rng.choice(PIECES)
    return data[:at] + piece + data[at + rng.choice((0, 0, len(piece))) :]


def change_lines(data: bytes, rng: Random) -> bytes:
    """Delete, repeat, exchange or empty lines."""
    lines = data.split(b"\n")
    k, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(5)
    if kind == 0:
        del lines[k]
    elif kind == 1:
        lines[k:k] = [lines[k]] * rng.choice((1, 1, 2, 100))
    elif kind == 2:
        lines[k], lines[other] = lines[other], lines[k]
    elif kind == 3:
        lines[k] = rng.choice((b"", b" ", b"#"))
    else:
        lines[k : k + rng.randint(1, 5)] = []
    return b"\n".join(lines)


def change_words(data: bytes, rng: Random) -> bytes:
    """Delete, repeat or exchange words of a line."""
    lines = data.split(b"\n")
    k = rng.randrange(len(lines))
    words = lines[k].split(b" ")
    i, j = rng.randrange(len(words)), rng.randrange(len(words))
    kind = rng.randrange(3)
    if kind == 0:
        del words[i]
    elif kind == 1:
        words.insert(j, words[i])
    else:
        words[i], words[j] = words[j], words[i]
    lines[k] = b" ".join(words)
    return b"\n".join(lines)


def put_keyword(data: bytes, rng: Random, suffix: str) -> bytes:
    """Put a word of the format on a line of its own, or over another word."""
    known = KEYWORDS.get(suffix, KEYWORDS[".txt"])
    word = rng.choice(known)
    words = list(re.finditer(rb"[A-Za-z_]{2,}", data[:65536]))
    if words and rng.random() < 0.4:
        found = rng.choice(words)
        return data[: found.start()] + word + data[found.end() :]
    lines = data.split(b"\n")
    lines.insert(rng.randint(0, min(len(lines), 40)), word)
    return b"\n".join(lines)


def mutate_text(data: bytes, rng: Random, suffix: str = ".txt") -> bytes:
    """Return the text after one mutation."""
    kind = rng.random()
    if kind < 0.45:
        return set_number(data, rng)
    if kind < 0.6:
        return change_lines(data, rng)
    if kind < 0.75:
        return change_words(data, rng)
    if kind < 0.88:
        return put_keyword(data, rng, suffix)
    return set_piece(data, rng)
