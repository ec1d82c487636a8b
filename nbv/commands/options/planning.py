# SPDX-License-Identifier: MIT
"""Options of the commands that know a scene or plan: scan, plan, coverage, study."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import typer

from completion.observe.user_options import Mode
from nbv.commands.options import shared
from nbv.commands.options.shared import (
    INFERENCE_HELP,
    SCENE_HELP,
    Axis,
    ReadOptions,
    SignedAxis,
    Units,
    input_option,
    output_option,
)
from nbv.run.plan_options import PaceOptions, RequirementOptions, SearchOptions
from nbv.visibility.site_options import SiteOptions
from scenes.run.option import NOT_NEGATIVE, POSITIVE, argument, each, group, numbers, option

if TYPE_CHECKING:
    from scenes.io.scan_request import ScanRequest

Returns = Literal["first", "strongest", "last", "mean", "all"]
ScanFormat = Literal["npz", "ply", "pcd", "ptx", "e57", "las", "laz", "xyz", "txt", "asc", "csv"]


@dataclass(frozen=True, kw_only=True, slots=True)
class ScanOptions:
    """One simulated scan, or one per pose of a file."""

    scene: str = argument("SCENE", SCENE_HELP)
    at: tuple[float, ...] | None = input_option(
        "--at", "Position of the sensor, metres.", None, metavar="X,Y,Z", shown=False, parse=numbers(3)
    )
    look: tuple[float, ...] | None = input_option(
        "--look", "Point that the sensor looks at, metres.", None, metavar="X,Y,Z", shown=False,
        parse=numbers(3),
    )  # fmt: skip
    poses: str | None = input_option(
        "--poses", "Poses, world from sensor, one per scan: a file of poses, plan.json or a trajectory, "
        "instead of --at and --look; several scans go to .e57 or a folder.", None, metavar="FILE[#k]",
        shown=False,
    )  # fmt: skip
    trajectory: str | None = input_option(
        "--trajectory", "Times and places of a moving scanner: instead of --at, --look and --poses; points "
        "with times go to .las, .laz or .csv.", None, metavar="FILE", shown=False,
    )  # fmt: skip
    rate_hz: float | None = option(
        "--rate", "Turns or images per second, with --trajectory.", None, metavar="HZ", limits=POSITIVE,
        shown="by the sensor's speed",
    )  # fmt: skip
    position_sd_m: float = option(
        "--position-sd", "Standard deviation of the reported positions, with --trajectory.", 0.0, metavar="M",
        limits=NOT_NEGATIVE,
    )  # fmt: skip
    angle_sd_deg: float = option(
        "--angle-sd", "Standard deviation of the reported angles, with --trajectory.", 0.0, metavar="DEG",
        limits=NOT_NEGATIVE,
    )  # fmt: skip
    clock_s: float = option(
        "--clock", "Seconds by which the scanner's clock is ahead, with --trajectory.", 0.0, metavar="S"
    )
    sensor: str = copy(shared.SENSOR)
    noise: str = copy(shared.NOISE)
    returns: Returns | None = option(
        "--returns", "Returns of a beam with width; all go to .npz, .las, .laz or .e57.", None,
        shown="as the sensor's footprint",
    )  # fmt: skip
    truth: bool = output_option(
        "--no-truth", "Leave out the true surface of each pixel.", True, is_negated=True
    )
    format: ScanFormat | None = output_option(
        "--format", "One file of this format a scan: with --poses, into a folder.", None,
        shown="RGB-D images of a camera, npz of a scanner",
    )  # fmt: skip
    part: str | None = copy(shared.PART)
    scheduler: str | None = copy(shared.SCHEDULER)
    up: Axis | None = copy(shared.UP)
    units: Units = copy(shared.UNITS)

    def check(self) -> None:
        """Raise a usage error for options that contradict each other."""
        if self.trajectory is not None:
            if self.poses is not None or self.at is not None or self.look is not None:
                raise typer.BadParameter("--trajectory replaces --poses, --at and --look: leave these out")
        elif self.rate_hz is not None or any(self.track_errors().values()):
            raise typer.BadParameter(
                "--rate, --position-sd, --angle-sd and --clock are of a moving sensor: give --trajectory FILE"
            )
        elif self.poses is None and (self.at is None or self.look is None):
            raise typer.BadParameter(
                "give --at X,Y,Z and --look X,Y,Z, or --poses FILE, or --trajectory FILE"
            )
        if self.poses is not None and (self.at is not None or self.look is not None):
            raise typer.BadParameter("--poses replaces --at and --look: leave both out")
        several = {"--format": self.format, "--part": self.part, "--scheduler": self.scheduler}
        for name, value in several.items():
            if self.poses is None and value is not None:
                raise typer.BadParameter(f"{name} is for several scans: give --poses FILE")

    def track_errors(self) -> dict[str, float]:
        """Return what is wrong with the track of a moving sensor."""
        return {name: getattr(self, name) for name in ("position_sd_m", "angle_sd_deg", "clock_s")}


@dataclass(frozen=True, kw_only=True, slots=True)
class _SceneOrScans:
    """A scene, scans that were taken, or both; what sees, and what must be seen."""

    scene: str | None = argument(
        "SCENE", f"{SCENE_HELP[:-1]}; leave it out to use --scans alone.", default=None, shown=False
    )
    scans: tuple[str, ...] = input_option(
        "--scans", "A registered scan that was already taken; repeat it.", (), metavar="SCAN", shown=False,
        is_repeated=True,
    )  # fmt: skip
    read: ReadOptions = group(ReadOptions)
    up: SignedAxis | None = input_option(
        "--up", "Up axis of the file; -x, -y and -z are possible only without a scene.", None,
        shown="z; y of GLB and glTF; estimated and reported without a scene",
    )  # fmt: skip
    units: Units = copy(shared.UNITS)
    mode: Literal["room", "object"] | None = input_option(
        "--mode", "Scan a room from within, or an object from around.", None, shown="from the scene"
    )
    sensor: str = copy(shared.SENSOR)
    requirement: RequirementOptions = group(RequirementOptions)
    without: tuple[str, ...] = shared.without_option('"*Door*"')

    def request(self) -> ScanRequest:
        """Return the scans that were taken before; beside a scene `units` and `up` are the scene's."""
        up = "z" if self.scene else self.up or "auto"
        return self.read.request(self.scans, "m" if self.scene else self.units, up)

    @property
    def scene_up(self) -> Axis | None:
        """The axis that is said to be up in the scene's file; a usage error for one that points down."""
        if self.scene is None or self.up is None or self.up == "auto":
            return None
        if self.up in ("x", "y", "z"):
            return self.up
        raise typer.BadParameter(f"--up {self.up} is for scans alone: a scene's file has x, y or z up")


