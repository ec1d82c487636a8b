# SPDX-License-Identifier: MIT
"""Memory: how much of it this process may still use. It sets the size of blocks, and never a result.

Whoever allocates much asks first: `rows_within` for the size of a block, `require` for what cannot be parted;
`in_blocks` splits work on many rows over threads.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import NamedTuple

from scenes.checks import InputError

if sys.platform != "win32":
    import resource

_limit: ContextVar[int | None] = ContextVar("memory limit", default=None)
_CGROUPS = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"))
_LEAST = 1 << 24  # bytes that a block may have however little is left: less would only be slower
_SHARE = 0.25  # of what is left, for one block
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # mallopt(3)
_BLOCK = 1 << 16  # rows: enough that a thread is worth waking


@contextmanager
def memory_limit(max_bytes: int | None, *, enforced: bool = False) -> Iterator[None]:
    """Let what runs inside, in this thread, plan for so much memory of the whole process.

    None for what the machine, or its container, has. Where it is `enforced` the system also refuses, by a
    MemoryError, what would take the process beyond (RLIMIT_DATA, with which Linux alone counts what numpy
    allocates). Raises InputError: the process uses more already.

    Examples
    --------
    >>> with memory_limit(10**12):
    ...     rows_within(10**6) > 1000
    True
    """
    token = _limit.set(max_bytes)
    try:
        with _refuse_beyond(max_bytes) if enforced and max_bytes is not None else nullcontext():
            yield
    finally:
        _limit.reset(token)


@contextmanager
def _refuse_beyond(max_bytes: int) -> Iterator[None]:
    """Have the system refuse what would take this process beyond so many bytes."""
    if sys.platform == "win32":
        yield
        return
    now = _usage()
    if now.resident > max_bytes:
        raise InputError(
            f"a limit of {in_words(max_bytes)} is less than the {in_words(now.resident)} that this command "
            "needs before it begins; give more"
        )
    before, hardest = resource.getrlimit(resource.RLIMIT_DATA)
    most = now.data + max_bytes - now.resident  # some of its data was never touched, and is not in memory
    bounds = [bound for bound in (most, before, hardest) if bound != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_DATA, (min(bounds), hardest))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (before, hardest))


def planned_bytes() -> int | None:
    """Return the limit in force here, None where it is what the machine has."""
    return _limit.get()


def room() -> int:
    """Return the bytes that this process may still use; 0 when it uses more than it may."""
    now = _usage()
    left = [(_limit.get() or machine_bytes()) - now.resident]
    if sys.platform != "win32":
        for which, used in ((resource.RLIMIT_AS, now.space), (resource.RLIMIT_DATA, now.data)):
            bound = resource.getrlimit(which)[0]
            if bound != resource.RLIM_INFINITY:
                left.append(bound - used)
    return max(min(left), 0)


def rows_within(bytes_a_row: float, most: int | None = None) -> int:
    """Return how many rows of so many bytes a block may have: a quarter of what is left, at least one row.

    The bytes are all that is allocated for a row meanwhile; more than `most` rows are of no use.
    """
    rows = max(int(max(_SHARE * room(), _LEAST) / max(bytes_a_row, 1.0)), 1)
    return rows if most is None else max(min(rows, most), 1)


def threads_within(bytes_each: float, n_threads: int | None = None) -> int:
    """Return how many threads may work at once when each uses so many bytes at its peak; at least one.

    At most `n_threads`; one a core when not given.
    """
    return max(min(n_threads or os.cpu_count() or 1, int(room() / max(bytes_each, 1.0))), 1)


@contextmanager
def threads(bytes_each: float, n_threads: int | None = None) -> Iterator[ThreadPoolExecutor]:
    """Give a pool of `threads_within` threads; they know the limit that is in force here."""
    count = threads_within(bytes_each, n_threads)
    with ThreadPoolExecutor(count, initializer=_limit.set, initargs=(_limit.get(),)) as pool:
        yield pool


def require(n_bytes: float, what: str, cure: str) -> None:
    """Raise InputError when `n_bytes`, about to be allocated at the peak, are more than what is left.

    For the message: `what` needs it, and the `cure`, which would need less.
    """
    left = room()
    if n_bytes > left:
        raise InputError(f"{what} needs about {in_words(n_bytes)}, and {in_words(left)} are left; {cure}")


def in_words(n_bytes: float) -> str:
    """Return an amount of memory for people.

    Examples
    --------
    >>> in_words(3.14e9), in_words(7.2e7)
    ('3.1 GB', '72 MB')
    """
    return f"{n_bytes / 1e9:.1f} GB" if n_bytes >= 1e9 else f"{n_bytes / 1e6:.0f} MB"


@cache
def machine_bytes() -> int:
    """Return what the machine has, or the container that this process is in, whichever is less."""
    numbers = []
    for file in _CGROUPS:
        try:
            numbers.append(int(file.read_text()))
        except (OSError, ValueError):  # no such group, or "max"
            continue
    if hasattr(os, "sysconf"):
        numbers.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    return min(numbers, default=sys.maxsize)


class _Usage(NamedTuple):
    """Memory of this process, bytes: address space, what of it is in memory, and its own data."""

    space: int
    resident: int
    data: int


def _usage() -> _Usage:
    try:
        pages = [int(number) for number in os.pread(_statm(os.getpid()), 256, 0).split()]
    except OSError:  # no /proc: the largest that it was so far, where that is told
        if sys.platform == "win32":
            return _Usage(0, 0, 0)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
        return _Usage(peak, peak, peak)
    size = os.sysconf("SC_PAGE_SIZE")
    return _Usage(*(pages[k] * size for k in (0, 1, 5)))


@cache
def _statm(_process: int) -> int:
    """The file in which a process reads what it has; it stays open, because loops ask often."""
    return os.open("/proc/self/statm", os.O_RDONLY)


def resident() -> int:
    """Return the bytes of this process that are in memory; where that is not told, the most so far."""
    return _usage().resident


def give_back() -> None:
    """Have the C library give memory to the system that was freed; not all of them do so by themselves."""
    trimmed = getattr(_c_library(), "malloc_trim", None)
    if trimmed is not None:
        trimmed(0)


@cache
def reuse_freed() -> None:
    """Have the C library keep some of what is freed for what comes next, as it does unless told otherwise.

    dask tells it otherwise for its workers (MALLOC_TRIM_THRESHOLD_): each array of a block would then be
    mapped and cleared anew, page by page, which takes a third of the time of a scan.
    """
    set_option = getattr(_c_library(), "mallopt", None)
    if set_option is not None:
        for option, n_bytes in ((_MMAP_THRESHOLD, 1 << 25), (_TRIM_THRESHOLD, 1 << 26)):
            set_option(option, n_bytes)


@cache
def _c_library() -> ctypes.CDLL | None:
    return ctypes.CDLL(None) if sys.platform == "linux" else None


def in_blocks(
    n_rows: int,
    work: Callable[[slice], object],
    n_threads: int | None = None,
    block: int = _BLOCK,
    *,
    bytes_a_block: float = 0.0,
) -> None:
    """Call `work` with slices that cover `n_rows`; it writes its own rows and holds no interpreter lock.

    It is called with one slice of `block` rows at a time, from `n_threads` threads, all cores when not given;
    but no more threads than fit into memory, each allocating `bytes_a_block`.
    """
    slices = [slice(start, min(start + block, n_rows)) for start in range(0, n_rows, block)]
    most = min(n_threads or os.cpu_count() or 1, len(slices))
    if most < 2:
        for part in slices:
            work(part)
        return
    with threads(bytes_a_block, most) as pool:
        list(pool.map(work, slices))
