# SPDX-License-Identifier: MIT
"""Consequence: what a statement changes in a completion, in numbers and sentences, before it is taken."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.stats import norm

from completion.relations.relation import Relation, RelationStatus, kind_text
from completion.result.completion import Completion
from completion.result.unknown import unknown_m2
from scenes.checks import FloatArray

_SAME_M2, _SAME_M = 1e-4, 1e-6  # areas and places that differ by less are the same
_NEAR_M = 1e-9  # two surfaces with the same anchor are one


@dataclass(frozen=True, slots=True)
class SurfaceChange:
    """A surface before and after: numbers (None where it is not), areas in square metres, how far it moved.

    `moved_sd` is in standard deviations of the place where it was measured.
    """

    before: int | None
    after: int | None
    kind: str
    measured_m2: tuple[float, float]
    inferred_m2: tuple[float, float]
    unknown_m2: tuple[float, float]
    moved_mm: float
    moved_sd: float


@dataclass(frozen=True, slots=True)
class Consequence:
    """What follows from a statement.

    Attributes
    ----------
    measured_m2, inferred_m2, unknown_m2 : (float, float)
        Before and after.
    surfaces : tuple of SurfaceChange
        Those that change.
    sentences : tuple of str
        What came of it, in plain words: tests with their numbers, and what beams overrule.
    is_refused : bool
        Whether the scans speak against it: a relation that was rejected, an area that beams keep empty.
    seconds : float
        How long it took.
    """

    measured_m2: tuple[float, float]
    inferred_m2: tuple[float, float]
    unknown_m2: tuple[float, float]
    surfaces: tuple[SurfaceChange, ...]
    sentences: tuple[str, ...]
    is_refused: bool
    seconds: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """Return what the page shows."""
        return asdict(self)


def compare(before: Completion, after: Completion, statement: Mapping[str, Any]) -> Consequence:
    """Return what differs between two completions of the same scans, the second with a statement more."""
    sentences, is_refused = [], False
    if "do" in statement:
        vetoed = _effect(after, "vetoed_m2") - _effect(before, "vetoed_m2")
        kept = _effect(after, "measured_m2") - _effect(before, "measured_m2")
        if vetoed > _SAME_M2:
            sentences.append(f"{vetoed:.2f} m2 of it stay empty: beams went through there.")
        if kept > _SAME_M2:
            sentences.append(f"{kept:.2f} m2 of it stay: they were measured.")
        filled = _effect(after, "filled_m2") - _effect(before, "filled_m2")
        is_refused = max(vetoed, kept) > _SAME_M2 and filled <= _SAME_M2
    else:
        relation = _stated_last(after)
        if relation is not None:
            sentences.append(_told(relation))
            is_refused = not relation.holds
    surfaces = tuple(_changes(before, after))
    inferred = before.hypothesised_m2, after.hypothesised_m2
    if not surfaces:
        sentences.append("Nothing changes.")
    return Consequence(
        measured_m2=(before.observed_m2, after.observed_m2),
        inferred_m2=inferred,
        unknown_m2=(_unknown_m2(before), _unknown_m2(after)),
        surfaces=surfaces,
        sentences=tuple(sentences),
        is_refused=is_refused,
    )


def _unknown_m2(completion: Completion) -> float:
    return sum(unknown_m2(patch) for patch in completion.patches)


def _effect(completion: Completion, name: str) -> float:
    return sum(float(getattr(surface.effect, name)) for surface in completion.surfaces)


def _stated_last(completion: Completion) -> Relation | None:
    """The relation that was stated last."""
    relations = completion.relations
    given = [] if relations is None else [one for one in relations.graph.relations if one.is_given]
    return given[-1] if given else None


def _told(relation: Relation) -> str:
    """What came of a relation, with its probability and its misfit in standard deviations."""
    name = f"{'not ' if relation.is_forbidden else ''}{kind_text(relation.kind)}"
    word = {
        RelationStatus.ACCEPTED: "holds, and is imposed",
        RelationStatus.REDUNDANT: "holds already by the others",
        RelationStatus.IMPLIED: "holds already by the others",
        RelationStatus.REJECTED: "is refused by the scans",
        RelationStatus.UNDECIDED: "is undecided",
    }[relation.status]
    tail = f" {relation.reason}." if relation.reason else ""
    if not np.isfinite(relation.p):
        return f"{name}: {word}.{tail}"
    misfit = float(norm.isf(max(relation.p, 1e-300) / 2))
    return f"{name}: {word}; p {relation.p:.2g}, {misfit:.1f} standard deviations off.{tail}"


def _changes(before: Completion, after: Completion) -> Iterator[SurfaceChange]:
    """Surfaces that are no longer the same, by the places at which they were measured."""
    olds, news = ([one.anchor(k) for k in range(1, len(one.patches) + 1)] for one in (before, after))
    free = set(range(len(news)))
    for k, place in enumerate(olds):
        same = [m for m in free if np.abs(news[m] - place).max() < _NEAR_M]
        change = _change(before, after, k, same[0] if same else None, place)
        free -= set(same[:1])
        if change is not None:
            yield change
    for m in sorted(free):
        change = _change(before, after, None, m, news[m])
        if change is not None:
            yield change


def _change(
    before: Completion, after: Completion, old: int | None, new: int | None, place: FloatArray
) -> SurfaceChange | None:
    """How a surface changed; None where it did not."""
    patches = [one.patches[k] if k is not None else None for one, k in ((before, old), (after, new))]
    kind = next(patch.grid.surface.kind for patch in patches if patch is not None)
    areas = [
        (0.0, 0.0, 0.0) if one is None else (one.observed_m2, one.hypothesised_m2, unknown_m2(one))
        for one in patches
    ]
    moved_m, sd = 0.0, 1.0
    first, last = patches
    if first is not None and last is not None:
        here = before.world_from_reference.inverse().apply(place[None])
        moved_m = float(abs(last.grid.surface.distance(here)[0] - first.grid.surface.distance(here)[0]))
        sd = float(first.stated.standard_deviation(here)[0])
    is_same = old is not None and new is not None and moved_m < _SAME_M
    if is_same and all(abs(a - b) < _SAME_M2 for a, b in zip(*areas, strict=True)):
        return None
    measured, inferred, unknown = zip(*areas, strict=True)
    return SurfaceChange(
        before=None if old is None else old + 1,
        after=None if new is None else new + 1,
        kind=kind,
        measured_m2=measured,
        inferred_m2=inferred,
        unknown_m2=unknown,
        moved_mm=1000 * moved_m,
        moved_sd=moved_m / max(sd, 1e-12),
    )
