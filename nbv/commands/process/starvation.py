# SPDX-License-Identifier: MIT
"""Starvation: whether memory ran out, whatever the error is called that came of it."""

from __future__ import annotations

import errno
import sys
from collections.abc import Sequence

NOT_ENOUGH = "not enough memory for this input; use a smaller one, coarser options, or a larger limit"
_SIGNS = (
    "cannot allocate memory",
    "failed to map segment",
    "can't start new thread",
    "out of memory",
    "insufficient memory",
    "unable to allocate",
)


def is_starved(error: BaseException) -> bool:
    """Tell whether an error, or one that led to it, says that memory ran out.

    Numpy and Python raise MemoryError, but threads that cannot start, libraries that cannot be loaded, Embree
    and OpenCV have words of their own. Under a limit an internal error of the interpreter counts, too.

    Examples
    --------
    >>> is_starved(RuntimeError("can't start new thread")), is_starved(RuntimeError("no such thing"))
    (True, False)
    """
    chain: list[BaseException] = []
    link: BaseException | None = error
    while link is not None and link not in chain:
        chain.append(link)
        link = link.__cause__ or link.__context__
    return any(
        isinstance(one, MemoryError)
        or getattr(one, "errno", None) == errno.ENOMEM
        or (isinstance(one, SystemError) and is_limited(sys.argv))
        or any(sign in str(one).lower() for sign in _SIGNS)
        for one in chain
    )


def is_limited(arguments: Sequence[str]) -> bool:
    """Tell whether there is a limit on the memory of this process, by the system or by its command line."""
    if sys.platform == "win32":
        return False
    import resource

    limits = [resource.getrlimit(which)[0] for which in (resource.RLIMIT_AS, resource.RLIMIT_DATA)]
    asked = any(argument.startswith("--max-memory") for argument in arguments)
    return asked or any(limit != resource.RLIM_INFINITY for limit in limits)
