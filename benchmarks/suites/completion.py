# SPDX-License-Identifier: MIT
"""Completion against the truth: rooms, the office and sweeps, by stratum of occlusion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache as cached
from functools import partial
from typing import Any

import numpy as np

from benchmarks.cases.rooms import Case, generated_cases, hypothesis_of, office_cases, random_case
from benchmarks.cases.sweeps import column_case, table_case, wall_case
from benchmarks.methods import Inference, inference_named
from benchmarks.methods.baselines import BASELINES, Baseline, baseline_hypothesis
from benchmarks.metrics.completion import Outcome, radius_errors, score
from benchmarks.metrics.inferred import Hypothesis, PairCounts, hypothesis_of_mesh, merge_counts
from benchmarks.metrics.truth import TrueCells, noise_free_ranges
from benchmarks.run import suite
from benchmarks.store import STORE, Store
from benchmarks.suites.summary import (
    ablation_row,
    ablation_table,
    confidence_table,
    deviation_table,
    figures_table,
    outside_table,
    reasons_table,
    strata_table,
    summarise,
    sweep_record,
    sweep_table,
)
from completion.boundary.continuation import ALL_CUES, Cue
from completion.options import CompletionOptions
from completion.pipeline import complete
from completion.result.completed_model import CompletedModel
from nbv.scanning.beam import Footprint
from nbv.scanning.effects import NO_EFFECTS, Effects, named_effects
from nbv.scanning.noise_models import ConstantNoise
from scenes.checks import FloatArray, InputError
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder

HELD_OUT = 2000  # seed of the first room that nothing is tuned on; constants of confidence come from 1000 on
MODES = ("conservative", "standard", "bold")
MIXED_M = 0.01  # a range this far from what the middle of its beam meets is mixed
_NOISE = "gaussian-2mm"

Method = CompletionOptions | Baseline | Inference
Measure = Callable[["Task", Sequence[TrueCells]], float]


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A case to scan, and the methods, by name, that complete the scans."""

    case: Case
    methods: Mapping[str, Method]
    noise: str  # name of the effects
    effects: Effects  # difference of the scans from exact ranges
    seed: int  # of the noise
    measure: Measure | None = None  # of a sweep, from the task and the cells that its scans see

    def key(self, method: str) -> dict[str, Any]:
        """Return all that the outcome of a method depends on, besides the sources."""
        chosen = self.methods[method]
        name = getattr(chosen, "__qualname__", None)
        name = f"{chosen.name}, {chosen.tests_rays}" if isinstance(chosen, Baseline) else name or repr(chosen)
        return {
            "case": self.case.name, "method": method, "noise": self.noise, "scene": self.case.fingerprint,
            "options": name, "effects": self.effects.to_json(), "seed": self.seed,
            "measured": self.measure is not None,
        }  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """A task with its scans taken."""

    task: Task
    scans: tuple[RangeImage, ...]
    cells: tuple[TrueCells, ...]
    n_threads: int | None = None

    @classmethod
    def of(cls, task: Task, n_threads: int | None = None) -> Bench:
        """Scan the case of a task."""
        scans = task.case.scans(task.effects, task.seed)
        return cls(task, scans, task.case.cells(scans), n_threads)

    def outcome(self, method: str) -> Outcome:
        """Run one of the task's methods and score it."""
        chosen, model = self.task.methods[method], self.task.case.model
        if isinstance(chosen, CompletionOptions):
            options, seed = chosen, self.task.seed
            return self.outcome_of(method, complete(self.scans, options, rng=seed, n_threads=self.n_threads))
        if isinstance(chosen, Baseline):
            inferred = baseline_hypothesis(chosen, model, self.cells, self.scans, self.n_threads)
        else:
            inferred = hypothesis_of_mesh(chosen(self.scans), [cell.chart for cell in self.cells])
        return self._scored(method, inferred, PairCounts(), np.zeros(0), None)

    def outcome_of(self, method: str, completed: CompletedModel) -> Outcome:
        """Score a completion of the scans."""
        model = self.task.case.model
        inferred = hypothesis_of(completed, self.scans)
        surfaces = [patch.source.fit.surface for patch in completed.patches]
        merges = merge_counts(self.scans, completed.owners, model.scored)
        radius_m = radius_errors(model, self.scans, surfaces, inferred.true_surface)
        areas = completed.hypothesised_m2, completed.free_space_violation_m2
        return self._scored(method, inferred, merges, radius_m, areas)

    def _scored(
        self, method: str, inferred: Hypothesis, merges: PairCounts, radius_m: FloatArray,
        areas: tuple[float, float] | None,
    ) -> Outcome:  # fmt: skip
        task = self.task
        result = score(task.case.model, self.cells, self.scans, inferred, n_threads=self.n_threads)
        hypothesised_m2, violation_m2 = areas or (result.claims.claimed.sum(), result.claims.violation_m2)
        names = task.case.scene.surface_names
        return Outcome(
            case=task.case.name, breaks_prior=task.case.breaks_prior, method=method, noise=task.noise,
            score=result, merges=merges, radius_m=radius_m, hypothesised_m2=float(hypothesised_m2),
            violation_m2=violation_m2, kinds=tuple((name.split()[0], k) for k, name in enumerate(names)),
            measured=math.nan if task.measure is None else task.measure(task, self.cells),
        )  # fmt: skip


