# SPDX-License-Identifier: MIT
"""Dimensions and angles of rooms of known truth: whether intervals hold, and what advice is worth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from trimesh.triangles import closest_point

from benchmarks.cases.frames import DATA, HELD_OUT_HOUSES, REAL
from benchmarks.cases.rooms import random_case
from benchmarks.cases.sensors import SCANNERS, distorted
from benchmarks.run import head, suite
from benchmarks.store import each
from completion import CompletionOptions, complete
from completion.export.decisions import advice
from completion.export.dimension import Dimension
from completion.fitting.result import SurfaceFit
from completion.result.completed_model import CompletedModel
from scenes import read_scan
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane
from scenes.world.scene import Scene

_NEAR_M = 0.05  # between a place and the true surface there, along its normal
_BESIDE_M = 0.05  # within the surface, to its border
_SAME = float(np.cos(np.radians(5.0)))
_OPENING_M = 0.4  # between the middles of an opening and of its truth


class SceneTruth:
    """The true surfaces of a scene."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._corners = scene.mesh.vertices[scene.mesh.faces]
        normal = np.cross(
            self._corners[:, 1] - self._corners[:, 0], self._corners[:, 2] - self._corners[:, 0]
        )
        length = np.linalg.norm(normal, axis=1)
        self._normal = normal / np.maximum(length, 1e-15)[:, None]

    def of(self, dimension: Dimension) -> float | None:
        """What a dimension should be; None where one of its ends is not there."""
        kind = dimension.kind
        if kind.startswith("opening"):
            return self._opening(dimension)
        if kind in ("room area", "room volume"):
            return self._room(dimension)
        if kind in ("room width", "room height", "wall thickness", "slab thickness"):
            return self._between(dimension)
        return self._cylinder(dimension)

    def _between(self, dimension: Dimension) -> float | None:
        ends = dimension.ends
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        shifts = []
        for support in dimension.supports:
            shift = self._shift(support.place, support.element.normal_at(support.place), along)
            if shift is None:
                return None
            shifts.append(shift)
        return float(dimension.value + shifts[1] - shifts[0])

    def _shift(self, place: FloatArray, normal: FloatArray, along: FloatArray) -> float | None:
        """How far from a place, along a direction, the true surface is that is meant there."""
        slope = self._normal @ along
        off = np.einsum("ij,ij->i", self._corners[:, 0] - place, self._normal)
        fits = (np.abs(self._normal @ normal) >= _SAME) & (np.abs(off) <= _NEAR_M)
        which = np.flatnonzero(fits)
        if not len(which):
            return None
        at = place - off[which, None] * -self._normal[which]
        beside = np.linalg.norm(closest_point(self._corners[which], at) - at, axis=1)
        there = which[beside <= _BESIDE_M]
        if not len(there):
            return None
        best = there[int(np.argmin(np.abs(off[there])))]
        return float(off[best] / slope[best])

    def _room(self, dimension: Dimension) -> float:
        """Area or volume by moving each side to where it truly is."""
        total = dimension.value
        for support in dimension.supports:
            normal = support.element.normal_at(support.place)
            shift = self._shift(support.place, normal, normal)
            total -= support.weight * (0.0 if shift is None else shift)
        return float(total)

    def _opening(self, dimension: Dimension) -> float | None:
        middle = dimension.ends.mean(axis=0)
        along = (dimension.ends[1] - dimension.ends[0]) / max(dimension.value, 1e-9)
        best, least = None, _OPENING_M
        for one in self._scene.openings:
            reach = one.outline @ along
            apart = float(np.linalg.norm((one.outline.min(axis=0) + one.outline.max(axis=0)) / 2 - middle))
            if apart < least:
                best, least = float(np.ptp(reach)), apart
        return best

    def _cylinder(self, dimension: Dimension) -> float | None:
        axes = []
        for number in (0, len(dimension.supports) - 1 if dimension.kind == "column spacing" else 0):
            element = dimension.supports[number].element
            found = self._nearest(element)
            if found is None:
                return None
            axes.append(found)
        (label, one), (_, other) = axes
        if dimension.kind == "column spacing":
            across = (one.point - other.point) - ((one.point - other.point) @ one.direction) * one.direction
            return float(np.linalg.norm(across))
        if dimension.kind.endswith("radius"):
            return float(one.radius)
        corners = self._corners[self._scene.mesh.face_surface == label].reshape(-1, 3)
        return float(np.ptp(corners @ one.direction))

    def _nearest(self, element: object) -> tuple[int, Cylinder] | None:
        ends, radius = element.ends, element.radius_m  # type: ignore[attr-defined]
        middle = ends.mean(axis=0)
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        best, least = None, max(0.5 * radius, _NEAR_M)
        for label, one in enumerate(self._scene.surfaces):
            if not isinstance(one, Cylinder) or abs(one.direction @ along) < np.cos(np.radians(10)):
                continue
            away = middle - one.point
            apart = float(np.linalg.norm(away - (away @ one.direction) * one.direction))
            if apart < least and abs(one.radius - radius) < 0.5 * one.radius:
                best, least = (label, one), apart
        return best


