# SPDX-License-Identifier: MIT
"""Morton order: points sorted so that neighbours in the list are neighbours in space.

Rays to points in this order share most of their way through Embree's tree, which makes a million of them
about twice as fast; sort once, cast often.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenes.checks import check_points

_BITS = 10
_SPREAD = ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249))  # 10 bits to every third


def morton_order(points: object) -> NDArray[np.int64]:
    """Order (n,) of points (n, 3) along a Morton curve with 1024 steps a side; ties keep their order.

    G. M. Morton, "A computer oriented geodetic data base", 1966: the bits of the three coordinates take
    turns in the key that is sorted by.

    Raises InputError: wrong shape, or points that are not finite.

    Examples
    --------
    >>> morton_order([[9, 9, 9], [0, 0, 0], [8, 9, 9], [1, 0, 0]]).tolist()
    [1, 3, 2, 0]
    """
    checked = check_points("points", points)
    if not len(checked):
        return np.zeros(0, np.int64)
    low = checked.min(axis=0)
    side = max(float((checked.max(axis=0) - low).max()), 1e-300)
    code = np.zeros(len(checked), np.uint32)
    for axis in range(3):
        steps = (checked[:, axis] - low[axis]) / side * 2**_BITS
        spread = np.minimum(steps, 2**_BITS - 1).astype(np.uint32)
        for shift, mask in _SPREAD:
            spread = (spread | (spread << np.uint32(shift))) & np.uint32(mask)
        code |= spread << np.uint32(axis)
    return np.argsort(code, kind="stable")