def evaluate(tasks: Sequence[Task], store: Store, *, n_threads: int | None = None) -> Iterator[Outcome]:
    """Complete and score all cases in turn; outcomes that are in the store are not made again."""
    for task in tasks:
        bench = cached(partial(Bench.of, task, n_threads))  # scans are taken when the first outcome is made
        for method in task.methods:
            yield store.get(task.key(method), partial(_outcome, bench, method), Outcome, method)


def _outcome(bench: Callable[[], Bench], method: str) -> Outcome:
    return bench().outcome(method)


def tasks_of(cases: Sequence[Case], noise: str, methods: Mapping[str, Method], seed: int) -> list[Task]:
    """Return a task for each case, with a noise model by name and noise of its own.

    Raises InputError: no noise model of that name.
    """
    effects = named_effects(noise)
    return [Task(case, methods, noise, effects, seed + 1000 * k) for k, case in enumerate(cases)]


def mode_methods(modes: Sequence[str]) -> dict[str, Method]:
    """Return our completion in some modes, by name."""
    return {mode: CompletionOptions(mode=mode, texture=False) for mode in modes}  # type: ignore[arg-type]


def ablation_methods(cues: Sequence[str]) -> dict[str, Method]:
    """Return our standard mode without one of these cues each, by the names that tables use.

    Raises InputError: no such cue.
    """
    standard, known = CompletionOptions(mode="standard", texture=False), [str(cue) for cue in Cue]
    for cue in cues:
        if cue not in known:
            raise InputError(f"{cue!r} is no cue that can be left out; there are {', '.join(known)}")
    return {_without(c): replace(standard, cues=tuple(o for o in ALL_CUES if o != c)) for c in cues}


def _without(cue: str) -> str:
    return f"standard without {cue}"


@dataclass(frozen=True, slots=True)
class Sweep:
    """A sweep: the parameter that varies, and what is measured on the noise-free rays of each case."""

    axis: str  # meaning of the levels, with their unit
    measured: str  # what is measured, with its unit; "" for nothing
    levels: tuple[float, ...]
    # from level and seed to scenes by kind, name of the noise, effects, and what measures
    at: Callable[[float, int], tuple[dict[str, Case], str, Effects, Measure | None]]

    def trials(self, n_seeds: int, methods: Mapping[str, Method]) -> Iterator[tuple[str, float, Task]]:
        """Yield kind of scene, level and task, level by level."""
        for level in self.levels:
            for seed in range(n_seeds):
                cases, noise, effects, measure = self.at(level, seed)
                for kind, case in cases.items():
                    yield kind, level, Task(case, methods, noise, effects, 1000 * seed, measure)


