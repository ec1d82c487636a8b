# SPDX-License-Identifier: MIT
"""Page: the evaluation's record, its Markdown page and the pictures beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.completion.cases.outcome import Outcome
from benchmarks.completion.cases.study import without
from benchmarks.completion.pages.plots import by_noise_plot, by_share_plot, reliability_plot, tradeoff_plot
from benchmarks.completion.pages.summary import ablation_row, summarise
from benchmarks.completion.pages.sweep_page import sweep_plot, sweep_table
from benchmarks.completion.pages.tables import (
    ablation_table,
    confidence_table,
    deviation_table,
    figures_table,
    outside_table,
    reasons_table,
    strata_table,
)
from benchmarks.completion.truth.tally import HEADLINE
from nbv.report.figures.plots import Plot
from scenes.run.atomic import write_bytes

_OURS = "standard"


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Summaries of all outcomes.

    Attributes
    ----------
    main : dict
        For each group of scenes and each method its record, with the main noise.
    by_noise : dict
        For each group and noise model the record of our standard mode.
    by_share : dict
        For each group, (share of the view that is hidden, IoU at 2 cm) of each case, standard mode.
    ablations : dict
        For each group and each cue left out, IoU by stratum and its difference to the full method.
    sweeps : dict
        For each sweep its record.
    noise : str
        The main noise.
    """

    main: Mapping[str, Mapping[str, dict[str, Any]]]
    by_noise: Mapping[str, Mapping[str, dict[str, Any]]]
    by_share: Mapping[str, Sequence[tuple[float, float]]]
    ablations: Mapping[str, Mapping[str, dict[str, Any]]]
    sweeps: Mapping[str, dict[str, Any]]
    noise: str

    @classmethod
    def of(
        cls,
        outcomes: Mapping[str, Sequence[Outcome]],
        noises: Sequence[str],
        cues: Sequence[str] = (),
        sweeps: Mapping[str, dict[str, Any]] | None = None,
    ) -> Evaluation:
        """Return the summaries of outcomes by group; `cues` are those left out, `sweeps` their records."""
        main: dict[str, dict[str, dict[str, Any]]] = {}
        by_noise: dict[str, dict[str, dict[str, Any]]] = {}
        by_share: dict[str, list[tuple[float, float]]] = {}
        left_out: dict[str, dict[str, dict[str, Any]]] = {}
        for group, of_group in outcomes.items():
            first = _by_method([outcome for outcome in of_group if outcome.noise == noises[0]])
            ours = [outcome for outcome in of_group if outcome.method == _OURS]
            ablated = {cue: first.pop(without(cue)) for cue in cues}
            main[group] = {method: summarise(of_method) for method, of_method in first.items()}
            by_noise[group] = {n: summarise([o for o in ours if o.noise == n]) for n in noises}
            by_share[group] = [_hidden_share(outcome) for outcome in first.get(_OURS, [])]
            left_out[group] = {cue: ablation_row(first[_OURS], rest) for cue, rest in ablated.items()}
        return cls(
            main=main,
            by_noise=by_noise,
            by_share=by_share,
            ablations=left_out,
            sweeps=sweeps or {},
            noise=noises[0],
        )

    def record(self) -> dict[str, Any]:
        """Return everything for JSON."""
        shares = {group: [list(pair) for pair in pairs] for group, pairs in self.by_share.items()}
        return {
            "main": self.main,
            "by_noise": self.by_noise,
            "by_hidden_share": shares,
            "ablations": self.ablations,
            "sweeps": self.sweeps,
        }

    def headline(self) -> dict[str, Any]:
        """Return IoU at 2 cm by group, method and row."""
        return {
            group: {
                method: {name: row["iou"][HEADLINE] for name, row in record["rows"].items()}
                for method, record in methods.items()
            }
            for group, methods in self.main.items()
        }

    def lines(self) -> list[str]:
        """Return a line a group and method for people."""
        return [
            f"{group}, {method}: IoU " + ", ".join(f"{key[:2]} {_text(value)}" for key, value in rows.items())
            for group, methods in self.headline().items()
            for method, rows in methods.items()
        ]


