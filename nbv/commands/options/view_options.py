# SPDX-License-Identifier: MIT
"""Options of `unseen plan` and `unseen coverage`, with their names and help."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

KnownScene = Annotated[
    str | None,
    typer.Argument(
        metavar="[SCENE]",
        help="A mesh file, or builtin:NAME; left out, --scans tell all there is to know.",
        show_default=False,
    ),
]
CompletionMode = Annotated[
    Literal["conservative", "standard", "bold"],
    typer.Option("--inference", help="Without SCENE: how far surfaces are continued."),
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
    int,
    typer.Option(
        "--polish-steps",
        min=0,
        help="cover: most swaps tried to need fewer views; the search ends early when 1,500 for each view "
        "find no smaller plan.",
    ),
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
Region = Annotated[
    str | None,
    typer.Option(
        "--region",
        metavar="X0,Y0,Z0,X1,Y1,Z1",
        help="Only surface in this box counts, metres.",
        show_default=False,
    ),
]
KeepOut = Annotated[
    list[str] | None,
    typer.Option(
        "--keep-out",
        metavar="X0,Y0,Z0,X1,Y1,Z1",
        help="No station in this box, and no way through it; repeat it.",
        show_default=False,
    ),
]
Infer = Annotated[bool, typer.Option("--infer", help="Let completion stand in for views.")]
EarlierPlan = Annotated[
    str | None,
    typer.Option(
        "--plan",
        metavar="plan.json",
        help="Without a scene: an earlier plan, whose predictions are held against the scans.",
        show_default="the one in the output folder",
    ),
]
PlanFile = Annotated[
    str | None,
    typer.Option(
        "--plan",
        metavar="plan.json",
        help="Views of a plan, or a trajectory that --sensor looks from.",
        show_default=False,
    ),
]
ScanFiles = Annotated[
    list[str] | None,
    typer.Option(
        "--scans", metavar="SCAN", help="A registered scan, taken before; repeat it.", show_default=False
    ),
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
ModeOption = Annotated[
    Literal["room", "object"] | None,
    typer.Option("--mode", help="Scan from within, or from around.", show_default="from the scene"),
]
