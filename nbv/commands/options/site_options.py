# SPDX-License-Identifier: MIT
"""Options of `unseen plan` and `unseen coverage` that say where stations may stand."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nbv.commands.options.options import Given, parse_numbers, with_value

if TYPE_CHECKING:
    from nbv.visibility.standing.site_options import SiteOptions

Rooms = Annotated[
    str, typer.Option("--rooms", metavar="all|connected|N,N,...", help="Rooms in which stations may stand.")
]
Without = Annotated[
    list[str] | None,
    typer.Option(
        "--without",
        metavar="PATTERN",
        help='Leave out surfaces of such names, like "*Door*"; repeat it.',
        show_default=False,
    ),
]
Outdoors = Annotated[bool, typer.Option("--outdoors", help="Stations may stand outside, too.")]
AllRound = Annotated[bool, typer.Option("--all-round", help="An object may be looked at from below.")]
Heights = Annotated[
    str | None,
    typer.Option(
        "--heights",
        metavar="M,M,...",
        help="Of the sensor above the floor.",
        show_default="0.4,1.0,1.6,2.2",
    ),
]
Spacing = Annotated[
    float | None,
    typer.Option(
        "--spacing",
        min=0.01,
        metavar="M",
        help="Between places for stations.",
        show_default="0.5; 1 for cameras in large buildings",
    ),
]
Clearance = Annotated[
    float, typer.Option("--clearance", min=0.001, metavar="M", help="From the sensor to every surface.")
]


Start = Annotated[
    str | None,
    typer.Option(
        "--start", metavar="X,Y[,Z]", help="Where the first station stands, metres.", show_default=False
    ),
]
SeveralHeights = Annotated[
    bool, typer.Option("--several-heights", help="Stations may stand at several heights over one spot.")
]


@dataclass(frozen=True, slots=True)
class AskedSite:
    """Where stations may stand, and the patterns of the names of surfaces that are left out."""

    options: SiteOptions
    without: tuple[str, ...]


def with_site(command: Given) -> Given:
    """Return a command that also has the options of where stations may stand; it takes them as `site`."""
    return with_value(command, "site", _SITE, _asked, after="mode")


def with_planned_site(command: Given) -> Given:
    """Return a command like `with_site` that also has those of the stations that are to be planned."""
    return with_value(command, "site", _PLANNED_SITE, _asked, after="mode")


_SITE: dict[str, tuple[Any, Any]] = {
    "rooms": (Rooms, "all"),
    "without": (Without, None),
    "outdoors": (Outdoors, False),
    "all_round": (AllRound, False),
    "heights": (Heights, None),
    "spacing": (Spacing, None),
    "clearance": (Clearance, 0.3),
}
_PLANNED_SITE: dict[str, tuple[Any, Any]] = {
    **_SITE,
    "start": (Start, None),
    "several_heights": (SeveralHeights, False),
}


def _asked(
    *,
    rooms: str,
    without: list[str] | None,
    outdoors: bool,
    all_round: bool,
    heights: str | None,
    spacing: float | None,
    clearance: float,
    start: str | None = None,
    several_heights: bool = False,
) -> AskedSite:
    """Return what a user wrote; what makes no sense is a usage error."""
    from nbv.visibility.standing.site_options import SiteOptions

    up = () if heights is None else parse_numbers(heights, heights.count(",") + 1, "--heights")
    if wrong := [height for height in up if height <= 0]:
        raise typer.BadParameter(f"--heights are above the floor, metres, got {wrong[0]:g}")
    if rooms in ("all", "connected"):
        chosen: str | tuple[int, ...] = rooms
    else:
        numbers = parse_numbers(rooms, rooms.count(",") + 1, "--rooms")
        chosen = tuple(int(number) for number in numbers)
        if chosen != numbers or min(chosen) < 1:
            raise typer.BadParameter(f"--rooms takes all, connected, or whole numbers from 1, got {rooms}")
    for option, length in (("--spacing", spacing), ("--clearance", clearance)):
        if length is not None and not math.isfinite(length):
            raise typer.BadParameter(f"{option} is a finite number of metres, got {length:g}")
    n_start = 3 if start is not None and start.count(",") == 2 else 2
    begins = None if start is None else parse_numbers(start, n_start, "--start")
    options = SiteOptions(
        rooms=chosen,  # type: ignore[arg-type]  # the two words, or numbers
        outdoors=outdoors,
        all_round=all_round,
        heights_m=up or None,
        spacing_m=spacing,
        clearance_m=clearance,
        start=begins,
        several_heights=several_heights,
    )
    return AskedSite(options, tuple(without or ()))
