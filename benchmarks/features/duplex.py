# SPDX-License-Identifier: MIT
"""`python -m benchmarks.features duplex`: doorways and windows of a duplex house from stations of our own."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
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
from scenes import RayCaster
from scenes.checks import FloatArray
from scenes.io.scene_files import open_scene

_LEAST_M2 = 0.05
_OFF_M = 0.4  # between a hole's middle plane and the side of its wall
_RIGHT_M = 0.03
_IN_REVEAL_M = 0.02  # behind the face of a wall
_BESIDE_M = 0.6  # of the middle of a leaf: in a room, or outside
_HOLE_M, _AROUND_M, _BEFORE_M = 0.01, 0.1, 0.35  # grid, margin, and where beams start before the middle
_HALF_CELL_M = _HOLE_M / 2


@dataclass(frozen=True, slots=True, eq=False)
class _Hole:
    """The true hole of leaves: the axis across its wall, its box, and whether it leads to the outside."""

    axis: int
    low: FloatArray
    high: FloatArray
    is_outer: bool


@dataclass(slots=True)
class _Tally:
    """What became of holes of one sort."""

    holes: int = 0
    told: int = 0
    whole: int = 0  # all of whose seen sides are right
    errors: list[float] = field(default_factory=list)
    z: list[float] = field(default_factory=list)

    def add(self, sides: list[tuple[str, float, float]]) -> None:
        """Count a hole that was told, with its seen sides."""
        self.told += 1
        self.whole += all(abs(error) < _RIGHT_M for _, error, _ in sides)
        self.errors += [error for _, error, _ in sides]
        self.z += [abs(error) / sd for _, error, sd in sides]

    def __str__(self) -> str:
        off = np.abs(self.errors)
        if not len(off):
            return f"{self.told} of {self.holes}"
        right = f"{(off < _RIGHT_M).mean():.3f} of {len(off)} seen sides within 3 cm"
        said = f"median {1000 * np.median(off):.1f} mm, |z| median {np.median(self.z):.2f}"
        return f"{self.told} of {self.holes}, {self.whole} with all seen sides right; {right}, {said}"


def duplex(
    stations: Annotated[int, typer.Option("--stations", min=1)] = 14,
    noise: Annotated[str, typer.Option("--noise")] = "gaussian-2mm",
    listed: Annotated[bool, typer.Option("--list")] = False,
) -> None:
    """Holes of doors and windows, all leaves taken out, from a panorama in each of the largest rooms."""
    truth = TrueBuilding.read(DATA / "buildings/duplex.npz")
    holes = _holes(truth)
    house = open_scene(DATA / "buildings/duplex.glb", up="y").without(("*Door*", "*Window*")).ray_caster()
    scans = list(house_scans(stations, noise, "panorama"))
    start = time.process_time()
    features = find_features(scans, ("doorway", "window", "niche"), rng=0)
    spent = time.process_time() - start
    found = [fit for fit in features.fits if fit.status is Status.FOUND and not fit.geometry["is_closed"]]
    unsure = [fit for fit in features.fits if fit.status is Status.AMBIGUOUS]
    matched: set[int] = set()
    tally = {name: _Tally() for name in ("inner, found", "outer, found", "outer, ambiguous")}
    for hole in holes:
        side = "outer" if hole.is_outer else "inner"
        same = [k for k, fit in enumerate(found) if _lies_in(fit, hole)]
        doubtful = [fit for fit in unsure if _lies_in(fit, hole)]
        matched |= set(same)
        tally[f"{side}, found"].holes += 1
        tally["outer, ambiguous"].holes += hole.is_outer and not same
        if listed:
            what = [found[k].kind for k in same], [fit.reason[:30] for fit in doubtful]
            print(f"{side} {np.round(hole.low, 2)} {np.round(hole.high, 2)}: {what}")
        told = found[same[0]] if same else doubtful[0] if doubtful and hole.is_outer else None
        if told is None:
            continue
        errors = _errors(told, house)
        tally[f"{side}, {'found' if same else 'ambiguous'}"].add(errors)
        for name, error, sd in errors:
            if listed and abs(error) > _RIGHT_M:
                print(f"   {name} off by {1000 * error:.0f} mm, sd {1000 * sd:.1f}")
    others = [fit for k, fit in enumerate(found) if k not in matched]
    for name, one in tally.items():
        print(f"{name}: {one}")
    free = [_is_free(fit, house) for fit in others]
    print(
        f"found elsewhere {len(others)}, of which beams pass {sum(free)}: holes without a leaf; ambiguous in "
        f"all {len(unsure)}; {spent:.0f} s of processors"
    )
    for fit, is_free in zip(others, free, strict=True):
        corners = np.asarray(fit.geometry["corners"])
        at = f"{np.round(corners.min(axis=0), 2)} {np.round(corners.max(axis=0), 2)}"
        off = [(name, round(1000 * error)) for name, error, _ in _errors(fit, house)]
        print(f"   elsewhere: {fit.kind} {at}, {'open' if is_free else 'FALSE'}, sides off by mm {off}")


def _holes(truth: TrueBuilding) -> list[_Hole]:
    """The holes of all groups of leaves that touch."""
    out = []
    for axis, box in leaf_groups(truth):
        places = _hole(truth, box, axis)
        if len(places) * _HOLE_M**2 >= _LEAST_M2:
            low, high = places.min(axis=0) - _HALF_CELL_M, places.max(axis=0) + _HALF_CELL_M
            out.append(_Hole(axis, low, high, not _is_inner(truth, box, axis)))
    return out


def _is_inner(truth: TrueBuilding, box: FloatArray, axis: int) -> bool:
    """Whether there are walls all around both places before a leaf."""
    places = box.mean(axis=0) + _BESIDE_M * np.array([[-1.0], [1.0]]) * np.eye(3)[axis]
    ways = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    hits = truth.closed.first_hit(np.repeat(places, len(ways), axis=0), np.tile(ways, (2, 1)))
    return bool(hits.hit.all())


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


def _lies_in(fit: TemplateFit, hole: _Hole) -> bool:
    """Whether most of an opening lies within a hole, in a wall beside its middle."""
    axis, low, high = hole.axis, hole.low, hole.high
    corners = np.asarray(fit.geometry["corners"])
    at, end = corners.min(axis=0), corners.max(axis=0)
    if end[axis] - at[axis] > 0.1 or abs(at[axis] - low[axis]) > _OFF_M:
        return False
    flat = [1 - axis, 2]
    shared = np.clip(np.minimum(end, high) - np.maximum(at, low), 0, None)[flat]
    return bool(np.prod(shared) > 0.7 * np.prod((end - at)[flat]))


def _errors(fit: TemplateFit, house: RayCaster) -> list[tuple[str, float, float]]:
    """Errors of the sides that were seen, outwards, with their deviations, metres.

    Where a side is, rays say that start within the opening, just behind the wall's face, and go along it.
    """
    corners, into = np.asarray(fit.geometry["corners"]), np.asarray(fit.geometry["into"])
    across, up = corners[1] - corners[0], corners[3] - corners[0]
    middle = corners.mean(axis=0) + _IN_REVEAL_M * into
    found = []
    for side in fit.sides:
        if side.state is not Seen.CONFIRMED:
            continue
        sign = 1.0 if side.name in ("right", "top") else -1.0
        out, along = (across, up) if side.name in ("left", "right") else (up, across)
        half = np.linalg.norm(out) / 2
        starts = middle + np.linspace(-0.35, 0.35, 15)[:, None] * along
        way = sign * out / np.linalg.norm(out)
        away = house.first_hit(starts, np.tile(way, (len(starts), 1))).ranges
        found.append((side.name, float(half - np.median(away)), max(side.deviation, 1e-6)))
    return found


def _is_free(fit: TemplateFit, house: RayCaster) -> bool:
    """Whether beams straight through an opening meet nothing for half a metre, nearly all over it."""
    corners, into = np.asarray(fit.geometry["corners"]), np.asarray(fit.geometry["into"])
    steps = np.linspace(0.02, 0.98, 40)
    a, b = (grid.ravel()[:, None] for grid in np.meshgrid(steps, steps))
    places = corners[0] + a * (corners[1] - corners[0]) + b * (corners[3] - corners[0]) - 0.05 * into
    hits = house.first_hit(places, np.tile(into, (len(places), 1)))
    return bool((hits.ranges > 0.5).mean() > 0.9)