def write_page(
    result: Evaluation, options: Mapping[str, Any], path: Path, place: Callable[[str], Path]
) -> None:
    """Write the page to `path`, its pictures to where `place` puts their names."""
    parts = [
        "<!-- Written by `python -m benchmarks.completion`; do not edit. -->",
        "# Completion against the truth",
        _INTRODUCTION.format(noise=result.noise, options=", ".join(f"{k} {v}" for k, v in options.items())),
    ]
    for group, methods in result.main.items():
        parts += [f"## Scenes: {group}", *_group_parts(group, methods, result)]
        for name, plot in _pictures(group, methods, result).items():
            parts.append(_written(place, f"{group}_{name}", name, plot))
    parts += ["## Sweeps", _SWEEPS] if result.sweeps else []
    for name, record in result.sweeps.items():
        parts.append(f"### {name}")
        parts += [f"#### {part}\n\n{sweep_table(record, part)}" for part in record["parts"]]
        parts.append(_written(place, f"sweep_{name}", name, sweep_plot(record)))
    write_bytes(path, ("\n\n".join(parts) + "\n").encode())


def _written(place: Callable[[str], Path], name: str, title: str, plot: Plot) -> str:
    """Write a picture and return what shows it on the page."""
    where = place(f"pictures/evaluation_{name}.png")
    where.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(where, plot.light)
    return f"![{title}](pictures/{where.name})"


def _group_parts(group: str, methods: Mapping[str, dict[str, Any]], result: Evaluation) -> list[str]:
    parts = [f"### {method}\n\n{strata_table(record)}" for method, record in methods.items()]
    parts += [f"### All methods\n\n{figures_table(methods)}", outside_table(methods)]
    if _OURS in methods:
        ours = methods[_OURS]
        parts.append(f"### Standard mode: confidence\n\n{confidence_table(ours['confidence'])}")
        parts.append(f"### Standard mode: predicted deviation\n\n{deviation_table(ours['deviation'])}")
        parts.append(f"### Standard mode: reasons\n\n{reasons_table(ours['reasons'])}")
    if result.ablations[group]:
        table = ablation_table(result.ablations[group], methods[_OURS])
        parts.append(f"### Standard mode, leaving one cue out at a time\n\n{_ABLATION}\n\n{table}")
    if len(result.by_noise[group]) > 1:
        parts.append(f"### Standard mode, by noise along the ray\n\n{figures_table(result.by_noise[group])}")
    return parts


def _pictures(group: str, methods: Mapping[str, dict[str, Any]], result: Evaluation) -> dict[str, Plot]:
    pictures = {"tradeoff": tradeoff_plot(methods)}
    if _OURS in methods:
        pictures["reliability"] = reliability_plot(methods[_OURS]["confidence"])
        pictures["hidden_share"] = by_share_plot(result.by_share[group])
    if len(result.by_noise[group]) > 1:
        pictures["noise"] = by_noise_plot(result.by_noise[group])
    return pictures


def _by_method(outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    """Outcomes by method, in their order."""
    methods = dict.fromkeys(outcome.method for outcome in outcomes)
    return {method: [outcome for outcome in outcomes if outcome.method == method] for method in methods}


def _hidden_share(outcome: Outcome) -> tuple[float, float]:
    """Share of the true surfaces in view that is hidden, and IoU at 2 cm."""
    pooled = outcome.score.areas.pooled()
    hidden = float(pooled.hidden)
    return hidden / max(hidden + outcome.score.findings.visible_m2, 1e-9), float(pooled.iou[HEADLINE])


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


_INTRODUCTION = """Scans are simulated with noise `{noise}` along the ray. Inferred area counts where it is
hidden from all scans or where a noise-free beam goes through; it is right within 1, 2 or 5 cm of a true
surface whose normal agrees within 10 degrees. Hidden area is asked for where it is connected with what is
seen of its surface. IoU is found area over hidden area and wrong area together; wrong area belongs to the
stratum of the hidden part nearest to it on the surface that it continues. Intervals are bootstrapped over the
cases. Strata are taken over the scenes that keep to the prior that hidden surface goes on; S7 is those that
break it. Baselines know the true planes and whose each pixel is, and infer planes only; what they predict of
their own deviation and confidence is a constant.

Options: {options}."""
_SWEEPS = """Sweeps are of our standard mode. In "noise" and "mixed-pixels" the scenes are generated rooms;
in the latter a phase scanner's beam has a width, and reports the mean of all that it meets: mixed is a
range that lies more than 1 cm from what the middle of its beam meets, but for noise. In "occlusion" a board
hides part of a wall with a window, or of a table; in "arc" two boards hide a column on both sides. There
only the wall, the table's top or the column is scored. Intervals are 95 % over the cases of a level."""
_ABLATION = (
    "IoU at 2 cm; in brackets the difference to the full method, with its 95 % interval over the cases."
)
