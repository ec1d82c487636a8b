# SPDX-License-Identifier: MIT
"""Options: those that several commands share, with their names and help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

Out = Annotated[Path | None, typer.Option("--out", "-o", help="Folder or file to write.", show_default=False)]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of everything random.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, nothing else there.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing.")]
Threads = Annotated[
    int | None,
    typer.Option("--threads", min=1, help="Threads; results do not depend on it.", show_default="all cores"),
]
MaxMemory = Annotated[
    str | None,
    typer.Option(
        "--max-memory", metavar="SIZE", help="Like 2GB; recorded, not enforced.", show_default="no limit"
    ),
]
SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help="A mesh file, or builtin:NAME.")]
SensorOption = Annotated[str, typer.Option("--sensor", help="A profile by name, or a TOML file.")]
NoiseOption = Annotated[
    str, typer.Option("--noise", help="none, gaussian-2mm, nguyen2012, ..., profile: the sensor's own.")
]
Incidence = Annotated[
    float, typer.Option("--max-incidence", metavar="DEG", help="Largest angle between ray and normal.")
]
MaxRange = Annotated[
    float | None, typer.Option("--max-range", metavar="M", help="Largest range.", show_default="the sensor's")
]
MinDensity = Annotated[
    float | None,
    typer.Option("--min-density", metavar="N", help="Fewest points on a square metre.", show_default=False),
]
MaxSd = Annotated[
    float | None,
    typer.Option(
        "--max-sd", metavar="M", help="Largest predicted sd of a surface point.", show_default=False
    ),
]
RegistrationSd = Annotated[
    float, typer.Option("--registration-sd", metavar="M", help="For --max-sd: of a station's position.")
]
AveragingRadius = Annotated[
    float, typer.Option("--averaging-radius", metavar="M", help="For --max-sd: points in this disc averaged.")
]
KViews = Annotated[int, typer.Option("--k", min=1, help="Views that must each measure a point well enough.")]
PolishSteps = Annotated[
    int, typer.Option("--polish-steps", min=0, help="cover: swaps tried to need fewer views.")
]
TimeBudget = Annotated[
    float | None,
    typer.Option(
        "--time-budget",
        min=0.0,
        metavar="S",
        help="cover: end the search then; not repeatable.",
        show_default="none",
    ),
]
Method = Annotated[
    Literal["nbv", "cover"], typer.Option("--method", help="Online without the scene, or offline with it.")
]
Target = Annotated[float, typer.Option("--target", help="Fraction of the reachable area.")]
MostViews = Annotated[int | None, typer.Option("--views", min=1, help="No more than so many.")]
CandidatesFile = Annotated[
    str | None, typer.Option("--candidates", metavar="FILE.npz", help="Fixed positions and directions.")
]
PlanFile = Annotated[
    str | None, typer.Option("--plan", metavar="plan.json", help="Views of a plan.", show_default=False)
]
ScanFiles = Annotated[
    list[str] | None,
    typer.Option("--scans", metavar="SCAN", help="A registered scan; repeat it.", show_default=False),
]
OverlapShare = Annotated[
    float | None,
    typer.Option(
        "--overlap",
        min=0.0,
        max=1.0,
        metavar="FRACTION",
        help="cover: scans share so much, and can all be registered.",
        show_default="not asked for",
    ),
]
UpOption = Annotated[Literal["x", "y", "z"], typer.Option("--up", help="Axis of the file that is up.")]
UnitsOption = Annotated[Literal["mm", "cm", "m", "in"], typer.Option("--units", help="Unit of the file.")]
ModeOption = Annotated[
    Literal["room", "object"] | None,
    typer.Option("--mode", help="Scan from within, or from around.", show_default="from the scene"),
]
Intrinsics = Annotated[
    str | None,
    typer.Option("--intrinsics", metavar="FX,FY,CX,CY", help="Of depth images, pixels.", show_default=False),
]
DepthScale = Annotated[
    float | None, typer.Option("--depth-scale", metavar="N", help="Depth values a unit.", show_default=False)
]
Poses = Annotated[
    str | None,
    typer.Option("--poses", metavar="FILE", help="World from sensor, one a scan.", show_default=False),
]
