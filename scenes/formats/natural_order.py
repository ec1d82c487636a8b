# SPDX-License-Identifier: MIT
"""Natural order: names with numbers in them, sorted so that frame 10 comes after frame 9."""

from __future__ import annotations

import re


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Return the key under which names are in natural order.

    Examples
    --------
    >>> sorted(["10.png", "9.png", "a2.png"], key=natural_key)
    ['9.png', '10.png', 'a2.png']
    """
    parts = re.split(r"(\d+)", name)
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts]
