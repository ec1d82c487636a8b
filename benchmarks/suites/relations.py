# SPDX-License-Identifier: MIT
"""Relations: how often true ones are rejected, and what they bring where little was seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from benchmarks.cases.frames import DATA, REAL
from benchmarks.cases.planes import figure_one
from benchmarks.cases.rooms import CAMERA, Case, generated_cases, hypothesis_of, random_case
from benchmarks.cases.sensors import SENSORS, SensorErrors
from benchmarks.metrics.completion import Outcome
from benchmarks.metrics.inferred import Hypothesis
from benchmarks.metrics.outlines import corner_errors, hidden_corners
from benchmarks.run import head, suite
from benchmarks.store import each
from benchmarks.suites.completion import Bench, tasks_of
from benchmarks.suites.relations_of_parts import is_true
from benchmarks.suites.summary import STRATA, WHOLE, summarise
from completion import CompletionOptions, complete
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation, PixelSet, ScanPixels, observe
from completion.observe.refitting import refit_each
from completion.parts.pipeline import doubt_of_warp
from completion.relations.estimate import NO_DOUBT, Doubt, JointEstimate, wald_test
from completion.relations.options import BUILT
from completion.relations.pipeline import SurfaceRelations, infer
from completion.relations.relation import Relation, RelationStatus
from completion.result.completed_model import CompletedModel
from completion.uncertainty.pipeline import StatedFits, state_fits
from completion.uncertainty.space_warp import find_warp
from nbv.scanning.effects import Effects
from nbv.scanning.sensor import View
from scenes import read_scan
from scenes.checks import FloatArray, IntArray
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

LEAST_PIXELS = 1_200
_ERODED = 2  # pixels at a surface's rim that may show what is behind


@dataclass(frozen=True, slots=True, eq=False)
class TrueFit:
    """A true plane and the surface that was fitted to its pixels."""

    true: Plane
    merged: MergedSurface

    @property
    def fit(self) -> SurfaceFit:
        """The fit."""
        return self.merged.fit


def true_fits(case: Case, observations: Sequence[Observation], flatness_m: float = 0.0) -> list[TrueFit]:
    """Fit every plane of a case to its own pixels in all scans, as `truth` of these names them."""
    found = []
    for number, surface in enumerate(case.scene.surfaces):
        if not isinstance(surface, Plane):
            continue
        sets = [_pixels_of(number, seen) for seen in observations]
        if sum(map(len, sets)) < LEAST_PIXELS:
            continue
        pixels = ScanPixels.of(sets)
        local = surface.transform(case.views[0].world_from_sensor.inverse())
        (fit,) = refit_each([local], observations, [pixels], flatness_m, n_rounds=2)
        if fit is not None:
            found.append(TrueFit(local, MergedSurface(fit, pixels, 1)))
    return found


def _pixels_of(number: int, seen: Observation) -> PixelSet:
    truth = seen.scan.truth
    assert truth is not None  # these scans are simulated
    mask = (truth.surface == number) & seen.valid
    return PixelSet.of(ndimage.binary_erosion(mask, iterations=_ERODED))


def true_relations(planes: Sequence[Plane]) -> list[Relation]:
    """Return which pairs are parallel or at right angles."""
    found = []
    for one, two in combinations(range(len(planes)), 2):
        cosine = abs(float(planes[one].normal_direction @ planes[two].normal_direction))
        if cosine > 1 - 1e-12:
            found.append(Relation(kind="parallel", surfaces=(one, two)))
        elif cosine < 1e-9:
            found.append(Relation(kind="perpendicular", surfaces=(one, two)))
    return found


LEVELS = (0.05, 0.001)


@suite("calibration", smallest="--rooms 1")
def calibration(first: int = 2000, rooms: int = 20) -> Iterator[str]:
    """Share of true relations of rooms that are rejected at .05 and .001, before five sensors."""
    yield from head("sensor", "pairs", "independent", "blocks", "stated")
    for number, sensor in enumerate(SENSORS):
        found: dict[str, list[float]] = {"independent": [], "blocks": [], "stated": []}
        for result in each(rejected, range(first, first + rooms), number):
            for name, values in result.items():
                found[name] += values
        cells = [_shares(values) for values in found.values()]
        yield f"| {sensor.name} | {len(found['stated'])} | " + " | ".join(cells) + " |"


def rejected(seed: int, number: int) -> dict[str, list[float]]:
    """Return the p of each true parallel and right angle of a room, by covariances of three kinds."""
    sensor = SENSORS[number]
    case = _by_camera(random_case(seed)) if sensor.is_camera else random_case(seed)
    scans = [sensor.applied(scan, 10 * seed + k) for k, scan in enumerate(case.scans(Effects(), 0))]
    seen = [observe(scan, case.views[0].world_from_sensor) for scan in scans]
    fits = true_fits(case, seen)
    relations = true_relations([one.true for one in fits])
    alone = [one.fit for one in fits]
    independent = [replace(fit, covariance=fit.covariance_independent) for fit in alone]
    stated = state_fits([one.merged for one in fits], seen, 0.0)
    return {
        "independent": _values(relations, independent, NO_DOUBT),
        "blocks": _values(relations, alone, NO_DOUBT),
        "stated": _values(relations, stated.fits, doubt_of(stated)),
    }


def _by_camera(case: Case) -> Case:
    """The case, seen from the same places by cameras alone."""
    views = tuple(
        view if view.sensor.kind == "pinhole" else View(view.world_from_sensor, CAMERA) for view in case.views
    )
    return replace(case, views=views)


def doubt_of(stated: StatedFits) -> Doubt:
    """Return what is doubtful of some fits."""
    return Doubt(stated.freedom, stated.smooth.covariance_of(range(len(stated.fits))))


def _values(relations: Sequence[Relation], fits: Sequence[SurfaceFit], doubt: Doubt) -> list[float]:
    estimate = JointEstimate(fits, None, np.zeros(3), doubt)
    return [wald_test(one, estimate).p for one in relations]


def _shares(values: Sequence[float]) -> str:
    return " / ".join(f"{np.mean(np.array(values) < level):.3f}" for level in LEVELS)


BEYOND_M = (1.0, 2.0, 3.0)
PINHOLE = PinholeProjection.from_fov(640, 480, 62.7)
STRIP = 3  # which of `ROOM` shows as a strip
ROOM = (
    Plane((0.0, 2.0, 0.0), (0, 0, 1.0)),
    Plane((-1.9, 2.0, 1.3), (1.0, 0, 0)),
    Plane((0.0, 4.2, 1.3), (0, -1.0, 0)),
    Plane((1.9, 2.0, 1.3), (-1.0, 0, 0)),
)
"""Floor, left wall, far wall and right wall of a room 3.8 m wide; the last shows beside the far one."""


def seen_room(
    sensor: SensorErrors, seed: int, strip_m: float | None, turn_deg: float = 0.0
) -> tuple[list[MergedSurface], Observation, list[Plane]]:
    """Return the planes of the room, each fitted to its own pixels, before a sensor, and the true ones.

    Of the right wall, which is turned about the vertical by `turn_deg`, only `strip_m` metres beside the
    corner with the far wall show; all of it when None.
    """
    rng = np.random.default_rng([20269, seed])
    eye = np.array([rng.uniform(-0.4, 0.4), rng.uniform(-0.4, 0.0), rng.uniform(1.3, 1.6)])
    pose = Pose.looking_at(eye, (rng.uniform(0.2, 0.6), 4.0, rng.uniform(0.8, 1.1)))
    turn = np.radians(turn_deg)
    true = [*ROOM[:3], Plane(ROOM[3].point, (-np.cos(turn), np.sin(turn), 0))]
    rays = PINHOLE.directions().reshape(-1, 3) @ pose.rotation.T
    every = np.stack([one.ray_ranges(eye, rays) for one in true])
    every = np.where(np.isfinite(every) & (every > 0), every, np.inf)
    which, ranges = np.argmin(every, axis=0), every.min(axis=0)
    if strip_m is not None:
        corner = true[2].point[1]
        hidden = (which == STRIP) & ((eye + ranges[:, None] * rays)[:, 1] < corner - strip_m)
        which = np.where(hidden, -1, which)
    scan = RangeImage(ranges.reshape(PINHOLE.shape), PINHOLE, pose)
    seen = observe(sensor.applied(scan, seed), pose)
    pixels = [ScanPixels.of([PixelSet.of((which == k).reshape(PINHOLE.shape))]) for k in range(len(true))]
    local = [one.transform(pose.inverse()) for one in true]
    fits = refit_each(local, [seen], pixels, 0.0, n_rounds=2)
    surfaces = [MergedSurface(fit, own, 1) for fit, own in zip(fits, pixels, strict=True) if fit is not None]
    return surfaces, seen, local


def strip_errors(number: int, seed: int, strip_m: float | None) -> tuple[FloatArray, FloatArray] | None:
    """How far off the right wall is 1, 2 and 3 m beyond the strip, metres: without relations, and with."""
    surfaces, seen, true = seen_room(SENSORS[number], seed, strip_m)
    if len(surfaces) < len(true):
        return None
    stated = state_fits(surfaces, [seen], 0.0)
    graph = infer(stated.fits, (), BUILT, doubt=doubt_of(stated))
    level = np.cross(true[STRIP].normal_direction, true[0].normal_direction)
    points = surfaces[STRIP].points([seen], 4_000)
    along = points @ level
    toward = 1.0 if level @ (points.mean(axis=0)) < 0 else -1.0  # back to where the sensor stands
    edge = points[np.argmax(toward * along)]
    beyond = edge + toward * np.outer(BEYOND_M, level)
    beyond -= true[STRIP].distance(beyond)[:, None] * true[STRIP].normal_direction
    alone, related = (_off(fit, beyond) for fit in (stated.fits[STRIP], graph.fits[STRIP]))
    return alone, related


def _off(fit: SurfaceFit, points: FloatArray) -> FloatArray:
    return np.abs(fit.surface.distance(points))


@suite("strips", smallest="--rooms 1")
def strips(first: int = 100, rooms: int = 25) -> Iterator[str]:
    """Root mean square error of a wall 1, 2 and 3 m beyond the strip that was seen of it."""
    yield from head("right wall", "sensor", "rooms", "alone, 1 / 2 / 3 m beyond, mm", "with relations")
    for strip_m, name in ((0.15, "15 cm"), (0.5, "50 cm"), (None, "whole")):
        for number, sensor in enumerate(SENSORS):
            seeds = range(first, first + rooms)
            found = [both for both in each(strip_errors, number, seeds, strip_m) if both is not None]
            alone, related = (np.sqrt(np.mean(np.square(some), axis=0)) for some in zip(*found, strict=True))
            yield f"| {name} | {sensor.name} | {len(found)} | {_cells(alone)} | {_cells(related)} |"


def _cells(errors: FloatArray) -> str:
    return " / ".join(f"{1000 * one:.1f}" if one < 0.0195 else f"{1000 * one:.0f}" for one in errors)


_FILES = (("office1", "range/pcl/office1.pcd"), ("pumpA", "range/e57/pumpA.e57"))
_LEFT_OUT = ("nyu_dining",)
_NEAR_DEG = 5.0  # of square or parallel: what is farther off was not meant to be
_EXACT_DEG = 0.05


@suite("real-relations", smallest="--only open3d_redwood")
def real_relations(only: str = "") -> Iterator[str]:
    """Relations of real scans, all frames of a scan completed together.

    Of pairs of planes within 5 deg of square or parallel: how many are within .05 deg of it, and how far off
    a usual one is, as measured, where relations hold, and where the model has them: a plane that would leave
    its points by half of their scatter stays. "turn" is the largest that relations ask for. Rejected are
    proposals that the data contradict, of all that could be decided.
    """
    yield from head(
        "scan | frames | surfaces | pairs | within .05 deg | related | in the model | off, deg | related | "
        "in the model | largest turn, deg | sd | above 3 sd | stayed | accepted, implied | rejected | "
        "undecided"
    )
    for name, scans in _sources():
        if only not in ("", name):
            continue
        done = complete(scans, CompletionOptions(texture=False), rng=0)
        if done.relations is not None:
            yield f"| {name} | {len(scans)} | {_row(done.relations)} |"


def _sources() -> Iterator[tuple[str, Sequence[RangeImage]]]:
    for source in REAL:
        if source.name not in _LEFT_OUT:
            yield source.name, source.frames
    for name, path in _FILES:
        yield name, [read_scan(DATA / path)]


def _row(found: SurfaceRelations) -> str:
    graph = found.graph
    places = [k for k, fit in enumerate(found.before) if isinstance(fit.surface, Plane)]
    now = [graph.fits[k] if moves else found.before[k] for k, moves in enumerate(found.is_moved)]
    sides = [_normals(fits, places) for fits in (found.before, graph.fits, now)]
    off = [[_off_deg(one[a], one[b]) for one in sides] for a, b in combinations(range(len(places)), 2)]
    meant = np.array([three for three in off if three[0] <= _NEAR_DEG]).reshape(-1, 3)
    turns = np.degrees(np.linalg.norm(np.cross(sides[0], sides[1]), axis=1))
    largest = int(np.argmax(turns)) if len(turns) else 0
    sd = graph.moved_sd[places[largest]] if len(turns) else 0.0
    n_far = sum(one > 3 for one in graph.moved_sd)
    exact = np.count_nonzero(meant <= _EXACT_DEG, axis=0)
    middle = np.median(meant, axis=0) if len(meant) else np.zeros(3)
    shares, offs = " | ".join(map(str, exact)), " | ".join(f"{one:.2f}" for one in middle)
    held = [graph.count_with(status) for status in (RelationStatus.ACCEPTED, RelationStatus.IMPLIED)]
    rejected = graph.count_with(RelationStatus.REJECTED)
    share = rejected / max(sum(held) + rejected, 1)
    n_stayed = sum(not moves for moves in found.is_moved)
    return (
        f"{len(found.before)} | {len(meant)} | {shares} | {offs} "
        f"| {turns.max(initial=0.0):.2f} | {sd:.1f} | {n_far} | {n_stayed} "
        f"| {held[0]}, {held[1]} | {rejected} ({share:.3f}) | {graph.count_with(RelationStatus.UNDECIDED)}"
    )


def _normals(fits: Sequence[SurfaceFit], places: Sequence[int]) -> FloatArray:
    """The normals (n, 3) of the planes among the fits."""
    chosen = [fits[k].surface for k in places]
    return np.array([one.normal_direction for one in chosen if isinstance(one, Plane)]).reshape(-1, 3)


def _off_deg(one: FloatArray, two: FloatArray) -> float:
    """How far two normals (3,) are from parallel or square, whichever is nearer, degrees."""
    angle = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(one, two)), abs(float(one @ two)))))
    return min(angle, 90.0 - angle)


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


@suite("corners", smallest="--rooms 1")
def corner_errors_of_rooms(first: int = 2000, rooms: int = 10) -> Iterator[str]:
    """Hidden corners of rooms with and without relations, and what relations do to the strata."""
    tasks = tasks_of(generated_cases(rooms, first), "gaussian-2mm", dict(METHODS), 0)
    corners: dict[str, list[Corners]] = {name: [] for name in METHODS}
    outcomes: dict[str, list[Outcome]] = {name: [] for name in METHODS}
    for task in tasks:
        bench = Bench.of(task, None)
        for name, options in METHODS.items():
            completed = complete(bench.scans, options, rng=task.seed)
            outcomes[name].append(bench.outcome_of(name, completed))
            corners[name].append(corners_of(bench, completed))
    yield from head("relations", "other planes", "corners", "missed", "median, mm", "in pixels")
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


ROOM_WARPS_MM = (2.0, 5.0, 20.0)
"""Root mean square of the displacement of a room's points."""