def _noise_level(level: float, seed: int) -> tuple[dict[str, Case], str, Effects, Measure | None]:
    """A generated room, scanned with so many millimetres of noise."""
    noise = f"gaussian-{level:g}mm" if level > 0 else "none"
    return {"rooms": random_case(seed)}, noise, named_effects(noise), None


def _beam_width(level: float, seed: int) -> tuple[dict[str, Case], str, Effects, Measure | None]:
    """A generated room, scanned by a phase scanner whose beam is so many pixels wide."""
    case, noise, name = random_case(seed), ConstantNoise(constant_m=0.002), _NOISE
    effects = Effects(noise=noise)
    if level > 0:
        width = level * case.views[0].sensor.projection.pixel_angle
        effects = Effects(noise=noise, footprint=Footprint(divergence_rad=width, returns="mean"))
        name = f"{_NOISE}, beam of {level:g} pixels"
    return {"rooms": case}, name, effects, _mixed_share


def _hidden_board(level: float, seed: int) -> tuple[dict[str, Case], str, Effects, Measure | None]:
    """A wall with a window, and a table, each with so many percent hidden."""
    cases = {"wall with window": wall_case(level / 100, seed), "table": table_case(level / 100, seed)}
    return cases, _NOISE, named_effects(_NOISE), _hidden_share


def _visible_arc(level: float, seed: int) -> tuple[dict[str, Case], str, Effects, Measure | None]:
    """A column of which an arc of so many degrees is in view."""
    return {"column": column_case(level, seed)}, _NOISE, named_effects(_NOISE), _arc_deg


def _mixed_share(task: Task, _cells: Sequence[TrueCells]) -> float:
    """Percent of the pixels that came back whose range, but for noise, lies between two surfaces."""
    if task.effects.footprint is None:
        return 0.0
    exact = task.case.scans(replace(NO_EFFECTS, footprint=task.effects.footprint), task.seed)
    mixed = [np.abs(scan.ranges - noise_free_ranges(scan))[scan.valid] > MIXED_M for scan in exact]
    return 100 * float(np.concatenate(mixed).mean())


def _hidden_share(_task: Task, cells: Sequence[TrueCells]) -> float:
    """Percent of what is scored and in view that is hidden."""
    hidden = sum(int(cell.hidden.sum()) for cell in cells)
    return 100 * hidden / max(hidden + sum(int(cell.visible.sum()) for cell in cells), 1)


def _arc_deg(_task: Task, cells: Sequence[TrueCells]) -> float:
    """Median over its height of the arc of a column that is in view, degrees."""
    (cell,) = [cell for cell in cells if isinstance(cell.chart.grid.surface, Cylinder)]
    surface = cell.chart.grid.surface
    assert isinstance(surface, Cylinder)
    seen = cell.visible.sum(axis=1)
    share = seen[seen > 0] * cell.chart.grid.cell[0] / surface.period
    return 360 * float(np.median(share)) if len(share) else 0.0


SWEEPS = {
    "noise": Sweep("noise along the ray, mm", "", (0, 1, 2, 5, 10), _noise_level),
    "mixed-pixels": Sweep("beam width, pixels", "mixed pixels, %", (0, 1, 2, 4, 6), _beam_width),
    "occlusion": Sweep("hidden share, %", "hidden share, %", tuple(range(10, 80, 10)), _hidden_board),
    "arc": Sweep("arc in view, deg", "arc in view, deg", tuple(range(40, 200, 20)), _visible_arc),
}


