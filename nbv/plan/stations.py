# SPDX-License-Identifier: MIT
"""Stations of an offline plan: the order in which to visit them, and which of their scans overlap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from nbv.plan.tour import Tour


@dataclass(frozen=True, slots=True)
class Overlap:
    """Two views, counted from 0, whose scans can be registered with one another.

    Attributes
    ----------
    first, second : int
        The views.
    share : float
        Of the smaller one's surface, what both measure.
    stiffness : float
        Least eigenvalue of the normalised Hessian (`nbv.cover.overlap`).
    """

    first: int
    second: int
    share: float
    stiffness: float

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `stations.json`, views counted from 1."""
        views = [self.first + 1, self.second + 1]
        return {"views": views, "overlap": self.share, "stiffness": self.stiffness}


@dataclass(frozen=True, slots=True, eq=False)
class Stations:
    """What there is to know of a plan's stations.

    Attributes
    ----------
    tour : Tour
        A short order, with collision-free legs.
    overlaps : tuple of Overlap
        All pairs that are linked.
    n_groups : int
        Groups of views that links join; 1 when all scans can be registered.
    """

    tour: Tour
    overlaps: tuple[Overlap, ...]
    n_groups: int

    def to_json(self) -> dict[str, Any]:
        """Return the contents of `stations.json`."""
        links = [overlap.to_json() for overlap in self.overlaps]
        return {"tour": self.tour.to_json(), "overlaps": links, "groups": self.n_groups}
