# SPDX-License-Identifier: MIT
"""Flattened walls beside the truth: how much ripple is left, how much relief is lost, how sure it was."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.flattening.walls import Wall, make_wall
from completion.flattening.flat import FlatHeights, RegionKind
from completion.flattening.pipeline import flatten_heights
from scenes.checks import FloatArray

Method = Callable[[FloatArray, float], FlatHeights]
TALL = 1.5  # sd of the ripple: relief as high as this must stay


@dataclass(frozen=True, slots=True)
class Score:
    """A wall's figures.

    Attributes
    ----------
    seed, layout, ripple : int, str, str
        Of the wall.
    sd_mm : float
        Of the ripple where the wall is plane.
    divided : float
        That, over the rms error there afterwards.
    tall_m2, lost_m2 : float
        Area of relief of at least `TALL` sd, and how much of it was flattened.
    kept : float
        Share of the plane that was taken for relief.
    relief_mm : float
        Rms error of the relief that stayed, afterwards.
    noise_mm : float
        White noise of a cell.
    relief_p : float
        Largest p of the regions that stayed.
    cpu_s : float
        Processor time.
    """

    seed: int
    layout: str
    ripple: str
    sd_mm: float
    divided: float
    tall_m2: float
    lost_m2: float
    kept: float
    relief_mm: float
    noise_mm: float
    relief_p: float
    cpu_s: float

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


def score_walls(seeds: range, *, held_out: bool, method: Method = flatten_heights) -> Iterator[Score]:
    """Flatten the walls of some seeds, and score them."""
    for seed in seeds:
        wall = make_wall(seed, held_out)
        begin = time.process_time()
        flat = method(wall.heights, wall.cell_m)
        yield score(wall, flat, seed, time.process_time() - begin)


def smallest_p(seeds: range, kinds: tuple[str, ...]) -> list[float]:
    """P of the most evident region on walls without relief: uniform, if p is what it says."""
    found = []
    for kind in kinds:
        for seed in seeds:
            wall = make_wall(seed, layout="plain", kind=kind)
            regions = flatten_heights(wall.heights, wall.cell_m).regions
            found.append(min((one.p for one in regions), default=1.0))
    return found


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
