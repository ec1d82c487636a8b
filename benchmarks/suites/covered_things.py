# SPDX-License-Identifier: MIT
"""Covered things of real scans: what their symmetries say of a covered part, judged by the scan as it was.

Each thing that a real scan shows is covered over a share of its width by a made-up occluder, on the left and
on the right. What is then asserted where the cover is, or elsewhere, is compared with what the scan measured
there: right where that is as far away, wrong where the beam went on or ended before; behind measured surface
nothing can be said. No truth but the scan itself is needed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.cases.frames import DATA
from benchmarks.run import head, row, suite
from completion import BackOptions, CompletionOptions, complete
from completion.backs.closed_things import ClosedThing, views_of
from completion.backs.pipeline import find_back
from completion.backs.views import Setting, ThingView
from completion.result.completion import Completion
from scenes.checks import BoolArray, FloatArray
from scenes.io.scan_files import read_scan
from scenes.scan.range_image import RangeImage

FILES = tuple(f"mOSD/learn{k}.pcd" for k in (0, 17, 25, 29, 33, 39))
_NEAR = 0.03  # share of size within which asserted surface is right
_BEFORE = 0.6  # where the occluder stands, share of the range


@dataclass(frozen=True, slots=True)
class CoveredThing:
    """What was asserted of a thing, one side covered: kind of symmetry, points right, wrong, not judged."""

    kind: str
    right: int
    wrong: int
    hidden: int

    @property
    def precision(self) -> float:
        """Share of the judged points that are right; nan of none."""
        return self.right / (self.right + self.wrong) if self.right + self.wrong else float("nan")


def covered_of(scan: RangeImage, mask: BoolArray, share: float, side: int) -> tuple[RangeImage, BoolArray]:
    """Return a scan with an occluder before a share of a thing's width, and what is left of its pixels."""
    columns = np.nonzero(mask)[1]
    edge = float(np.quantile(columns, share if side == 0 else 1 - share))
    along = np.arange(mask.shape[1])
    under = mask & ((along < edge) if side == 0 else (along > edge))
    ranges = np.where(under, _BEFORE * scan.ranges, scan.ranges).astype(scan.ranges.dtype)
    points = scan.sensor_points
    if points is not None:
        points = np.asarray(np.where(under[..., None], _BEFORE, 1.0) * points, dtype=np.float64)
    return replace(scan, ranges=ranges, sensor_points=points), mask & ~under


def judge(scan: RangeImage, mask: BoolArray, points: FloatArray, size_m: float) -> tuple[int, int, int]:
    """Count asserted points (n, 3) that are right, wrong, and hidden by what the whole scan measured."""
    pixels = scan.pixels(points)
    inside = np.isfinite(pixels).all(axis=1)
    row_, column = np.rint(pixels[inside]).astype(np.int64).T
    off = np.linalg.norm(points[inside] - scan.origin, axis=1) - scan.ranges[row_, column]
    known = np.isfinite(off)
    off, own = off[known], mask[row_[known], column[known]]
    right = own & (np.abs(off) < _NEAR * size_m)
    wrong = ~right & (off < -_NEAR * size_m)
    return int(right.sum()), int(wrong.sum()), int((~right & ~wrong).sum())


def cover(completion: Completion, one: ClosedThing, share: float, side: int) -> CoveredThing | None:
    """Cover a thing in the scan that shows most of it; None where too little is left, or it is cut."""
    number = int(np.argmax([len(pixels) for pixels in one.thing.pixels]))
    cuts = [cut for cut in one.thing.cuts if cut.scan == number]
    if one.back is None or any(cut.border or cut.occluder for cut in cuts):
        return None
    upright = completion.up.drawing_from_world @ completion.world_from_reference
    views, sigma_m = views_of(one.thing, completion.observations, upright)
    view = views[[k for k, pixels in enumerate(one.thing.pixels) if len(pixels)].index(number)]
    scan, left = covered_of(view.scan, view.of_thing, share, side)
    assert one.thing.support_m is not None
    walls = [
        [*completion.up.drawing_from_world.rotate(w.normal[None])[0], w.offset_m] for w in one.around.walls
    ]
    setting = Setting(one.thing.support_m, sigma_m, np.array(walls).reshape(-1, 4))
    back = find_back([ThingView(scan, left)], setting, BackOptions(), seed=one.thing.index)
    kind = back.sure[0].kind if back.sure else "refused"
    return CoveredThing(kind, *judge(view.scan, view.of_thing, back.asserted.points, back.size_m))


@suite("covered-things", smallest="--file mOSD/learn39.pcd")
def covered_things(file: list[str] | None = None, share: float = 0.4) -> Iterator[str]:
    """Things of real scans, --share of their width covered; --file: of the data's range folder."""
    found = list[CoveredThing]()
    yield from head("scan", "thing", "covered", "symmetry", "right", "wrong", "not judged", "precision")
    for name in file or FILES:
        scan = read_scan(DATA / "range" / name)
        completion = complete(scan, CompletionOptions(texture=False, backs=BackOptions()), rng=0)
        for one in completion.things:
            for side in (0, 1):
                judged = cover(completion, one, share, side)
                if judged is not None:
                    found.append(judged)
                    yield row(
                        name, one.thing.index + 1, ("left", "right")[side], judged.kind, judged.right,
                        judged.wrong, judged.hidden, f"{judged.precision:.2f}",
                    )  # fmt: skip
    yield ""
    yield from head("symmetry", "things and sides", "of 0.9 precision or more", "median precision")
    for kind in ("refused", "axis", "turn", "mirror"):
        own = [one for one in found if one.kind == kind]
        told = [one.precision for one in own if one.right + one.wrong]
        good = sum(p >= 0.9 for p in told)
        yield row(kind, len(own), f"{good} of {len(told)}", f"{np.median(told or [np.nan]):.2f}")
