# SPDX-License-Identifier: MIT
"""Options of the commands for scans and images: complete, check, register, texture."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal

import typer

from completion.observe.user_options import Mode, UserOptions
from nbv.commands.options import shared
from nbv.commands.options.parsing import parse_registration, parse_shape, parse_tolerances, record_of
from nbv.commands.options.shared import (
    AUTO_OFF,
    INFER_HELP,
    INFERENCE_HELP,
    POSE_HELP,
    SCAN_HELP,
    Axis,
    ReadOptions,
    SignedAxis,
    Units,
    input_option,
    output_option,
)
from scenes.run.option import NOT_NEGATIVE, NumberRange, argument, group, option

if TYPE_CHECKING:
    from scenes.io.scan_request import ScanRequest

EXPORTS = ("obj", "e57", "dxf", "svg", "ifc")


def _renamed(name: str, flags: str, help: str = "") -> Any:  # noqa: A002  # as typer calls it
    """Return a field of `UserOptions` under the name and help text that it has in all commands."""
    entry = next(entry for entry in fields(UserOptions) if entry.name == name)
    declared = entry.metadata["option"]
    renamed = replace(declared, flags=flags, help=help or declared.help)
    return field(default=entry.default, metadata={"option": renamed})


@dataclass(frozen=True, kw_only=True, slots=True)
class CompleteOptions(UserOptions):
    """How scans are completed: beside `UserOptions` files, outputs and workers."""

    scans: tuple[str, ...] = argument("SCAN", SCAN_HELP, is_repeated=True)
    mode: Mode = _renamed("mode", "--inference", f"{INFERENCE_HELP}.")
    sigma_m: float | None = shared.sigma_option("along rays", "from the scans")
    max_sd_m: float = _renamed("max_sd_m", "--inferred-sd")
    only: tuple[str, ...] = _renamed("only", "--kinds")
    registration_m: float = _renamed(
        "registration_m", "--registration-sd", f"{POSE_HELP}: taken where several scans do not show it."
    )
    texture: bool = True
    flatness_m: float | None = option(
        "--flatness", "Deviation of real surfaces from their ideal form.", None, metavar="M",
        shown="from the scans", limits=NOT_NEGATIVE,
    )  # fmt: skip
    register: bool = shared.register_option()
    cell_m: float | None = option(
        "--resolution", "Side of a cell of inferred surface.", None, metavar="M", shown="the pixels'",
        limits=NumberRange(least=1e-4, most=1.0),
    )  # fmt: skip
    edits: str | None = input_option(
        "--edits", "completion.json with your edits.", None, metavar="FILE", shown=False
    )
    relations: str = shared.relations_option("perpendicular, parallel, coplanar")
    features: str = option(
        "--features", "Doorways and windows fitted whole: auto, off, or the features of a features.json.",
        "auto", metavar="auto|off|FILE",
    )  # fmt: skip
    flatten: bool = option("--flatten", "Remove the ripple of planes, but keep their relief.", False)
    backs: bool = option(
        "--backs", "Infer the unseen sides: those of each object in the room from its symmetries.", False
    )
    least: float = copy(shared.LEAST)
    search: Literal["auto", "exact", "budget", "off"] = option(
        "--texture", "Search for the texture of inferred area: exact, budget (quicker), auto (chosen by the "
        "size of the hidden area), or off.", "auto",
    )  # fmt: skip
    exports: tuple[str, ...] = shared.export_option(
        "completed.obj or .e57, drawings as .dxf or .svg, BIM as .ifc", EXPORTS
    )
    export_units: Units = output_option("--export-units", "Length unit of the .dxf and .ifc exports.", "m")
    tolerance_m: float = output_option(
        "--rely", 'Largest half-width of the 95 % interval for "rely".', 0.01, metavar="M",
        limits=NumberRange(least=1e-6, most=100.0),
    )  # fmt: skip
    observed: Literal["auto", "full"] = output_option(
        "--observed", "Points of observed.ply: at most ten million (auto), or all.", "auto"
    )
    scheduler: str | None = copy(shared.SCHEDULER)
    read: ReadOptions = group(ReadOptions)
    units: Units = copy(shared.UNITS)
    up: SignedAxis = copy(shared.SCAN_UP)

    def check(self) -> None:
        """Raise a usage error for options that contradict each other."""
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
        return () if self.relations in AUTO_OFF else (self.relations,)

    @property
    def files(self) -> tuple[str, ...]:
        """Files with a person's edits, relations and features."""
        features = () if self.features in AUTO_OFF else (self.features,)
        return (*((self.edits,) if self.edits else ()), *self.stated, *features)

    def record(self) -> dict[str, Any]:
        """Return the options beside those of the scans, for manifest and report."""
        read = ("scans", "origins", "intrinsics", "depth_scale", "poses", "units", "up", "scheduler")
        record = record_of(self, files=("edits", "relations", "features"), without=read)
        return {**record, "texture": self.has_texture, "search": self.search if self.has_texture else "auto"}

    @property
    def has_texture(self) -> bool:
        """Whether inferred area is textured."""
        return self.texture and self.search != "off"


@dataclass(frozen=True, kw_only=True, slots=True)
class ReviewOptions:
    """A finished completion to correct."""

    folder: str = argument("OUT", "Output folder of `unseen complete`.")
    port: int = shared.run_option(
        "--port", "Port of the page on this machine.", 0, metavar="N", shown="any that is free",
        limits=NumberRange(least=0, most=65535),
    )  # fmt: skip
    open: Literal["yes", "no"] = shared.run_option("--open", "Open the page in the browser.", "yes")
    sensor: str = copy(shared.SENSOR)


