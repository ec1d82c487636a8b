# SPDX-License-Identifier: MIT
"""Plan: views of a scene, how they were chosen and what they cover; read from and written to `plan.json`.

Stations are also written as CSV for people who set up a scanner, and as a TUM trajectory for programs.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from nbv.cover.instance import LowerBound
from nbv.coverage.coverage import Coverage, CoverageSummary
from nbv.coverage.surface_classes import ClassShares
from nbv.coverage.unreachable import coverage_record
from nbv.plan.site_time import SiteTime, curve_in_words, site_time_from
from nbv.plan.tour import Stations
from nbv.run.showing import show_report
from nbv.run.wording import count, percent
from nbv.scanning.sensor import Sensor, View
from nbv.scanning.sensor_profile import sensor_from_profile
from nbv.visibility.requirement import Requirement
from nbv.visibility.site import Site
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.zones import EVERYWHERE, Zones, zones_from_json
from scenes.card import Card, CardPicture, CardShare
from scenes.checks import InputError, Value, check_number
from scenes.io.checks.documents import read_json
from scenes.io.checks.guard import one_line
from scenes.io.poses.trajectory import write_timed_poses
from scenes.pose import Pose
from scenes.run.atomic import Stage, make_folder, write_json, write_text
from scenes.run.csv_table import csv_text
from scenes.run.libraries import table_of

CSV_NAME, TRAJECTORY_NAME = "plan.csv", "trajectory.txt"
_STEEP = 1e-6  # length of a level part below which a direction has no heading
COLUMNS = (
    "number", "x_m", "y_m", "z_m", "heading_deg", "pitch_deg", "roll_deg", "visit", "gain_m2", "met_fraction",
    "predicted_gain_m2",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Aim:
    """How a sensor is turned, degrees.

    Attributes
    ----------
    heading_deg : float
        Of the direction of view on the map, clockwise from the world's +y axis (north), 0 to 360.
    pitch_deg : float
        Of the direction of view above the level, -90 to 90.
    roll_deg : float
        Of the image about the direction of view, clockwise as the sensor sees it; 0 when it stands upright.
    """

    heading_deg: float
    pitch_deg: float
    roll_deg: float


def aim_of(pose: Pose) -> Aim:
    """Return how the sensor of a pose is turned.

    Where it looks straight up or down, the heading is that of the image's upper edge, or lower edge, and the
    roll 0.

    Examples
    --------
    >>> aim_of(Pose.looking_at((0, 0, 1), (5, 0, 1)))
    Aim(heading_deg=90.0, pitch_deg=0.0, roll_deg=0.0)
    """
    right, down, forward = pose.rotation.T
    pitch = float(np.degrees(np.arcsin(np.clip(forward[2], -1, 1))))
    if np.hypot(forward[0], forward[1]) < _STEEP:
        edge = np.sign(forward[2]) * down
        return Aim(_heading_of(edge), pitch, 0.0)
    level = np.cross(forward, [0.0, 0, 1])
    level /= np.linalg.norm(level)
    roll = float(np.degrees(np.arctan2(right @ np.cross(forward, level), right @ level)))
    return Aim(_heading_of(forward), pitch, roll + 0.0)


def _heading_of(direction: Any) -> float:
    return float(np.degrees(np.arctan2(direction[0], direction[1])) % 360.0)


def write_plan_files(
    views: Sequence[View], order: Sequence[int] | None, csv_file: Path, trajectory_file: Path
) -> None:
    """Write stations as CSV, and their poses as a TUM trajectory whose time stamps are their numbers.

    `order` tells from 0 in which to visit them, where that is known.
    """
    write_text(csv_file, stations_csv(views, order))
    poses = [view.world_from_sensor for view in views]
    write_timed_poses(trajectory_file, np.arange(1.0, len(poses) + 1), poses)


def stations_csv(views: Sequence[View], order: Sequence[int] | None = None) -> str:
    """Return a line for each station, numbered from 1.

    `order` tells from 0 in which to visit them; `visit` is a station's place in it, from 1, and empty
    without.
    """
    place = {} if order is None else {station: k for k, station in enumerate(order, start=1)}
    rows: list[list[object]] = []
    for number, view in enumerate(views, start=1):
        pose, aim = view.world_from_sensor, aim_of(view.world_from_sensor)
        where = [f"{value:.4f}" for value in pose.translation]
        turned = [f"{value + 0.0:.4f}" for value in (aim.heading_deg, aim.pitch_deg, aim.roll_deg)]
        gains = (view.gain_m2, view.met_fraction, view.predicted_gain_m2)
        rows.append([number, *where, *turned, place.get(number - 1, ""), *gains])
    return csv_text(COLUMNS, rows)


if TYPE_CHECKING:
    from scenes.world.scene import Scene


_CURE = "give the plan.json that `unseen plan` wrote"


@dataclass(frozen=True, slots=True, eq=False)
class Resumption(Value):
    """What a plan was resumed from: where the scans that were given have been taken.

    `met_fraction` is the share of the scene's area that they meet the requirement on; None without a scene.
    """

    poses: tuple[Pose, ...]
    met_fraction: float | None

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`."""
        return {**self.summary(), "world_from_sensor": [pose.matrix.tolist() for pose in self.poses]}

    def summary(self) -> dict[str, Any]:
        """Return how many scans there were, and what they had met."""
        return {"scans": len(self.poses), "met": self.met_fraction}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Plan(Value):
    """A plan.

    Attributes
    ----------
    method : str
        "nbv" (online, the planner did not know the scene) or "cover" (offline, it did).
    sensor : Sensor
        What scans.
    requirement : Requirement
        What counts as met.
    target : float or None
        Fraction of the reachable area that was to be met; None where the scene is not known.
    seed : int or None
        Seed of its randomness, None where it was not given as a number.
    n_candidates : int
        Poses that could be chosen.
    views : tuple of View
        The views in order, those not counted that the plan was resumed from.
    coverage : Coverage, CoverageSummary or None
        What they cover, with the scans that the plan was resumed from; a plan read from a file holds the
        summary. None where the scene is not known.
    lower_bound : LowerBound or None
        How many views any plan with these candidates and samples needs, where known.
    stopped_because : str
        Why there are no more views.
    stations : Stations or None
        In which order to visit them, and which scans overlap; not in `plan.json`.
    candidates : Candidates or None
        The poses that could be chosen; None for a plan read from a file.
    shares : tuple of Shares
        Of a plan in which completion stood in for views: how the area parts into met, modelled, inferred and
        unknown whenever the scans were completed.
    resumed_from : Resumption or None
        The scans that had been taken before.
    zones : Zones
        Where surface counts, and where no station may be.
    site : Site or None
        The rooms of the scene; None around objects, with given candidates, and for a plan read from a file.
    rooms : tuple of dict
        The entries of `plan.json`: each room, whether it was asked for, its stations, counted
        from 1, and what of its surface was met.
    platforms : tuple of dict
        The entries of `plan.json`: large level surface that is no place to stand.
    time : SiteTime or None
        What it takes on site; None without a tour.
    lost_if_blocked : tuple of float
        For each view the share of the area that would not be met without it, the others as they are.
    most_in_time : float or None
        Of a plan within a budget: the share of the area that no plan from these candidates within it exceeds.
    """

    method: str
    sensor: Sensor
    requirement: Requirement
    target: float | None
    seed: int | None
    n_candidates: int
    views: tuple[View, ...]
    coverage: Coverage | CoverageSummary | None
    lower_bound: LowerBound | None
    stopped_because: str
    stations: Stations | None = None
    candidates: Candidates | None = None
    shares: tuple[ClassShares, ...] = ()
    resumed_from: Resumption | None = None
    zones: Zones = EVERYWHERE
    site: Site | None = None
    rooms: tuple[dict[str, Any], ...] = ()
    platforms: tuple[dict[str, Any], ...] = ()
    time: SiteTime | None = None
    lost_if_blocked: tuple[float, ...] = ()
    most_in_time: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the contents of `plan.json`."""
        coverage = self.coverage.summary() if isinstance(self.coverage, Coverage) else self.coverage
        return {
            "method": self.method,
            "sensor": self.sensor.to_json(),
            "requirement": {**self.requirement.to_json(), "target": self.target},
            "seed": self.seed,
            "n_candidates": self.n_candidates,
            "views": [self._entry(view) for view in self.views],
            "coverage": coverage.to_json() if coverage else None,
            "lower_bound": self.lower_bound.to_json() if self.lower_bound else None,
            "stopped_because": self.stopped_because,
            "inference": [shares.to_json() for shares in self.shares],
            "resumed_from": self.resumed_from.to_json() if self.resumed_from else None,
            **self.zones.to_json(),
            "rooms": list(self.rooms),
            "platforms": list(self.platforms),
            "time": None if self.time is None else self.time.to_json(),
            "lost_if_blocked": list(self.lost_if_blocked),
            "most_in_time": self.most_in_time,
        }

    def _entry(self, view: View) -> dict[str, Any]:
        """The entry of a view, with its sensor where that has other angular steps than the plan's."""
        return {**view.to_json(), **({} if view.sensor == self.sensor else {"sensor": view.sensor.to_json()})}

    @property
    def met_curve(self) -> tuple[float, ...]:
        """Share of the area that is met before the first view, and after each."""
        before = self.resumed_from.met_fraction if self.resumed_from else None
        return (before or 0.0, *(view.met_fraction or 0.0 for view in self.views))

    @property
    def visiting_order(self) -> tuple[int, ...] | None:
        """Numbers of the views, from 0, in the order of the tour; None without one."""
        return None if self.stations is None else self.stations.tour.order

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the plan: into a file that ends in `.json`, or with all that belongs to it into a folder.

        The folder gets plan.json, plan.csv, trajectory.txt, and coverage.json and stations.json where the
        plan holds them, together or not at all. `read_plan` reads plan.json.

        Raises
        ------
        InputError
            The file or folder cannot be written.
        """
        target = Path(path)
        if target.suffix == ".json":
            write_json(target, self.to_json())
            return
        with Stage(make_folder(target)) as stage:
            write_json(stage.path("plan.json"), self.to_json())
            files = stage.path(CSV_NAME), stage.path(TRAJECTORY_NAME)
            write_plan_files(self.views, self.visiting_order, *files)
            if isinstance(self.coverage, Coverage):
                write_json(stage.path("coverage.json"), coverage_record(self.coverage))
            if self.stations is not None:
                write_json(stage.path("stations.json"), self.stations.to_json())
            stage.commit(last="plan.json")

    def to_pandas(self) -> Any:
        """Return the stations of `stations.csv` as a `pandas.DataFrame`; raises InputError without pandas."""
        return table_of(stations_csv(self.views, self.visiting_order))

    def __repr__(self) -> str:
        met = "" if self.coverage is None else f", {percent(self.coverage.met)} % met"
        bound = "" if self.lower_bound is None else f", at least {self.lower_bound.views}"
        views = count(len(self.views), "view")
        return f"Plan({self.method!r}, {self.sensor.name}, {views}{bound}{met})"

    def show(self, scene: Scene, *, n_threads: int | None = None) -> Path:
        """Show the full report of this plan of `scene`; see `nbv.show`."""
        return show_report(self, scene, n_threads=n_threads)

    def _repr_html_(self) -> str:
        """What a notebook shows: views, coverage and its curve."""
        from nbv.coverage.card_parts import area_bar, coverage_curve  # only notebooks need cards

        figures = [
            ("views", f"{len(self.views)} of {self.n_candidates} candidates"),
            ("sensor", self.sensor.name),
            ("counts as measured", self.requirement.describe()),
        ]
        pictures, summary = list[CardPicture](), self.coverage
        bar: Sequence[CardShare] = ()
        if summary is not None:
            figures += [("measured", f"{100 * summary.met:.1f} % of {summary.total_m2:.1f} m\u00b2")]
            bar = area_bar(
                met=summary.met, inferred=summary.modelled + summary.inferred, reachable=summary.reachable
            )
            pictures = [coverage_curve(self.met_curve, summary.reachable)]
        if self.lower_bound is not None:
            figures += [("lower bound", count(self.lower_bound.views, "view"))]
        if self.stations is not None:
            figures += [("tour", self.stations.tour.describe())]
        if self.time is not None:
            figures += [("time", self.time.describe())]
        title, note = f"method {self.method}", f"stopped because: {self.stopped_because}"
        return Card("View plan", title, figures, bar=bar, pictures=pictures, note=note).to_html()


def cost_sentences(plan: Plan) -> list[str]:
    """What a plan takes on site, where more stations pay little, and which is missed most if blocked."""
    said = [] if plan.time is None else [plan.time.describe()]
    if bends := curve_in_words(plan.met_curve):
        said.append(bends)
    if len(plan.lost_if_blocked) > 1:
        worst = int(np.argmax(plan.lost_if_blocked))
        lost = percent(plan.lost_if_blocked[worst])
        said.append(f"view {worst + 1} is missed most if it cannot be taken: {lost} % of the area")
    if plan.most_in_time is not None:
        most = percent(plan.most_in_time)
        said.append(
            f"no plan from these candidates within the budget measures more than {most} % of the area"
        )
    return said


def read_plan(path: str | Path) -> Plan:
    """Read a `plan.json`.

    Parameters
    ----------
    path : str or path
        As `unseen plan` writes it. Of the coverage it holds the summary alone.

    Raises
    ------
    InputError
        No such file, not JSON, or not a plan: the entry is named.
    """
    content = read_json(Path(path), dict)
    try:
        return _plan_of(content)
    except KeyError as error:
        raise InputError(f"{path} is not a plan: it has no {error}; {_CURE}") from error
    except (InputError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InputError(f"{path} is not a plan: {one_line(str(error))}; {_CURE}") from error


def _plan_of(content: dict[str, Any]) -> Plan:
    sensor = sensor_from_profile(content["sensor"])
    required = dict(content["requirement"])
    target, bound, coverage = required.pop("target"), content["lower_bound"], content["coverage"]
    seed, resumed = content["seed"], content.get("resumed_from")
    return Plan(
        method=str(content["method"]),
        sensor=sensor,
        requirement=Requirement(**required),
        target=None if target is None else float(target),
        seed=None if seed is None else int(seed),
        n_candidates=int(check_number("n_candidates", content["n_candidates"])),
        views=tuple(
            View(
                Pose(view["world_from_sensor"]),
                sensor_from_profile(view["sensor"]) if "sensor" in view else sensor,
                _number(view["gain_m2"], "gain_m2"),
                _number(view["met_fraction"], "met_fraction"),
                _number(view.get("predicted_gain_m2"), "predicted_gain_m2"),
            )
            for view in content["views"]
        ),
        coverage=None if coverage is None else _summary_of(coverage),
        lower_bound=LowerBound(int(bound["views"]), str(bound["kind"])) if bound else None,
        stopped_because=str(content["stopped_because"]),
        shares=tuple(ClassShares(**_numbers(shares)) for shares in content.get("inference", ())),
        resumed_from=_resumption_of(resumed) if resumed else None,
        zones=zones_from_json(content.get("region"), content.get("keep_out") or ()),
        rooms=tuple(dict(room) for room in content.get("rooms") or ()),
        platforms=tuple(dict(platform) for platform in content.get("platforms") or ()),
        time=site_time_from(content["time"]) if content.get("time") else None,
        lost_if_blocked=tuple(float(share) for share in content.get("lost_if_blocked") or ()),
        most_in_time=_number(content.get("most_in_time"), "most_in_time"),
    )


def _summary_of(content: dict[str, Any]) -> CoverageSummary:
    shares = dict(content)
    errors = _numbers(dict(shares.pop("standard_error", {})))
    return CoverageSummary(**_numbers(shares), standard_error=errors)


def _number(value: Any, name: str) -> Any:
    """Return a number, or None, as it is."""
    if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
        raise InputError(f"{name} must be a number, got {value!r}")
    return value


def _numbers(table: dict[str, Any]) -> dict[str, Any]:
    """Return a table in which only "unknown" may be missing a number."""
    if missing := [name for name, value in table.items() if value is None and name != "unknown"]:
        raise InputError(f"{missing[0]} must be a number, got null")
    return {name: _number(value, name) for name, value in table.items()}


def _resumption_of(content: dict[str, Any]) -> Resumption:
    met = content["met"]
    poses = tuple(Pose(matrix) for matrix in content["world_from_sensor"])
    return Resumption(poses, None if met is None else float(met))
