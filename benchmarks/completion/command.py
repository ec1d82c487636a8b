# SPDX-License-Identifier: MIT
"""The evaluation's command line: which scenes, seeds, noises, methods and sweeps, and where to write."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.completion.cases.archive import Archive
from benchmarks.completion.cases.baselines import BASELINES
from benchmarks.completion.cases.cost import Cost, cost_line, cost_summary
from benchmarks.completion.cases.outcome import Outcome
from benchmarks.completion.cases.study import (
    ablation_methods,
    generated_cases,
    mode_methods,
    office_cases,
    tasks_of,
)
from benchmarks.completion.cases.sweeps import SWEEPS, Sweep
from benchmarks.completion.cases.task import Method, Task, evaluate
from benchmarks.completion.pages.page import Evaluation, write_page
from benchmarks.completion.pages.sweep_page import Found, sweep_record
from benchmarks.completion.scenes.cases import Case
from completion.extension.extent import Mode
from nbv.commands.process.progress import Progress
from nbv.commands.process.run import Shared, running
from scenes.run.atomic import write_json

MODES: tuple[Mode, ...] = ("conservative", "standard", "bold")
HELD_OUT = 2000  # seed of the first room that nothing is tuned on; constants of confidence come from 1000 on


class Scenes(StrEnum):
    """Which scenes to evaluate on; nothing is tuned on the rooms that are held out."""

    office = "office"
    generated = "generated"
    held_out = "held-out"


class SweepName(StrEnum):
    """Sweeps of `benchmarks.completion.cases.sweeps`."""

    noise = "noise"
    mixed_pixels = "mixed-pixels"
    occlusion = "occlusion"
    arc = "arc"


def evaluation(
    scenes: Annotated[
        list[Scenes] | None,
        typer.Option(
            "--scenes", help="Once for each kind.", show_default="office, generated; none with --sweep"
        ),
    ] = None,
    frames: Annotated[int, typer.Option("--frames", min=1, max=10, help="Of the office.")] = 10,
    rooms: Annotated[
        int, typer.Option("--rooms", min=1, help="Generated or held out, three of ten break the prior.")
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
    leave_out: Annotated[
        list[str] | None, typer.Option("--leave-out", help="A cue; once for each study without one.")
    ] = None,
    sweep: Annotated[list[SweepName] | None, typer.Option("--sweep", help="Once for each.")] = None,
    sweep_seeds: Annotated[int, typer.Option("--sweep-seeds", min=1, help="Scenes at each level.")] = 10,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder; outcomes that are in it are not made again.")
    ] = Path("out/evaluation"),
    page: Annotated[Path | None, typer.Option("--page", help="Also write the page to this file.")] = None,
    seed: Annotated[int, typer.Option("--seed", help="Of the noise.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing.")] = False,
    threads: Annotated[int | None, typer.Option("--threads", min=1)] = None,
) -> None:
    """Complete scans of scenes whose truth is known, score them by stratum, and write table and pictures.

    Each outcome is kept in the folder as soon as it is there: run parts one after the other or interrupt
    them, and name all of them at last to join the page.
    """
    wanted = scenes or ([] if sweep else [Scenes.office, Scenes.generated])
    noises, cues, chosen = noise or ["gaussian-2mm"], leave_out or [], _modes(modes or [], leave_out or [])
    shared = Shared(out=out, seed=seed, as_json=as_json, quiet=quiet, threads=threads, max_memory=None)
    with running("evaluation", shared, default=str(out), is_folder=True) as run:
        ours = mode_methods(["standard"])
        methods: dict[str, Method] = {**mode_methods(chosen), **ablation_methods(cues)}
        methods |= {baseline.name: baseline for baseline in BASELINES if baselines}
        study = _Study(Archive(run.out / "outcomes"), threads, run.progress)
        outcomes = {
            group: [
                outcome
                for index, name in enumerate(noises)
                for outcome in study.run(tasks_of(cases, name, methods if index == 0 else ours, seed))
            ]
            for group, cases in _groups(wanted, frames, rooms, first_room).items()
        }
        records = {
            str(name): sweep_record(SWEEPS[name], study.sweep(SWEEPS[name], sweep_seeds, ours))
            for name in sweep or []
        }
        result = Evaluation.of(outcomes, noises, cues, records)
        options = {
            "scenes": [str(kind) for kind in wanted], "frames": frames, "rooms": rooms,
            "first_room": first_room, "noise": noises, "modes": list(chosen), "baselines": baselines,
            "leave_out": cues, "sweeps": list(records), "sweep_seeds": sweep_seeds,
        }  # fmt: skip
        write_json(run.path("evaluation.json"), {"options": {**options, "seed": seed}, **result.record()})
        write_page(result, options, run.path("completion-evaluation.md"), run.path)
        if page is not None:
            write_page(result, options, page, lambda name: page.parent / name)
        costs = study.costs()
        run.costs.update(costs)
        lines = [cost_line(method, cost) for method, cost in costs.items()]
        run.finish(options, result.headline(), [*result.lines(), *lines])


@dataclass(slots=True, eq=False)
class _Study:
    """Runs tasks, and keeps account of what each method took."""

    archive: Archive
    threads: int | None
    progress: Progress
    taken: dict[str, list[Cost]] = field(default_factory=dict)

    def run(self, tasks: Sequence[Task]) -> list[Outcome]:
        """Return the outcomes of some tasks."""
        outcomes = []
        for outcome, cost in evaluate(tasks, self.archive, n_threads=self.threads, progress=self.progress):
            outcomes.append(outcome)
            if cost is not None:
                self.taken.setdefault(outcome.method, []).append(cost)
        return outcomes

    def sweep(self, sweep: Sweep, n_seeds: int, methods: Mapping[str, Method]) -> list[Found]:
        """Return the outcomes of a sweep; no scene stays in memory longer than it is needed."""
        return [
            Found(trial.part, trial.level, outcome)
            for trial in sweep.all_trials(n_seeds, methods)
            for outcome in self.run([trial.task])
        ]

    def costs(self) -> dict[str, dict[str, Any]]:
        """Return what each method took."""
        return {method: cost_summary(costs) for method, costs in self.taken.items()}


def _groups(wanted: Sequence[Scenes], frames: int, rooms: int, first_room: int) -> dict[str, list[Case]]:
    """Return the cases of each kind of scenes."""
    groups: dict[str, list[Case]] = {}
    if Scenes.office in wanted:
        groups["office"] = office_cases(frames)
    if Scenes.generated in wanted:
        groups["generated"] = generated_cases(rooms, first_room)
    if Scenes.held_out in wanted:
        groups["held-out"] = generated_cases(rooms, HELD_OUT + first_room)
    return groups


def _modes(names: Sequence[str], cues: Sequence[str]) -> tuple[Mode, ...]:
    """Return the modes with these names, all when none is given; standard too where cues are left out."""
    for name in names:
        if name not in MODES:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(MODES)}", param_hint="--mode")
    asked = set(names or MODES) | ({"standard"} if cues else set())
    return tuple(mode for mode in MODES if mode in asked)


def main() -> None:
    """Run the command."""
    typer.run(evaluation)
