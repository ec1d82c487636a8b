# SPDX-License-Identifier: MIT
"""Mapping: large arrays whose numbers are in a temporary file, so that memory holds only what is in use.

The file has no name, being unlinked as soon as it is open, so that nothing is left however a run ends.
Its room is reserved before a number is written, so that a full disk is reported at once.

Spill: the results of a long run's steps, their large arrays one after another in few large mapped files; a
file for each would take more than a process may have open.
"""

from __future__ import annotations

import dataclasses
import math
import mmap
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Lock
from time import monotonic
from typing import IO, Any, TypeVar
from weakref import WeakSet

import numpy as np
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.run.memory import give_back, in_words, resident

LARGE = 1 << 19
"""Rows times columns beyond which an array is mapped.

A camera's frame of 640 x 480 pixels stays in memory: it has 9 MB at most, and a file takes 0.1 ms to make.
"""
_BLOCK = 1 << 20  # bytes that are written or read at a time
_RESIDENT = 1 << 26  # bytes more than there were, from which on memory is given back
_PAUSE_S = 2e-3  # in which nobody looks again: a look takes 20 us, and some 10 megabytes may come meanwhile
_kept = 0  # bytes that were in memory when it was given back last
_looked = 0.0  # when somebody looked last, seconds
_folders: list[Path] = []  # of this process: threads and forked workers have the same


class _Mapping(mmap.mmap):
    """A file that none but this process, and those forked from it, can open."""


_mappings: WeakSet[_Mapping] = WeakSet()
_lock = Lock()


def allocate(shape: Sequence[int], dtype: Any, fill: float = 0) -> NDArray[Any]:
    """Return an array, C order, that holds `fill` everywhere: mapped where it is large, else in memory.

    Both are plain arrays; whoever has gone through a mapped one lets go of it with `release`.

    Raises InputError: the disk has no room for it, or the folder cannot be written.

    Examples
    --------
    >>> small, large = (allocate((n, n), np.float32, np.inf) for n in (2, 1000))
    >>> is_mapped(small), is_mapped(large), bool(np.isinf(large).all())
    (False, True, True)
    """
    kind, pixels = np.dtype(dtype), math.prod(shape[:2])
    if pixels <= LARGE:
        return np.zeros(shape, kind) if fill == 0 else np.full(shape, fill, kind)
    n_bytes = math.prod(shape) * kind.itemsize
    array: NDArray[Any] = np.ndarray(tuple(shape), kind, buffer=_reserve(n_bytes))
    if fill != 0:  # not a number is not 0 either
        step = max(_BLOCK * len(array) // n_bytes, 1)
        for start in range(0, len(array), step):
            array[start : start + step] = fill
            release(array)
    return array


def is_mapped(array: Any) -> bool:
    """Tell whether an array is one that `allocate` mapped, or a view of one."""
    return _mapping_of(array) is not None


def release(*arrays: Any) -> None:
    """Let the system take the memory of mapped arrays, or of what views show; their numbers stay.

    What is read or written next comes back by itself. Nothing happens to other arrays, or to None.
    """
    if not hasattr(mmap, "MADV_DONTNEED"):  # Windows takes back by itself
        return
    for array in arrays:
        mapping = _mapping_of(array)
        if mapping is not None:
            mapping.madvise(mmap.MADV_DONTNEED)


def trim() -> None:
    """Give memory back once more than 64 MB have come to it: pages of mapped arrays, and what was freed.

    Less than a microsecond where somebody has just looked; loops over large scans ask often. Results are the
    same.
    """
    global _kept, _looked
    now = monotonic()
    if now - _looked < _PAUSE_S:
        return
    _looked, held = now, resident()
    if held < _kept:
        _kept = held
    if held - _kept <= _RESIDENT:
        return
    with _lock:
        mappings = list(_mappings)
    if hasattr(mmap, "MADV_DONTNEED"):
        for mapping in mappings:
            mapping.madvise(mmap.MADV_DONTNEED)
    give_back()
    _kept = resident()


def fill_from(array: NDArray[Any], stream: IO[bytes]) -> int:
    """Fill an array of any shape, C order, with the next bytes of a stream, a block at a time.

    Returns how many there were: less than the array has where the stream ends before.
    """
    held = array.reshape(-1).view(np.uint8) if array.size and array.itemsize else np.zeros(0, np.uint8)
    n_bytes = 0
    while n_bytes < len(held):
        part = stream.read(min(_BLOCK, len(held) - n_bytes))
        if not part:
            break
        held[n_bytes : n_bytes + len(part)] = np.frombuffer(part, np.uint8)
        n_bytes += len(part)
        release(array)
    return n_bytes


@contextmanager
def mapped_in(folder: Path) -> Iterator[None]:
    """Have arrays that are made meanwhile, by any thread, in a folder, as long as it is there.

    Else they are in the folder of temporary files (TMPDIR), which some machines keep in memory.
    """
    _folders.append(folder)
    try:
        yield
    finally:
        _folders.remove(folder)


def _reserve(n_bytes: int) -> _Mapping:
    """A new file of zeros, mapped."""
    there = [folder for folder in _folders if folder.is_dir()]
    folder = there[-1] if there else Path(tempfile.gettempdir())
    try:
        with tempfile.TemporaryFile(buffering=0, dir=folder) as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, n_bytes)
            else:
                _write_zeros(file, n_bytes)
            mapping = _Mapping(file.fileno(), n_bytes)
    except OSError as error:
        raise InputError(
            f"{folder}: no room for {in_words(n_bytes)} of a scan's pixels: {error.strerror}; free some, or "
            "write the output to a larger disk (without an output, set TMPDIR to a folder there)"
        ) from error
    with _lock:
        _mappings.add(mapping)
    return mapping


def _write_zeros(file: IO[bytes], n_bytes: int) -> None:
    """Take the room of a file where the system cannot reserve it."""
    for start in range(0, n_bytes, _BLOCK):
        file.write(bytes(min(_BLOCK, n_bytes - start)))


def _mapping_of(array: Any) -> _Mapping | None:
    """What an array, or the one that it is a view of, is mapped by; None where it is in memory."""
    while isinstance(array, np.ndarray):
        array = array.base
    return array if isinstance(array, _Mapping) else None


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
            kept = value if is_there else self._copy(value)
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

    def _copy(self, array: NDArray[Any]) -> NDArray[Any]:
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
