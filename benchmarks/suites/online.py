# SPDX-License-Identifier: MIT
"""The online planner in the room with two occluders: views, time of a decision, and what each term is worth.

Three tables, medians or means over seeds (each its own starting pose) in the scene's own room mode with a
60 deg camera and a requirement of 60 deg: views to 90, 95, 98 and 99 % of the reachable area for several
voxels and noises, with the seconds a view takes, scan and measurement included; and the ablation of the
gain: share of the area within 60 deg and mean quality (cosine of the best view, 0 where unseen) at equal
numbers of views, as differences to both terms on, seed by seed, with 95 % bootstrap intervals. Give the
bench's candidates by UNSEEN_BENCH; without them their rows are left out.
"""

import os
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.run import head, row, suite
from nbv.coverage.coverage import Coverage
from nbv.coverage.measurement import CoverageTally
from nbv.online.planner import PlannerOptions
from nbv.online.targets import GainOptions
from nbv.plan.plan import Plan
from nbv.plan.planning import plan_views
from nbv.run.wording import count
from nbv.visibility.viewpoints import Candidates, load_candidates
from scenes.world.builtin import builtin_scene

BENCH = Path(os.environ.get("UNSEEN_BENCH", "../shared/bench")) / "room_candidates.npz"
SHARES = (0.90, 0.95, 0.98, 0.99)
VOXELS_M = (0.1, 0.05)
NOISES = ("none", "gaussian-2mm", "gaussian-10mm", "nguyen2012")
MOST_VIEWS = 60
WEIGHTS = {"w_q = 0": (1.0, 0.0), "w_q = 0.5": (1.0, 0.5), "w_q = 2": (1.0, 2.0), "w_v = 0": (0.0, 1.0)}


def plan(seed: int, *, target: float = 0.99, candidates: Candidates | None = None, **options: Any) -> Plan:
    """Plan online from the start that the seed draws."""
    noise = str(options.pop("noise", "none"))
    planner = PlannerOptions(**{"max_views": MOST_VIEWS, **options})
    scene = builtin_scene("two_occluders")
    return plan_views(
        scene, target=target, candidates=candidates, noise=noise, options=planner, rng=seed, n_threads=2
    )


def views_to(found: Plan) -> list[float]:
    """Views after which each share of the reachable area was met."""
    assert found.coverage is not None
    met = np.array([view.met_fraction for view in found.views]) / found.coverage.reachable
    return [
        float(np.argmax(met >= share - 1e-9)) + 1 if met[-1] >= share - 1e-9 else np.inf for share in SHARES
    ]


def views_row(name: str, n_seeds: int, **options: Any) -> str:
    """Return medians and the worst of the views, and the time of one view."""
    rows, seconds = [], []
    for seed in range(n_seeds):
        begun = time.perf_counter()
        found = plan(seed, **options)
        rows.append(views_to(found))
        seconds.append((time.perf_counter() - begun) / len(found.views))
    middle, worst = np.median(rows, axis=0), np.max(rows, axis=0)
    cells = [f"{m:g} ({w:g})" for m, w in zip(middle, worst, strict=True)]
    return row(name, *cells, f"{np.median(seconds):.2f}")


def curves(seed: int, n_views: int, gain: GainOptions) -> NDArray[np.float64]:
    """Share of the area within 60 deg and mean quality after each view, (2, n_views)."""
    found = plan(seed, target=1.0, max_views=n_views, epsilon_m2=0.0, gain=gain)
    assert isinstance(found.coverage, Coverage)  # a fresh plan holds its full coverage
    samples = found.coverage.samples
    tally = CoverageTally.start(builtin_scene("two_occluders").ray_caster(), samples, found.requirement)
    rows = []
    for view in found.views:
        tally.add(view)
        rows.append((tally.met_m2(), float(samples.areas @ tally.best_cosine)))
    rows += rows[-1:] * (n_views - len(rows))  # a planner that stopped sees no more
    return np.array(rows).T / samples.total_m2


def curves_of_seeds(n_seeds: int, n_views: int, gain: GainOptions) -> NDArray[np.float64]:
    """Return the curves of each seed, (n_seeds, 2, n_views)."""
    return np.array([curves(seed, n_views, gain) for seed in range(n_seeds)])


def interval(differences: NDArray[np.float64], rng: np.random.Generator) -> str:
    """Mean of differences with the 95 % bootstrap interval of it, in per cent."""
    drawn = rng.choice(differences, (4000, len(differences))).mean(axis=1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return f"{100 * differences.mean():+.1f} ({100 * low:+.1f} to {100 * high:+.1f})"


def ablation(n_seeds: int, n_views: int) -> Iterator[str]:
    """Yield what the planner gains or loses with other weights, at a third, two thirds and all views."""
    at = [max(round(n_views * k / 3), 1) for k in (1, 2, 3)]
    both, rng = curves_of_seeds(n_seeds, n_views, GainOptions()), np.random.default_rng(0)
    heads = [f"{what}, {count(k, 'view')}" for what in ("within 60 deg", "quality") for k in at]
    yield ""
    yield from head("weights", *heads)
    means = [f"{100 * both[:, what, k - 1].mean():.1f}" for what in (0, 1) for k in at]
    yield row("both 1", *means)
    for name, (occplane, quality) in WEIGHTS.items():
        gain = GainOptions(occplane_weight=occplane, quality_weight=quality)
        other = curves_of_seeds(n_seeds, n_views, gain) - both
        cells = [interval(other[:, what, k - 1], rng) for what in (0, 1) for k in at]
        yield row(name, *cells)


@suite("online", smallest="--seeds 1 --views 2 --most 2")
def online(seeds: int = 10, views: int = 24, most: int = MOST_VIEWS) -> Iterator[str]:
    """The online planner in the room with two occluders: views, seconds, and what each term is worth."""
    yield from head("room", *(f"{100 * share:.0f} %" for share in SHARES), "s a view")
    if BENCH.exists():
        bench = replace(load_candidates(BENCH), half_angle_deg=30.0)
        for voxel in VOXELS_M:
            name = f"bench candidates, cone, {voxel:g} m"
            yield views_row(name, seeds, candidates=bench, voxel_m=voxel, max_views=most)
    for noise in NOISES:
        yield views_row(f"room mode, 0.1 m, noise {noise}", seeds, voxel_m=0.1, noise=noise, max_views=most)
    yield from ablation(seeds, views)
