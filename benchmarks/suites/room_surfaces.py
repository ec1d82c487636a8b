# SPDX-License-Identifier: MIT
"""The weights of room surfaces: how probably floors, walls and ceilings go on, most likely on many kinds.

Generated rooms, flats, furnished walks and real frames are completed, the frames alone and several together.
Hidden places that a floor, wall or ceiling was considered at are right or wrong by the truth, or by what the
other frames measured (real ones: where neither is told, they are left out). Each kind counts the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.cases.frames import FURNISHED, HELD_OUT_HOUSES, HOUSES, JUDGED, Source
from benchmarks.cases.rooms import random_case
from benchmarks.metrics.odds import log_likelihood, most_likely_odds, probability
from benchmarks.metrics.other_scans import is_there, seen_by_others
from benchmarks.run import suite
from benchmarks.store import each
from completion import CompletionOptions, complete
from completion.evidence.evidence import Label
from completion.extension import room_surfaces as surfaces
from completion.extension.confidence import prospects
from completion.extension.patch import Patch
from completion.result.completed_model import CompletedModel
from nbv.scanning.effects import named_effects
from scenes.checks import BoolArray, FloatArray, IntArray

TOLERANCE_M = 0.02  # of rooms
MOST_PLACES = 600  # of one surface
RIDGE = 0.02  # of all places, what a weight whose part of the log odds strays by one has to be worth
FEWEST_PLACES = 300  # of a kind that is fitted to
PARTS = {"level": surfaces.LEVEL_WEIGHTS, "wall": surfaces.WALL_WEIGHTS}
NAMES = {"level": surfaces.KNOWN_OF_LEVEL, "wall": surfaces.KNOWN_OF_WALL}

Judge = Callable[[FloatArray, FloatArray], NDArray[np.int8]]


class Places(NamedTuple):
    """Hidden places (n,) of one surface, or of several."""

    known: FloatArray  # (n, k) what their probability depends on
    right: BoolArray
    weight: FloatArray  # cells of one surface err together: the root of its area
    area_m2: FloatArray


def places_in_room(seed: int) -> list[tuple[str, Places]]:
    """Complete a generated room and compare with the truth."""
    case = random_case(seed)
    scans = case.scans(named_effects("gaussian-2mm"), 1000 * seed)
    completed = complete(scans, CompletionOptions(mode="bold", texture=False), rng=0)

    def judge(points: FloatArray, normals: FloatArray) -> NDArray[np.int8]:
        nearest = np.full(len(points), np.inf)
        for chart in case.charts:
            nearest = np.minimum(nearest, chart.distances(points, normals))
        return np.where(nearest <= TOLERANCE_M, 1, -1).astype(np.int8)

    return _places(completed, judge, seed)


def places_in_frames(source: Source, frames: Sequence[int]) -> list[tuple[str, Places]]:
    """Complete some frames of a source together and compare with the truth, or with the other frames."""
    options = CompletionOptions(mode="bold", texture=False, registration_m=source.registration_m)
    completed = complete([source.frames[k] for k in frames], options, rng=0)
    if hasattr(source, "caster"):
        caster = source.caster

        def judge(points: FloatArray, normals: FloatArray) -> NDArray[np.int8]:
            return np.where(is_there(points, normals, caster), 1, -1).astype(np.int8)
    else:
        others = [scan for k, scan in enumerate(source.frames) if k not in frames]

        def judge(points: FloatArray, normals: FloatArray) -> NDArray[np.int8]:
            return seen_by_others(points, normals, others, max(0.03, 2 * source.registration_m))

    return _places(completed, judge, frames[0])


def _places(completed: CompletedModel, judge: Judge, seed: int) -> list[tuple[str, Places]]:
    """By "level" or "wall", the hidden places of each surface of the room of which anything is known."""
    rng, places = np.random.default_rng(seed), []
    world = completed.world_from_reference
    for patch in completed.patches:
        hidden = np.flatnonzero(patch.shadows.region >= 0)
        if not patch.limits.role or not len(hidden) or not patch.observed.any():
            continue
        chosen, area = _chosen(patch, hidden, rng)
        points = patch.grid.centres()[hidden[chosen]]
        state = judge(world.apply(points), world.rotate(patch.grid.surface.normal(points)))
        is_known = state != 0
        base = prospects(patch.grid, patch.shadows, patch.labelling, patch.limits, patch.evidence).base
        known = surfaces.known_of_room(
            patch.grid, patch.shadows, patch.limits, patch.evidence, base=base, room=completed.completed.room
        )[chosen][is_known]
        n = max(len(chosen), 1)
        even = np.full(len(known), 1.0 / n)
        part = "wall" if patch.limits.role == "wall" else "level"
        places.append((part, Places(known, state[is_known] > 0, even * np.sqrt(area), even * area)))
    return places


def _chosen(patch: Patch, hidden: IntArray, rng: np.random.Generator) -> tuple[IntArray, float]:
    """Some of the hidden cells that are looked at, and the area of all of these, square metres.

    They are behind something, and of floors where nothing came back.
    """
    looked = (Label.OCCLUDED, Label.NO_RETURN) if patch.limits.role == "floor" else (Label.OCCLUDED,)
    at = np.flatnonzero(np.isin(patch.evidence.labels.ravel()[hidden], looked))
    return np.sort(rng.permutation(at)[:MOST_PLACES]), len(at) * patch.grid.cell_area


def together(places: Sequence[Places]) -> Places:
    """All places as one."""
    return Places(*(np.concatenate(values) for values in zip(*places, strict=True)))


def fitted(kinds: Sequence[Places]) -> FloatArray:
    """The weights most likely on some kinds, each counted alike."""
    every = together([kind._replace(weight=kind.weight / kind.weight.sum()) for kind in kinds])
    return most_likely_odds(every.known, every.right, every.weight, ridge=RIDGE)


@suite("room-surfaces", smallest="--rooms 2 --flats 0 --walks 0 --no-real --held-out 0")
def room_surfaces(
    rooms: int = 8, flats: int = 12, walks: int = 6, held_out: int = 5, real: bool = True
) -> Iterator[str]:
    """Weights of floors, walls and ceilings: in use, and most likely with each kind left out in turn.

    --held-out: flats that none of them are fitted to.
    """
    kinds: dict[str, list[tuple[str, Places]]] = {}
    for kind, places in (
        *(("rooms", places) for places in each(places_in_room, list(range(1000, 1000 + rooms)))),
        *_frames("flats", HOUSES[:flats]),
        *_frames("walks", [FURNISHED[(0, 1, 2, 10, 11, 12)[k]] for k in range(min(walks, 6))]),
        *_frames("held-out flats", HELD_OUT_HOUSES[:held_out]),
        *(entry for source in JUDGED if real for entry in _frames(source.name, [source])),
    ):
        kinds.setdefault(kind, []).extend(places)
    for part, in_use in PARTS.items():
        by_kind = {
            kind: together(some)
            for kind, pairs in kinds.items()
            if (some := [places for name, places in pairs if name == part])
        }
        used = {
            kind: entries
            for kind, entries in by_kind.items()
            if "held-out" not in kind and len(entries.right) >= FEWEST_PLACES
        }
        yield f"{part}: kind, places; mean log likelihood, right, wrong m2 in use; the same with it left out"
        for kind, entries in by_kind.items():
            others = [other for name, other in used.items() if name != kind]
            yield _line(kind, entries, in_use, fitted(others) if others else in_use)
        likely = fitted(list(used.values())) if used else in_use
        for name, weight, fit in zip(("constant", *NAMES[part]), in_use, likely, strict=True):
            yield f"{weight:7.2f} {fit:7.2f}  {name}"


def _frames(kind: str, sources: Sequence[Source]) -> Iterator[tuple[str, list[tuple[str, Places]]]]:
    """Places of five frames of each source alone, and of as many together."""
    for source in sources:
        n = len(source.frames)
        some = list(range(0, n, max(1, n // 5)))[:5]
        for frames in [[k] for k in some] + ([some] if hasattr(source, "caster") else []):
            yield kind if len(frames) == 1 else f"{kind}, together", places_in_frames(source, frames)


def _line(kind: str, places: Places, in_use: FloatArray, left_out: FloatArray) -> str:
    cells = [f"{kind:24s} {len(places.right):6d}"]
    for weights in (in_use, left_out):
        stated = probability(places.known, weights)
        claimed = stated >= 0.8
        right, wrong = (
            float(places.area_m2[claimed & (places.right == is_so)].sum()) for is_so in (True, False)
        )
        cells.append(f"{log_likelihood(stated, places.right, places.weight):7.3f} {right:6.2f} {wrong:6.2f}")
    return "  ".join(cells)
