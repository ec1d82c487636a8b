# SPDX-License-Identifier: MIT
"""`python -m benchmarks.features openings|nulls`: openings behind clutter, and walls without any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer

from benchmarks.features.null_walls import NULLS, null_case
from benchmarks.features.walls import KINDS, WallCase, opening_case
from completion.templates.engine.template import Seen, Status, TemplateFit
from completion.templates.openings.null import LEVELS, rank
from completion.templates.pipeline import find_features
from scenes.checks import FloatArray

_RIGHT_M = 0.03
_SEEN = 0.3  # share of a side that must be in sight for it to be asked for
_HARDLY = 0.02  # share up to which a side is not in sight
_SAME = 0.7  # of what is found that must lie within the true one: the rest of that may be hidden


@dataclass(frozen=True, slots=True)
class SideError:
    """A side of an opening that was found: its error and deviation, metres, and whether it was in sight."""

    kind: str
    name: str
    error: float
    deviation: float
    state: Seen
    in_sight: float


def openings(
    first: Annotated[int, typer.Option("--first")] = 0,
    seeds: Annotated[int, typer.Option("--seeds")] = 10,
    noise: Annotated[float, typer.Option("--noise", help="Metres.")] = 0.005,
    listed: Annotated[bool, typer.Option("--list")] = False,
) -> None:
    """Doorways, windows and niches, 30, 50 and 70 % hidden."""
    print("| kind, hidden | found | of | false | sides in sight right | median mm | depth mm | z |")
    print("|---|---|---|---|---|---|---|---|")
    every: list[SideError] = []
    told = np.zeros(3, np.int64)
    kinds_right = []
    for kind in KINDS:
        for hidden in (0.3, 0.5, 0.7):
            sides, depth, counts = [], [], np.zeros(3, np.int64)
            for seed in range(first, first + seeds):
                case = opening_case(seed, kind, hidden, noise)
                fits = find_features([case.scan], KINDS).fits
                found = [fit for fit in fits if fit.status is not Status.NONE]
                same = [fit for fit in found if _overlap(case, fit) > _SAME]
                asked = sum(share >= _SEEN for share in case.seen.values()) >= 2
                counts += [bool(same) and asked, asked, len(found) - len(same)]
                if listed:
                    _tell(seed, case, fits)
                if same:
                    if "bottom" not in same[0].unseen:
                        kinds_right.append(same[0].kind == kind)
                    sides += _errors(case, same[0])
                    depth.append(same[0].value("depth") - case.depth)
            every += sides
            told += counts
            seen = [one for one in sides if one.in_sight >= _SEEN and one.state is Seen.CONFIRMED]
            off = np.array([abs(one.error) for one in seen])
            z = np.array([abs(one.error) / one.deviation for one in seen])
            print(
                f"| {kind} {hidden:.0%} | {counts[0]} | {counts[1]} | {counts[2]} | {(off < _RIGHT_M).sum()} "
                f"of {len(off)} | {1000 * np.median(off):.2f} | {1000 * np.median(np.abs(depth)):.1f} "
                f"| {np.median(z):.2f} |",
                flush=True,
            )
    seen = [one for one in every if one.in_sight >= _SEEN and one.state is Seen.CONFIRMED]
    missed = [one for one in every if one.in_sight >= _SEEN and one.state is not Seen.CONFIRMED]
    blind = [one for one in every if one.in_sight <= _HARDLY]
    blind = [one for one in blind if (one.kind, one.name) != ("doorway", "bottom")]  # floor goes on there
    off = np.array([abs(one.error) for one in seen])
    jambs = np.array(
        [abs(one.error) for one in seen if one.kind == "doorway" and one.name in ("left", "right")]
    )
    z = np.array([abs(one.error) / max(one.deviation, 1e-9) for one in seen])
    precision, recall = told[0] / max(told[0] + told[2], 1), told[0] / max(told[1], 1)
    print(
        f"F1 {2 * precision * recall / max(precision + recall, 1e-9):.3f}, kinds {np.mean(kinds_right):.2f}"
    )
    print(
        f"sides in sight within 3 cm {(off < _RIGHT_M).mean():.3f} of {len(off)}, not confirmed {len(missed)}"
    )
    print(f"median {1000 * np.median(off):.2f} mm, doors' jambs {1000 * np.median(jambs):.2f} mm")
    print(f"|z| median {np.median(z):.2f}, above 3: {(z > 3).mean():.3f}")
    unseen = np.mean([one.state is not Seen.CONFIRMED for one in blind])
    print(f"sides out of sight called unseen {unseen:.3f} of {len(blind)}")


def nulls(
    first: Annotated[int, typer.Option("--first")] = 0,
    seeds: Annotated[int, typer.Option("--seeds")] = 50,
    noise: Annotated[float, typer.Option("--noise", help="Metres.")] = 0.005,
    listed: Annotated[bool, typer.Option("--list")] = False,
    tail: Annotated[bool, typer.Option("--tail", help="The table of templates/openings/null.py.")] = False,
) -> None:
    """Walls without openings: how many are found, and what mirrors are called."""
    print("| null | walls | false | ambiguous | greatest evidence |")
    print("|---|---|---|---|---|")
    every: list[list[TemplateFit]] = []
    for kind in NULLS:
        false = unsure = 0
        most = [0.0]
        for seed in range(first, first + seeds):
            case = null_case(seed, kind, noise)
            fits = find_features([case.scan], KINDS).fits
            every.append(list(fits))
            false += any(fit.status is Status.FOUND for fit in fits)
            unsure += any(fit.status is Status.AMBIGUOUS for fit in fits)
            most += [fit.evidence for fit in fits]
            if listed and any(fit.status is not Status.NONE for fit in fits):
                _tell(seed, case, fits)
        print(f"| {kind} | {seeds} | {false} | {unsure} | {max(most):.0f} |", flush=True)
    if tail:
        for line in tail_lines(every):
            print(line)


def tail_lines(walls: Sequence[Sequence[TemplateFit]]) -> list[str]:
    """Return, of walls' fits, how many walls have one as good: by status first, then by evidence."""
    out = [f"N_WALLS = {len(walls)}"]
    for status in Status:
        ranks = [[rank(fit.status, fit.evidence) for fit in fits] for fits in walls]
        held = [sum(any(one >= rank(status, nats) for one in fits) for fits in ranks) for nats in LEVELS]
        out.append(f"{status.name}: {tuple(held)}")
    return out


