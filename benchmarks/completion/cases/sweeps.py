# SPDX-License-Identifier: MIT
"""Sweeps: noise along the ray, mixed pixels, hidden share, arc of a cylinder in view; scenes by seed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.completion.cases.task import Method, Task
from benchmarks.completion.scenes.rooms import random_case
from benchmarks.completion.scenes.sweep_scenes import column_case, table_case, wall_case
from benchmarks.completion.truth.cells import TrueCells
from benchmarks.completion.truth.sight import noise_free_ranges
from nbv.scanning.effects.effects import NO_EFFECTS, Effects, named_effects
from nbv.scanning.effects.footprint import Footprint
from nbv.scanning.effects.noise_models import ConstantNoise
from scenes.surfaces.catalogue import Cylinder

NOISE = "gaussian-2mm"  # where noise is not what is swept
MIXED_M = 0.01  # a range this far from what the middle of its beam meets is mixed
_SIGMA_M = 0.002


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One case at one level of a sweep; `part` tells kinds of scenes apart."""

    part: str
    level: float
    task: Task


@dataclass(frozen=True, slots=True)
class Sweep:
    """A sweep: what is varied, what is measured on each case, and the levels.

    Attributes
    ----------
    name : str
        As the command line has it.
    axis : str
        What the levels are, with their unit.
    measured : str
        What is measured on the noise-free rays of each case, with its unit; "" for nothing.
    levels : tuple of float
        Settings.
    trials : callable
        From level, seed of the scene and methods to the cases there.
    """

    name: str
    axis: str
    measured: str
    levels: tuple[float, ...]
    trials: Callable[[float, int, Mapping[str, Method]], list[Trial]]

    def all_trials(self, n_seeds: int, methods: Mapping[str, Method]) -> Iterator[Trial]:
        """Yield all cases, level by level."""
        for level in self.levels:
            for seed in range(n_seeds):
                yield from self.trials(level, seed, methods)


def _noise_trials(level: float, seed: int, methods: Mapping[str, Method]) -> list[Trial]:
    """A generated room, scanned with so many millimetres of noise."""
    noise = f"gaussian-{level:g}mm" if level > 0 else "none"
    return [Trial("rooms", level, Task(random_case(seed), methods, noise, named_effects(noise), 1000 * seed))]


def _mixed_trials(level: float, seed: int, methods: Mapping[str, Method]) -> list[Trial]:
    """A generated room, scanned by a phase scanner whose beam is so many pixels wide."""
    case = random_case(seed)
    noise, name = ConstantNoise(constant_m=_SIGMA_M), NOISE
    effects = Effects(noise=noise)
    if level > 0:
        width = level * case.views[0].sensor.projection.pixel_angle
        effects = Effects(noise=noise, footprint=Footprint(divergence_rad=width, returns="mean"))
        name = f"{NOISE}, beam of {level:g} pixels"
    return [
        Trial(
            "rooms",
            level,
            Task(
                case=case,
                methods=methods,
                noise=name,
                effects=effects,
                seed=1000 * seed,
                measure=_mixed_share,
            ),
        )
    ]


def _mixed_share(task: Task, _cells: Sequence[TrueCells]) -> float:
    """Percent of the pixels that came back whose range, but for noise, lies between two surfaces."""
    if task.effects.footprint is None:
        return 0.0
    exact = task.case.scans(replace(NO_EFFECTS, footprint=task.effects.footprint), task.seed)
    mixed = [np.abs(scan.ranges - noise_free_ranges(scan))[scan.valid] > MIXED_M for scan in exact]
    return 100 * float(np.concatenate(mixed).mean())


def _occlusion_trials(level: float, seed: int, methods: Mapping[str, Method]) -> list[Trial]:
    """A wall with a window, and a table, each with so many percent hidden."""
    cases = {"wall with window": wall_case(level / 100, seed), "table": table_case(level / 100, seed)}
    effects = named_effects(NOISE)
    return [
        Trial(
            part,
            level,
            Task(
                case=case,
                methods=methods,
                noise=NOISE,
                effects=effects,
                seed=1000 * seed,
                measure=_hidden_share,
            ),
        )
        for part, case in cases.items()
    ]


def _hidden_share(_task: Task, cells: Sequence[TrueCells]) -> float:
    """Percent of what is scored and in view that is hidden."""
    hidden = sum(int(cell.hidden.sum()) for cell in cells)
    return 100 * hidden / max(hidden + sum(int(cell.visible.sum()) for cell in cells), 1)


def _arc_trials(level: float, seed: int, methods: Mapping[str, Method]) -> list[Trial]:
    """A column of which an arc of so many degrees is in view."""
    case = column_case(level, seed)
    return [
        Trial(
            "column",
            level,
            Task(
                case=case,
                methods=methods,
                noise=NOISE,
                effects=named_effects(NOISE),
                seed=1000 * seed,
                measure=_arc_deg,
            ),
        )
    ]


def _arc_deg(_task: Task, cells: Sequence[TrueCells]) -> float:
    """Median over its height of the arc of a column that is in view, degrees."""
    (cell,) = [cell for cell in cells if isinstance(cell.chart.grid.surface, Cylinder)]
    surface = cell.chart.grid.surface
    seen = cell.visible.sum(axis=1)
    share = seen[seen > 0] * cell.chart.grid.cell[0] / surface.period
    return 360 * float(np.median(share)) if len(share) else 0.0


SWEEPS: dict[str, Sweep] = {
    sweep.name: sweep
    for sweep in (
        Sweep("noise", "noise along the ray, mm", "", (0, 1, 2, 5, 10), _noise_trials),
        Sweep("mixed-pixels", "beam width, pixels", "mixed pixels, %", (0, 1, 2, 4, 6), _mixed_trials),
        Sweep("occlusion", "hidden share, %", "hidden share, %", tuple(range(10, 80, 10)), _occlusion_trials),
        Sweep("arc", "arc in view, deg", "arc in view, deg", tuple(range(40, 200, 20)), _arc_trials),
    )
}
