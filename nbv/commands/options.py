# SPDX-License-Identifier: MIT
"""Options of every command, each declared once: name, help text, default and limits.

`nbv.cli` makes the commands from these dataclasses; a command's work takes its dataclass.
Nothing slow is imported here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from completion.fitting.shape import Metric, Shape
from completion.observe.user_options import Mode, UserOptions
from nbv.run.plan_options import PaceOptions, RequirementOptions, SearchOptions
from nbv.visibility.site_options import SiteOptions
from scenes.run.option import (
    NOT_NEGATIVE,
    POSITIVE,
    NumberRange,
    argument,
    choices,
    each,
    group,
    numbers,
    option,
)

if TYPE_CHECKING:
    from scenes.io.scan_request import ScanRequest

Axis = Literal["x", "y", "z"]
SignedAxis = Literal["auto", "x", "y", "z", "-x", "-y", "-z"]
Units = Literal["mm", "cm", "m", "in", "ft", "us-ft"]
Returns = Literal["first", "strongest", "last", "mean", "all"]
ScanFormat = Literal["npz", "ply", "pcd", "ptx", "e57", "las", "laz", "xyz", "txt", "asc", "csv"]
FEATURES = (
    "doorway", "window", "niche", "hole-row", "hole-grid", "bolt-circle", "junction", "elbow", "column",
    "stairs",
)  # fmt: skip
EXPORTS = ("obj", "e57", "dxf", "svg", "ifc")
_AUTO_OFF = ("auto", "off")
_MOST_TOLERANCE_M = 1.0


def parse_bytes(text: str) -> int:
    """Return the bytes that a text such as 2GB means.

    Examples
    --------
    >>> parse_bytes("2GB"), parse_bytes("1.5 GiB")
    (2000000000, 1610612736)
    """
    size = _amount(text)
    if size < 1:
        raise ValueError(f"{text!r} is no amount of memory; write it like 2GB")
    return size


def _amount(text: str) -> int:
    """Return the number that digits with a suffix such as K, M, GB or GiB mean, 0 where they mean none."""
    match = re.fullmatch(r"\s*(\d{1,18}(?:\.\d{1,18})?)\s*([kMGT]?)(i?)B?\s*", text, re.IGNORECASE)
    if not match:
        return 0
    return int(float(match[1]) * (1024 if match[3] else 1000) ** " kmgt".index(match[2].lower() or " "))


def parse_limits(texts: Iterable[str]) -> Mapping[str, int]:
    """Return limits by name, of texts such as faces=100M; K, M, G and T stand for thousands and more.

    Examples
    --------
    >>> parse_limits(["faces=200M", "file_bytes=8GiB"])
    {'faces': 200000000, 'file_bytes': 8589934592}
    """
    from scenes.io.checks.limits import LIMIT_NAMES  # numpy comes with it, and is not needed to show help

    limits: dict[str, int] = {}
    for text in texts:
        name, _, number = text.partition("=")
        if name not in LIMIT_NAMES:
            raise ValueError(f"{name!r} is no limit; write NAME=NUMBER, NAME one of {', '.join(LIMIT_NAMES)}")
        limits[name] = _amount(number)
        if limits[name] < 1:
            raise ValueError(f"{number!r} is no number of 1 or more; write {name}=100M")
    return limits


def parse_tolerances(texts: Iterable[str]) -> Mapping[str, float]:
    """Return tolerances in metres by pattern, "" for the one of all other elements.

    Examples
    --------
    >>> parse_tolerances(["0.01", "IfcDoor*=0.005"])
    {'': 0.01, 'IfcDoor*': 0.005}
    """
    tolerances: dict[str, float] = {}
    for text in texts:
        pattern, _, number = text.rpartition("=")
        try:
            tolerance = float(number)
        except ValueError:
            tolerance = 0.0
        if not 0 < tolerance <= _MOST_TOLERANCE_M:
            raise ValueError(
                f"{number!r} is no tolerance above 0 and up to {_MOST_TOLERANCE_M:g} m; write 0.010, or "
                "IfcDoor*=0.005"
            )
        tolerances[pattern] = tolerance
    return tolerances


def parse_shape(text: str) -> tuple[int, int]:
    """Return the rows and columns of a text such as 120x160.

    Examples
    --------
    >>> parse_shape("120x160")
    (120, 160)
    """
    match = re.fullmatch(r"([1-9]\d{0,4})[xX]([1-9]\d{0,4})", text.strip())
    if not match:
        raise ValueError(f"{text!r} is no size; write HxW, like 120x160")
    return int(match[1]), int(match[2])


def record_of(options: Any, *, files: Iterable[str] = (), without: Iterable[str] = ()) -> dict[str, Any]:
    """Return options by name for manifest and report, those of groups among them, files without folders."""
    files, without = set(files), set(without)
    record: dict[str, Any] = {}
    for entry in fields(options):
        value = getattr(options, entry.name)
        if entry.name in without:
            continue
        if "group" in entry.metadata:
            record |= record_of(value, files=files, without=without)
        else:
            record[entry.name] = Path(value).name if entry.name in files and value else value
    return record


@dataclass(frozen=True, kw_only=True, slots=True)
class Shared:
    """Options that every command has.

    `out` is the folder or file to write, the command's default when not given; `max_memory` is in bytes;
    `limits` hold sizes that files may have where these are not the defaults, by name
    (`scenes.io.checks.limits`).
    """

    out: Path | None = option("--out -o", "Folder or file to write.", None, shown=False)
    seed: int = option("--seed", "Seed of all random numbers.", 0, limits=NOT_NEGATIVE)
    as_json: bool = option("--json", "Print one JSON object on stdout, nothing else there.", False)
    quiet: bool = option("--quiet -q", "Print nothing.", False)
    threads: int | None = option(
        "--threads", "Number of threads; results do not depend on it.", None, shown="all cores",
        limits=NumberRange(least=1),
    )  # fmt: skip
    max_memory: int | None = option(
        "--max-memory", "Memory limit, like 2GB; results do not depend on it.", None, metavar="SIZE",
        shown="no limit", parse=parse_bytes,
    )  # fmt: skip
    limits: Mapping[str, int] = field(
        default_factory=dict,
        metadata=option(
            "--limit", "Largest size of the contents of a file, like faces=200M; repeat it.", None,
            metavar="NAME=NUMBER", shown="see docs/guides/bad-input.md", is_repeated=True, parse=parse_limits,
        ).metadata,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True)
class ReadOptions:
    """How scans are read from their files."""

    origins: tuple[tuple[float, ...], ...] = option(
        "--origin", "Scanner's position in the file's units, for mere points; repeat it for each file.", (),
        metavar="X,Y,Z", shown="from the files", is_repeated=True, parse=each(numbers(3)),
    )  # fmt: skip
    intrinsics: tuple[float, ...] | None = option(
        "--intrinsics", "Intrinsics of depth images, pixels.", None, metavar="FX,FY,CX,CY", shown=False,
        parse=numbers(4),
    )  # fmt: skip
    depth_scale: float | None = option(
        "--depth-scale", "Depth values per unit.", None, metavar="N", shown=False
    )
    poses: str | None = option(
        "--poses", "Poses, world from sensor, one per scan.", None, metavar="FILE", shown=False
    )
    trajectory: str | None = option(
        "--trajectory", "Times and places of a moving scanner, for points with times.", None, metavar="FILE",
        shown=False,
    )  # fmt: skip

    def request(
        self, paths: tuple[str, ...], units: Units, up: SignedAxis = "z", poses: str | None = None
    ) -> ScanRequest:
        """Return the scans of files, in the units and with the up axis that they have."""
        from scenes.io.scan_request import ScanRequest

        return ScanRequest(
            paths, self.intrinsics, self.depth_scale, poses or self.poses, units=units, origins=self.origins,
            up=up, trajectory=self.trajectory,
        )  # fmt: skip


SCENE_HELP = "A mesh file, or builtin:NAME."
SCAN_HELP = "Files or RGB-D folders; PATH#k for one scan."


def _sensor() -> Any:
    return option("--sensor", "A sensor profile by name, or a TOML file.", "generic60")


def _noise() -> Any:
    return option(
        "--noise", "Noise model: none, gaussian-2mm, nguyen2012, ..., or profile: the sensor's own.", "none"
    )


def _up() -> Any:
    return option("--up", "Up axis of the file.", None, shown="z; y of GLB and glTF")


def _site_up() -> Any:
    return option(
        "--up", "Up axis of the file; of scans alone -x, -y and -z, too.", None,
        shown="z; y of GLB and glTF; of scans alone estimated and reported",
    )  # fmt: skip


def _scene_up(up: SignedAxis | None, scene: str | None) -> Axis | None:
    """The axis that a person says is up in a scene's file; a usage error for one that points down."""
    if scene is None or up is None or up == "auto":
        return None
    if up in ("x", "y", "z"):
        return up
    raise typer.BadParameter(f"--up {up} is for scans alone: a scene's file has x, y or z up")