def _rectangle(case: WallCase, fit: TemplateFit) -> tuple[FloatArray, float]:
    """The fit's y and z of the near and far corner (4,) in the world, and how far it is from the wall."""
    points = np.asarray(fit.geometry["corners"])
    off = float(np.abs(points[:, 0] - case.x).max())
    return np.array([*points[:, 1:].min(axis=0), *points[:, 1:].max(axis=0)]), off


def _overlap(case: WallCase, fit: TemplateFit) -> float:
    if case.hole is None:
        return 0.0
    found, off = _rectangle(case, fit)
    true = np.array(case.hole)
    shared = np.prod(np.clip(np.minimum(found[2:], true[2:]) - np.maximum(found[:2], true[:2]), 0, None))
    return float(shared / np.prod(found[2:] - found[:2])) * (off < 0.2)


def _errors(case: WallCase, fit: TemplateFit) -> list[SideError]:
    """Errors of all sides; left is the greater y, as seen from the room."""
    found = _rectangle(case, fit)[0] - np.array(case.hole)
    at = {"left": found[2], "right": found[0], "bottom": found[1], "top": found[3]}
    return [
        SideError(
            case.kind, side.name, float(at[side.name]), side.deviation, side.state, case.seen[side.name]
        )
        for side in fit.sides
    ]


def _tell(seed: int, case: WallCase, fits: Sequence[TemplateFit]) -> None:
    true = None if case.hole is None else np.round(case.hole, 3).tolist()
    seen = {name[0]: round(share, 2) for name, share in case.seen.items()}
    print(f"{case.kind} {seed} {true} depth {case.depth:.3f} hidden {case.hidden:.2f} seen {seen}")
    for fit in fits:
        at = np.round(_rectangle(case, fit)[0], 3).tolist()
        sides = [
            (s.name[0], s.confirmed, s.contradicted, s.total, round(1e3 * s.deviation, 1)) for s in fit.sides
        ]
        told = f"d {fit.value('depth'):.3f} evidence {fit.evidence:.0f} {fit.reason}"
        print(f"   {fit.kind} {fit.status} {at} {told} {sides}")
