# SPDX-License-Identifier: MIT
"""Blockers: what to move so that elements can be seen, and why others cannot be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from completion.asbuilt.findings import DesignCheck, ElementFinding, Extra
from nbv.inspection.obstacles import Obstacles
from nbv.inspection.targets import PROMISED_BEAMS, PROMISED_M2, Left, Targets
from nbv.visibility.requirement import SightLimits
from scenes.checks import FloatArray, Value

_MOST_SAMPLES, _MOST_PLACES = 100, 400  # of an element, and from where they are looked at
_LIFT_M = 1e-3  # off the face


@dataclass(frozen=True, slots=True, eq=False)
class Move(Value):
    """An extra to move: the elements that it hides from all standing places, and their hidden area."""

    extra: Extra
    elements: tuple[ElementFinding, ...]
    area_m2: float

    def sentence(self) -> str:
        """Say what to move, and what that shows."""
        sides = np.maximum(np.ptp(self.extra.box_m, axis=0), 0.1)
        size = " x ".join(f"{side:.1f}" for side in sides)
        names = named(self.elements)
        return f"Move {self.extra.name} ({size} m) to see {names}: {self.area_m2:.2f} m2."


def named(elements: Sequence[ElementFinding]) -> str:
    """Return the names of elements in a row, the number of those beyond six."""
    names = [element.element.name for element in elements]
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def find_blockers(
    check: DesignCheck,
    targets: Targets,
    numbers: Sequence[int],
    *,
    places: FloatArray,
    obstacles: Obstacles,
    limits: SightLimits,
) -> tuple[tuple[Move, ...], tuple[Left, ...]]:
    """Return which extras hide the elements `numbers` of `targets`, and why others cannot be seen.

    Each element's samples are looked at from the standing places (p, 3), metres. Where a line of sight is
    free of the design, the extra that is first on it hides the sample; of several the one on most lines.
    """
    places = places[:: -(-len(places) // _MOST_PLACES)]
    left, of_extra = list[Left](), dict[int, list[tuple[ElementFinding, float]]]()
    for number in numbers:
        element = targets.elements[number]
        sight = _Sight.of(targets, number, places=places, obstacles=obstacles, limits=limits)
        most = max(sight.by_extra, key=lambda k: (sight.by_extra[k], -k), default=None)
        if most is not None and sight.by_extra[most] >= PROMISED_M2:
            of_extra.setdefault(most, []).append((element, sight.by_extra[most]))
        else:
            left.append(Left(element, sight.reason()))
    moves = [
        Move(check.extra[k], tuple(element for element, _ in hidden), sum(area for _, area in hidden))
        for k, hidden in of_extra.items()
    ]
    return tuple(sorted(moves, key=lambda move: (-move.area_m2, move.extra.name))), tuple(left)


@dataclass(frozen=True, slots=True)
class _Sight:
    """Areas of an element, square metres: in sight of some place, behind each extra, behind the design.

    `out` is what no place has in range and steep enough; `is_near` whether some place has any in range.
    """

    seen: float
    by_extra: dict[int, float]
    behind: float
    out: float
    is_near: bool

    @classmethod
    def of(
        cls, targets: Targets, number: int, *, places: FloatArray, obstacles: Obstacles, limits: SightLimits
    ) -> _Sight:
        """Look at an element from all places (p, 3)."""
        rows = np.flatnonzero(targets.owner[targets.face] == number)
        few = rows[:: -(-len(rows) // _MOST_SAMPLES)]
        held = targets.samples
        areas = held.areas[few] * float(held.areas[rows].sum() / held.areas[few].sum())
        starts = held.points[few] + _LIFT_M * held.normals[few]
        way = places[None] - starts[:, None]
        away = np.linalg.norm(way, axis=2)
        cosine = np.einsum("npk,nk->np", way, held.normals[few]) / np.maximum(away, 1e-9)
        faces = limits.hold(away.ravel(), cosine.ravel()).reshape(away.shape)
        sample, place = np.nonzero(faces)
        free = ~obstacles.design.are_blocked(starts[sample], places[place])
        sample, place = sample[free], place[free]
        hits = obstacles.caster.first_hit(places[place], starts[sample] - places[place])
        blocked = hits.ranges < away[sample, place] - _LIFT_M / 2
        seen = np.isin(np.arange(len(few)), sample[~blocked])
        in_reach, open_ = faces.any(axis=1), np.isin(np.arange(len(few)), sample)
        by = -2 - obstacles.owner[hits.face[blocked]].astype(np.int64)
        n_extras = int(by.max(initial=-1)) + 1
        lines = np.bincount(sample[blocked] * n_extras + by, minlength=len(few) * n_extras)
        hidden = np.flatnonzero(open_ & ~seen)
        most = lines.reshape(len(few), n_extras)[hidden].argmax(axis=1) if n_extras else hidden
        by_extra = {int(k): float(areas[hidden[most == k]].sum()) for k in np.unique(most)}
        return cls(
            float(areas[seen].sum()), by_extra, float(areas[in_reach & ~open_].sum()),
            float(areas[~in_reach].sum()), bool(limits.in_range(away.ravel()).any()),
        )  # fmt: skip

    def reason(self) -> str:
        """Say why no scan settles the element."""
        hidden = sum(self.by_extra.values())
        most = max(self.seen, hidden, self.behind, self.out)
        if most == self.out:
            if not self.is_near:
                return "it is out of range of all standing places"
            return "all standing places are behind its main faces, or see them too obliquely"
        if most == self.behind:
            return "it is behind the design from all standing places"
        return (
            f"no standing place sees {PROMISED_M2:g} m2 of a main face with {PROMISED_BEAMS} beams: "
            f"{self.seen:.2f} m2 are in sight, {self.behind:.2f} m2 behind the design, "
            f"{hidden:.2f} m2 behind extras"
        )