@dataclass(frozen=True, kw_only=True, slots=True)
class RegisterOptions:
    """Scans to register."""

    scans: tuple[str, ...] = argument("SCAN", SCAN_HELP, is_repeated=True)
    upright: bool = option(
        "--upright", "The scanner stood level: search only rotations about the vertical.", False
    )
    checks: bool = option(
        "--check", "Compute no pose; report how far beams contradict the given poses.", False
    )
    level: float = option("--level", "Accepted probability of a false registration.", 0.01, metavar="P")
    read: ReadOptions = group(ReadOptions, ("trajectory",))
    units: Units = copy(shared.UNITS)
    up: SignedAxis = copy(shared.SCAN_UP)

    def request(self) -> ScanRequest:
        """Return the scans."""
        return self.read.request(self.scans, self.units, self.up)

    def record(self) -> dict[str, Any]:
        """Return the options beside those of the scans, for manifest and report."""
        return {"upright": self.upright, "checks": self.checks, "level": self.level}


@dataclass(frozen=True, kw_only=True, slots=True)
class CheckCommandOptions:
    """A design, scans, and what is asked of the design's elements."""

    design: str = argument("DESIGN", "IFC, or a mesh file whose parts have names.")
    scans: tuple[str, ...] = argument("SCAN", SCAN_HELP, is_repeated=True)
    tolerances: Mapping[str, float] = field(
        default_factory=dict,
        metadata=option(
            "--tolerance", 'Tolerance of all elements, or of some: "IfcDoor*=0.005"; repeat it.', None,
            metavar="M|PATTERN=M", shown="0.010", is_repeated=True, parse=parse_tolerances,
        ).metadata,
    )  # fmt: skip
    registration: tuple[float, float] | None = option(
        "--registration-sd", f"{POSE_HELP}: metres and degrees.", None, metavar="M[,DEG]",
        shown="0.002,0.006 in buildings", parse=parse_registration,
    )  # fmt: skip
    align: Literal["yes", "no"] = option(
        "--align", "Move all scans together to fit the design; no, if a control network fixes them.", "yes"
    )
    only: tuple[str, ...] = option(
        "--only", 'Check only elements of this class or name, like "IfcWall*"; repeat it.', (),
        metavar="PATTERN", shown="all", is_repeated=True,
    )  # fmt: skip
    without: tuple[str, ...] = shared.without_option('"IfcWall*", or such a class')
    false_alarms: float = option(
        "--false-alarms", 'Expected number of wrong "deviates" in the whole design.', 0.05, metavar="P",
        limits=NumberRange(least=1e-9, most=100.0),
    )  # fmt: skip
    no_return: Literal["unknown", "free"] = option(
        "--no-return",
        "Meaning of a beam without a return: unknown space, or free space along the beam.",
        "unknown",
    )
    infer: bool = option("--infer", f"{INFER_HELP}: for elements that are not measured.", False)
    next: int | None = option(
        "--next", "Also plan up to N next stations.", None, metavar="N", shown=False,
        limits=NumberRange(least=1, most=1000),
    )  # fmt: skip
    sensor: str = copy(shared.SENSOR)
    loa: str | None = input_option(
        "--loa", "Bands of accuracy, TOML or JSON: name = upper end in metres.", None, metavar="FILE",
        shown="LOA50 to LOA20 of USIBD",
    )  # fmt: skip
    before: str | None = shared.before_option("check.json, to report what changed")
    bcf: Literal["2.1", "3.0"] = output_option("--bcf", "Version of issues.bcf.", "3.0")
    sigma_m: float | None = shared.sigma_option("along rays", "from the scans")
    register: bool = shared.register_option("and place them on the design")
    read: ReadOptions = group(ReadOptions)
    units: Units = copy(shared.UNITS)
    design_units: Units | None = input_option(
        "--design-units", "Length unit of a mesh as design.", None, shown="that of --units"
    )
    up: Axis | None = copy(shared.UP)

    def check(self) -> None:
        """Raise a usage error for options that contradict each other."""
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
class TextureOptions:
    """A hole to fill, or a texture to grow."""

    image: str = argument("IMAGE", "PNG, JPEG, WebP or TIFF.")
    mask: str | None = option(
        "--mask", "Image that is not zero at the pixels to fill.", None, metavar="MASK", shown=False
    )
    grow: tuple[int, int] | None = option(
        "--grow", "Grow a texture of this size.", None, metavar="HxW", shown=False, parse=parse_shape
    )
    window: int | None = option(
        "--window", "Side of the window, pixels, odd.", None, metavar="N", shown="from the sample"
    )
    order: Literal["paper", "window"] = option(
        "--order", "Order of filling: that of the paper, or one that preserves structure better.", "paper"
    )
    surface: bool = option("--surface", "Fill shading and texture separately, with --mask.", False)

    def check(self) -> None:
        """Raise a usage error for options that contradict each other."""
        if (self.mask is None) == (self.grow is None):
            raise typer.BadParameter("give either --mask MASK or --grow HxW")
        if self.surface and self.mask is None:
            raise typer.BadParameter("--surface fills a hole: give --mask MASK")
