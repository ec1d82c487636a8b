# SPDX-License-Identifier: MIT
"""Compiled functions whose stored code goes stale with everything that it was made from.

numba stores compiled code beside a digest of the file of the outermost function. What that function calls in
other files, and the constants that it names, is compiled into it all the same. The digest here holds these
too, so that a change in any of them compiles anew.
"""

from __future__ import annotations

import linecache
from collections.abc import Callable, Iterator, Mapping
from hashlib import sha256
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numba import njit

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function compiled by numba: stored on disk, without the interpreter's lock, numpy's division.

    What it calls in other files, and the constants and named tuples of its file, are part of the digest of
    the stored code. Where numba finds no folder to store it in, it is compiled for this process alone.
    """
    try:
        made: Callable[P, R] = njit(nogil=True, cache=True, error_model="numpy")(function)
    except RuntimeError:
        made = njit(nogil=True, error_model="numpy")(function)
    stored = getattr(getattr(made, "_cache", None), "_cache_file", None)  # none where nothing is compiled
    if stored is not None:
        path = function.__code__.co_filename
        parts = sorted(set(_parts(function.__globals__, {path})))
        stored._source_stamp = stored._source_stamp, sha256("\n".join(parts).encode()).digest()
    return made


def _parts(names: Mapping[str, Any], seen: set[str]) -> Iterator[str]:
    """What the functions of a file are compiled from: its constants, and other files with what these need."""
    for name, value in names.items():
        if name.startswith("__"):
            continue
        if isinstance(value, int | float | str | np.generic):
            yield f"{name} = {value!r}"
        elif isinstance(value, type) and issubclass(value, tuple):
            yield f"{name}{getattr(value, '_fields', ())}"
        else:  # a compiled function or an instruction
            source = getattr(value, "py_func", getattr(value, "_defn", None))
            if source is not None and source.__code__.co_filename not in seen:
                seen.add(source.__code__.co_filename)
                yield "".join(linecache.getlines(source.__code__.co_filename, source.__globals__))
                yield from _parts(source.__globals__, seen)
