# SPDX-License-Identifier: MIT
"""Things that stand in furnished rooms and flats: how many are separated, joined, cut apart, false."""

from __future__ import annotations

import time
from collections.abc import Iterator

import shapely

from benchmarks.cases.frames import Flat
from benchmarks.cases.rooms import random_case
from benchmarks.metrics.things import Separated, instances, judge
from benchmarks.run import head, row, suite
from benchmarks.store import each
from completion import CompletionOptions, complete
from completion.backs.things import find_things
from nbv.scanning.effects import Effects
from nbv.scanning.noise_models import ConstantNoise
from scenes.scan.range_image import RangeImage

_PLAIN = CompletionOptions(texture=False)


def _separated(
    scans: tuple[RangeImage, ...], names: tuple[str, ...], room: int | None
) -> tuple[Separated, float]:
    """Judge the things of some scans in each of them; with the seconds of processor time."""
    completion = complete(scans, _PLAIN, rng=0)
    done = completion.completed
    begin = time.process_time()
    things = find_things(done.patches, done.scans, done.room, done.up, completion.world_from_reference)
    cost, sums, truth = time.process_time() - begin, Separated(), instances(names, room)
    for number, (scan, seen) in enumerate(zip(scans, completion.observations, strict=True)):
        assert scan.truth is not None
        masks = [thing.mask(number, scan.shape) for thing in things if len(thing.pixels[number])]
        sums += judge(truth[scan.truth.surface], masks, seen.valid)
    return sums, cost


def _flat(seed: int, together: bool) -> tuple[Separated, float]:
    """Two frames of a furnished flat, one by one or together."""
    flat = Flat(seed, 2)
    plan, names = flat.house.plan, flat.house.scene.surface_names
    sums, cost = Separated(), 0.0
    for scans in [flat.frames] if together else [(scan,) for scan in flat.frames]:
        eye = shapely.Point(scans[0].origin[:2])
        room = min(range(len(plan.rooms)), key=lambda k: float(plan.rooms[k].floor.distance(eye)))
        judged, seconds = _separated(scans, names, room)
        sums, cost = sums + judged, cost + seconds
    return sums, cost


def _room(seed: int) -> tuple[Separated, float]:
    """The scans of a room with boxes, drums and tables, noise 3 mm."""
    case = random_case(seed)
    scans = case.scans(Effects(noise=ConstantNoise(constant_m=0.003)), 5)
    return _separated(scans, case.scene.surface_names, None)


@suite("things", smallest="--n 1")
def things(n: int = 20) -> Iterator[str]:
    """Things in furnished flats and simple rooms of tuning and held-out seeds; --n of each."""
    yield from head("scans | asked | found | told | right | joined | cut apart | false | s of CPU")
    for name, first in (("tuning", 0), ("held out", 100)):
        kinds = {
            f"flats, frame by frame, {name}": list(each(_flat, range(first, first + n), False)),
            f"flats, two frames together, {name}": list(each(_flat, range(first, first + n), True)),
            f"rooms, {name}": list(each(_room, range(10 * first, 10 * first + n))),
        }
        for kind, results in kinds.items():
            sums = sum((judged for judged, _ in results), Separated())
            yield row(
                kind, sums.asked, f"{sums.found / max(sums.asked, 1):.2f}", sums.told,
                f"{sums.n_right / max(sums.told, 1):.2f}", sums.joined, sums.cut, sums.false,
                f"{sum(cost for _, cost in results) / max(len(results), 1):.2f}",
            )  # fmt: skip
