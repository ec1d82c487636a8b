# SPDX-License-Identifier: MIT
"""Compiled functions whose stored code goes stale with everything that it was made from.

numba stores compiled code beside a digest of the file of the outermost function. What that function calls in
other files, and the constants that it names, is compiled into it all the same. The digest here holds these
too, so that a change in any of them compiles anew.
"""

from __future__ import annotations

import linecache
import pickle
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from hashlib import sha256
from types import FunctionType
from typing import Any, ParamSpec, TypeVar

import numpy as np
from llvmlite import ir
from numba import config, njit, types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.registry import CPUDispatcher
from numba.extending import intrinsic
from numpy.typing import NDArray

P = ParamSpec("P")
R = TypeVar("R")
LANES = 64  # consecutive centres that are measured together
TERMS_PER_STEP = 8  # terms added between two comparisons with the bound


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function compiled by numba: stored on disk, without the interpreter's lock, numpy's division.

    What it calls in other files, and the constants and named tuples of its file, are part of the digest of
    the stored code. Where numba finds no folder to store it in, it is compiled for this process alone.
    """
    try:
        made: Callable[P, R] = njit(nogil=True, cache=True, error_model="numpy", no_cfunc_wrapper=True)(
            function
        )
    except RuntimeError:
        made = njit(nogil=True, error_model="numpy")(function)
    cache = getattr(made, "_cache", None)  # none where nothing is compiled
    if isinstance(cache, FunctionCache):  # none where nothing is stored
        path = function.__code__.co_filename
        parts = sorted(set(_parts(function.__globals__, {path})))
        stamp = cache._cache_file._source_stamp, sha256("\n".join(parts).encode()).digest()
        cache._cache_file = _Index(cache.cache_path, cache._impl.filename_base, stamp)
    return made


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function whose code becomes part of the compiled loops that call it.

    A call would count references to the arrays that it passes, which takes ten times as long. Without an
    entry of its own for the interpreter the function compiles in half the time.
    """
    if config.DISABLE_JIT:
        return function
    options = {"nopython": True, "nogil": True, "error_model": "numpy", "forceinline": True}
    made: Callable[P, R] = _Inlined(function, targetoptions=options | _NO_WRAPPERS)
    return made


_NO_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


class _Inlined(CPUDispatcher):  # type: ignore[misc]
    """A function for compiled loops; the interpreter, as in a test, gets at it through a loop of its own."""

    def __call__(self, *arguments: Any) -> Any:
        return _entry(self)(*arguments)


@cache
def _entry(function: _Inlined) -> Callable[..., Any]:
    """Return a compiled function that calls another one, stored under a name of its own."""
    source = function.py_func
    made = FunctionType(_call.__code__, {"_called": function}, source.__name__)
    made.__module__, made.__qualname__ = source.__module__, f"{source.__module__}.{source.__qualname__}"
    return compiled(made)


_called: Any = None  # of each entry the function that it calls


def _call(*arguments: Any) -> Any:
    return _called(*arguments)


@inlined
def sort_order(values: NDArray[Any], order: NDArray[np.int64], room: NDArray[np.int64]) -> None:
    """Write the order (n,) that sorts values (n,), equal ones in turn; `room` (n,) is scratch.

    numba's own sorts take ten times as long to compile.
    """
    n, width = len(values), 1
    for k in range(n):
        order[k] = k
    while width < n:
        for low in range(0, n, 2 * width):
            middle, high = min(low + width, n), min(low + 2 * width, n)
            left, right = low, middle
            for k in range(low, high):
                if left < middle and (right >= high or values[order[left]] <= values[order[right]]):
                    room[k] = order[left]
                    left += 1
                else:
                    room[k] = order[right]
                    right += 1
        for k in range(n):
            order[k] = room[k]
        width *= 2


class _Index(IndexDataCacheFile):  # type: ignore[misc]
    """numba's list of what is stored for a function, by the types of its arguments.

    A list that cannot be read counts as empty: the next compilation writes it anew. That is so where it names
    a type that was renamed or removed since, or where a power cut left it short.
    """

    def _load_index(self) -> dict[Any, str]:
        try:
            listed: dict[Any, str] = super()._load_index()
        except (AttributeError, ImportError, EOFError, pickle.UnpicklingError):
            return {}
        return listed


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


@intrinsic
def add_step(
    _typing: Any, levels: Any, offsets: Any, values: Any, weights: Any, before: Any, sums: Any, _bound: Any
) -> Any:
    """Write the sums of LANES centres, what they were before and TERMS_PER_STEP terms; all by address.

    Says whether any is at most the bound.
    """
    signature = types.boolean(levels, offsets, values, weights, before, sums, types.float32)
    real, word, lanes = ir.FloatType(), ir.IntType(64), ir.VectorType(ir.FloatType(), LANES)
    nobody = ir.Constant(lanes, ir.Undefined)
    first = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        def spread(number: Any) -> Any:
            single = builder.insert_element(nobody, number, ir.Constant(ir.IntType(32), 0))
            return builder.shuffle_vector(single, nobody, first)

        kinds = (real, word, real, real, lanes, lanes)
        pointers = [builder.inttoptr(a, k.as_pointer()) for a, k in zip(arguments, kinds, strict=False)]
        chains = [builder.load(pointers[4], align=4), None]
        for term in range(TERMS_PER_STEP):
            at = ir.Constant(word, term)
            offset, value, weight = (builder.load(builder.gep(p, [at])) for p in pointers[1:4])
            there = builder.bitcast(builder.gep(pointers[0], [offset]), lanes.as_pointer())
            difference = builder.fsub(builder.load(there, align=4), spread(value))
            weighted = builder.fmul(difference, spread(weight))
            product = builder.fmul(weighted, difference, flags=("contract",))
            chain = chains[term % 2]
            chains[term % 2] = product if chain is None else builder.fadd(chain, product, flags=("contract",))
        total = builder.fadd(*chains)
        builder.store(total, pointers[5], align=4)
        is_near = builder.fcmp_ordered("<=", total, spread(arguments[6]))
        return builder.icmp_unsigned(
            "!=", builder.bitcast(is_near, ir.IntType(LANES)), ir.Constant(ir.IntType(LANES), 0)
        )

    return signature, generate


@intrinsic
def take_number(_typing: Any, counter: Any) -> Any:
    """Return the number at an address and raise it by one, as one step for all threads."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pointer = builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())
        return builder.atomic_rmw("add", pointer, ir.Constant(ir.IntType(64), 1), "acq_rel")

    return types.int64(counter), generate


@intrinsic
def read_number(_typing: Any, address: Any) -> Any:
    """Return the number at an address, and see all that was written before it."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pointer = builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())
        return builder.load_atomic(pointer, "acquire", 8)

    return types.int64(address), generate
