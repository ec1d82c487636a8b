# SPDX-License-Identifier: MIT
"""Flattened walls beside the truth: how much ripple is left, how much relief is lost, how sure it was."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import kstest

from benchmarks.cases.relief import HELD_OUT_RIPPLES, STATIONARY, TUNING_RIPPLES, Wall, make_wall
from benchmarks.run import suite
from benchmarks.store import each
from completion.flattening.flat import FlatHeights, RegionKind
from completion.flattening.pipeline import flatten_heights

TALL = 1.5  # sd of the ripple: relief as high as this must stay


@dataclass(frozen=True, slots=True)
class Score:
    """A wall's figures.

    `seed`, `layout`, `ripple`: of the wall. `tall_m2`, `lost_m2`: area of relief of at least `TALL` sd, and
    how much of it was flattened.
    """

    seed: int
    layout: str
    ripple: str
    sd_mm: float  # of the ripple where the wall is plane
    divided: float  # that, over the rms error there afterwards
    tall_m2: float
    lost_m2: float
    kept: float  # share of the plane that was taken for relief
    relief_mm: float  # rms error of the relief that stayed, afterwards
    noise_mm: float  # white noise of a cell
    relief_p: float  # largest p of the regions that stayed
    cpu_s: float  # processor time

    @property
    def lost(self) -> float:
        """Share of the tall relief that was flattened."""
        return self.lost_m2 / self.tall_m2 if self.tall_m2 else 0.0

    def __str__(self) -> str:
        """A row of a table."""
        return (
            f"| {self.seed} | {self.layout} | {self.ripple} | {self.sd_mm:.1f} "
            f"| {min(self.divided, 999):.0f} | {100 * self.lost:.2f} | {100 * self.kept:.2f} "
            f"| {self.relief_mm:.2f} | {self.noise_mm:.2f} | {self.relief_p:.3f} | {self.cpu_s:.1f} |"
        )


HEAD = (
    "| seed | relief | ripple | sd, mm | divided by | relief lost, % | plane kept, % | error of relief, mm "
    "| noise, mm | largest p | CPU s |\n|---|---|---|---|---|---|---|---|---|---|---|"
)


def score(wall: Wall, flat: FlatHeights, seed: int = 0, cpu_s: float = 0.0) -> Score:
    """Compare a flattened wall with the truth."""
    plain = wall.relief == 0
    sd = float(np.std(wall.ripple[plain]))
    error = flat.heights - wall.relief
    tall = np.abs(wall.relief) >= TALL * np.std(wall.ripple)
    stays = flat.kept & ~plain
    p = [one.p for one in flat.regions if one.kind is RegionKind.RELIEF]
    return Score(
        seed=seed,
        layout=wall.layout,
        ripple=wall.kind,
        sd_mm=1e3 * sd,
        divided=sd / max(float(np.sqrt(np.mean(error[plain] ** 2))), 1e-9),
        tall_m2=float(tall.sum()) * wall.cell_m**2,
        lost_m2=float((tall & ~flat.kept).sum()) * wall.cell_m**2,
        kept=float(np.mean(flat.kept[plain])),
        relief_mm=1e3 * float(np.sqrt(np.mean(error[stays] ** 2))) if stays.any() else 0.0,
        noise_mm=1e3 * wall.noise_m,
        relief_p=max(p, default=0.0),
        cpu_s=cpu_s,
    )


def wall_score(seed: int, held_out: bool) -> Score:
    """Flatten the wall of a seed, and score it."""
    wall = make_wall(seed, held_out)
    begin = time.process_time()
    flat = flatten_heights(wall.heights, wall.cell_m)
    return score(wall, flat, seed, time.process_time() - begin)


def smallest_p(seed: int, kind: str) -> float:
    """P of the most evident region on a wall without relief: uniform, if p is right."""
    wall = make_wall(seed, layout="plain", kind=kind)
    regions = flatten_heights(wall.heights, wall.cell_m).regions
    return min((region.p for region in regions), default=1.0)


def summary(scores: list[Score], stationary: tuple[str, ...]) -> str:
    """The figures of all walls in one sentence."""
    steady = [one for one in scores if one.ripple in stationary]
    lost = sum(one.lost_m2 for one in scores) / max(sum(one.tall_m2 for one in scores), 1e-9)
    divided = np.array([one.divided for one in steady])
    well, bad = int(np.sum(divided >= 5)), sum(one.lost > 0.01 for one in scores)
    return (
        f"{len(scores)} walls, {len(steady)} with stationary ripple: of these the ripple was divided by 5 or "
        f"more on {well}, by {np.median(divided):.0f} in the median and {divided.min():.1f} at least; of all "
        f"relief of {TALL} sd or more {100 * lost:.2f} % was lost, more than 1 % on {bad} walls."
    )


@suite("flattening", smallest="--walls 1")
def flattening(held_out: bool = False, first: int = 0, walls: int = 24) -> Iterator[str]:
    """Generated walls with relief under ripple, flattened: ripple left, relief lost, plane kept.

    --held-out: layouts and ripples on which nothing was tuned.
    """
    yield HEAD
    scores = list[Score]()
    for result in each(wall_score, range(first, first + walls), held_out):
        scores.append(result)
        yield str(result)
    yield "\n" + summary(scores, STATIONARY)


@suite("flattening-nulls", smallest="--walls 1")
def flattening_nulls(held_out: bool = False, first: int = 0, walls: int = 12) -> Iterator[str]:
    """Smallest p of a region on walls without relief, which should be uniform; --walls a kind of ripple."""
    kinds = [kind for kind in (HELD_OUT_RIPPLES if held_out else TUNING_RIPPLES) if kind in STATIONARY]
    p = [value for kind in kinds for value in each(smallest_p, range(first, first + walls), kind)]
    shares = ", ".join(f"{100 * np.mean(np.array(p) <= x):.1f} % at {x}" for x in (0.01, 0.05, 0.5))
    yield f"{len(p)} walls without relief: {shares}; uniform: p = {kstest(p, 'uniform').pvalue:.2f}"