PART_WARPS_MM = (0.0, 0.05, 0.2, 1.0)
"""The same of the part of figure 1, whose points have noise of .1 mm."""

_NOISE_MM = 0.1
_PART_BOX = np.array([(-50.0, -40.0, 0.0), (75.0, 40.0, 60.0)])


@suite("warps", smallest="--rooms 1 --parts 1")
def warps(first: int = 2000, rooms: int = 10, parts: int = 100) -> Iterator[str]:
    """True relations of rooms and parts that are warped as a whole: shares rejected, and what they came to.

    A warp is a displacement in space that is any polynomial of second order in x, y and z: it bends planes,
    and turns them against each other by as much. The first share is of tests of each relation by itself; the
    counts are of the true ones among all that `infer` looked at.
    """
    yield from head(
        "warped", "rms, mm", "tests", "p < .05 / .001", "accepted", "implied", "undecided", "rejected"
    )
    for size in ROOM_WARPS_MM:
        yield _row_of_warp_study(
            "rooms, 2 mm noise", size, [_room(seed, 1e-3 * size) for seed in range(first, first + rooms)]
        )
    for size in PART_WARPS_MM:
        yield _row_of_warp_study(
            f"part of figure 1, {_NOISE_MM:g} mm noise", size, [_part(seed, size) for seed in range(parts)]
        )


