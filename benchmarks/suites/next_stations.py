# SPDX-License-Identifier: MIT
"""Next stations of a check: what was open and is settled once they are taken, beside coverage alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.cases.asbuilt import PlantedState, duplex, planted_state
from benchmarks.cases.surveys import SETTINGS, survey
from benchmarks.run import head, row, suite
from benchmarks.store import each
from completion.asbuilt.findings import DesignCheck
from completion.asbuilt.pipeline import CheckOptions, check_against_design
from nbv.cover.pipeline import CoverOptions
from nbv.inspection.next_stations import CHECKED, NextStations, plan_next_stations
from nbv.inspection.targets import OPEN
from nbv.plan.plan import Plan
from nbv.plan.planning import plan_views
from nbv.scanning.sensor import Sensor
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.site_options import SiteOptions
from scenes.checks import FloatArray
from scenes.world.scene import Scene

_SITE = SiteOptions(heights_m=(1.6,))


@dataclass(frozen=True, slots=True)
class Outcome:
    """Numbers of elements in one state; `n_stations` proposed.

    `opened` by the first check, `promised` to be settled, `kept` of these, `settled` in all, with stations
    for the check and for coverage; `moves` and `left` as in `NextStations`.
    """

    n_stations: int
    opened: int
    promised: int
    kept: int
    settled: int
    settled_by_coverage: int
    moves: int
    left: int


def of_state(seed: int, setting: str, megapixels: float, n_scans: int, n_stations: int) -> Outcome:
    """Scan a state from the first stations, check, plan, scan from the stations planned, and check again."""
    state = planted_state(duplex(), seed)
    first = replace(state, stations=state.stations[:n_scans])
    sensor, before = load_sensor("panorama"), _check(first, setting, seed, megapixels)
    found = plan_next_stations(before, sensor, n_stations=n_stations, site=_SITE)
    plans = (found.plan, _for_coverage(before, first, sensor, len(found.plan.views)))
    settled = [_settled(before, first, plan, setting, seed, megapixels) for plan in plans]
    promised = _promised(found)
    return Outcome(
        n_stations=len(found.plan.views),
        opened=len(_open(before)),
        promised=len(promised),
        kept=len(promised & settled[0]),
        settled=len(settled[0]),
        settled_by_coverage=len(settled[1]),
        moves=sum(len(move.elements) for move in found.moves),
        left=len(found.left),
    )


def _check(state: PlantedState, setting: str, seed: int, megapixels: float) -> DesignCheck:
    """Check scans from the stations of a state, each of so many megapixels."""
    sd_m, sd_rad = SETTINGS[setting].station
    options = CheckOptions(registration=(sd_m, float(np.degrees(sd_rad))))
    scans = survey(state, setting, seed, megapixels * len(state.stations)).given
    return check_against_design(state.design, scans, options, n_threads=1)


def _open(check: DesignCheck) -> set[int]:
    return {element.surface for element in check.elements if element.verdict in OPEN}


def _promised(found: NextStations) -> set[int]:
    return {element.surface for one in found.promised for element in one.elements}


def _settled(
    before: DesignCheck, state: PlantedState, plan: Plan, setting: str, seed: int, megapixels: float
) -> set[int]:
    """Return the elements that were open, and are no more when scans from a plan's stations are added."""
    places: FloatArray = np.array([view.world_from_sensor.translation for view in plan.views]).reshape(-1, 3)
    after = replace(state, stations=np.vstack([state.stations, places]))
    return _open(before) - _open(_check(after, setting, seed, megapixels))


def _for_coverage(check: DesignCheck, state: PlantedState, sensor: Sensor, n_stations: int) -> Plan:
    """Return as many stations that cover most of the design beside what the stations so far see."""
    scene = Scene.from_mesh(check.design.mesh, name="design", mode="room")
    held = np.array([pose.translation for pose in check.alignment.poses])
    simulated = survey(replace(state, built=scene, stations=held), "0mm", 0, 0.1 * len(held)).true
    return plan_views(
        scene, sensor, method="cover", requirement=CHECKED, views=max(n_stations, 1), site=_SITE,
        scans=simulated, budgets=CoverOptions(polish_steps=0), rng=0,
    )  # fmt: skip


@suite("next_stations", smallest="--seeds 1 --megapixels 0.06 --stations 2")
def next_stations(
    seeds: int = 4,
    first: int = 100,
    setting: str = "2mm",
    megapixels: float = 0.17,
    scans: int = 6,
    stations: int = 4,
) -> Iterator[str]:
    """What next stations settle in planted states of the duplex, first scanned from some of its 14 stations.

    Open: undecided, hidden or not seen after the first scans. Coverage: as many stations that see most of the
    design's surface that the first scans do not see.
    """
    outcomes = list(each(of_state, range(first, first + seeds), setting, megapixels, scans, stations))
    yield from head(
        "seed", "stations", "open", "promised", "of these settled", "settled", "settled by coverage",
        "shown by moving", "left",
    )  # fmt: skip
    for seed, one in enumerate(outcomes, first):
        yield row(
            seed, one.n_stations, one.opened, one.promised, one.kept, one.settled, one.settled_by_coverage,
            one.moves, one.left,
        )  # fmt: skip
    kept, promised = (sum(getattr(one, name) for one in outcomes) for name in ("kept", "promised"))
    yield f"settled of what was promised: {kept} of {promised}"