@suite("completion", smallest="--scenes generated --rooms 1 --mode standard --no-baselines")
def completion(
    scenes: list[str] | None = None,
    frames: int = 10,
    rooms: int = 10,
    first_room: int = 0,
    noise: list[str] | None = None,
    mode: list[str] | None = None,
    baselines: bool = True,
    leave_out: list[str] | None = None,
    method: list[str] | None = None,
    sweep: list[str] | None = None,
    sweep_seeds: int = 10,
    seed: int = 0,
    threads: int | None = None,
) -> Iterator[str]:
    """Completion of simulated scans against the truth, by stratum of occlusion.

    --scenes: office, generated or held-out (nothing is tuned on those); --frames of the office; --rooms, of
    ten of which three break the prior; --noise: the first is the main one; --mode: conservative, standard or
    bold; --leave-out: a cue; --method: a method of others, by name or as MODULE:FUNCTION; --sweep: noise,
    mixed-pixels, occlusion or arc. Options that take no number may be repeated.
    """
    groups = scenes or ([] if sweep else ["office", "generated"])
    modes, cues, noises = mode or list(MODES), leave_out or [], noise or [_NOISE]
    ours = mode_methods(["standard"])
    methods: dict[str, Method] = mode_methods([m for m in MODES if m in modes or (cues and m == "standard")])
    methods |= ablation_methods(cues)
    methods |= {baseline.name: baseline for baseline in BASELINES if baselines}
    methods |= {name: inference_named(name) for name in method or []}
    store = STORE.get(Store())
    for group in groups:
        cases = _cases(group, frames, rooms, first_room)
        by_noise = {
            name: list(evaluate(tasks_of(cases, name, chosen, seed), store, n_threads=threads))
            for name, chosen in zip(noises, [methods] + [ours] * len(noises), strict=False)
        }
        yield from _group_lines(group, by_noise, cues)
    for name in sweep or []:
        found = [
            (kind, level, outcome)
            for kind, level, task in SWEEPS[name].trials(sweep_seeds, ours)
            for outcome in evaluate([task], store, n_threads=threads)
        ]
        record = sweep_record(SWEEPS[name], found)
        for kind in record["parts"]:
            yield from ("", f"### Sweep of {name}: {kind}", "", sweep_table(record, kind))


def _cases(group: str, frames: int, rooms: int, first_room: int) -> list[Case]:
    """The cases of a kind of scenes."""
    if group == "office":
        return office_cases(frames)
    if group not in ("generated", "held-out"):
        raise InputError(f"{group!r} is no kind of scenes; there are office, generated and held-out")
    return generated_cases(rooms, first_room + HELD_OUT * (group == "held-out"))


def _group_lines(group: str, by_noise: Mapping[str, Sequence[Outcome]], cues: Sequence[str]) -> Iterator[str]:
    """The tables of one kind of scenes."""
    main = next(iter(by_noise.values()))
    names = dict.fromkeys(outcome.method for outcome in main)
    outcomes = {name: [outcome for outcome in main if outcome.method == name] for name in names}
    ablated = {cue: outcomes.pop(_without(cue)) for cue in cues}
    records = {name: summarise(of_method) for name, of_method in outcomes.items()}
    for name, record in records.items():
        yield from ("", f"### {group}, {name}", "", strata_table(record))
    yield from ("", f"### {group}, all methods", "", figures_table(records), "", outside_table(records))
    if "standard" in records:
        ours = records["standard"]
        yield from ("", f"### {group}, standard: confidence", "", confidence_table(ours["confidence"]))
        yield from ("", f"### {group}, standard: deviation", "", deviation_table(ours["deviation"]))
        yield from ("", f"### {group}, standard: reasons", "", reasons_table(ours["reasons"]))
    if ablated:
        rows = {cue: ablation_row(outcomes["standard"], rest) for cue, rest in ablated.items()}
        yield from ("", f"### {group}, standard without a cue: IoU at 2 cm and difference", "")
        yield ablation_table(rows, records["standard"])
    if len(by_noise) > 1:
        ours = {n: summarise([o for o in some if o.method == "standard"]) for n, some in by_noise.items()}
        yield from ("", f"### {group}, standard, by noise", "", figures_table(ours))
