# SPDX-License-Identifier: MIT
"""What a survey of a building costs by each way of choosing stations: stations, walked length, minutes.

A panoramic scanner in a building (default: the duplex of the data folder, `UNSEEN_DATA`, doors left out) by
rules of thumb, by greedy choice, by cover, and online. All stand on the same poses, and are measured on the
same samples, until 95 and 99 % of what these poses can reach is measured within 60 deg.

A rule of thumb ends with its own stations. Where they reach too little its grid gets finer, from 5 m in steps
of half a metre down to that of the poses, until the whole rule reaches the share. A surveyor takes all
stations of a rule; how few of them would have done, each time the one that adds most, is told beside.

Minutes are stations x (scan + set-up) + walked length / speed. A leg without a way (from one dwelling into
the next, say) is charged the straight line, and counted.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

import numpy as np

from benchmarks.cases.frames import DATA
from benchmarks.run import head, suite
from benchmarks.run import row as line
from nbv import SurfaceSamples, load_sensor, plan_views
from nbv.coverage.coverage import Coverage
from nbv.coverage.measurement import CoverageTally
from nbv.online.limits import GRID_M
from nbv.plan.rules import grid_places, nearest_poses, room_and_doorway_places
from nbv.plan.tour import Tour, plan_tour
from nbv.run.plan_options import Method
from nbv.scanning.sensor import Sensor, View
from nbv.visibility.candidates import Standing, find_standing, samples_that_count
from nbv.visibility.requirement import Requirement
from nbv.visibility.site import Site
from nbv.visibility.site_options import SiteOptions
from scenes import Scene
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.io.scene_files import open_scene
from scenes.mesh.orientation import Axis

SHARES = (0.95, 0.99)
FINEST_M, FINER_M = 0.5, 0.5
PLANNERS = ("rules", "greedy", "cover", "nbv", "nbv --infer")


@dataclass(frozen=True)
class Cost:
    """Minutes of a scan and of setting the tripod up, and the speed of walking, m/s."""

    scan_min: float
    set_up_min: float
    speed_m_s: float

    def minutes(self, n_stations: int, walked_m: float) -> float:
        """Return what a survey takes."""
        return n_stations * (self.scan_min + self.set_up_min) + walked_m / self.speed_m_s / 60


@dataclass(frozen=True)
class Survey:
    """Stations in the order in which they were chosen; the shares (n,) of what can be reached after each.

    `enough` tells how many of a rule's stations would have done, where they are not chosen one by one.
    """

    stations: FloatArray
    shares: FloatArray
    enough: int | None = None
    remark: str = ""

    def until(self, share: float) -> int | None:
        """Return the stations until the share is reached, None where it never is."""
        reached = np.flatnonzero(self.shares >= share - 1e-9)
        return int(reached[0]) + 1 if len(reached) else None


@dataclass(frozen=True)
class Building:
    """A building, where the scanner may stand in it, and what the best of it would be."""

    scene: Scene
    sensor: Sensor
    standing: Standing
    site: Site
    samples: SurfaceSamples
    possible: BoolArray

    @property
    def reachable_m2(self) -> float:
        """Area that the poses can measure as required, square metres."""
        return float(self.samples.areas[self.possible].sum())

    @classmethod
    def of(cls, scene: Scene, options: SiteOptions) -> "Building":
        """Find where stations may stand, and what can be reached from there."""
        sensor = load_sensor("panorama")
        standing = find_standing(scene, sensor, options)
        if standing.site is None:
            raise InputError(f"{scene.name} is no building: nothing to stand on was found")
        caster = scene.ray_caster()
        samples, _ = samples_that_count(scene, standing, caster)
        tally = CoverageTally.start(caster, samples, Requirement())
        possible = tally.reachable(standing.candidates, sensor, None, None).reachable
        return cls(scene, sensor, standing, standing.site, samples, possible)

    def by_rule(self, places: FloatArray, share: float) -> Survey:
        """Stand at the poses nearest to places (k, 3) on the floor; the shares are in order of gain."""
        numbers = nearest_poses(places, self.standing.candidates)
        views = [View(self.standing.candidates.pose(number), self.sensor) for number in numbers]
        caster, seen = self.scene.ray_caster(), []
        for view in views:
            tally = CoverageTally.start(caster, self.samples, Requirement())
            tally.add(view)
            seen.append(tally.met)
        left, order, curve = self.samples.areas.copy(), list[int](), [0.0]
        while len(order) < len(views):
            gains = [-1.0 if k in order else float(left[met].sum()) for k, met in enumerate(seen)]
            order.append(int(np.argmax(gains)))
            curve.append(curve[-1] + gains[order[-1]])
            left[seen[order[-1]]] = 0.0
        shares = np.array(curve[1:]) / self.reachable_m2
        best = Survey(np.zeros((0, 3)), shares).until(share)
        whole = np.append(np.zeros(len(views) - 1), shares[-1])  # a surveyor takes all of them
        return Survey(np.array([view.world_from_sensor.translation for view in views]), whole, best)

    def planned(self, planner: str, target: float, seed: int) -> Survey:
        """Plan to a target."""
        infer, method = planner.endswith("--infer"), cast(Method, planner.split()[0])
        plan = plan_views(
            self.scene, self.sensor, method=method, target=target, standing=self.standing,
            samples=self.samples, infer=infer, rng=seed,
        )  # fmt: skip
        if not isinstance(plan.coverage, Coverage) or plan.coverage.history is None:
            raise TypeError("a fresh plan holds its full coverage")
        first = plan.coverage.history.first_met[self.possible]  # online stations may see beyond that
        views, areas = range(1, len(plan.views) + 1), self.samples.areas[self.possible]
        met = np.array([areas[first <= number].sum() for number in views]) / self.reachable_m2
        if infer and plan.stopped_because.startswith("target"):  # what is completed counts too
            met[-1] = target
        places = np.array([view.world_from_sensor.translation for view in plan.views])
        bound = f"; {plan.lower_bound.describe()}" if plan.lower_bound else ""
        return Survey(places, met, remark=plan.stopped_because + bound)

    def tour(self, stations: FloatArray, *, in_order: bool) -> Tour:
        """Walk from station to station."""
        caster = self.scene.ray_caster()
        return plan_tour(self.scene.mesh, stations, on_foot=True, in_order=in_order, caster=caster)


def rule_surveys(building: Building, share: float) -> Iterator[tuple[str, Survey]]:
    """Yield each rule as it is, and, where that is not enough, the coarsest grid that makes it enough."""
    site = building.site
    rules: dict[str, tuple[FloatArray, Callable[[float], FloatArray]]] = {
        "rule:grid5m": (grid_places(site), lambda step: grid_places(site, step)),
        "rule:rooms-and-doorways": (
            room_and_doorway_places(site),
            lambda step: np.vstack([room_and_doorway_places(site), grid_places(site, step)]),
        ),
    }
    for name, (places, finer) in rules.items():
        survey, step, told = building.by_rule(places, share), GRID_M, name
        yield told, survey
        while survey.until(share) is None and step >= FINEST_M:
            told = f"{name}, with a grid of {step:g} m"
            survey, step = building.by_rule(finer(step), share), step - FINER_M
        if told != name:
            yield told, survey


def row(name: str, building: Building, survey: Survey, share: float, cost: Cost) -> str:
    """Return the line of the table."""
    n = survey.until(share)
    if n is None:
        end = f"{100 * survey.shares[-1]:.1f} % after {len(survey.shares)}"
        return line(name, f"never: {end}", survey.enough or "", "", "", "")
    in_order = name.startswith("nbv")
    stations = survey.stations[:n]
    tour = building.tour(stations, in_order=in_order)
    straight = [
        float(np.linalg.norm(stations[b] - stations[a]))
        for (a, b), leg in zip(pairwise(tour.order), tour.legs, strict=True)
        if not np.isfinite(leg.length_m)
    ]
    walked = tour.length_m + sum(straight)
    enough = survey.enough or ""
    return line(name, n, enough, f"{walked:.0f}", len(straight), f"{cost.minutes(n, walked):.0f}")


def surveys(building: Building, planner: str, share: float, seeds: int) -> Iterator[tuple[str, Survey]]:
    """Yield the surveys of one planner, or of all rules."""
    if planner == "rules":
        yield from rule_surveys(building, share)
        return
    for seed in range(1 if planner == "greedy" else seeds):
        name = planner if planner == "greedy" else f"{planner}, seed {seed}"
        yield name, building.planned(planner, share, seed)


@suite("survey", smallest="--rooms 2 --planner greedy --share 0.5")
def survey(
    scene: str = str(DATA / "buildings/duplex.glb"),
    up: Axis = "y",
    without: list[str] | None = None,
    heights: list[float] | None = None,
    rooms: list[int] | None = None,
    planner: list[str] | None = None,
    share: list[float] | None = None,
    seeds: int = 1,
    scan_minutes: float = 3.0,
    set_up_minutes: float = 1.0,
    walking_speed: float = 1.0,
) -> Iterator[str]:
    """What a survey of a building costs by each way of choosing stations: stations, walked length, minutes.

    --without: surfaces left out, by name (default *Door*); --heights of the instrument, metres; --rooms by
    number, all if not given; --planner: rules, greedy, cover, nbv, nbv --infer; --walking-speed: m/s.
    """
    cost = Cost(scan_minutes, set_up_minutes, walking_speed)
    whole = open_scene(scene, up=up).without(without or ["*Door*"])
    options = SiteOptions(rooms=tuple(rooms) if rooms else "all", heights_m=tuple(heights or [1.6]))
    building = Building.of(whole, options)
    yield (
        f"{whole.name}: {building.standing.candidates.n_poses} poses, {len(building.samples)} samples, "
        f"{building.reachable_m2:.0f} of {building.samples.total_m2:.0f} m2 can be reached"
    )
    for part in share or SHARES:
        yield ""
        yield from head(
            f"{100 * part:g} %", "stations", "of which enough", "walked, m", "legs without way", "min"
        )
        for name in planner or PLANNERS[:-1]:
            begun = time.process_time()
            for title, found in surveys(building, name, part, seeds):
                yield row(title, building, found, part, cost)
                if found.remark:
                    yield f"  {found.remark}"
            yield f"  {name}: {time.process_time() - begun:.0f} s of the processor"
