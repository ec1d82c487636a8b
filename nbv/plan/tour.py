# SPDX-License-Identifier: MIT
"""Tour: an order of stations with short legs that keep clear of every surface (`nbv.plan.ways`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from nbv.plan.visiting_order import short_order
from nbv.plan.ways import BODY_M, Leg, Ways
from nbv.run.wording import count
from nbv.visibility.zones import Box
from scenes.checks import FloatArray, InputError, check_points
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Tour:
    """Stations by their numbers in their order, and the legs between them.

    It `is_given` where the stations were to be visited as they come, as scans are that decide the next one.
    """

    order: tuple[int, ...]
    legs: tuple[Leg, ...]
    is_given: bool = False

    def __repr__(self) -> str:
        return f"Tour({count(len(self.order), 'station')}, {self.describe()})"

    @property
    def length_m(self) -> float:
        """Length of all legs that have a way, metres."""
        return float(sum(leg.length_m for leg in self.legs if np.isfinite(leg.length_m)))

    @property
    def n_without_way(self) -> int:
        """How many legs have no way, which the length leaves out."""
        return sum(1 for leg in self.legs if not np.isfinite(leg.length_m))

    def describe(self) -> str:
        """Return the length in words, and how many legs it leaves out.

        Examples
        --------
        >>> there, nowhere = Leg(np.zeros((2, 3)), 3.25), Leg(np.zeros((0, 3)), np.inf)
        >>> Tour((0, 1), (there,)).describe()
        '3.2 m'
        >>> Tour((0, 1, 2), (there, nowhere)).describe()
        '3.2 m, without 1 of 2 legs that has no way (closed doors, storeys without stairs, narrow places)'
        """
        text = f"{self.length_m:.1f} m"
        if not self.n_without_way:
            return text
        have = "has" if self.n_without_way == 1 else "have"
        return (
            f"{text}, without {self.n_without_way} of {count(len(self.legs), 'leg')} that {have} no way "
            "(closed doors, storeys without stairs, narrow places)"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `stations.json`: views counted from 1, length null where there is no way."""
        legs = [
            {"length_m": leg.length_m if len(leg.path) else None, "path": leg.path.tolist()}
            for leg in self.legs
        ]
        order = [number + 1 for number in self.order]
        lost = self.n_without_way
        return {
            "order": order,
            "is_given": self.is_given,
            "length_m": self.length_m,
            "legs_without_way": lost,
            "legs": legs,
        }


def plan_tour(
    mesh: LabelledMesh,
    stations: FloatArray,
    *,
    body_m: float = BODY_M,
    on_foot: bool = False,
    in_order: bool = False,
    keep_out: Sequence[Box] = (),
    first: int | None = None,
    caster: RayCaster | None = None,
) -> Tour:
    """Return a short open tour of `stations` (n, 3), metres, that keeps `body_m` clear of the mesh.

    It begins at the station `first` where that is given. No leg leads through the boxes `keep_out`; on foot
    they count where they stand in a person's way.

    Nearest neighbours from several starts, then 2-opt and the moving of short stretches (Or 1976) until
    neither helps; `in_order` the stations are visited as they come. Legs between stations that no way joins
    come out as such. `on_foot` the ways lead over the floors of all storeys, by steps and stairs. `caster` is
    of the mesh, made here when not given.

    Raises
    ------
    InputError
        A body without size.
    """
    if not body_m > 0:
        raise InputError(f"body_m must be positive, got {body_m}")
    stations = check_points("stations", stations)
    if len(stations) < 2:
        return Tour(tuple(range(len(stations))), (), in_order)
    if on_foot:
        caster = caster or RayCaster(mesh.vertices, mesh.faces)
        ways = Ways.walked(mesh, caster, stations, body_m=body_m, keep_out=keep_out)
    else:
        ways = Ways.flown(mesh, stations, body_m=body_m, keep_out=keep_out)
    order = list(range(len(stations))) if in_order else short_order(ways.lengths, first)
    legs = tuple(ways.leg(a, b) for a, b in pairwise(order))
    return Tour(tuple(order), legs, in_order)


@dataclass(frozen=True, slots=True)
class Overlap:
    """Two views, counted from 0, whose scans can be registered with one another.

    `share` is of the smaller one's surface what both measure, `stiffness` the least eigenvalue of the
    normalised Hessian (`nbv.cover.overlap`).
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
    """A tour with collision-free legs, and all pairs of a plan's stations that are linked.

    `n_groups` are the groups of views that links join; 1 when all scans can be registered. Both are None
    where overlap was not looked at: in plans of scenes that the planner did not know, and of baselines.
    """

    tour: Tour
    overlaps: tuple[Overlap, ...] | None = None
    n_groups: int | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the contents of `stations.json`."""
        links = None if self.overlaps is None else [overlap.to_json() for overlap in self.overlaps]
        return {"tour": self.tour.to_json(), "overlaps": links, "groups": self.n_groups}
