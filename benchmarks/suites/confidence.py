# SPDX-License-Identifier: MIT
"""The constants of confidence: how far surfaces go on, most likely on rooms, furnished flats and a walk.

Each room is scanned with 2 mm of noise and completed. Every
hidden place that a surface was considered at is right or wrong by the truth. So are frames in furnished
flats, and of a walk through the furnished lower storey of a house (`UNSEEN_DATA`, default ../shared/data;
left out where that is absent). Rooms, flats and walk count the same. It prints the constants in use,
the most likely ones, and the mean log likelihood of both on the half of the places that the latter were not
fitted to.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.optimize import minimize

from benchmarks.cases.frames import DATA, WALKS, Flat, Known
from benchmarks.cases.rooms import hypothesis_of, random_case
from benchmarks.metrics.odds import most_likely_odds
from benchmarks.metrics.other_scans import is_there
from benchmarks.run import suite
from completion import CompletionOptions, Patch, complete
from completion.evidence.evidence import Label
from completion.extension.confidence import (
    EVEN_M,
    KNOWN,
    KNOWN_PAST_END,
    PAST_END,
    PERSISTENCE,
    WEIGHTS,
    Onward,
    Prospects,
    prospects,
)
from nbv.scanning.effects import named_effects
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose

TOLERANCE_M = 0.02
MOST_PLACES = 600  # of one surface
EACH = 1  # frame of the walk
PRIOR = 0.1  # of a surface of 1 m2, what a change of a constant's logarithm by one has to be worth
RIDGE = 0.01  # of all places, what a weight whose part of the log odds strays by one has to be worth


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
    patches = [patch for patch, true in zip(completed.patches, continued, strict=True) if scored[true]]

    def is_right(points: FloatArray, normals: FloatArray) -> BoolArray:
        nearest = np.full(len(points), np.inf)
        for chart in case.charts:
            nearest = np.minimum(nearest, chart.distances(points, normals))
        return nearest <= TOLERANCE_M

    return _all_places(patches, completed.world_from_reference, is_right, seed)


def places_in_frame(source: Known, number: int) -> list[Places]:
    """Complete a frame of a flat or of a walk alone and compare with the truth."""
    completed = complete(source.frames[number], CompletionOptions(mode="bold", texture=False), rng=0)
    return _all_places(
        completed.patches,
        completed.world_from_reference,
        lambda points, normals: is_there(points, normals, source.caster),
        number,
    )


def _all_places(
    patches: Iterable[Patch], world: Pose, is_right: Callable[[FloatArray, FloatArray], BoolArray], seed: int
) -> list[Places]:
    rng = np.random.default_rng(seed)
    found = [_places(patch, world, is_right, rng) for patch in patches if patch.observed.any()]
    return [places for places in found if len(places.weight)]


def _places(
    patch: Patch,
    world: Pose,
    is_right: Callable[[FloatArray, FloatArray], BoolArray],
    rng: np.random.Generator,
) -> Places:
    evidence = patch.evidence
    given = prospects(patch.grid, patch.shadows, patch.labelling, patch.limits, evidence)
    hidden = patch.shadows.region >= 0
    occluded = np.flatnonzero(evidence.labels[hidden] == Label.OCCLUDED)
    chosen = np.sort(rng.permutation(occluded)[:MOST_PLACES])
    points = patch.grid.centres()[np.flatnonzero(hidden)[chosen]]
    right = is_right(world.apply(points), world.rotate(patch.grid.surface.normal(points)))
    area = len(occluded) * patch.grid.cell_area
    weight = np.full(len(chosen), np.sqrt(area) / max(len(chosen), 1))  # cells of one surface err together
    picked = Prospects(*(getattr(given, one.name)[chosen] for one in fields(given)))
    return Places(picked, right, weight)


def together(places: list[Places]) -> Places:
    """All places as one."""
    names = [one.name for one in fields(Prospects)]
    joined = (np.concatenate([getattr(one.prospects, name) for one in places]) for name in names)
    return Places(
        Prospects(*joined),
        np.concatenate([one.is_right for one in places]),
        np.concatenate([one.weight for one in places]),
    )


def _as_heavy(frames: list[list[Places]], rooms: list[list[Places]]) -> list[list[Places]]:
    """The frames, weighted so that all of them count as much as all rooms."""
    held, wanted = (sum(one.weight.sum() for all_ in some for one in all_) for some in (frames, rooms))
    return [[replace(one, weight=one.weight * wanted / held) for one in frame] for frame in frames]


def log_likelihood(
    places: Places,
    persistence: FloatArray,
    weights: FloatArray,
    even_m: float = EVEN_M,
    end_weights: FloatArray = PAST_END,
) -> float:
    """Mean over the places, weighted."""
    probability = np.clip(
        places.prospects.probability(persistence, weights, even_m, end_weights), 0.003, 0.997
    )
    told = np.log(np.where(places.is_right, probability, 1 - probability))
    return float(np.average(told, weights=places.weight))


def most_likely(places: Places) -> tuple[FloatArray, float]:
    """The constants (3, 2) within what was measured, and `EVEN_M`; those in use where nothing tells."""
    pairs = np.column_stack([np.log(PERSISTENCE[:, 0] / (1 - PERSISTENCE[:, 0])), np.log(PERSISTENCE[:, 1])])
    start = np.append(pairs.ravel(), np.log(EVEN_M))

    def constants(x: FloatArray) -> tuple[FloatArray, float]:
        pairs = x[:-1].reshape(-1, 2)
        return np.column_stack([1 / (1 + np.exp(-pairs[:, 0])), np.exp(pairs[:, 1])]), float(np.exp(x[-1]))

    def cost(x: FloatArray) -> float:
        persistence, even_m = constants(x)
        prior = PRIOR / places.weight.sum() * float(np.sum(np.square(x - start)))
        return float(prior - log_likelihood(places, persistence, WEIGHTS, even_m))

    return constants(minimize(cost, start, method="L-BFGS-B", options={"ftol": 1e-12, "gtol": 1e-8}).x)


def most_likely_weights(places: Places) -> FloatArray:
    """The weights (12,) past the rectangle of planes."""
    given = places.prospects
    beyond = (given.onward == Onward.BEYOND) & ~given.is_said
    return _ridge(given.known, np.ones(len(beyond)), places, beyond)


def most_likely_past_ends(places: Places) -> FloatArray:
    """The weights (5,) past the ends of cylinders."""
    given = places.prospects
    return _ridge(given.end_features, given.base, places, (given.onward == Onward.PAST_END) & ~given.is_said)


def _ridge(known: FloatArray, base: FloatArray, places: Places, chosen: BoolArray) -> FloatArray:
    """Constant and weights of some places, `base` (n,) times as probable."""
    weight = places.weight[chosen]
    return most_likely_odds(known[chosen], places.is_right[chosen], weight, ridge=RIDGE, base=base[chosen])


def _frames_of(source: Known, every: int) -> list[list[Places]]:
    return [places_in_frame(source, number) for number in range(0, len(source.frames), every)]


@suite("confidence", smallest="--rooms 2 --flats 1 --no-walk")
def confidence(rooms: int = 32, first: int = 1000, flats: int = 20, walk: bool = True) -> Iterator[str]:
    """Constants of confidence: how far surfaces go on, most likely on rooms, furnished flats and a walk."""
    own = [places_in(seed) for seed in range(first, first + rooms)]
    in_flats = [[place for frame in _frames_of(Flat(seed), 1) for place in frame] for seed in range(flats)]
    every = own + _as_heavy(in_flats, own)
    if walk and (DATA / WALKS[0].scene).exists():
        every += _as_heavy(_frames_of(WALKS[0], EACH), own)
    halves = [together([place for room in every[k::2] for place in room]) for k in (0, 1)]
    for k in (0, 1):
        (fitted, even_m), weights = most_likely(halves[k]), most_likely_weights(halves[k])
        past_end, other = most_likely_past_ends(halves[k]), halves[1 - k]
        yield (
            f"log likelihood on half {1 - k}: constants in use "
            f"{log_likelihood(other, PERSISTENCE, WEIGHTS):.4f}, "
            f"fitted to half {k} {log_likelihood(other, fitted, weights, even_m, past_end):.4f}"
        )
    whole = together([place for room in every for place in room])
    (best, even_m), weights = most_likely(whole), most_likely_weights(whole)
    past_end = most_likely_past_ends(whole)
    yield (
        f"on all: in use {log_likelihood(whole, PERSISTENCE, WEIGHTS):.4f}, "
        f"fitted {log_likelihood(whole, best, weights, even_m, past_end):.4f}"
    )
    for onward in list(Onward)[: len(PERSISTENCE)]:
        n_surfaces = sum(bool((one.prospects.onward == onward).any()) for room in every for one in room)
        (a, b), (c, d) = PERSISTENCE[onward], best[onward]
        name = onward.name.lower().replace("_", " ")
        yield f"{name:14s} {n_surfaces:4d} surfaces  in use {a:.3f} {b:6.2f}  most likely {c:.3f} {d:6.2f}"
    yield f"even odds of an opening at half a width of {EVEN_M:.2f} m in use, most likely {even_m:.2f} m"
    for where, names, in_use, likely in (
        ("past the rectangle", KNOWN, WEIGHTS, weights),
        ("past the end of a cylinder", KNOWN_PAST_END, PAST_END, past_end),
    ):
        yield f"{where}: log odds in use, most likely"
        for name, used, fit in zip(("constant", *names), in_use, likely, strict=True):
            yield f"{used:7.2f} {fit:7.2f}  {name}"