def _scan_up() -> Any:
    return option("--up", "Up axis of the files; auto: estimated and reported.", "auto")


def _units() -> Any:
    return option("--units", "Length unit of the file; `us-ft` is the US survey foot.", "m")


def _scheduler() -> Any:
    return option(
        "--scheduler", "Address of a dask.distributed scheduler, or local:N for N processes here.", None,
        metavar="ADDRESS", shown="this process",
    )  # fmt: skip


def _register() -> Any:
    return option("--register", "Register the scans first; scans that cannot be placed are left out.", False)


def _relations(example: str) -> Any:
    return option(
        "--relations", f"{example}: auto infers them, off does not, a FILE states and forbids some.", "auto",
        metavar="auto|off|FILE",
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True)
class DemoOptions:
    """The demo has no options of its own."""


@dataclass(frozen=True, kw_only=True, slots=True)
class WarmOptions:
    """Warming has no options of its own."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ScanOptions:
    """One simulated scan, or one per pose of a file."""

    scene: str = argument("SCENE", SCENE_HELP)
    at: tuple[float, ...] | None = option(
        "--at", "Position of the sensor, metres.", None, metavar="X,Y,Z", shown=False, parse=numbers(3)
    )
    look: tuple[float, ...] | None = option(
        "--look", "Point that the sensor looks at, metres.", None, metavar="X,Y,Z", shown=False,
        parse=numbers(3),
    )  # fmt: skip
    poses: str | None = option(
        "--poses", "Instead of both: plan.json or a trajectory; several scans go to .e57 or a folder.", None,
        metavar="FILE[#k]", shown=False,
    )  # fmt: skip
    trajectory: str | None = option(
        "--trajectory", "Instead of all three: the track of a moving sensor; points with times go to .las, "
        ".laz or .csv.", None, metavar="FILE", shown=False,
    )  # fmt: skip
    rate_hz: float | None = option(
        "--rate", "With --trajectory: turns or images a second.", None, metavar="HZ", limits=POSITIVE,
        shown="by the sensor's speed",
    )  # fmt: skip
    position_sd_m: float = option(
        "--position-sd", "With --trajectory: deviation of the reported positions.", 0.0, metavar="M",
        limits=NOT_NEGATIVE,
    )  # fmt: skip
    angle_sd_deg: float = option(
        "--angle-sd", "With --trajectory: deviation of the reported angles.", 0.0, metavar="DEG",
        limits=NOT_NEGATIVE,
    )  # fmt: skip
    clock_s: float = option(
        "--clock", "With --trajectory: by how much the scanner's clock is ahead.", 0.0, metavar="S"
    )
    sensor: str = _sensor()
    noise: str = _noise()
    returns: Returns | None = option(
        "--returns", "Returns of a beam with width; all go to .npz, .las, .laz or .e57.", None,
        shown="as the sensor's footprint",
    )  # fmt: skip
    truth: bool = option("--no-truth", "Leave out the true surface of each pixel.", True, is_negated=True)
    format: ScanFormat | None = option(
        "--format", "With --poses, into a folder: one file of this format a scan.", None,
        shown="RGB-D images of a camera, npz of a scanner",
    )  # fmt: skip
    part: str | None = option(
        "--part", "With --poses: every Nth scan from the Ith; a run without it then finishes.", None,
        metavar="I/N", shown=False,
    )  # fmt: skip
    scheduler: str | None = _scheduler()
    up: Axis | None = _up()
    units: Units = _units()

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


def _scene_or_scans() -> Any:
    return argument(
        "[SCENE]", f"{SCENE_HELP[:-1]}; leave it out to use --scans alone.", default=None, shown=False
    )


def _earlier_scans() -> Any:
    return option(
        "--scans", "A registered scan that was already taken; repeat it.", (), metavar="SCAN", shown=False,
        is_repeated=True,
    )  # fmt: skip


def _scene_mode() -> Any:
    return option(
        "--mode", "Scan a room from within, or an object from around.", None, shown="from the scene"
    )


def _without() -> Any:
    return option(
        "--without", 'Leave out surfaces with such names, like "*Door*"; repeat it.', (), metavar="PATTERN",
        shown=False, is_repeated=True,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True)
class PlanOptions:
    """Views of a scene, or next stations after scans."""

    scene: str | None = _scene_or_scans()
    search: SearchOptions = group(SearchOptions)
    pace: PaceOptions = group(PaceOptions)
    sensor: str = _sensor()
    requirement: RequirementOptions = group(RequirementOptions)
    mode: Literal["room", "object"] | None = _scene_mode()
    site: SiteOptions = group(SiteOptions)
    without: tuple[str, ...] = _without()
    candidates: str | None = option(
        "--candidates", "Fixed positions and directions.", None, metavar="FILE.npz"
    )
    scans: tuple[str, ...] = _earlier_scans()
    read: ReadOptions = group(ReadOptions)
    plan: str | None = option(
        "--plan", "Without SCENE: an earlier plan, whose predictions are compared with the scans.", None,
        metavar="plan.json", shown="the one in the output folder",
    )  # fmt: skip
    region: tuple[float, ...] | None = option(
        "--region", "Only surface in this box counts, metres.", None, metavar="X0,Y0,Z0,X1,Y1,Z1",
        shown=False, parse=numbers(6),
    )  # fmt: skip
    keep_out: tuple[tuple[float, ...], ...] = option(
        "--keep-out", "Box without stations and ways, metres; repeat it.", (), metavar="X0,Y0,Z0,X1,Y1,Z1",
        shown=False, is_repeated=True, parse=each(numbers(6)),
    )  # fmt: skip
    noise: str = _noise()
    scheduler: str | None = _scheduler()
    up: SignedAxis | None = _site_up()
    units: Units = _units()

    def check(self) -> None:
        """Raise a usage error for options that contradict each other."""
        _ = self.scene_up
        method, search = self.search.method, self.search
        if self.scene is None and not self.scans:
            raise typer.BadParameter("give SCENE, or --scans SCAN one or more times, or both")
        if self.scene is None and method != "nbv":
            raise typer.BadParameter(f"--method {method} needs a scene: give SCENE, or leave the method out")
        if self.scene is not None and self.plan is not None:
            raise typer.BadParameter("--plan is an earlier plan of next stations: leave SCENE out, or --plan")
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

    def request(self) -> ScanRequest:
        """Return the scans that were taken before; beside a scene `units` and `up` are the scene's."""
        up = "z" if self.scene else self.up or "auto"
        return self.read.request(self.scans, "m" if self.scene else self.units, up)

    @property
    def scene_up(self) -> Axis | None:
        """The axis that is said to be up in the scene's file."""
        return _scene_up(self.up, self.scene)

    @property
    def inputs(self) -> list[str]:
        """What the manifest lists beside the scene."""
        return [self.sensor, *([self.candidates] if self.candidates else []), *self.request().inputs]