@dataclass(frozen=True, kw_only=True, slots=True)
class PlanOptions(_SceneOrScans):
    """Views of a scene, or next stations after scans."""

    search: SearchOptions = group(SearchOptions)
    pace: PaceOptions = group(PaceOptions)
    site: SiteOptions = group(SiteOptions)
    candidates: str | None = input_option(
        "--candidates", "Fixed positions and directions.", None, metavar="FILE.npz", shown="a lattice"
    )
    before: str | None = shared.before_option(
        "plan.json, whose predictions are compared with the scans", shown="the one in the output folder"
    )
    region: tuple[float, ...] | None = option(
        "--region", "Only surface in this box counts, metres.", None, metavar="X0,Y0,Z0,X1,Y1,Z1",
        shown=False, parse=numbers(6),
    )  # fmt: skip
    keep_out: tuple[tuple[float, ...], ...] = option(
        "--keep-out", "Box that stations and the ways between them avoid, metres; repeat it.", (),
        metavar="X0,Y0,Z0,X1,Y1,Z1", shown=False, is_repeated=True, parse=each(numbers(6)),
    )  # fmt: skip
    noise: str = copy(shared.NOISE)
    scheduler: str | None = copy(shared.SCHEDULER)

    def check(self) -> None:
        """Raise a usage error for options that contradict each other."""
        _ = self.scene_up
        method, search = self.search.method, self.search
        if self.scene is None and not self.scans:
            raise typer.BadParameter("give SCENE, or --scans SCAN one or more times, or both")
        if self.scene is None and method != "nbv":
            raise typer.BadParameter(f"--method {method} needs a scene: give SCENE, or leave the method out")
        if self.scene is not None and self.before is not None:
            raise typer.BadParameter("--before is a plan of next stations: leave SCENE out, or --before")
        if self.scene is None and (self.without or self.site.start is not None):
            flag = "--without" if self.without else "--start"
            raise typer.BadParameter(f"{flag} is for plans of a known scene: give SCENE, or leave it out")
        if self.scheduler is not None and method != "cover":
            raise typer.BadParameter("--scheduler casts for planners that know the scene: add --method cover")
        if method != "cover" and (search.overlap is not None or search.time_budget_s is not None):
            flag = "--time-budget" if search.overlap is None else "--overlap"
            raise typer.BadParameter(f"{flag} is for plans of a known scene: add --method cover")
        if self.pace.budget_min is not None and (method != "cover" or search.infer or search.overlap):
            raise typer.BadParameter(
                "--budget is for plans of a known scene, without --infer and --overlap: add --method cover"
            )
        if self.pace.budget_min is not None and search.views is not None:
            raise typer.BadParameter("give --budget or --views, not both")

    @property
    def inputs(self) -> list[str]:
        """What the manifest lists beside the scene."""
        return [self.sensor, *([self.candidates] if self.candidates else []), *self.request().inputs]


@dataclass(frozen=True, kw_only=True, slots=True)
class CoverageOptions(_SceneOrScans):
    """Which stations to judge, and by what."""

    plan: str | None = input_option(
        "--plan", "Views of a plan, or a trajectory for --sensor.", None, metavar="plan.json", shown=False
    )
    register: bool = shared.register_option()
    site: SiteOptions = group(SiteOptions, ("start", "several_heights"))
    inference: Mode = option("--inference", f"{INFERENCE_HELP}: without SCENE.", "standard")

    def check(self) -> None:
        """Raise a usage error for options that contradict each other."""
        _ = self.scene_up
        if (self.plan is None) == (not self.scans):
            raise typer.BadParameter("give either --plan plan.json or --scans SCAN, one or more times")
        if self.scene is None and self.plan is not None:
            raise typer.BadParameter("a plan alone measures nothing: give SCENE too")
        if self.register and self.scene is not None:
            raise typer.BadParameter("--register places scans to each other, not to SCENE: leave one out")


@dataclass(frozen=True, kw_only=True, slots=True)
class StudyOptions:
    """A study file, and who plans."""

    file: str = argument("STUDY.toml", "The study file.")
    part: str | None = copy(shared.PART)
    scheduler: str | None = copy(shared.SCHEDULER)
