# SPDX-License-Identifier: MIT
"""The constants of confidence: how far surfaces of each kind go on, most likely on generated rooms.

Run it with `python examples/calibrate_confidence.py [ROOMS] [FIRST_SEED]` (default: 32 rooms from seed 1000,
some minutes). Each room is scanned with 2 mm of noise and completed; every hidden place that a surface was
considered at is right or wrong by the truth. It prints the constants in use, the most likely ones, and the
mean log likelihood of both on the half of the rooms that the latter were not fitted to.
"""

import sys
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from benchmarks.completion.scenes.cases import hypothesis_of
from benchmarks.completion.scenes.rooms import random_case
from benchmarks.completion.truth.truth import TrueChart
from completion import CompletionOptions, Patch, complete
from completion.evidence.evidence import Label
from completion.extension.confidence import PERSISTENCE, Onward, Prospects, prospects
from nbv.scanning.effects.effects import named_effects
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose

TOLERANCE_M = 0.02
MOST_PLACES = 600  # of one surface
PRIOR = 0.1  # of a surface of 1 m2, what a change of a constant's logarithm by one has to be worth


@dataclass(frozen=True)
class Places:
    """Hidden places of one surface: what their probability depends on, which are right, what they weigh."""

    prospects: Prospects
    is_right: BoolArray
    weight: FloatArray


def places_in(seed: int) -> list[Places]:
    """Complete the room with this seed and compare with the truth."""
    case = random_case(seed)
    scans = case.scans(named_effects("gaussian-2mm"), 1000 * seed)
    completed = complete(scans, CompletionOptions(mode="bold", texture=False), rng=0)
    continued = hypothesis_of(completed, scans).true_surface
    scored = np.array([*case.model.scored, True])  # -1, none, is the last
    world, rng = completed.world_from_reference, np.random.default_rng(seed)
    found = [
        _places(patch, case.charts, world, rng)
        for patch, true in zip(completed.patches, continued, strict=True)
        if scored[true] and patch.observed.any()
    ]
    return [places for places in found if len(places.weight)]


def _places(patch: Patch, charts: tuple[TrueChart, ...], world: Pose, rng: np.random.Generator) -> Places:
    evidence = patch.evidence
    given = prospects(patch.grid, patch.shadows, patch.labelling, patch.limits, evidence)
    hidden = patch.shadows.region >= 0
    occluded = np.flatnonzero(evidence.labels[hidden] == Label.OCCLUDED)
    chosen = np.sort(rng.permutation(occluded)[:MOST_PLACES])
    points = patch.grid.centres()[np.flatnonzero(hidden)[chosen]]
    normals = world.rotate(patch.grid.surface.normal(points))
    nearest = np.full(len(chosen), np.inf)
    for chart in charts:
        nearest = np.minimum(nearest, chart.distances(world.apply(points), normals))
    area = len(occluded) * patch.grid.cell_area
    weight = np.full(len(chosen), np.sqrt(area) / max(len(chosen), 1))  # cells of one surface err together
    return Places(
        Prospects(
            given.base[chosen], given.onward[chosen], given.distance[chosen], given.end_probability[chosen]
        ),
        nearest <= TOLERANCE_M,
        weight,
    )  # fmt: skip


def together(places: list[Places]) -> Places:
    """All places as one."""
    fields = ("base", "onward", "distance", "end_probability")
    joined = (np.concatenate([getattr(one.prospects, field) for one in places]) for field in fields)
    return Places(
        Prospects(*joined),
        np.concatenate([one.is_right for one in places]),
        np.concatenate([one.weight for one in places]),
    )


def log_likelihood(places: Places, persistence: FloatArray) -> float:
    """Mean over the places, weighted."""
    probability = np.clip(places.prospects.probability(persistence), 0.003, 0.997)
    told = np.log(np.where(places.is_right, probability, 1 - probability))
    return float(np.average(told, weights=places.weight))


def most_likely(places: Places) -> FloatArray:
    """The constants (6, 2) that make the places most likely; those in use where nothing tells."""
    start = np.column_stack([np.log(PERSISTENCE[:, 0] / (1 - PERSISTENCE[:, 0])), np.log(PERSISTENCE[:, 1])])

    def constants(x: FloatArray) -> FloatArray:
        pairs = x.reshape(-1, 2)
        return np.column_stack([1 / (1 + np.exp(-pairs[:, 0])), np.exp(pairs[:, 1])])

    def cost(x: FloatArray) -> float:
        prior = PRIOR / places.weight.sum() * float(np.sum(np.square(x - start.ravel())))
        return prior - log_likelihood(places, constants(x))

    return constants(minimize(cost, start.ravel(), method="L-BFGS-B").x)


def main() -> None:
    """Fit and print."""
    given = [int(word) for word in sys.argv[1:]]
    n_rooms, first = [*given, *(32, 1000)[len(given) :]]
    rooms = [places_in(seed) for seed in range(first, first + n_rooms)]
    halves = [together([one for room in rooms[k::2] for one in room]) for k in (0, 1)]
    for k in (0, 1):
        fitted = most_likely(halves[k])
        print(
            f"log likelihood on the rooms of half {1 - k}: constants in use "
            f"{log_likelihood(halves[1 - k], PERSISTENCE):.4f}, fitted to half {k} "
            f"{log_likelihood(halves[1 - k], fitted):.4f}"
        )
    every = together([one for room in rooms for one in room])
    best = most_likely(every)
    print(
        f"on all: in use {log_likelihood(every, PERSISTENCE):.4f}, fitted {log_likelihood(every, best):.4f}"
    )
    for onward in Onward:
        n_surfaces = sum(bool((one.prospects.onward == onward).any()) for room in rooms for one in room)
        (a, b), (c, d) = PERSISTENCE[onward], best[onward]
        name = onward.name.lower().replace("_", " ")
        print(f"{name:14s} {n_surfaces:4d} surfaces  in use {a:.3f} {b:6.2f}  most likely {c:.3f} {d:6.2f}")


if __name__ == "__main__":
    main()