@dataclass(frozen=True, kw_only=True, slots=True)
class CoverageOptions:
    """Which stations to judge, and by what."""

    scene: str | None = _scene_or_scans()
    plan: str | None = option(
        "--plan", "Views of a plan, or a trajectory for --sensor.", None, metavar="plan.json", shown=False
    )
    scans: tuple[str, ...] = _earlier_scans()
    register: bool = _register()
    read: ReadOptions = group(ReadOptions)
    sensor: str = _sensor()
    requirement: RequirementOptions = group(
        RequirementOptions,
        ("min_density_per_m2", "max_sd_m", "registration_sd_m", "averaging_radius_m", "k"),
    )
    mode: Literal["room", "object"] | None = _scene_mode()
    site: SiteOptions = group(SiteOptions, ("start", "several_heights"))
    without: tuple[str, ...] = _without()
    inference: Mode = option("--inference", "Without SCENE: how far surfaces are continued.", "standard")
    up: SignedAxis | None = _site_up()
    units: Units = _units()

    def check(self) -> None:
        """Raise a usage error for options that contradict each other."""
        _ = self.scene_up
        if (self.plan is None) == (not self.scans):
            raise typer.BadParameter("give either --plan plan.json or --scans SCAN, one or more times")
        if self.scene is None and self.plan is not None:
            raise typer.BadParameter("a plan alone measures nothing: give SCENE too")
        if self.register and self.scene is not None:
            raise typer.BadParameter("--register places scans to each other, not to SCENE: leave one out")

    def request(self) -> ScanRequest:
        """Return the scans; beside a scene `units` and `up` are the scene's."""
        up = "z" if self.scene else self.up or "auto"
        return self.read.request(self.scans, "m" if self.scene else self.units, up)

    @property
    def scene_up(self) -> Axis | None:
        """The axis that is said to be up in the scene's file."""
        return _scene_up(self.up, self.scene)


