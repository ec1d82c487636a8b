# SPDX-License-Identifier: MIT
"""Pairs: three pairs of scans of each room that look 30 to 120 degrees apart, and strangers."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from benchmarks.registration.rooms import Room, is_right, overlap
from completion.registration.candidates.station_view import StationView
from completion.registration.hypotheses import Hypothesis, find_hypotheses
from completion.registration.pipeline import LEVEL
from completion.registration.verdict import Verdict, judge

_BINS = (0.1, 0.2, 0.4, 1.0)


def pair_table(first: int, n_rooms: int) -> Iterator[str]:
    """Yield the lines of a table: pairs by overlap, and strangers."""
    rows: list[tuple[float, list[Hypothesis], list[bool], float]] = []
    strangers: list[list[Hypothesis]] = []
    before: StationView | None = None
    for seed in range(first, first + n_rooms):
        room = Room(seed)
        for _ in range(3):
            a, b = room.pair()
            shared = overlap(a, b)
            started = time.process_time()
            one, two = StationView.of(a), StationView.of(b)
            found = find_hypotheses(one, two)
            rows.append(
                (
                    shared,
                    found,
                    [is_right(each.motion, a, b) for each in found],
                    time.process_time() - started,
                )
            )
            if before is not None:
                strangers.append(find_hypotheses(before, two))
        before = one
    yield "| overlap | pairs | best is right | of these claimed | else truth among them | wrong claims |"
    yield "|---|---|---|---|---|---|"
    for low, high in pairwise(_BINS):
        own = [row for row in rows if low <= row[0] < high]
        claimed = [judge(row[1], LEVEL).verdict is Verdict.REGISTERED for row in own]
        best = [bool(row[2]) and row[2][0] for row in own]
        sure = sum(c and r for c, r in zip(claimed, best, strict=True))
        among = [any(row[2]) for row, c in zip(own, claimed, strict=True) if not c]
        wrong = sum(c and not r for c, r in zip(claimed, best, strict=True))
        yield (
            f"| {100 * low:.0f}-{100 * high:.0f} % | {len(own)} | {sum(best)} | {sure} "
            f"| {sum(among)} of {len(among)} | {wrong} |"
        )
    false = sum(judge(one, LEVEL).verdict is Verdict.REGISTERED for one in strangers)
    yield f"| strangers | {len(strangers)} | | | | {false} |"
    yield f"median {np.median([row[3] for row in rows]):.2f} CPU s a pair, segmentation included"
