# SPDX-License-Identifier: MIT
"""Long distortions: rooms and a part that are warped as a whole, and what becomes of their true relations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.completion.relations.calibration import LEVELS, doubt_of
from benchmarks.completion.relations.figure_one import figure_one
from benchmarks.completion.relations.figure_study import is_true
from benchmarks.completion.relations.sensors import SENSORS
from benchmarks.completion.relations.true_fits import true_fits, true_relations
from benchmarks.completion.scenes.rooms import random_case
from completion.observe.observation import observe
from completion.parts.pipeline import doubt_of_warp
from completion.relations.engine.estimate import Estimate
from completion.relations.engine.relation import Status
from completion.relations.engine.wald import wald_test
from completion.relations.options import BUILT
from completion.relations.pipeline import infer
from completion.uncertainty.pipeline import state_fits
from completion.uncertainty.space_warp import find_warp
from nbv.scanning.effects.effects import Effects
from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

ROOM_WARPS_MM = (2.0, 5.0, 20.0)
"""Root mean square of the displacement of a room's points."""

PART_WARPS_MM = (0.0, 0.05, 0.2, 1.0)
"""The same of the part of figure 1, whose points have noise of .1 mm."""

_NOISE_MM = 0.1
_PART_BOX = np.array([(-50.0, -40.0, 0.0), (75.0, 40.0, 60.0)])


def warp_table(rooms: Sequence[int], parts: Sequence[int]) -> Iterator[str]:
    """Yield the lines of a table: a warp each, shares of true relations rejected, and what they came to.

    A warp is a displacement in space that is any polynomial of second order in x, y and z: it bends planes,
    and turns them against each other by as much. The first share is of tests of each relation by itself; the
    counts are of the true ones among all that `infer` looked at.
    """
    yield "| warped | rms, mm | tests | p < .05 / .001 | accepted | implied | undecided | rejected |"
    yield "|---|---|---|---|---|---|---|---|"
    for size in ROOM_WARPS_MM:
        yield _row("rooms, 2 mm noise", size, [_room(seed, 1e-3 * size) for seed in rooms])
    for size in PART_WARPS_MM:
        yield _row(f"part of figure 1, {_NOISE_MM:g} mm noise", size, [_part(seed, size) for seed in parts])


def warped(points: FloatArray, seed: int, size: float, span: FloatArray) -> FloatArray:
    """Points (n, 3) displaced by a polynomial of second order over a box (2, 3), some `size` rms over it.

    What is a rigid motion, a stretch or a shear is not in it: only its terms of second order, about the
    middle of the box.
    """
    rng = np.random.default_rng([20270, seed])
    x, y, z = ((points - span.mean(axis=0)) / np.ptp(span, axis=0) * np.sqrt(12)).T
    terms = np.stack([(x * x - 1) / 1.2, x * y, x * z, (y * y - 1) / 1.2, y * z, (z * z - 1) / 1.2], axis=1)
    return np.asarray(points + size / np.sqrt(18) * terms @ rng.normal(size=(6, 3)))


def _room(seed: int, size_m: float) -> tuple[list[float], Counter[Status]]:
    """The p of a warped room's true relations, and what became of those that were proposed."""
    case = random_case(seed)
    scans = [_bent(SENSORS[0].applied(scan, 10 * seed + k), seed, size_m, case.scene.mesh.vertices)
             for k, scan in enumerate(case.scans(Effects(), 0))]  # fmt: skip
    seen = [observe(scan, case.views[0].world_from_sensor) for scan in scans]
    fits = true_fits(case, seen)
    relations = true_relations([one.true for one in fits])
    stated = state_fits([one.merged for one in fits], seen, 0.0)
    estimate = Estimate(stated.fits, None, np.zeros(3), doubt_of(stated))
    graph = infer(stated.fits, (), BUILT, doubt=doubt_of(stated))
    exact = Estimate([replace(one.fit, surface=one.true) for one in fits], None, np.zeros(3))
    counts = Counter(one.status for one in graph.relations if is_true(one, exact))
    return [wald_test(one, estimate).p for one in relations], counts


def _bent(scan: RangeImage, seed: int, size_m: float, vertices: FloatArray) -> RangeImage:
    """The scan with its ranges as a warp of the whole room displaces its points along the rays."""
    box = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
    at = scan.origin + scan.ranges[scan.valid][:, None] * scan.rays()[scan.valid]
    moved = warped(at, seed, size_m, box) - at
    ranges = scan.ranges.copy()
    ranges[scan.valid] += np.einsum("ij,ij->i", moved, scan.rays()[scan.valid])
    return replace(scan, ranges=np.maximum(ranges, 0.05))


def _part(seed: int, size: float) -> tuple[list[float], Counter[Status]]:
    """The same of the part of figure 1."""
    points = list[FloatArray]()
    fits = figure_one(seed, _NOISE_MM, warp=lambda places: warped(places, seed, size, _PART_BOX), kept=points)
    doubt = doubt_of_warp(find_warp(fits, points), len(fits))
    exact = figure_one(0, 1e-7)
    truth = Estimate(exact, None, np.zeros(3))
    relations = true_relations([fit.surface for fit in exact if isinstance(fit.surface, Plane)])
    estimate = Estimate(fits, None, np.zeros(3), doubt)
    graph = infer(fits, doubt=doubt)
    counts = Counter(one.status for one in graph.relations if is_true(one, truth))
    return [wald_test(one, estimate).p for one in relations], counts


def _row(name: str, size: float, found: Sequence[tuple[list[float], Counter[Status]]]) -> str:
    values = np.array([p for some, _ in found for p in some])
    counts = sum((some for _, some in found), Counter[Status]())
    shares = " / ".join(f"{np.mean(values < level):.3f}" for level in LEVELS)
    order = (Status.ACCEPTED, Status.IMPLIED, Status.UNDECIDED, Status.REJECTED)
    cells = " | ".join(str(counts[status]) for status in order)
    return f"| {name} | {size:g} | {len(values)} | {shares} | {cells} |"