@dataclass(frozen=True, kw_only=True, slots=True)
class StudyOptions:
    """A study file, and who plans."""

    file: str = argument("STUDY.toml", "The study file.")
    part: str | None = option(
        "--part", "Do every Nth case from the Ith alone, and no tables: a job of an array.", None,
        metavar="I/N", shown=False,
    )  # fmt: skip
    scheduler: str | None = _scheduler()


@dataclass(frozen=True, kw_only=True, slots=True)
class CompleteOptions(UserOptions):
    """How scans are completed: beside `UserOptions` files, outputs and workers."""

    scans: tuple[str, ...] = argument("SCAN...", SCAN_HELP, is_repeated=True)
    flatness_m: float | None = option(
        "--flatness", "Deviation of real surfaces from their ideal form.", None, metavar="M",
        shown="from the scans", limits=NOT_NEGATIVE,
    )  # fmt: skip
    register: bool = _register()
    cell_m: float | None = option(
        "--resolution", "Side of a cell of inferred surface.", None, metavar="M", shown="the pixels'",
        limits=NumberRange(least=1e-4, most=1.0),
    )  # fmt: skip
    edits: str | None = option(
        "--edits", "completion.json with your edits.", None, metavar="FILE", shown=False
    )
    relations: str = _relations("Perpendicular, parallel and coplanar surfaces")
    features: str = option(
        "--features", "Doorways and windows fitted whole: auto, off, or the features of a features.json.",
        "auto", metavar="auto|off|FILE",
    )  # fmt: skip
    flatten: bool = option("--flatten", "Remove the ripple of measured planes, but keep their relief.", False)
    backs: bool = option(
        "--backs", "Separate the things in the room, and close each behind what was seen by its symmetries.",
        False,
    )  # fmt: skip
    least: float = option(
        "--least", "Probability from which a symmetry counts as inferred surface, for --backs.", 0.8,
        metavar="P", limits=NumberRange(least=0.5, most=1.0),
    )  # fmt: skip
    search: Literal["exact", "budget"] | None = option(
        "--texture", "Texture search: exact, or quicker within a budget.", None, shown="by the hidden area"
    )
    exports: tuple[str, ...] = option(
        "--export", "Also write completed.obj or .e57, drawings as .dxf or .svg, BIM as .ifc; repeat it.", (),
        metavar="|".join(EXPORTS), shown=False, is_repeated=True, parse=choices(EXPORTS),
    )  # fmt: skip
    export_units: Units = option("--export-units", "Length unit of the .dxf and .ifc exports.", "m")
    tolerance_m: float = option(
        "--tolerance", 'Largest half-width of the 95 % interval for "rely".', 0.01, metavar="M",
        limits=NumberRange(least=1e-6, most=100.0),
    )  # fmt: skip
    observed: Literal["auto", "full"] = option(
        "--observed", "Points of observed.ply: at most ten million (auto), or all.", "auto"
    )
    scheduler: str | None = _scheduler()
    read: ReadOptions = group(ReadOptions)
    units: Units = _units()
    up: SignedAxis = _scan_up()

    def check(self) -> None:
        """Raise a usage error for options that contradict each other."""
        if self.search is not None and not self.texture:
            raise typer.BadParameter("give --texture or --no-texture, not both")
        if self.register and self.scheduler is not None:
            raise typer.BadParameter(
                "--register works in one process: run `unseen register` first, then complete its posed/"
            )

    def request(self) -> ScanRequest:
        """Return the scans."""
        return self.read.request(self.scans, self.units, self.up)

    @property
    def stated(self) -> tuple[str, ...]:
        """The file of relations that a person states, if there is one."""
        return () if self.relations in _AUTO_OFF else (self.relations,)

    @property
    def files(self) -> tuple[str, ...]:
        """Files with a person's edits, relations and features."""
        features = () if self.features in _AUTO_OFF else (self.features,)
        return (*((self.edits,) if self.edits else ()), *self.stated, *features)

    def record(self) -> dict[str, Any]:
        """Return the options beside those of the scans, for manifest and report."""
        read = ("scans", "origins", "intrinsics", "depth_scale", "poses", "units", "up", "scheduler")
        record = record_of(self, files=("edits", "relations", "features"), without=read)
        return {**record, "search": self.search or "auto"}