def warped(points: FloatArray, seed: int, size: float, span: FloatArray) -> FloatArray:
    """Points (n, 3) displaced by a polynomial of second order over a box (2, 3), some `size` rms over it.

    What is a rigid motion, a stretch or a shear is not in it: only its terms of second order, about the
    middle of the box.
    """
    rng = np.random.default_rng([20270, seed])
    x, y, z = ((points - span.mean(axis=0)) / np.ptp(span, axis=0) * np.sqrt(12)).T
    terms = np.stack([(x * x - 1) / 1.2, x * y, x * z, (y * y - 1) / 1.2, y * z, (z * z - 1) / 1.2], axis=1)
    return np.asarray(points + size / np.sqrt(18) * terms @ rng.normal(size=(6, 3)))


def _room(seed: int, size_m: float) -> tuple[list[float], Counter[RelationStatus]]:
    """The p of a warped room's true relations, and what became of those that were proposed."""
    case = random_case(seed)
    scans = [_bent(SENSORS[0].applied(scan, 10 * seed + k), seed, size_m, case.scene.mesh.vertices)
             for k, scan in enumerate(case.scans(Effects(), 0))]  # fmt: skip
    seen = [observe(scan, case.views[0].world_from_sensor) for scan in scans]
    fits = true_fits(case, seen)
    relations = true_relations([one.true for one in fits])
    stated = state_fits([one.merged for one in fits], seen, 0.0)
    estimate = JointEstimate(stated.fits, None, np.zeros(3), doubt_of(stated))
    graph = infer(stated.fits, (), BUILT, doubt=doubt_of(stated))
    exact = JointEstimate([replace(one.fit, surface=one.true) for one in fits], None, np.zeros(3))
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


