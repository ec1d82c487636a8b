# SPDX-License-Identifier: MIT
"""Mapping: large arrays whose numbers are in a temporary file, so that memory holds only what is in use.

The file has no name, being unlinked as soon as it is open, so that nothing is left however a run ends.
Its room is reserved before a number is written, so that a full disk is told at once.
"""

from __future__ import annotations

import math
import mmap
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from time import monotonic
from typing import IO, Any
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
    array: NDArray[Any] = np.ndarray(tuple(shape), kind, buffer=_reserved(n_bytes))
    if fill != 0:  # not a number is not 0 either
        step = max(_BLOCK * len(array) // n_bytes, 1)
        for start in range(0, len(array), step):
            array[start : start + step] = fill
            release(array)
    return array


def is_mapped(array: Any) -> bool:
    """Tell whether an array is one that `allocate` mapped, or a view of one."""
    return _mapping(array) is not None


def release(*arrays: Any) -> None:
    """Let the system take the memory of mapped arrays, or of what views show; their numbers stay.

    What is read or written next comes back by itself. Nothing happens to other arrays, or to None.
    """
    if not hasattr(mmap, "MADV_DONTNEED"):  # Windows takes back by itself
        return
    for array in arrays:
        mapping = _mapping(array)
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


def _reserved(n_bytes: int) -> _Mapping:
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


def _mapping(array: Any) -> _Mapping | None:
    """What an array, or the one that it is a view of, is mapped by; None where it is in memory."""
    while isinstance(array, np.ndarray):
        array = array.base
    return array if isinstance(array, _Mapping) else None
