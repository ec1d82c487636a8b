# SPDX-License-Identifier: MIT
"""Options of the commands for shapes: fit, part, feature."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from completion.fitting.shape import Metric, Shape
from nbv.commands.options import shared
from nbv.commands.options.parsing import record_of
from nbv.commands.options.shared import (
    AUTO_OFF,
    SCAN_HELP,
    ReadOptions,
    SignedAxis,
    Units,
    input_option,
    output_option,
)
from scenes.run.option import NumberRange, argument, choices, group, numbers, option

if TYPE_CHECKING:
    from scenes.io.scan_request import ScanRequest

FEATURES = (
    "doorway", "window", "niche", "hole-row", "hole-grid", "bolt-circle", "junction", "elbow", "column",
    "stairs",
)  # fmt: skip


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
    origin: tuple[float, ...] | None = input_option(
        "--origin", "Scanner's position in the file's units: for --rays.", None, metavar="X,Y,Z",
        shown="from the file", parse=numbers(3),
    )  # fmt: skip
    radius: float | None = option(
        "--radius", "Known radius of a sphere, a cylinder or a torus' circle, metres; held exactly.", None,
        metavar="R",
    )  # fmt: skip
    axis: tuple[float, ...] | None = option(
        "--axis", "Known direction of the axis, or of a plane's normal; held exactly.", None,
        metavar="X,Y,Z", parse=numbers(3),
    )  # fmt: skip
    between: Path | None = input_option(
        "--between", "JSON: planes and cylinders around a free-form patch, and how it joins each.", None,
        metavar="FILE", shown=False,
    )  # fmt: skip
    export: tuple[str, ...] = shared.export_option("with -o, a patch as a B-spline face for CAD", ("step",))
    units: Units = copy(shared.UNITS)

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
    relations: str = shared.relations_option("parallel, coaxial, equal radii")
    noise_m: float | None = shared.sigma_option("of points, along the normal", "estimated")
    ignores_labels: bool = option(
        "--ignore-labels", "Divide the points anew, even if the file has labels.", False
    )
    preferred: Literal["off", "tell", "impose"] = option(
        "--preferred", "Compare dimensions with round numbers, inch fractions and thread holes.", "tell"
    )
    backs: bool = option(
        "--backs", "Infer the unseen sides: from mirror planes and axes of the surfaces.", False
    )
    least: float = copy(shared.LEAST)
    flatten: bool = output_option(
        "--flatten", "Remove the ripple of planes, but keep their relief: flat.ply.", False
    )
    exports: tuple[str, ...] = shared.export_option("part.step, and its features, for CAD", ("step",))
    units: Units = copy(shared.UNITS)

    @property
    def files(self) -> tuple[str, ...]:
        """The files that are read."""
        return (self.shape, *(() if self.relations in AUTO_OFF else (self.relations,)))

    def record(self) -> dict[str, Any]:
        """Return the options for manifest and report."""
        return record_of(self, files=("shape", "relations"))


@dataclass(frozen=True, kw_only=True, slots=True)
class FeatureCommandOptions:
    """Features to find."""

    material: tuple[str, ...] = argument("SCAN|POINTS|MESH", SCAN_HELP, is_repeated=True)
    kinds: tuple[str, ...] = field(
        metadata=option(
            "--find", f"Kind of feature; repeat it: {', '.join(FEATURES)}.", None, metavar="KIND",
            is_repeated=True, parse=choices(FEATURES),
        ).metadata
    )  # fmt: skip
    given: str | None = input_option(
        "--given", 'Known values, held exactly: {"hole-row": {"count": 6}}.', None, metavar="FILE",
        shown=False,
    )  # fmt: skip
    evaluations: int = option(
        "--evaluations", "Largest number of evaluations per search.", 200_000, metavar="N",
        limits=NumberRange(least=1),
    )  # fmt: skip
    read: ReadOptions = group(ReadOptions)
    units: Units = copy(shared.UNITS)
    up: SignedAxis = copy(shared.SCAN_UP)

    def request(self) -> ScanRequest:
        """Return the scans, points or mesh."""
        return self.read.request(self.material, self.units, self.up)

    def record(self) -> dict[str, Any]:
        """Return the options beside those of the files, for manifest and report."""
        given = None if self.given is None else Path(self.given).name
        return {"kinds": self.kinds, "given": given, "evaluations": self.evaluations}
