# SPDX-License-Identifier: MIT
"""Hidden corners of rooms with and without relations, and what relations do to the strata."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmarks.completion.cases.outcome import Outcome
from benchmarks.completion.cases.study import generated_cases, tasks_of
from benchmarks.completion.cases.task import Bench
from benchmarks.completion.pages.summary import STRATA, WHOLE, summarise
from benchmarks.completion.scenes.cases import hypothesis_of
from benchmarks.completion.scores.outline import corner_errors, hidden_corners
from benchmarks.completion.truth.hypothesis import Hypothesis
from completion import CompletionOptions, complete
from completion.result.completed_model import CompletedModel
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Plane

METHODS: Mapping[str, CompletionOptions] = {
    "off": CompletionOptions(texture=False, relations=None),
    "auto": CompletionOptions(texture=False),
}
"""Completion without relations, and with them."""

_ON_IT_M = 1e-3  # of a true plane: it goes through the corner
_SAME_WAY = 0.999  # |cosine| of normals of planes that do not cross


class Corners(NamedTuple):
    """Hidden corners of some rooms: errors (n,), metres, and in footprints of a pixel; planes that meet.

    An error is inf where a corner was missed. `n_planes` (n,) counts the other true planes through a corner
    that were found, and so may end the surface there.
    """

    error_m: FloatArray
    in_pixels: FloatArray
    n_planes: IntArray


def corner_table(first_seed: int, n_rooms: int) -> Iterator[str]:
    """Yield the lines of two tables: hidden corners by what meets there, and intersection over union."""
    tasks = tasks_of(generated_cases(n_rooms, first_seed), "gaussian-2mm", dict(METHODS), 0)
    corners: dict[str, list[Corners]] = {name: [] for name in METHODS}
    outcomes: dict[str, list[Outcome]] = {name: [] for name in METHODS}
    for task in tasks:
        bench = Bench.of(task, None)
        for name, options in METHODS.items():
            completed = complete(bench.scans, options, rng=task.seed)
            outcomes[name].append(bench.outcome_of(name, completed))
            corners[name].append(corners_of(bench, completed))
    yield "| relations | other planes | corners | missed | median, mm | in pixels |"
    yield "|---|---|---|---|---|---|"
    for name, some in corners.items():
        yield from _corner_rows(name, some)
    yield ""
    yield from _strata_rows({name: summarise(some) for name, some in outcomes.items()})


def corners_of(bench: Bench, completed: CompletedModel) -> Corners:
    """The hidden corners of a room that was completed."""
    found = hypothesis_of(completed, bench.scans)
    errors, pixels, planes = [np.zeros(0)], [np.zeros(0)], list[IntArray]()
    for cells in bench.cells:
        at = hidden_corners(cells) if cells.reachable.any() else np.zeros((0, 3))
        if not len(at):
            continue
        off = corner_errors(cells, found)
        errors.append(off)
        pixels.append(off / _footprints(bench, at))
        planes.append(_planes_through(bench, found, cells.chart.surface, at))
    counts = np.concatenate([np.zeros(0, np.int64), *planes])
    return Corners(np.concatenate(errors), np.concatenate(pixels), counts)


def _footprints(bench: Bench, points: FloatArray) -> FloatArray:
    """How wide a pixel of the nearest scan is at points (n, 3), across its ray, metres."""
    each = [
        scan.projection.pixel_angle * np.linalg.norm(points - scan.origin, axis=1) for scan in bench.scans
    ]
    return np.asarray(np.min(each, axis=0))


def _planes_through(bench: Bench, found: Hypothesis, own: int, points: FloatArray) -> IntArray:
    """How many directions (n,) planes that were found have at points (n, 3), the surface's `own` left out."""
    surfaces = bench.task.case.model.surfaces
    me = surfaces[own]
    assert isinstance(me, Plane)
    counts = np.zeros(len(points), dtype=np.int64)
    for k, point in enumerate(points):
        ways = [me.normal_direction]
        for number in sorted({int(one) for one in found.true_surface if one >= 0} - {own}):
            plane = surfaces[number]
            if not isinstance(plane, Plane) or abs(float(plane.distance(point[None])[0])) > _ON_IT_M:
                continue
            if all(abs(float(plane.normal_direction @ way)) < _SAME_WAY for way in ways):
                ways.append(plane.normal_direction)
        counts[k] = len(ways) - 1
    return counts


def _corner_rows(name: str, rooms: Sequence[Corners]) -> Iterator[str]:
    error, pixels, planes = (np.concatenate(part) for part in zip(*rooms, strict=True))
    chosen = {
        "none": planes == 0,
        "one": planes == 1,
        "two or more": planes >= 2,
        "one or more": planes >= 1,
        "any": planes >= 0,
    }
    for words, own in chosen.items():
        if own.any():
            middle, wide = (float(np.quantile(some[own], 0.5, method="lower")) for some in (error, pixels))
            yield (
                f"| {name} | {words} | {own.sum()} | {np.isinf(error[own]).sum()} "
                f"| {1e3 * middle:.2f} | {wide:.2f} |"
            )


def _strata_rows(found: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    yield "| | " + " | ".join(found) + " |"
    yield "|---" * (1 + len(found)) + "|"
    for row in (*STRATA, WHOLE, "S7 breaks the prior", "S7 where it breaks"):
        cells = [one["rows"][row]["iou"][1] for one in found.values()]
        if any(cell is not None for cell in cells):
            yield f"| IoU at 2 cm, {row} | " + " | ".join(f"{cell:.4f}" for cell in cells) + " |"
    for name in ("violation_audited_ppm", "violation_by_true_beams_ppm"):
        yield (
            f"| {name.replace('_', ' ')} | " + " | ".join(f"{one[name]:.1f}" for one in found.values()) + " |"
        )
