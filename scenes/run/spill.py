# SPDX-License-Identifier: MIT
"""Spill: what the steps of a long run came to, its large arrays on disk, where memory does not grow by them.

The arrays lie one after another in few large mapped files; a file for each would take more than a process may
have open.
"""

from __future__ import annotations

import dataclasses
import mmap
from functools import cache
from threading import Lock
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from scenes.run.mapping import allocate, is_mapped, trim

_LEAST = 512  # bytes of an array that is worth a place in a file; what names the place takes a hundred
_STEP = 64  # bytes between the beginnings of small arrays; those of many pages begin with one
IN_MEMORY = 1 << 21
"""Pixels of all scans of a run, up to which all is kept in memory."""
_FILE = 1 << 26  # bytes; larger arrays have a file of their own
_PLAIN = frozenset({bool, int, float, str, type(None)})
_Value = TypeVar("_Value")


class Spill:
    """Arrays of one run in files that have no name; several threads may keep theirs at a time."""

    def __init__(self) -> None:
        self._files: list[NDArray[np.uint8]] = []
        self._used, self._lock = _FILE, Lock()

    def keep(self, value: _Value) -> _Value:
        """Return an equal value whose large arrays are on disk.

        Dataclasses, tuples and lists are gone through. Arrays in files already stay where they are; so do
        arrays of objects, and whatever else there is. An array that cannot be written to stays so.

        Raises
        ------
        InputError
            The disk has no room.

        Examples
        --------
        >>> spill, array = Spill(), np.arange(100_000)
        >>> kept = spill.keep((array, "a"))
        >>> kept[0] is array, bool((kept[0] == array).all()), is_mapped(kept[0]), kept[1]
        (False, True, True, 'a')
        """
        kept: Any = value
        kind: type = type(value)
        if kind in _PLAIN:
            return value
        if isinstance(value, np.ndarray):
            is_there = value.nbytes < _LEAST or value.dtype.hasobject or is_mapped(value)
            kept = value if is_there else self._copied(value)
        elif isinstance(value, list | tuple):
            items = [self.keep(item) for item in value]
            if any(item is not held for item, held in zip(items, value, strict=True)):
                kept = kind(*items) if hasattr(kind, "_fields") else kind(items)
        elif names := _names(kind):
            held = [getattr(value, name) for name in names]
            parts = [self.keep(item) for item in held]
            if any(part is not item for part, item in zip(parts, held, strict=True)):
                kept = object.__new__(kind)  # as it was: its checks are done
                for name, part in zip(names, parts, strict=True):
                    object.__setattr__(kept, name, part)
        result: _Value = kept
        return result

    def _copied(self, array: NDArray[Any]) -> NDArray[Any]:
        """The same array on disk."""
        place = self._place(array.nbytes)
        copy: NDArray[Any] = place.view(array.dtype).reshape(array.shape)
        copy[...] = array
        trim()
        copy.setflags(write=array.flags.writeable)
        return copy

    def _place(self, n_bytes: int) -> NDArray[np.uint8]:
        """Room for so many bytes, small arrays side by side on one page."""
        step = mmap.PAGESIZE if n_bytes > _FILE // 4 else _STEP
        whole = -(-n_bytes // step) * step
        with self._lock:
            if whole > _FILE // 4:
                file = allocate((whole, 1), np.uint8)[:, 0]
                self._files.insert(0, file)
                return file[:n_bytes]
            if self._used + whole > _FILE:
                self._files.append(allocate((_FILE, 1), np.uint8)[:, 0])
                self._used = 0
            start = self._used
            self._used += whole
            return self._files[-1][start : start + n_bytes]


@cache
def _names(kind: type) -> tuple[str, ...]:
    """The fields of a dataclass; none of another type."""
    return tuple(field.name for field in dataclasses.fields(kind)) if dataclasses.is_dataclass(kind) else ()


class NoSpill:
    """Keeps everything in memory."""

    def keep(self, value: _Value) -> _Value:
        """Return the value."""
        return value


NO_SPILL = NoSpill()


def spill_of(n_pixels: int) -> Spill | NoSpill:
    """Return where to keep what is made of scans of so many pixels in all: of few in memory."""
    return Spill() if n_pixels > IN_MEMORY else NO_SPILL
