# SPDX-License-Identifier: MIT
"""`python -m benchmarks.completion.relations calibration`: the tables of docs/results/relations.md."""

from __future__ import annotations

from typing import Annotated

import typer

from benchmarks.completion.relations.building import building_table
from benchmarks.completion.relations.calibration import calibration_table
from benchmarks.completion.relations.corner_study import corner_table
from benchmarks.completion.relations.figure_study import cost_table, part_table, start_table
from benchmarks.completion.relations.pattern_study import pattern_table
from benchmarks.completion.relations.real_study import real_table
from benchmarks.completion.relations.sensors import SENSORS
from benchmarks.completion.relations.strips import off_square_table, strip_table
from benchmarks.completion.relations.warp_study import warp_table

app = typer.Typer(help="What relations between surfaces are worth.", no_args_is_help=True)

_First = Annotated[int, typer.Option("--first", min=0, help="Seed of the first room.")]
_Rooms = Annotated[int, typer.Option("--rooms", min=1, help="How many rooms.")]


@app.callback()
def main() -> None:
    """What relations between surfaces are worth."""


@app.command()
def calibration(first: _First = 2000, rooms: _Rooms = 20) -> None:
    """How often true relations are rejected, before five sensors."""
    for line in calibration_table(range(first, first + rooms)):
        print(line, flush=True)


@app.command()
def strips(first: _First = 100, rooms: _Rooms = 25) -> None:
    """How far off a wall is beyond what was seen of it."""
    for line in strip_table(range(first, first + rooms)):
        print(line, flush=True)


@app.command()
def off_square(first: _First = 100, rooms: _Rooms = 25) -> None:
    """Walls that are .3, 1 and 3 deg off square: how often that is overruled, and the harm."""
    for line in off_square_table(range(first, first + rooms)):
        print(line, flush=True)


@app.command()
def corners(
    first: _First = 2000, rooms: Annotated[int, typer.Option("--rooms", min=1, help="How many rooms.")] = 10
) -> None:
    """Hidden corners of rooms without relations and with them, and what these do to the strata."""
    for line in corner_table(first, rooms):
        print(line, flush=True)


@app.command()
def part(parts: Annotated[int, typer.Option(min=1, help="How many parts a noise.")] = 100) -> None:
    """The part of figure 1: how well its R60 is known, wrong statements, and fits from any start."""
    for table in (part_table(parts), start_table(parts)):
        for line in table:
            print(line, flush=True)
        print()


@app.command()
def patterns(
    first: Annotated[int, typer.Option(min=0, help="Seed of the first part.")] = 100,
    parts: Annotated[int, typer.Option(min=1, help="How many of each, a noise.")] = 50,
) -> None:
    """Rows and mirrors of parts that have them, and what is taken for such among surfaces at random."""
    for line in pattern_table(range(first, first + parts)):
        print(line, flush=True)


@app.command()
def building(
    stations: Annotated[int, typer.Option(min=1, help="In the largest rooms.")] = 8,
    sensor: Annotated[
        list[int] | None, typer.Option(min=1, max=len(SENSORS), help="Of the five; all, when not given.")
    ] = None,
) -> None:
    """The duplex from several stations: which true relations are found, and which false ones."""
    for line in building_table(stations, [number - 1 for number in sensor or range(1, 1 + len(SENSORS))]):
        print(line, flush=True)


@app.command()
def warps(
    first: _First = 2000,
    rooms: Annotated[int, typer.Option("--rooms", min=1, help="How many rooms.")] = 10,
    parts: Annotated[int, typer.Option("--parts", min=1, help="How many parts.")] = 100,
) -> None:
    """Rooms and parts that are warped as a whole: what becomes of relations that hold."""
    for line in warp_table(range(first, first + rooms), range(parts)):
        print(line, flush=True)


@app.command()
def real() -> None:
    """Real scans: angles before and after, the largest turn, what is rejected."""
    for line in real_table():
        print(line, flush=True)


@app.command()
def cost() -> None:
    """What it costs to relate many surfaces."""
    for line in cost_table():
        print(line, flush=True)


if __name__ == "__main__":
    app()