@dataclass(frozen=True, kw_only=True, slots=True)
class TextureOptions:
    """A hole to fill, or a texture to grow."""

    image: str = argument("IMAGE", "PNG, JPEG, WebP or TIFF.")
    mask: str | None = option("--mask", "Fill where it is not zero.", None, metavar="MASK", shown=False)
    grow: tuple[int, int] | None = option(
        "--grow", "Grow a texture of this size.", None, metavar="HxW", shown=False, parse=parse_shape
    )
    window: int | None = option(
        "--window", "Side of the window, pixels, odd.", None, metavar="N", shown="from the sample"
    )
    order: Literal["paper", "window"] = option(
        "--order", "Order of filling: as in the paper, or one that keeps structure better.", "paper"
    )
    surface: bool = option(
        "--surface", "With --mask: fill shading and texture apart, plain areas as such.", False
    )

    def check(self) -> None:
        """Raise a usage error for options that contradict each other."""
        if (self.mask is None) == (self.grow is None):
            raise typer.BadParameter("give either --mask MASK or --grow HxW")
        if self.surface and self.mask is None:
            raise typer.BadParameter("--surface fills a hole: give --mask MASK")


@dataclass(frozen=True, kw_only=True, slots=True)
class FitOptions:
    """A surface to fit."""

    points: str = argument("POINTS", "A file of points or scans; PATH#k for one scan.")
    shape: Literal[Shape, "patch"] = option(
        "--shape", "Surface to fit; auto chooses by evidence; a patch needs --between.", "auto"
    )
    metric: Metric = option("--metric", "Distance to minimise: Euclidean, or an approximation.", "euclidean")
    robust: bool = option("--robust", "Allow for many points of other surfaces.", False)
    rays: bool = option("--rays", "Errors lie along the scanner's rays, as range noise does.", False)
    origin: tuple[float, ...] | None = option(
        "--origin", "Position of the scanner, for --rays.", None, metavar="X,Y,Z", shown="from the file",
        parse=numbers(3),
    )  # fmt: skip
    radius: float | None = option(
        "--radius", "Known radius of a sphere, a cylinder or a torus' circle, metres; held exactly.", None,
        metavar="R",
    )  # fmt: skip
    axis: tuple[float, ...] | None = option(
        "--axis", "Known direction of the axis, or of a plane's normal; held exactly.", None,
        metavar="X,Y,Z", parse=numbers(3),
    )  # fmt: skip
    between: Path | None = option(
        "--between", "JSON: planes and cylinders around a free-form patch, and how it joins each.", None,
        metavar="FILE", shown=False,
    )  # fmt: skip
    export: tuple[str, ...] = option(
        "--export", "For a patch, with -o: also write its B-spline face for CAD.", (), metavar="step",
        shown=False, is_repeated=True, parse=choices(("step",)),
    )  # fmt: skip
    units: Units = _units()

    def check(self) -> None:
        """Raise a usage error for options that contradict each other."""
        if (self.shape == "patch") != (self.between is not None):
            raise typer.BadParameter("--shape patch and --between FILE belong together")
        if self.shape != "patch":
            if self.export:
                raise typer.BadParameter("--export is for --shape patch")
            return
        has_given = any(value is not None for value in (self.origin, self.radius, self.axis))
        if self.metric != "euclidean" or self.robust or self.rays or has_given:
            raise typer.BadParameter("a patch has no --metric, --robust, --rays, --origin, --radius, --axis")


