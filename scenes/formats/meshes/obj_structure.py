# SPDX-License-Identifier: MIT
"""Structure of OBJ: its lines made plain, its faces' numbers held against the vertices that are there."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.run.file_limits import check_limit

_INDENTED = re.compile(rb"(?m)^[ \t]+(?=[a-z#])")
_KEYWORD = re.compile(rb"(?m)^(v|vn|vt|f|o|g|usemtl|mtllib)[ \t]*\t[ \t]*")
_CONTINUED = re.compile(rb"\\\r?\n")
_COMMENT = re.compile(rb"(?m)^((?:v|vn|vt|f)[ ][^#\n]*)#[^\n]*")
_WIDTHS = {b"v": (3, 8), b"vt": (1, 3), b"vn": (3, 3)}  # numbers of a line: fewest, most
_NAMES = {0: "vertex", 1: "texture coordinate", 2: "normal"}
_KEYS = (b"v", b"vt", b"vn")


def plain_obj(data: bytes) -> bytes:
    """Return the text of an OBJ file with one line an entry, not indented, its keyword before one blank."""
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    for pattern, instead in ((_CONTINUED, b" "), (_INDENTED, b""), (_KEYWORD, rb"\1 "), (_COMMENT, rb"\1")):
        data = pattern.sub(instead, data)
    return data


def check_obj(text: bytes) -> int:
    """Return how many triangles a plain OBJ text holds, its polygons cut into fans.

    Raises
    ------
    InputError
        A vertex that is not numbers, a face of fewer than three corners or with a corner that is not there,
        or faces written in ways that are easily taken for each other; lines are numbered.
    """
    counts = dict.fromkeys(_KEYS, 0)
    kept: dict[bytes, list[bytes]] = {key: [] for key in _KEYS}
    faces: dict[tuple[int, int, bool], tuple[list[int], list[bytes]]] = {}
    before: list[int] = []  # vertices before the first face that counts from the end
    for number, line in enumerate(text.split(b"\n"), start=1):
        key, _, rest = line.partition(b" ")
        if key in counts:
            counts[key] += 1
            kept[key].append(rest)
        elif key == b"f":
            words = rest.split()
            plain = rest.replace(b"/", b" ")
            kind = (len(words), len(plain.split()), b"//" in rest)
            lines = faces.setdefault(kind, ([], []))
            lines[0].append(number)
            lines[1].append(plain)
            if b"-" in rest and not before:
                before = [counts[one] for one in _KEYS]
        elif key.startswith(b"f") and not key.isalpha():
            raise InputError(f"line {number} begins with {key[:20].decode('latin-1')!r}, which is no face")
    if before and before != [counts[key] for key in _KEYS]:
        raise InputError("has faces that count from the end, and vertices after them; save it without")
    check_limit("points", counts[b"v"], "its vertices")
    for key in _KEYS:
        _check_vertices(key, kept[key])
    return _check_faces(faces, [counts[key] for key in _KEYS])


def _check_vertices(key: bytes, lines: Sequence[bytes]) -> None:
    """Raise where lines of one kind are no rows of numbers."""
    if not lines:
        return
    fewest, most = _WIDTHS[key]
    widths = {len(line.split()) for line in lines}
    if min(widths) < fewest or max(widths) > most:
        raise InputError(f"has {key.decode()} lines of {min(widths)} to {max(widths)} numbers")
    for width in widths:
        rows = [line for line in lines if len(line.split()) == width] if len(widths) > 1 else lines
        try:
            np.loadtxt([row.decode("latin-1") for row in rows], comments=None)
        except ValueError as error:
            raise InputError(f"its {key.decode()} lines cannot be read: {error}") from error


def _check_faces(faces: dict[tuple[int, int, bool], tuple[list[int], list[bytes]]], counts: list[int]) -> int:
    total = 0
    by_width: dict[int, tuple[int, int, bool]] = {}
    for kind, (numbers, lines) in faces.items():
        n_corners, width, skips = kind
        if n_corners < 3:
            raise InputError(f"line {numbers[0]} is a face of {n_corners} corners; three are needed")
        each = width // n_corners
        if width % n_corners or each > 3 or (skips and each != 2):
            raise InputError(f"line {numbers[0]} is a face whose corners are written in different ways")
        if by_width.setdefault(width, kind) != kind:
            raise InputError(
                f"line {numbers[0]} is a face written in another way than one before; save it as triangles"
            )
        total += len(numbers) * (n_corners - 2)
        check_limit("faces", total, "its faces")
        try:
            table = np.loadtxt([line.decode("latin-1") for line in lines], np.int64, ndmin=2, comments=None)
        except (ValueError, OverflowError) as error:
            raise InputError(f"its faces cannot be read: {error}") from error
        for part in range(each):
            what = 2 if skips and part == 1 else part
            _check_range(table[:, part::each], counts[what], _NAMES[what], numbers)
    return total


def _check_range(table: NDArray[np.int64], count: int, name: str, lines: list[int]) -> None:
    bad = ((table == 0) | (np.abs(table) > count)).any(axis=1)
    if bad.any():
        first = int(np.argmax(bad))
        wrong = table[first][(table[first] == 0) | (np.abs(table[first]) > count)][0]
        raise InputError(
            f"line {lines[first]}: its face names {name} {wrong}, but they count from 1 to {count} "
            f"({int(bad.sum())} such faces)"
        )
