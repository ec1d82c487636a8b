# SPDX-License-Identifier: MIT
"""The evaluation's command line: which scenes, seeds, noises and modes, and where to write."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from completion.limits import Mode
from nbv.commands.run import Shared, running
from nbv.evaluation.cases import Case
from nbv.evaluation.page import Evaluation, write_page
from nbv.evaluation.study import evaluate, generated_cases, office_cases
from nbv.scanning.effects import named_effects
from scenes.atomic import write_json

MODES: tuple[Mode, ...] = ("conservative", "standard", "bold")


class Scenes(StrEnum):
    """Which scenes to evaluate on."""

    office = "office"
    generated = "generated"


def evaluation(
    scenes: Annotated[
        list[Scenes] | None, typer.Option("--scenes", help="Once for each kind.", show_default="both")
    ] = None,
    frames: Annotated[int, typer.Option("--frames", min=1, max=10, help="Of the office.")] = 10,
    rooms: Annotated[
        int, typer.Option("--rooms", min=1, help="Generated, three of ten break the prior.")
    ] = 10,
    first_room: Annotated[int, typer.Option("--first-room", min=0, help="Seed of the first room.")] = 0,
    noise: Annotated[
        list[str] | None,
        typer.Option("--noise", help="Once for each model; the first is the main one.", show_default="2 mm"),
    ] = None,
    modes: Annotated[
        list[str] | None, typer.Option("--mode", help="Once for each mode.", show_default="all three")
    ] = None,
    baselines: Annotated[bool, typer.Option("--baselines/--no-baselines", help="Naive ones beside.")] = True,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder.")] = Path("out/evaluation"),
    page: Annotated[Path | None, typer.Option("--page", help="Also write the page to this file.")] = None,
    seed: Annotated[int, typer.Option("--seed", help="Of the noise.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing.")] = False,
    threads: Annotated[int | None, typer.Option("--threads", min=1)] = None,
) -> None:
    """Complete scans of scenes whose truth is known, score them by stratum, and write table and pictures."""
    wanted = scenes or list(Scenes)
    noises = noise or ["gaussian-2mm"]
    chosen = _modes(modes)
    shared = Shared(out=out, seed=seed, as_json=as_json, quiet=quiet, threads=threads, max_memory=None)
    with running("evaluation", shared, default=str(out), is_folder=True) as run:
        for name in noises:
            named_effects(name)
        groups = _groups(wanted, frames, rooms, first_room)
        outcomes = [
            (group, outcome)
            for group, cases in groups.items()
            for index, name in enumerate(noises)
            for outcome in evaluate(
                cases,
                noise=name,
                modes=chosen if index == 0 else ("standard",),
                with_baselines=baselines and index == 0,
                seed=seed,
                n_threads=threads,
                progress=run.progress,
            )
        ]
        result = Evaluation.of(outcomes, noises)
        options = {
            "scenes": [str(kind) for kind in wanted], "frames": frames, "rooms": rooms,
            "first_room": first_room, "noise": noises, "modes": list(chosen), "baselines": baselines,
        }  # fmt: skip
        write_json(run.path("evaluation.json"), {"options": {**options, "seed": seed}, **result.record()})
        write_page(result, options, run.path("completion-evaluation.md"), run.path)
        if page is not None:
            write_page(result, options, page, lambda name: page.parent / name)
        run.finish([], options, result.headline(), result.lines())


def _groups(wanted: list[Scenes], frames: int, rooms: int, first_room: int) -> dict[str, list[Case]]:
    """Return the cases of each kind of scenes."""
    groups: dict[str, list[Case]] = {}
    if Scenes.office in wanted:
        groups["office"] = office_cases(frames)
    if Scenes.generated in wanted:
        groups["generated"] = generated_cases(rooms, first_room)
    return groups


def _modes(names: list[str] | None) -> tuple[Mode, ...]:
    """Return the modes with these names, all of them when none is given."""
    for name in names or []:
        if name not in MODES:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(MODES)}", param_hint="--mode")
    return tuple(mode for mode in MODES if mode in (names or MODES))


def main() -> None:
    """Run the command."""
    typer.run(evaluation)
