# SPDX-License-Identifier: MIT
"""Rules of thumb: where surveyors put stations in a building without a planner.

"rule:grid5m" puts one at each point of a square grid of 5 m, and one into each room that no point falls in;
"rule:rooms-and-doorways" one into the middle of each room, and one into each doorway between two of them.
They are for instruments that turn by themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from nbv.coverage.coverage import Coverage
from nbv.coverage.measurement import CoverageTally
from nbv.online.limits import GRID_M, INSTRUMENT_M, ONE_DOORWAY_M
from nbv.plan.plan import Plan
from nbv.scanning.sensor import View
from nbv.visibility.rooms import SiteRoom
from nbv.visibility.site import Site
from nbv.visibility.viewpoints import Candidates
from scenes.checks import FloatArray
from scenes.rays.raycast import RayCaster


@dataclass(frozen=True, slots=True)
class RuleOutcome:
    """What the stations of a rule measure, by the same samples as the plan beside it.

    Attributes
    ----------
    name : str
        Of the rule, as `RULES` has it.
    stations : int
        How many it takes.
    met, met_of_reachable : float
        Share of the area that they measure as required, and of that which can be reached.
    stations_to_target : int or None
        How many of them, each time the one that adds most, until the plan's target is met; None where all of
        them do not.
    """

    name: str
    stations: int
    met: float
    met_of_reachable: float
    stations_to_target: int | None

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`."""
        return {
            "stations": self.stations,
            "met": self.met,
            "met_of_reachable": self.met_of_reachable,
            "stations_to_target": self.stations_to_target,
        }


def grid_places(site: Site, step_m: float = GRID_M) -> FloatArray:
    """Return the places (k, 3) on the floor of the rooms asked for that a grid of `step_m` has, metres.

    Each room's grid lies in the middle of its floor's extent; a room that no point of it falls in has its
    middle.
    """
    columns, places = site.rooms.floors.columns, []
    for room in _rooms_of(site):
        spans = np.flatnonzero(site.rooms.room == room.number)
        floor = columns.places(columns.cell[spans])
        low, high = floor.min(axis=0), floor.max(axis=0)
        lines = [
            (a + b) / 2 + step_m * (np.arange(n) - (n - 1) / 2)
            for a, b in zip(low, high, strict=True)
            for n in [max(round((b - a) / step_m), 1)]
        ]
        points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
        off, nearest = cKDTree(floor).query(points)
        on = off <= 1.5 * columns.cell_m
        here = np.column_stack([points[on], columns.bottom[spans[nearest[on]]]])
        places.append(here if len(here) else np.array([room.place]))
    return np.vstack(places)


def room_and_doorway_places(site: Site) -> FloatArray:
    """Return the middles of the rooms asked for, and of the doorways between two of them (k, 3), metres."""
    rooms, columns = site.rooms, site.rooms.floors.columns
    places_found = [np.array([room.place for room in _rooms_of(site)])]
    links = rooms.floors.links[np.isin(rooms.room[rooms.floors.links], site.chosen).all(axis=1)]
    pair = np.sort(rooms.room[links], axis=1)
    links, pair = links[pair[:, 0] < pair[:, 1]], pair[pair[:, 0] < pair[:, 1]]
    for room_pair in np.unique(pair, axis=0):
        sides = links[(pair == room_pair).all(axis=1)]
        ends = [np.column_stack([columns.places(columns.cell[s]), columns.bottom[s]]) for s in sides.T]
        places = (ends[0] + ends[1]) / 2
        near = cKDTree(places).query_pairs(ONE_DOORWAY_M, output_type="ndarray")
        graph = coo_array((np.ones(len(near), np.int8), near.T), shape=(len(places),) * 2)
        n, of = connected_components(graph, directed=False)
        places_found += [places[of == k].mean(axis=0)[None] for k in range(n)]
    return np.vstack(places_found)


RULES: Mapping[str, Callable[[Site], FloatArray]] = {
    "rule:grid5m": grid_places,
    "rule:rooms-and-doorways": room_and_doorway_places,
}


def rule_poses(name: str, site: Site, candidates: Candidates) -> list[int]:
    """Return the numbers of the candidate poses nearest to where a rule puts its stations, each once."""
    return nearest_poses(RULES[name](site), candidates)


def nearest_poses(places: FloatArray, candidates: Candidates) -> list[int]:
    """Return the numbers of the candidate poses nearest to places (k, 3) on the floor, metres, each once.

    An instrument is 1.6 m above the floor, or at the nearest height that there is.
    """
    numbers = [_nearest(candidates.positions, place + [0.0, 0.0, INSTRUMENT_M]) for place in places]
    return [number * candidates.n_directions for number in dict.fromkeys(numbers)]


def compare_with_rules(caster: RayCaster, plan: Plan) -> tuple[RuleOutcome, ...]:
    """Measure the rules of thumb on a plan's own samples; nothing for cameras, objects and resumed plans."""
    coverage, site, candidates = plan.coverage, plan.site, plan.candidates
    if site is None or candidates is None or not isinstance(coverage, Coverage) or not plan.views:
        return ()
    if plan.sensor.kind != "spherical" or plan.resumed_from is not None or plan.requirement.k > 1:
        return ()
    outcomes = []
    for name in RULES:
        numbers = rule_poses(name, site, candidates)
        gains = [_met_by(caster, plan, coverage, candidates, number) for number in numbers]
        curve = _greedy_curve(coverage.samples.areas, gains) / coverage.total_m2
        target = (plan.target or 1.0) * coverage.reachable - 1e-9
        outcomes.append(
            RuleOutcome(
                name=name,
                stations=len(numbers),
                met=float(curve[-1]),
                met_of_reachable=float(curve[-1]) / max(coverage.reachable, 1e-12),
                stations_to_target=int(np.argmax(curve >= target)) + 1 if curve[-1] >= target else None,
            )
        )
    return tuple(outcomes)


def _rooms_of(site: Site) -> list[SiteRoom]:
    return [site.rooms.rooms[number - 1] for number in site.chosen]


def _nearest(positions: FloatArray, place: FloatArray) -> int:
    """Number of the position (p, 3) nearest to a place (3,): first from above, and then in height."""
    off = np.linalg.norm(positions - place, axis=1)
    around = np.flatnonzero(off <= off.min() + 2 * INSTRUMENT_M)
    level = np.linalg.norm(positions[around, :2] - place[:2], axis=1)
    storey = np.abs(positions[around, 2] - place[2])
    return int(around[np.lexsort((storey, level.round(6), storey > INSTRUMENT_M))[0]])


def _met_by(
    caster: RayCaster, plan: Plan, coverage: Coverage, candidates: Candidates, number: int
) -> NDArray[np.int64]:
    """Samples (m,) that the view from a candidate pose meets the requirement on."""
    tally = CoverageTally.start(caster, coverage.samples, plan.requirement)
    tally.add(View(candidates.pose(number), plan.sensor))
    return np.flatnonzero(tally.met)


def _greedy_curve(areas: FloatArray, met: list[NDArray[np.int64]]) -> FloatArray:
    """Area (n,) that is met after each station, each time the one that adds most."""
    left, curve, open_ = areas.copy(), [0.0], list(met)
    while open_:
        gains = [float(left[samples].sum()) for samples in open_]
        best = int(np.argmax(gains))
        curve.append(curve[-1] + gains[best])
        left[open_.pop(best)] = 0.0
    return np.array(curve[1:])
