# SPDX-License-Identifier: MIT
"""Things that stand in furnished rooms and flats: how many are separated, joined, cut apart, false."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

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


@dataclass(frozen=True, slots=True)
class _Judged:
    """What became of things, of those of them that are whole in their scan, and seconds of processor time."""

    every: Separated = field(default_factory=Separated)
    whole: Separated = field(default_factory=Separated)
    cpu_s: float = 0.0

    def __add__(self, other: _Judged) -> _Judged:
        return _Judged(self.every + other.every, self.whole + other.whole, self.cpu_s + other.cpu_s)


def _separated(scans: Sequence[RangeImage], names: Sequence[str], room: int | None) -> _Judged:
    """Judge the things of some scans in each of them."""
    completion = complete(scans, _PLAIN, rng=0)
    done = completion.completed
    begin = time.process_time()
    things = find_things(done.patches, done.scans, done.room, done.up, completion.world_from_reference)
    cost, truth = time.process_time() - begin, instances(names, room)
    every, whole = Separated(), Separated()
    for number, (scan, seen) in enumerate(zip(scans, completion.observations, strict=True)):
        assert scan.truth is not None
        shown = [(thing, cut) for thing in things for cut in thing.cuts if cut.scan == number]
        masks = [thing.mask(number, scan.shape) for thing, _ in shown]
        kept = [mask for mask, (_, cut) in zip(masks, shown, strict=True) if not (cut.border or cut.occluder)]
        every += judge(truth[scan.truth.surface], masks, seen.valid)
        whole += judge(truth[scan.truth.surface], kept, seen.valid)
    return _Judged(every, whole, cost)


def _flat(seed: int, together: bool) -> _Judged:
    """Two frames of a furnished flat, one by one or together."""
    flat, sums = Flat(seed, 2), _Judged()
    plan, names = flat.house.plan, flat.house.scene.surface_names
    for scans in [flat.frames] if together else [(scan,) for scan in flat.frames]:
        eye = shapely.Point(scans[0].origin[:2])
        room = min(range(len(plan.rooms)), key=lambda k: float(plan.rooms[k].floor.distance(eye)))
        sums += _separated(scans, names, room)
    return sums


def _room(seed: int) -> _Judged:
    """The scans of a room with boxes, drums and tables, noise 3 mm."""
    case = random_case(seed)
    scans = case.scans(Effects(noise=ConstantNoise(constant_m=0.003)), 5)
    return _separated(scans, case.scene.surface_names, None)


@suite("things", smallest="--n 1")
def things(n: int = 20) -> Iterator[str]:
    """Things in furnished flats and simple rooms of tuning and held-out seeds; --n of each."""
    yield from head(
        "scans | asked | found | told | right | whole | of them right | joined | cut apart | false | s of CPU"
    )
    for name, first in (("tuning", 0), ("held out", 100)):
        kinds = {
            f"flats, frame by frame, {name}": list(each(_flat, range(first, first + n), False)),
            f"flats, two frames together, {name}": list(each(_flat, range(first, first + n), True)),
            f"rooms, {name}": list(each(_room, range(10 * first, 10 * first + n))),
        }
        for kind, results in kinds.items():
            sums = sum(results, _Judged())
            every, whole = sums.every, sums.whole
            yield row(
                kind, every.asked, f"{every.found / max(every.asked, 1):.2f}",
                every.told, f"{every.n_right / max(every.told, 1):.2f}",
                whole.told, f"{whole.n_right / max(whole.told, 1):.2f}",
                every.joined, every.cut, every.false, f"{sums.cpu_s / max(len(results), 1):.2f}",
            )  # fmt: skip
