# SPDX-License-Identifier: MIT
"""LZF: the packing of compressed PCD files, undone a part at a time by compiled code."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from scenes.run.stored_code import can_store


@njit(cache=can_store(), nogil=True)
def unpack_some(packed: NDArray[np.uint8], out: NDArray[np.uint8], n_out: int, last: int) -> tuple[int, int]:
    """Write to `out` (n,), of which `n_out` bytes are there, what instructions that begin before `last` say.

    Returns how many bytes of `packed` were used, -1 where they are damaged, and how many of `out` are there.
    """
    at = 0
    while at < last:
        control = int(packed[at])
        at += 1
        source, length = at, control + 1
        if control >= 32:  # what was written before, else what comes next
            length = (control >> 5) + 2
            if length == 9:
                if at >= packed.size:
                    return -1, n_out
                length += int(packed[at])
                at += 1
            if at >= packed.size:
                return -1, n_out
            source = n_out - ((control & 31) << 8) - int(packed[at]) - 1
            at += 1
            if source < 0 or n_out + length > out.size:
                return -1, n_out
            for k in range(length):
                out[n_out + k] = out[source + k]
        else:
            at += length
            if at > packed.size or n_out + length > out.size:
                return -1, n_out
            for k in range(length):
                out[n_out + k] = packed[source + k]
        n_out += length
    return at, n_out
