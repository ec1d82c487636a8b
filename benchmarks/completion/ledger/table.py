# SPDX-License-Identifier: MIT
"""Table: stated confidence beside what came true, by reason and by confidence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.completion.ledger.entries import Entry

BINS = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
_N_RESAMPLES = 1000
_MOST_UNKNOWN = 0.7  # share of the area beyond which nothing is claimed


@dataclass(frozen=True, slots=True)
class Row:
    """Pooled entries.

    Attributes
    ----------
    name : str
        What they have in common.
    n_surfaces : int
        Surfaces with area that is known to be right or wrong.
    right_m2, wrong_m2, unknown_m2 : float
        Square metres.
    stated : float
        Mean confidence of what is known.
    low, high : float
        95 % interval of the precision, surfaces drawn anew with replacement (Efron & Tibshirani 1993).
    """

    name: str
    n_surfaces: int
    right_m2: float
    wrong_m2: float
    unknown_m2: float
    stated: float
    low: float
    high: float

    @property
    def precision(self) -> float:
        """Right over right and wrong area; NaN where neither is known."""
        known = self.right_m2 + self.wrong_m2
        return self.right_m2 / known if known > 0 else float("nan")

    @property
    def decides(self) -> bool:
        """Whether enough is known of the area for any claim."""
        area = self.right_m2 + self.wrong_m2 + self.unknown_m2
        return area > 0 and self.unknown_m2 <= _MOST_UNKNOWN * area


def row(name: str, entries: Sequence[Entry]) -> Row:
    """Pool some entries."""
    surfaces: dict[tuple[str, tuple[int, ...], int], list[float]] = {}
    stated = known = 0.0
    for one in entries:
        if one.right_m2 + one.wrong_m2 > 0:
            pair = surfaces.setdefault((one.source, one.frames, one.surface), [0.0, 0.0])
            pair[0] += one.right_m2
            pair[1] += one.wrong_m2
            stated += one.confidence * (one.right_m2 + one.wrong_m2)
            known += one.right_m2 + one.wrong_m2
    low = high = float("nan")
    if surfaces:
        areas = np.array(list(surfaces.values()))
        picks = np.random.default_rng(0).integers(0, len(areas), (_N_RESAMPLES, len(areas)))
        drawn = areas[picks].sum(axis=1)
        low, high = (float(value) for value in np.quantile(drawn[:, 0] / drawn.sum(axis=1), [0.025, 0.975]))
    return Row(
        name=name,
        n_surfaces=len(surfaces),
        right_m2=sum(one.right_m2 for one in entries),
        wrong_m2=sum(one.wrong_m2 for one in entries),
        unknown_m2=sum(one.unknown_m2 for one in entries),
        stated=stated / known if known else float("nan"),
        low=low,
        high=high,
    )


def rows_by(entries: Sequence[Entry], key: Callable[[Entry], str]) -> list[Row]:
    """Pool entries with the same key, in its order."""
    named = [(key(one), one) for one in entries]
    return [row(name, [one for own, one in named if own == name]) for name in sorted({n for n, _ in named})]


def bin_of(entry: Entry) -> str:
    """Name the bin that an entry's confidence falls into."""
    at = int(np.clip(np.searchsorted(BINS, entry.confidence, side="right") - 1, 0, len(BINS) - 2))
    return f"{BINS[at]:.2f}-{BINS[at + 1]:.2f}"


def table(rows: Iterable[Row]) -> str:
    """Write rows as a Markdown table."""
    lines = [
        "| | surfaces | right m2 | wrong m2 | unknown m2 | precision | 95 % | stated | |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for one in rows:
        inside = one.low <= one.stated <= one.high and abs(one.stated - one.precision) <= 0.05
        verdict = "decides nothing" if not one.decides else "" if inside else "off"
        lines.append(
            f"| {one.name} | {one.n_surfaces} | {one.right_m2:.2f} | {one.wrong_m2:.2f} "
            f"| {one.unknown_m2:.2f} | {one.precision:.3f} | {one.low:.2f}-{one.high:.2f} "
            f"| {one.stated:.3f} | {verdict} |"
        )
    return "\n".join(lines)