_CLEAR_M = 0.4  # around a station


@dataclass(frozen=True, slots=True)
class Stated:
    """A dimension, what is said of it, and what is true."""

    kind: str
    value: float
    low: float
    high: float
    share: float
    across: float
    word: str
    truth: float | None

    @property
    def holds(self) -> bool:
        """Whether its interval holds the truth."""
        return self.truth is not None and self.low <= self.truth <= self.high


@suite("dimensions", smallest="--rooms 2")
def dimensions(
    rooms: int = 200, first: int = 12000, scanner: str = "2mm", tolerance: float = 0.01, listed: bool = False
) -> Iterator[str]:
    """Intervals and advice on dimensions of rooms scanned once, by scanners with errors of their own.

    By kind of dimension: how many intervals hold the truth, those that rest on inferred surface apart, how
    wide they are, and how often each advice is wrong. --scanner: 2mm or 10mm.
    """
    known: list[Stated] = []
    for seed, stated in zip(
        range(first, first + rooms),
        each(_of_room, range(first, first + rooms), scanner, tolerance),
        strict=True,
    ):
        known += stated
        yield from (f"room {seed}: {dimension}" for dimension in stated if listed and not dimension.holds)
    yield from table(known, tolerance)


def _of_room(seed: int, scanner: str, tolerance: float) -> list[Stated]:
    scene = random_case(seed).scene
    scan = SCANNERS[scanner].scan(scene, station(scene, seed), seed)
    done = complete(scan, CompletionOptions(texture=False), rng=0)
    truth = SceneTruth(scene)
    return [
        Stated(
            d.kind, d.value, d.low, d.high, share=d.measured_share, across=d.across_m,
            word=advice(d, tolerance), truth=truth.of(d),
        )
        for d in done.decisions(tolerance).dimensions
    ]  # fmt: skip


def station(scene: Scene, seed: int) -> Pose:
    """A place in a room with nothing near."""
    rng = np.random.default_rng([20270, seed])
    around = rng.normal(size=(200, 3))
    caster, size = scene.ray_caster(), np.minimum(scene.mesh.bounds()[1], [5.5, 5.0, 3.0])
    for _ in range(500):
        eye = np.array([*rng.uniform(0.4, size[:2] - 0.4), rng.uniform(1.3, 1.7)])
        if caster.first_hit(np.tile(eye, (200, 1)), around).ranges.min() >= _CLEAR_M:
            break
    turn = rng.uniform(0, 2 * np.pi)
    return Pose.looking_at(eye, eye + [np.cos(turn), np.sin(turn), 0.0])


def table(found: list[Stated], tolerance: float) -> Iterator[str]:
    """Lines of a table in Markdown."""
    yield from head(
        "kind", "n", "not there", "hold", "on inferred surface: n, hold", "rms error, mm", "median half, mm"
    )
    for kind in sorted({one.kind for one in found}):
        own = [one for one in found if one.kind == kind]
        there = [one for one in own if one.truth is not None]
        inferred = [one for one in there if one.share < 1]
        error = [one.value - one.truth for one in there if one.truth is not None]
        yield (
            f"| {kind} | {len(own)} | {len(own) - len(there)} | {_share(there)} | {len(inferred)}, "
            f"{_share(inferred)} | {1000 * float(np.sqrt(np.mean(np.square(error or [np.nan])))):.2f} | "
            f"{500 * float(np.median([one.high - one.low for one in there] or [np.nan])):.2f} |"
        )
    yield ""
    yield from head("advice", "n", "not there", "wrong by more than the tolerance")
    for word in ("rely", "check", "do not build"):
        own = [one for one in found if one.word == word]
        gone = sum(one.truth is None for one in own)
        wrong = sum(
            one.truth is not None and abs(one.value - one.truth) > tolerance * one.across for one in own
        )
        yield f"| {word} | {len(own)} | {gone} | {wrong} |"