@dataclass(frozen=True, kw_only=True, slots=True)
class PartOptions:
    """A part to divide into surfaces."""

    shape: str = argument("POINTS|MESH", "A file of points, or a mesh.")
    relations: str = _relations("Parallel and coaxial surfaces, equal radii")
    noise_m: float | None = option(
        "--noise", "Standard deviation of the points along the normal.", None, metavar="M",
        shown="estimated", limits=NOT_NEGATIVE,
    )  # fmt: skip
    ignores_labels: bool = option(
        "--ignore-labels", "Divide the points anew, even if the file has labels.", False
    )
    preferred: Literal["off", "tell", "impose"] = option(
        "--preferred", "Round numbers, inch fractions and holes for threads that dimensions may mean.", "tell"
    )
    backs: bool = option(
        "--backs", "Infer the sides that no scan saw, from mirror planes and axes of the surfaces.", False
    )
    least: float = option(
        "--least", "Probability from which a symmetry counts as inferred surface, for --backs.", 0.8,
        metavar="P", limits=NumberRange(least=0.5, most=1.0),
    )  # fmt: skip
    flatten: bool = option("--flatten", "Also write flat.ply: planes without ripple, relief kept.", False)
    exports: tuple[str, ...] = option(
        "--export", "Also write part.step, and its features, for CAD.", (), metavar="step", shown=False,
        is_repeated=True, parse=choices(("step",)),
    )  # fmt: skip
    units: Units = _units()

    @property
    def files(self) -> tuple[str, ...]:
        """The files that are read."""
        return (self.shape, *(() if self.relations in _AUTO_OFF else (self.relations,)))

    def record(self) -> dict[str, Any]:
        """Return the options for manifest and report."""
        return record_of(self, files=("shape", "relations"))


