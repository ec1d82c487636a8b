# SPDX-License-Identifier: MIT
"""Summary: the outcomes of a study that differ by their seed alone, together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nbv.study.outcome import Outcome
from scenes.checks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Outcomes of one scene, sensor, requirement and planner.

    Attributes
    ----------
    scene, sensor, requirement, planner : str
        Labels.
    outcomes : tuple of Outcome
        One a seed, those that could be planned.
    n_failed : int
        How many could not.
    """

    scene: str
    sensor: str
    requirement: str
    planner: str
    outcomes: tuple[Outcome, ...]
    n_failed: int

    @property
    def setting(self) -> tuple[str, str, str]:
        """Scene, sensor and requirement."""
        return self.scene, self.sensor, self.requirement

    def views_to(self, share: float) -> FloatArray:
        """Views (n,) of each outcome until `share` of the reachable area is measured; inf for never."""
        found = [outcome.views_to(share) for outcome in self.outcomes]
        return np.array([np.inf if views is None else views for views in found], dtype=np.float64)

    def values(self, name: str) -> FloatArray:
        """Values (n,) of a column of the results; nan for none."""
        found = [outcome.row()[name] for outcome in self.outcomes]
        return np.array([np.nan if value is None else value for value in found], dtype=np.float64)

    def curves(self) -> FloatArray:
        """Share of the reachable area (n, n_most + 1) measured before the first and after each view.

        A plan that has ended stays where it was.
        """
        found = [outcome.of_reachable for outcome in self.outcomes]
        n_most = max((len(curve) for curve in found), default=1)
        padded = [np.concatenate([curve, np.full(n_most - len(curve), curve[-1])]) for curve in found]
        return np.array(padded).reshape(len(found), n_most)


def groups_of(outcomes: Sequence[Outcome]) -> tuple[Group, ...]:
    """Return the outcomes in groups, in the order of the study file."""
    members: dict[tuple[str, str, str, str], list[Outcome]] = {}
    for outcome in outcomes:
        labels = outcome.case.labels()
        key = (labels["scene"], labels["sensor"], labels["requirement"], labels["planner"])
        members.setdefault(key, []).append(outcome)
    return tuple(
        Group(
            *key,
            outcomes=tuple(one for one in found if not one.error),
            n_failed=sum(bool(one.error) for one in found),
        )
        for key, found in members.items()
    )
