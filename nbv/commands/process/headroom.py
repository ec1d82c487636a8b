# SPDX-License-Identifier: MIT
"""Headroom: what libraries need before a command begins, taken while there is room for it.

OpenBLAS takes 32 MB for each thread that multiplies matrices when it does so first, and where it gets none it
tries again for ever. Numpy, scipy and OpenCV bring one each.
"""

from __future__ import annotations

import ctypes
import os
import sys
from importlib import import_module
from pathlib import Path

from nbv.commands.process.starvation import NOT_ENOUGH

_LEAST = 640_000_000  # bytes of address space that numpy, scipy, OpenCV and their OpenBLAS take when imported
_LEAST_DATA = 240_000_000  # of private memory
_BUFFER = 34 << 20  # bytes: OpenBLAS' and its pages


def settle() -> None:
    """Where the system limits this process (`ulimit -v`, `-d`), load what takes memory by itself.

    Raises
    ------
    MemoryError
        There is no room for it; the message says how much there must be.
    """
    if sys.platform == "win32":
        return
    import resource

    limited = False
    for which, least, option in ((resource.RLIMIT_AS, _LEAST, "v"), (resource.RLIMIT_DATA, _LEAST_DATA, "d")):
        bound = resource.getrlimit(which)[0]
        if bound == resource.RLIM_INFINITY:
            continue
        limited = True
        if bound < least:
            raise MemoryError(
                f"the libraries alone need {least // 10**6} MB, and the limit of this process "
                f"(ulimit -{option}) is {bound // 10**6} MB"
            )
    if limited:
        import_module("cv2")
        reserve(os.cpu_count() or 1)


def reserve(n_threads: int) -> None:
    """Have OpenBLAS take now what so many threads, and the main one, will need.

    Raises
    ------
    MemoryError
        There is no room for it.
    """
    from scenes.run.memory import room

    for name in ("numpy", "scipy"):
        package = import_module(name)
        for file in Path(str(package.__file__)).parents[1].glob(f"{name}.libs/*openblas*"):
            library = ctypes.CDLL(str(file))
            try:
                take, give = library.blas_memory_alloc, library.blas_memory_free
            except AttributeError:  # another build, with ways of its own
                continue
            take.restype, give.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
            held = []
            for _ in range(n_threads + 1):
                if room() < _BUFFER:
                    raise MemoryError(NOT_ENOUGH)
                held.append(take(1))
            for buffer in held:
                give(buffer)