@dataclass(frozen=True, kw_only=True, slots=True)
class FeatureCommandOptions:
    """Features to find."""

    material: tuple[str, ...] = argument("SCAN|POINTS|MESH...", SCAN_HELP, is_repeated=True)
    kinds: tuple[str, ...] = field(
        metadata=option(
            "--find", f"Kind of feature; repeat it: {', '.join(FEATURES)}.", None, metavar="KIND",
            is_repeated=True, parse=choices(FEATURES),
        ).metadata
    )  # fmt: skip
    given: str | None = option(
        "--given", 'Known values, held exactly: {"hole-row": {"count": 6}}.', None, metavar="FILE",
        shown=False,
    )  # fmt: skip
    evaluations: int = option(
        "--evaluations", "Largest number of evaluations per search.", 200_000, metavar="N",
        limits=NumberRange(least=1),
    )  # fmt: skip
    read: ReadOptions = group(ReadOptions)
    units: Units = _units()
    up: SignedAxis = _scan_up()

    def request(self) -> ScanRequest:
        """Return the scans, points or mesh."""
        return self.read.request(self.material, self.units, self.up)

    def record(self) -> dict[str, Any]:
        """Return the options beside those of the files, for manifest and report."""
        given = None if self.given is None else Path(self.given).name
        return {"kinds": self.kinds, "given": given, "evaluations": self.evaluations}


@dataclass(frozen=True, kw_only=True, slots=True)
class RegisterOptions:
    """Scans to register."""

    scans: tuple[str, ...] = argument("SCAN...", SCAN_HELP, is_repeated=True)
    upright: bool = option("--upright", "The scanner stood level: only rotations about the vertical.", False)
    start: str | None = option(
        "--start", "Initial poses to try as well, one per scan.", None, metavar="FILE", shown=False
    )
    checks: bool = option(
        "--check", "Compute no pose; report how far beams contradict the given poses.", False
    )
    level: float = option("--level", "Accepted probability of a false registration.", 0.01, metavar="P")
    read: ReadOptions = group(ReadOptions, ("poses", "trajectory"))
    units: Units = _units()
    up: SignedAxis = _scan_up()

    def request(self) -> ScanRequest:
        """Return the scans."""
        return self.read.request(self.scans, self.units, self.up, self.start)

    def record(self) -> dict[str, Any]:
        """Return the options beside those of the scans, for manifest and report."""
        return {"upright": self.upright, "checks": self.checks, "level": self.level}


def _patterns(flags: str, help: str) -> Any:  # noqa: A002  # as typer calls it
    return option(
        flags, f'{help} of such a class or name, like "IfcWall*"; repeat it.', (), metavar="PATTERN",
        shown=False, is_repeated=True,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True)
