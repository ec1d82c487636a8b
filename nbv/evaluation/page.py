# SPDX-License-Identifier: MIT
"""Page: the evaluation's record, its Markdown page and the pictures beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from completion.evaluation.tally import HEADLINE
from nbv.evaluation.plots import by_noise_plot, by_share_plot, reliability_plot, tradeoff_plot
from nbv.evaluation.study import Outcome
from nbv.evaluation.summary import summarise
from nbv.evaluation.tables import figures_table, outside_table, strata_table
from nbv.plots import Plot
from scenes.atomic import write_bytes

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
    noise : str
        The main noise.
    """

    main: Mapping[str, Mapping[str, dict[str, Any]]]
    by_noise: Mapping[str, Mapping[str, dict[str, Any]]]
    by_share: Mapping[str, Sequence[tuple[float, float]]]
    noise: str

    @classmethod
    def of(cls, outcomes: Sequence[tuple[str, Outcome]], noises: Sequence[str]) -> Evaluation:
        """Return the summaries of outcomes, each with the group of its scene."""
        groups = list(dict.fromkeys(group for group, _ in outcomes))
        main: dict[str, dict[str, dict[str, Any]]] = {}
        by_noise: dict[str, dict[str, dict[str, Any]]] = {}
        by_share: dict[str, list[tuple[float, float]]] = {}
        for group in groups:
            of_group = [outcome for name, outcome in outcomes if name == group]
            first = [outcome for outcome in of_group if outcome.noise == noises[0]]
            methods = list(dict.fromkeys(outcome.method for outcome in first))
            main[group] = {m: summarise([o for o in first if o.method == m]) for m in methods}
            ours = [outcome for outcome in of_group if outcome.method == _OURS]
            by_noise[group] = {n: summarise([o for o in ours if o.noise == n]) for n in noises}
            by_share[group] = [_hidden_share(o) for o in ours if o.noise == noises[0]]
        return cls(main, by_noise, by_share, noises[0])

    def record(self) -> dict[str, Any]:
        """Return everything for JSON."""
        shares = {group: [list(pair) for pair in pairs] for group, pairs in self.by_share.items()}
        return {"main": self.main, "by_noise": self.by_noise, "by_hidden_share": shares}

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
        "<!-- Written by `python -m nbv.evaluation`; do not edit. -->",
        "# Completion against the truth",
        _INTRODUCTION.format(noise=result.noise, options=", ".join(f"{k} {v}" for k, v in options.items())),
    ]
    for group, methods in result.main.items():
        parts += [f"## Scenes: {group}", *_group_parts(group, methods, result)]
        for name, plot in _pictures(group, methods, result).items():
            where = place(f"pictures/evaluation_{group}_{name}.png")
            where.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(where, plot.light)
            parts.append(f"![{name}](pictures/{where.name})")
    write_bytes(path, ("\n\n".join(parts) + "\n").encode())


def _group_parts(group: str, methods: Mapping[str, dict[str, Any]], result: Evaluation) -> list[str]:
    parts = [f"### {method}\n\n{strata_table(record)}" for method, record in methods.items()]
    parts += [f"### All methods\n\n{figures_table(methods)}", outside_table(methods)]
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
