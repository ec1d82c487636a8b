# SPDX-License-Identifier: MIT
"""Verdicts: a check of a planted state against its truth, element by element and interval by interval."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import chi2

from benchmarks.cases.asbuilt import Change, PlantedState
from benchmarks.cases.surveys import Sighting
from completion.asbuilt.findings import DesignCheck, ElementFinding, Interval
from scenes.checks import FloatArray

_LEAST_FACE_M2 = 0.5  # of faces whose offsets are judged
_EXTRA_M = 0.1  # between what is an extra and what was found
_BEHIND_M2 = 0.02  # through a body that is not there, where it can be known


@dataclass(frozen=True, slots=True)
class Judged:
    """An element: what was done, what beams met of it, what was said of it."""

    surface: int
    truth: str
    measured: bool
    worst_m: float
    behind: bool
    verdict: str
    kind: str
    related: bool


@dataclass(frozen=True, slots=True)
class Covered:
    """An interval of 95 %: of what, after which change, whether it holds the truth, half its width."""

    what: str
    truth: str
    holds: bool
    half: float


@dataclass(frozen=True, slots=True)
class StateScore:
    """Scores of one state. `extra_right`, `extra_found`: shares of extras; NaN where there are none."""

    judged: list[Judged]
    covered: list[Covered]
    extra_right: float
    extra_found: float


def score(check: DesignCheck, state: PlantedState, seen: Sighting) -> StateScore:
    """Return how a check of a state's scans fared."""
    judged: list[Judged] = []
    covered: list[Covered] = []
    for one in check.elements:
        k, change = one.surface, state.change(one.surface)
        judged.append(
            Judged(
                k, change.label, bool(seen.measured[k]), float(seen.worst_m[k]),
                bool(seen.through_m2[k] >= _BEHIND_M2), one.verdict, one.kind, bool(one.related_extra),
            )
        )  # fmt: skip
        covered += _intervals(one, change)
    found = [extra.points for extra in check.extra if len(extra.points)]
    places = np.concatenate(found) if found else np.zeros((0, 3))
    right, told = _near(places, seen.extra), _near(seen.extra, places)
    return StateScore(judged, covered, right, told)


def _near(places: FloatArray, others: FloatArray) -> float:
    """Share of places (n, 3) with one of the others near."""
    if not len(places) or not len(others):
        return 0.0 if len(places) else float("nan")
    return float((cKDTree(others).query(places)[0] <= _EXTRA_M).mean())


def _intervals(one: ElementFinding, change: Change) -> Iterator[Covered]:
    """Yield the intervals of an element that was built."""
    if change.is_gone or change.kind == "open":
        return

    def held(what: str, stated: Interval, *true: float) -> Covered:
        holds = any(stated.low <= value <= stated.high for value in true)
        return Covered(what, change.kind, holds, (stated.high - stated.low) / 2)

    for face in one.faces:
        if face.kind != "plane" or not face.is_tested or face.area_m2 < _LEAST_FACE_M2:
            continue
        if face.offset is not None and change.kind != "displaced":
            yield held("offset", face.offset, change.offset_at(face.place, face.normal))
        if face.is_main and face.bow is not None and change.kind == "bowed":
            yield held("bow", face.bow, change.size * float(face.normal @ change.normal))
        if face.is_main and face.tilt is not None and change.kind == "tilted":
            yield held("tilt", face.tilt, change.size, -change.size)
    if one.thickness is not None and change.kind in ("unchanged", "moved", "thickness"):
        yield held("thickness", one.thickness, change.size if change.kind == "thickness" else 0.0)
    if one.kind == "displaced" and one.offset is not None and change.kind == "displaced":
        along = np.array(one.offset.along)
        yield held("shift", one.offset, float(change.motion[:3, 3] @ along))


@dataclass(frozen=True, slots=True)
class Share:
    """How many of how many."""

    part: int
    whole: int

    def __str__(self) -> str:
        return f"{self.part} of {self.whole}" + (f" ({self.part / self.whole:.1%})" if self.whole else "")


@dataclass(frozen=True, slots=True)
class Rates:
    """What is promised of a check, over some states at one tolerance."""

    false_deviates: int
    false_missing: int
    false_within: int
    deviating_told: Share  # measured, off by at least twice the tolerance: deviates or missing
    removed_told: Share  # beams behind: missing
    hidden_told: Share  # not measured, standing or removed: hidden
    hidden_missing: int
    left_open: Share  # measured and unchanged, not decided


def rates(judged: Sequence[Judged], tolerance_m: float) -> Rates:
    """Return the rates of elements of some states."""

    def share(of: Sequence[Judged], *words: str) -> Share:
        return Share(sum(one.verdict in words for one in of), len(of))

    still = [one for one in judged if one.truth == "unchanged"]
    small = [one for one in judged if one.truth.startswith("moved") and one.worst_m < tolerance_m * 0.999]
    off = [one for one in judged if one.measured and one.worst_m > tolerance_m * 1.001]
    gone = [one for one in judged if one.truth in ("removed", "hidden removed")]
    hidden = [one for one in judged if one.truth.startswith("hidden") and not one.measured]
    there = [one for one in judged if one.truth not in ("removed", "hidden removed", "displaced", "open")]
    told = [one for one in off if one.worst_m >= 1.999 * tolerance_m and one.truth != "displaced"]
    return Rates(
        share(still + [one for one in small if one.measured], "deviates").part,
        share(there, "missing").part,
        share(off + gone, "within").part,
        share(told, "deviates"),
        share([one for one in gone if one.behind and one.truth == "removed"], "missing"),
        share(hidden, "hidden"),
        share(hidden, "missing").part,
        Share(sum(o.measured and o.verdict not in ("within", "deviates") for o in still),
              sum(o.measured for o in still)),
    )  # fmt: skip


def poisson_bound(count: int, n_states: int) -> float:
    """Return the upper end, 95 %, of a rate a state of which `count` were seen in some.

    Examples
    --------
    >>> round(poisson_bound(0, 8), 2)
    0.37
    """
    return float(chi2.ppf(0.95, 2 * (count + 1)) / 2 / n_states)
