# SPDX-License-Identifier: MIT
"""Truth of things: which pixels of a scan are of which thing, and what separation made of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray

LEAST = 0.002  # share of a scan's pixels of a true thing that is asked for
_SAME = 0.5  # intersection over union
_PART = 0.25  # of the pixels of what is found, from which it holds another thing
_HUNG = re.compile(
    r"room \d+ (picture|mirror|ceiling lamp|(tall )?radiator|wall shelf|basin|parapet|podium|stairs|rug)"
    r"( \d+)?(: .*)?$|.*: (pillow|row) \d+.*|.*(curtain|blind).*|.*sill$|post \d+ .*"
)
_BUILT = re.compile(r"room \d+ (casing|column) \d+: .*")
_SIDE = re.compile(r"(box \d+|drum|table|cabinet|screen)( .*)?$")


@dataclass(frozen=True, slots=True)
class Separated:
    """What became of the things of some scans; all are counts.

    Attributes
    ----------
    asked, found : int
        True things that fill enough of a scan, and those that one thing found agrees with.
    told : int
        Things found, without those that may be called either.
    joined, cut, false : int
        Of those that agree with none: with several true things in it, with a part of one, with neither.
    """

    asked: int = 0
    found: int = 0
    told: int = 0
    joined: int = 0
    cut: int = 0
    false: int = 0

    @property
    def n_right(self) -> int:
        """How many of those that were found are right."""
        return self.told - self.joined - self.cut - self.false

    def __add__(self, other: Separated) -> Separated:
        """Count both."""
        names = ("asked", "found", "told", "joined", "cut", "false")
        return Separated(*(getattr(self, name) + getattr(other, name) for name in names))


def instances(names: Sequence[str], room: int | None = None) -> NDArray[np.int32]:
    """Return of which thing (n + 1,) each surface of a scene is, from 1, by their names; the last for no hit.

    0 for the building, -1 for what may be called a thing or not: what hangs on walls, cushions, curtains, and
    all in other rooms than `room`.
    """
    known: dict[str, int] = {}
    found = [_instance(name, room) for name in names]
    numbers = [
        0 if one == "" else -1 if one == "?" else known.setdefault(one, len(known) + 1) for one in found
    ]
    return np.array([*numbers, 0], dtype=np.int32)


def _instance(name: str, room: int | None) -> str:
    """The thing that a surface is of: "" for the building, "?" for either."""
    side = _SIDE.match(name)
    if side and ":" not in name:
        return side[1]
    if _HUNG.match(name):
        return "?"
    if ": " not in name or _BUILT.match(name):
        return ""
    prefix, part = name.split(": ", 1)
    if room is not None and not prefix.startswith(f"room {room} "):
        return "?"
    if " boxes " in prefix:
        part = "box" if part.startswith("box flap") else part
        return f"{prefix}: {part}"
    return f"{prefix}: laundry bowl" if part == "laundry bowl" else prefix


def judge(truth: NDArray[np.int32], found: Sequence[BoolArray], valid: BoolArray) -> Separated:
    """Compare things that were found with the true ones in one scan.

    Parameters
    ----------
    truth : (rows, columns) int32
        The true thing of each pixel, from 1; 0 for the building, -1 for either.
    found : sequence of (rows, columns) bool
        The pixels of each thing.
    valid : (rows, columns) bool
        Where something came back.
    """
    n = int(truth.max(initial=0)) + 1
    whole = np.bincount(truth[valid & (truth >= 0)], minlength=n)
    least = LEAST * truth.size
    asked, right = whole >= least, np.zeros(n, dtype=np.bool_)
    asked[0] = False
    told = joined = cut = false = 0
    for mask in found:
        inside = truth[mask & valid]
        if not len(inside) or (inside < 0).mean() > 0.5:
            continue
        inside = inside[inside >= 0]
        own = np.bincount(inside, minlength=n)
        overlap = own / (whole + len(inside) - own)
        overlap[0] = 0
        best = int(overlap.argmax())
        told += 1
        if overlap[best] >= _SAME:
            right[best] = True
        elif (own[1:] > _PART * len(inside)).sum() > 1:
            joined += 1
        elif own[1:].max(initial=0) > 0.5 * len(inside):
            cut += 1
        else:
            false += 1
    return Separated(int(asked.sum()), int((asked & right).sum()), told, joined, cut, false)
