# SPDX-License-Identifier: MIT
"""Stored code: whether compiled loops can be kept from one process to the next."""

from __future__ import annotations

import logging
from functools import cache

from numba import njit


@cache
def can_store() -> bool:
    """Tell whether numba finds a folder for compiled code; say so in one line where it does not.

    It finds none where neither the installation nor the user's home can be written, as in containers that
    run as another user.
    """
    try:
        njit(cache=True)(_nothing)
    except RuntimeError:
        logging.getLogger(__name__).warning(
            "no folder for compiled code can be written: each run compiles anew, which takes a minute; "
            "set NUMBA_CACHE_DIR to a folder that can"
        )
        return False
    return True


def _nothing() -> None: ...
