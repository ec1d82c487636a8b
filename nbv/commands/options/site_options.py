# SPDX-License-Identifier: MIT
"""Options of `unseen plan` and `unseen coverage` that say where stations may stand."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from nbv.commands.options.options import parse_numbers

if TYPE_CHECKING:
    from nbv.visibility.standing.site import SiteOptions

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
        "--spacing", min=0.01, metavar="M", help="Between places for stations.", show_default="0.5, or 1"
    ),
]
Clearance = Annotated[
    float, typer.Option("--clearance", min=0.001, metavar="M", help="From the sensor to every surface.")
]


def asked_site(
    *,
    rooms: str,
    outdoors: bool,
    all_round: bool,
    heights: str | None,
    spacing: float | None,
    clearance: float,
) -> SiteOptions:
    """Return where stations may stand, as a user wrote it.

    Raises
    ------
    typer.BadParameter
        Rooms or heights that are no list of numbers.
    InputError
        Numbers that make no sense.
    """
    from nbv.visibility.standing.site import SiteOptions

    up = () if heights is None else parse_numbers(heights, heights.count(",") + 1, "--heights")
    if rooms in ("all", "connected"):
        chosen: str | tuple[int, ...] = rooms
    else:
        numbers = parse_numbers(rooms, rooms.count(",") + 1, "--rooms")
        chosen = tuple(int(number) for number in numbers)
        if chosen != numbers:
            raise typer.BadParameter(f"--rooms takes all, connected, or whole numbers, got {rooms}")
    return SiteOptions(
        rooms=chosen,  # type: ignore[arg-type]  # the two words, or numbers
        outdoors=outdoors,
        all_round=all_round,
        heights_m=up or None,
        spacing_m=spacing,
        clearance_m=clearance,
    )
