# SPDX-License-Identifier: MIT
"""`python -m benchmarks.completion.dimensions`: intervals and advice against rooms of known truth.

Each room is scanned from one place, by a scanner whose offset, scale and axes are drawn anew. A table tells
by kind of dimension how many intervals hold the truth, those that rest on inferred surface apart, how wide
they are, and how often each word of advice is regretted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer

from benchmarks.completion.dimensions.scanners import SCANNERS
from benchmarks.completion.dimensions.truth import SceneTruth
from benchmarks.completion.scenes.rooms import random_case
from completion import CompletionOptions, complete
from completion.exchange.dimensions.advice import advice
from scenes.pose import Pose
from scenes.world.scene import Scene

_CLEAR_M = 0.4  # around a station


@dataclass(frozen=True, slots=True)
class Found:
    """A dimension, what is said of it, and what is true."""

    kind: str
    value: float
    low: float
    high: float
    share: float
    across: float
    word: str
    truth: float | None

    @property
    def holds(self) -> bool:
        """Whether its interval holds the truth."""
        return self.truth is not None and self.low <= self.truth <= self.high


def main(
    rooms: Annotated[int, typer.Option("--rooms", min=1, help="How many.")] = 200,
    first: Annotated[int, typer.Option("--first", min=0, help="Seed of the first.")] = 12000,
    scanner: Annotated[str, typer.Option("--scanner", help=", ".join(SCANNERS))] = "2mm",
    tolerance: Annotated[float, typer.Option("--tolerance", help="Metres.")] = 0.01,
    listed: Annotated[bool, typer.Option("--listed", help="Print what does not hold.")] = False,
) -> None:
    """Print the table."""
    found: list[Found] = []
    for seed in range(first, first + rooms):
        some = list(_of_room(seed, scanner, tolerance))
        found += some
        if listed:
            for one in some:
                if not one.holds:
                    print(f"room {seed}: {one}", flush=True)
    for line in table(found, tolerance):
        print(line, flush=True)


def _of_room(seed: int, scanner: str, tolerance: float) -> Iterator[Found]:
    scene = random_case(seed).scene
    scan = SCANNERS[scanner].scan(scene, station(scene, seed), seed)
    done = complete(scan, CompletionOptions(texture=False), rng=0)
    truth = SceneTruth(scene)
    for one in done.decisions(tolerance).dimensions:
        known = one.kind, one.value, one.low, one.high
        yield Found(
            *known, one.measured_share, across=one.across_m, word=advice(one, tolerance), truth=truth.of(one)
        )


def station(scene: Scene, seed: int) -> Pose:
    """A place in a room with nothing near."""
    rng = np.random.default_rng([20270, seed])
    around = rng.normal(size=(200, 3))
    caster, size = scene.ray_caster(), np.minimum(scene.mesh.bounds()[1], [5.5, 5.0, 3.0])
    for _ in range(500):
        eye = np.array([*rng.uniform(0.4, size[:2] - 0.4), rng.uniform(1.3, 1.7)])
        if caster.first_hit(np.tile(eye, (200, 1)), around).ranges.min() >= _CLEAR_M:
            break
    turn = rng.uniform(0, 2 * np.pi)
    return Pose.looking_at(eye, eye + [np.cos(turn), np.sin(turn), 0.0])


def table(found: list[Found], tolerance: float) -> Iterator[str]:
    """Lines of a table in Markdown."""
    yield "| kind | n | not there | hold | on inferred surface: n, hold | rms error, mm | median half, mm |"
    yield "|---|---|---|---|---|---|---|"
    for kind in sorted({one.kind for one in found}):
        own = [one for one in found if one.kind == kind]
        there = [one for one in own if one.truth is not None]
        inferred = [one for one in there if one.share < 1]
        error = [one.value - one.truth for one in there if one.truth is not None]
        yield (
            f"| {kind} | {len(own)} | {len(own) - len(there)} | {_share(there)} | {len(inferred)}, "
            f"{_share(inferred)} | {1000 * float(np.sqrt(np.mean(np.square(error or [np.nan])))):.2f} | "
            f"{500 * float(np.median([one.high - one.low for one in there] or [np.nan])):.2f} |"
        )
    yield ""
    yield "| advice | n | not there | wrong by more than the tolerance |"
    yield "|---|---|---|---|"
    for word in ("rely", "check", "do not build"):
        own = [one for one in found if one.word == word]
        gone = sum(one.truth is None for one in own)
        wrong = sum(
            one.truth is not None and abs(one.value - one.truth) > tolerance * one.across for one in own
        )
        yield f"| {word} | {len(own)} | {gone} | {wrong} |"


def _share(found: list[Found]) -> str:
    return f"{100 * np.mean([one.holds for one in found]):.1f} %" if found else "-"


if __name__ == "__main__":
    typer.run(main)