def _part(seed: int, size: float) -> tuple[list[float], Counter[RelationStatus]]:
    """The same of the part of figure 1."""
    points = list[FloatArray]()
    fits = figure_one(seed, _NOISE_MM, warp=lambda places: warped(places, seed, size, _PART_BOX), kept=points)
    doubt = doubt_of_warp(find_warp(fits, points), len(fits))
    exact = figure_one(0, 1e-7)
    truth = JointEstimate(exact, None, np.zeros(3))
    relations = true_relations([fit.surface for fit in exact if isinstance(fit.surface, Plane)])
    estimate = JointEstimate(fits, None, np.zeros(3), doubt)
    graph = infer(fits, doubt=doubt)
    counts = Counter(one.status for one in graph.relations if is_true(one, truth))
    return [wald_test(one, estimate).p for one in relations], counts


def _row_of_warp_study(
    name: str, size: float, found: Sequence[tuple[list[float], Counter[RelationStatus]]]
) -> str:
    values = np.array([p for some, _ in found for p in some])
    counts = sum((some for _, some in found), Counter[RelationStatus]())
    shares = " / ".join(f"{np.mean(values < level):.3f}" for level in LEVELS)
    order = (
        RelationStatus.ACCEPTED,
        RelationStatus.IMPLIED,
        RelationStatus.UNDECIDED,
        RelationStatus.REJECTED,
    )
    cells = " | ".join(str(counts[status]) for status in order)
    return f"| {name} | {size:g} | {len(values)} | {shares} | {cells} |"