class CheckCommandOptions:
    """A design, scans, and what is asked of the design's elements."""

    design: str = argument("DESIGN", "IFC, or a mesh file whose parts have names.")
    scans: tuple[str, ...] = argument("SCAN...", SCAN_HELP, is_repeated=True)
    tolerances: Mapping[str, float] = field(
        default_factory=dict,
        metadata=option(
            "--tolerance", 'Tolerance of all elements, or of some: "IfcDoor*=0.005"; repeat it.', None,
            metavar="M|PATTERN=M", shown="0.010", is_repeated=True, parse=parse_tolerances,
        ).metadata,
    )  # fmt: skip
    registration: tuple[float, ...] | None = option(
        "--registration", "Standard deviation of each scan's pose: metres and degrees.", None,
        metavar="M,DEG", shown="0.002,0.006 in buildings", parse=numbers(2),
    )  # fmt: skip
    align: Literal["yes", "no"] = option(
        "--align", "Move all scans together to fit the design; no: a control network holds.", "yes"
    )
    only: tuple[str, ...] = _patterns("--only", "Check only elements")
    without: tuple[str, ...] = _patterns("--without", "Leave out elements")
    false_alarms: float = option(
        "--false-alarms", 'Expected number of wrong "deviates" in the whole design.', 0.05, metavar="P",
        limits=NumberRange(least=1e-9, most=100.0),
    )  # fmt: skip
    no_return: Literal["unknown", "free"] = option(
        "--no-return", "What beams without a return say: nothing, or that their way was free.", "unknown"
    )
    infer: bool = option(
        "--infer", "Also complete the scans, and report what that says of what is not measured.", False
    )
    next: int | None = option(
        "--next", "Also plan up to N next stations.", None, metavar="N", shown=False,
        limits=NumberRange(least=1, most=1000),
    )  # fmt: skip
    sensor: str = _sensor()
    loa: str | None = option(
        "--loa", "Bands of accuracy, TOML or JSON: name = upper end in metres.", None, metavar="FILE",
        shown="LOA50 to LOA20 of USIBD",
    )  # fmt: skip
    before: str | None = option(
        "--before", "An earlier check, to report what changed.", None, metavar="check.json", shown=False
    )
    bcf: Literal["2.1", "3.0"] = option("--bcf", "Version of issues.bcf.", "3.0")
    sigma_m: float | None = option(
        "--sigma", "Standard deviation of the range noise.", None, metavar="M", shown="from the scans",
        limits=NOT_NEGATIVE,
    )  # fmt: skip
    register: bool = option("--register", "Register the scans and place them on the design first.", False)
    read: ReadOptions = group(ReadOptions)
    units: Units = _units()
    design_units: Units | None = option(
        "--design-units", "Length unit of a mesh as design.", None, shown="that of --units"
    )
    up: Axis | None = _up()

    def check(self) -> None:
        """Raise a usage error for options that contradict each other."""
        if self.registration is not None and min(self.registration) < 0:
            raise typer.BadParameter("--registration M,DEG: both are 0 or more")
        if self.register and self.read.poses is not None:
            raise typer.BadParameter("--register finds the poses: leave --poses out, or --register")

    def request(self) -> ScanRequest:
        """Return the scans."""
        return self.read.request(self.scans, self.units)

    @property
    def inputs(self) -> list[str]:
        """What the manifest lists."""
        sensor = [self.sensor] if self.next is not None else []
        files = [file for file in (self.loa, self.before) if file is not None]
        return [self.design, *self.request().inputs, *files, *sensor]

    def record(self) -> dict[str, Any]:
        """Return the options beside those of the scans, for manifest and report."""
        read = ("scans", "origins", "intrinsics", "depth_scale", "poses", "trajectory", "units")
        record = record_of(self, files=("design", "loa", "before", "sensor"), without=read)
        return {**record, "tolerances": {name or "all": m for name, m in self.tolerances.items()} or 0.01}


@dataclass(frozen=True, kw_only=True, slots=True)
class InfoOptions:
    """A file to describe."""

    file: str = argument("FILE", "Any file, or an output folder.")
    up: Axis | None = _up()
    units: Units = _units()
    read: ReadOptions = group(ReadOptions, ("origins", "poses"))
