# SPDX-License-Identifier: MIT
"""`python -m benchmarks.features duplex`: doorways and windows of a duplex house from stations of our own."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer
from scipy import ndimage

from benchmarks.completion.ledger.sources import DATA
from benchmarks.completion.quantities.__main__ import house_scans
from benchmarks.completion.quantities.comparison import leaf_groups
from benchmarks.completion.quantities.elements import TrueBuilding
from completion.templates.engine.template import Seen, Status, TemplateFit
from completion.templates.pipeline import find_features
from scenes.checks import FloatArray

_LEAST_M2 = 0.05
_OFF_M = 0.4  # between a hole's middle plane and the side of its wall
_RIGHT_M = 0.03
_HOLE_M, _AROUND_M, _BEFORE_M = 0.01, 0.1, 0.35  # grid, margin, and where beams start before the middle
_HALF_CELL_M = _HOLE_M / 2


def duplex(
    stations: Annotated[int, typer.Option("--stations", min=1)] = 14,
    noise: Annotated[str, typer.Option("--noise")] = "gaussian-2mm",
    listed: Annotated[bool, typer.Option("--list")] = False,
) -> None:
    """Holes of doors and windows, all leaves taken out, from a panorama in each of the largest rooms."""
    truth = TrueBuilding.read(DATA / "buildings/duplex.npz")
    holes = [
        (axis, places)
        for axis, box in leaf_groups(truth)
        if len(places := _hole(truth, box, axis)) * _HOLE_M**2 >= _LEAST_M2
    ]
    scans = list(house_scans(stations, noise, "panorama"))
    features = find_features(scans, ("doorway", "window", "niche"), rng=0)
    found = [fit for fit in features.fits if fit.status is Status.FOUND and not fit.geometry["is_closed"]]
    silent = [fit for fit in features.fits if fit.status is Status.AMBIGUOUS]
    doubtful = 0
    matched: set[int] = set()
    told, errors, z = 0, [], []
    for axis, places in holes:
        low, high = places.min(axis=0) - _HALF_CELL_M, places.max(axis=0) + _HALF_CELL_M
        same = [k for k, fit in enumerate(found) if _lies_in(fit, low, high, axis)]
        matched |= set(same)
        told += bool(same)
        doubtful += not same and any(_lies_in(fit, low, high, axis) for fit in silent)
        if listed:
            print(f"hole {np.round(low, 2)} {np.round(high, 2)}: {[found[k].kind for k in same]}")
        for k in same[:1]:
            for name, error, sd in _errors(found[k], low, high, axis):
                errors.append(error)
                z.append(abs(error) / sd)
                if listed and abs(error) > _RIGHT_M:
                    print(f"   {name} off by {1000 * error:.0f} mm, sd {1000 * sd:.1f}")
    others = [fit for k, fit in enumerate(found) if k not in matched]
    off = np.abs(errors)
    print(f"holes of doors and windows {len(holes)}, found {told}, found elsewhere {len(others)}")
    print(f"ambiguous {doubtful} of the others, as nothing came back; ambiguous in all {len(silent)}")
    right = (off < _RIGHT_M).mean()
    print(f"seen sides within 3 cm {right:.3f} of {len(off)}, median {1000 * np.median(off):.1f} mm")
    print(f"|z| median {np.median(z):.2f} (true sides are known to {1000 * _HALF_CELL_M:.0f} mm)")
    for fit in others:
        corners = np.asarray(fit.geometry["corners"])
        print(
            f"   elsewhere: {fit.kind} {np.round(corners.min(axis=0), 2)} {np.round(corners.max(axis=0), 2)}"
        )


def _hole(truth: TrueBuilding, box: FloatArray, axis: int) -> FloatArray:
    """Places (n, 3) around the box of a leaf where a beam goes straight through the wall."""
    other, middle = 1 - axis, box.mean(axis=0)
    steps = [np.arange(box[0, k] - _AROUND_M, box[1, k] + _AROUND_M, _HOLE_M) for k in (other, 2)]
    places = np.empty((len(steps[0]) * len(steps[1]), 3))
    places[:, [other, 2]] = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
    places[:, axis] = middle[axis] - _BEFORE_M
    hits = truth.shell.first_hit(places, np.tile(np.eye(3)[axis], (len(places), 1)))
    free = (hits.ranges > 2 * _BEFORE_M).reshape(len(steps[0]), len(steps[1]))
    part, _ = ndimage.label(free)  # margins may lie within walls that stand across
    sizes = np.bincount(part.ravel())
    sizes[0] = 0
    hole = part == int(np.argmax(sizes))
    for count, along in ((hole.sum(axis=1), 1), (hole.sum(axis=0), 0)):
        few = count < count.max() / 2
        hole &= ~(few[:, None] if along else few[None, :])
    return places[hole.ravel()] + _BEFORE_M * np.eye(3)[axis]


def _lies_in(fit: TemplateFit, low: FloatArray, high: FloatArray, axis: int) -> bool:
    """Whether most of an opening lies within a hole, in a wall beside its middle."""
    corners = np.asarray(fit.geometry["corners"])
    at, end = corners.min(axis=0), corners.max(axis=0)
    if end[axis] - at[axis] > 0.1 or abs(at[axis] - low[axis]) > _OFF_M:
        return False
    flat = [1 - axis, 2]
    shared = np.clip(np.minimum(end, high) - np.maximum(at, low), 0, None)[flat]
    return bool(np.prod(shared) > 0.7 * np.prod((end - at)[flat]))


def _errors(fit: TemplateFit, low: FloatArray, high: FloatArray, axis: int) -> list[tuple[str, float, float]]:
    """Errors of the sides that were seen, with their deviations, metres."""
    corners, other = np.asarray(fit.geometry["corners"]), 1 - axis
    left_is_low = corners[0, other] < corners[1, other]
    ends = {
        "left": (corners[0, other], low[other] if left_is_low else high[other]),
        "right": (corners[1, other], high[other] if left_is_low else low[other]),
        "bottom": (corners[0, 2], low[2]),
        "top": (corners[2, 2], high[2]),
    }
    return [
        (side.name, float(ends[side.name][0] - ends[side.name][1]), max(side.deviation, 1e-6))
        for side in fit.sides
        if side.state is Seen.CONFIRMED
    ]