def _share(found: list[Stated]) -> str:
    return f"{100 * np.mean([one.holds for one in found]):.1f} %" if found else "-"


LEAST_M2 = 0.3  # measured of each plane
_NEAR_DEG = 10.0  # of square or parallel: what is farther off was not meant to be


@dataclass(frozen=True, slots=True)
class AnglePair:
    """Two planes that should be square or parallel."""

    scan: str  # what it was called
    off_deg: float  # from a right angle or none
    without_deg: float  # stated deviation of the angle, the sensor's systematic errors left out
    stated_deg: float  # the same with them


def pairs_of(name: str, completed: CompletedModel) -> list[AnglePair]:
    """Return the pairs of planes that enclose what was scanned, and were measured well enough."""
    planes = [
        patch
        for patch in completed.patches
        if isinstance(patch.grid.surface, Plane) and patch.limits.encloses and patch.observed_m2 >= LEAST_M2
    ]
    found = []
    for one, other in combinations(planes, 2):
        cosine = abs(float(_normal(one.stated) @ _normal(other.stated)))
        angle = float(np.degrees(np.arccos(min(cosine, 1.0))))
        if min(angle, 90.0 - angle) > _NEAR_DEG:
            continue
        parallel = angle <= _NEAR_DEG
        without, stated = (
            float(np.degrees(np.sqrt(_variance(a, b, parallel) + _variance(b, a, parallel))))
            for a, b in ((one.source.fit, other.source.fit), (one.stated, other.stated))
        )
        found.append(AnglePair(name, angle if parallel else 90.0 - angle, without, stated))
    return found


def _normal(fit: SurfaceFit) -> np.ndarray:
    return np.asarray(fit.surface.normal(np.zeros((1, 3)))[0])


def _variance(fit: SurfaceFit, other: SurfaceFit, parallel: bool) -> float:
    """What a plane's tilt adds to the variance of the angle to another; of parallel ones the mean of both."""
    tilt, across = fit.parameter_covariances()["normal"], _normal(other)
    return float(np.trace(tilt) / 2 if parallel else across @ tilt @ across)


def summary(name: str, pairs: Sequence[AnglePair]) -> str:
    """Return a line of a Markdown table."""
    off = np.array([one.off_deg for one in pairs])
    cells = [name, str(len(pairs)), f"{np.median(off):.2f}"]
    for stated in ([one.without_deg for one in pairs], [one.stated_deg for one in pairs]):
        times = off / np.maximum(stated, 1e-12)
        cells += [f"{np.median(stated):.2f}", f"{np.median(times):.1f}", f"{np.mean(times <= 2):.2f}"]
    return "| " + " | ".join(cells) + " |"


def names_of(scans: Sequence[RangeImage], name: str) -> list[tuple[str, RangeImage]]:
    """Number some scans."""
    return [(f"{name} {k}", scan) for k, scan in enumerate(scans)]


_REAL = ("nyu_dining", "open3d_redwood", "align3d_sample1")
_OFFICE = "range/pcl/office1.pcd"


@suite("angles", smallest="--flats 1 --no-real")
def angles(
    flats: int = 20,
    units: float = 2.0,
    real: bool = True,
) -> Iterator[str]:
    """Angles of walls and floors that should be square or parallel, in stated deviations."""
    options = CompletionOptions(texture=False)
    yield from head(
        "", "pairs", "off, deg", "stated before", "times", "within 2 sd", "stated", "times", "within 2 sd"
    )
    for name, scans in sources(flats, units, real=real):
        found = [pair for one, scan in scans for pair in pairs_of(one, complete(scan, options, rng=0))]
        if found:
            yield summary(name, found)


def sources(flats: int, units: float, *, real: bool) -> Iterator[tuple[str, list[tuple[str, RangeImage]]]]:
    """Yield what is scanned by name, with its frames."""
    if real:
        for source in REAL:
            if source.name in _REAL:
                yield source.name, names_of(source.frames, source.name)
        yield "office1", names_of([read_scan(DATA / _OFFICE)], "office1")
    scans = [
        distorted(flat.frames[k], 10 * flat.seed + k, units)
        for flat in HELD_OUT_HOUSES[:flats]
        for k in (0, 2)
    ]
    yield f"flats, bent by {units:g} units", names_of(scans, "flat")
