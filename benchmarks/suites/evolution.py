# SPDX-License-Identifier: MIT
"""Evolution, least squares from many starts and the exact solver on the same cases."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from benchmarks.cases.planes import BASE, SIDE, WIDE, figure_one
from benchmarks.run import suite
from completion.features.engine.search import Progress, polish, search
from completion.fitting.result import FitError
from completion.fitting.robust import fit_robust
from completion.relations.pipeline import impose
from completion.relations.relation import Relation
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane

SIGMA, SQUARE_DEG = 0.2, 0.05
"""Noise of the part, millimetres, and the gates' tolerance."""

_FAR = 3.0  # deviations at which a residual is cut off, where the objective is truncated
_N = 250  # points of each surface


class Case(Protocol):
    """Something to search for: its box, objective, residuals, and what an answer is off."""

    @property
    def lower(self) -> FloatArray:
        """Lower corner of the box (d,)."""
        ...

    @property
    def upper(self) -> FloatArray:
        """Upper corner of the box (d,)."""
        ...

    def objective(self, x: FloatArray) -> FloatArray:
        """Values (n,) of places (n, d)."""
        ...

    def violation(self, x: FloatArray) -> FloatArray:
        """How far places (n, d) break the gates (n,)."""
        ...

    def residuals(self, x: FloatArray) -> FloatArray:
        """Residuals (m,) of one place (d,), for least squares; gates weighed among them."""
        ...

    def errors(self, x: FloatArray) -> tuple[float, float]:
        """What a place (d,) is off: radius and angle of the part, sides of an opening."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PartCase:
    """Base, side and R60 of the part: 3 + 3 + 5 unknowns; R60 shows 60 deg of itself.

    Unknowns: of each plane two tilts and an offset; of the cylinder two tilts, two shifts and the radius.
    """

    clouds: tuple[FloatArray, ...]  # of base, side and cylinder (n, 3), mm, where the axes are the part's
    turn: FloatArray  # (3, 3) from the part's axes to those of the box
    is_truncated: bool
    is_gated: bool

    @property
    def lower(self) -> FloatArray:
        """The box: 15 deg and 10 mm to each side, a radius from 30 mm."""
        tilt, off = np.radians(-15.0), -10.0
        return np.array([tilt, tilt, off, tilt, tilt, off, tilt, tilt, off, off, 30.0])

    @property
    def upper(self) -> FloatArray:
        """See `lower`."""
        return np.append(-self.lower[:-1], 100.0)

    def _axes(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Unit normals of base and side, and the axis, each (n, 3)."""
        one = np.ones(len(x))
        found = (
            np.stack([x[:, 0], x[:, 1], -one], axis=1),
            np.stack([-one, x[:, 3], x[:, 4]], axis=1),
            np.stack([x[:, 6], x[:, 7], one], axis=1),
        )
        base, side, axis = (some / np.linalg.norm(some, axis=1, keepdims=True) for some in found)
        return base, side, axis

    def _distances(self, x: FloatArray) -> FloatArray:
        """Of all points from their surface, in deviations (n, m)."""
        base, side, axis = self._axes(x)
        planes = [
            normal @ (cloud - cloud_centre).T - x[:, [column]]
            for normal, cloud, cloud_centre, column in (
                (base, self.clouds[0], np.zeros(3), 2),
                (side, self.clouds[1], np.array([-50.0, 0, 20]), 5),
            )
        ]
        centre = np.stack([x[:, 8], x[:, 9], np.full(len(x), 20.0)], axis=1)
        offset = self.clouds[2][None] - centre[:, None]
        along = np.einsum("nmi,ni->nm", offset, axis)
        across = np.sqrt(np.maximum(np.einsum("nmi,nmi->nm", offset, offset) - along**2, 0.0))
        return np.asarray(np.concatenate([*planes, across - x[:, [10]]], axis=1) / SIGMA)

    def angles_deg(self, x: FloatArray) -> FloatArray:
        """Of places (n, d): how far side and base are off square, and axis and base off parallel (n, 2)."""
        base, side, axis = self._axes(x)
        square = np.abs(np.arcsin(np.clip(np.einsum("ij,ij->i", base, side), -1, 1)))
        parallel = np.arcsin(np.clip(np.linalg.norm(np.cross(base, axis), axis=1), 0, 1))
        return np.asarray(np.degrees(np.stack([square, parallel], axis=1)))

    def objective(self, x: FloatArray) -> FloatArray:
        """Mean squared distances, each cut off at three deviations where they are truncated."""
        squared = self._distances(x) ** 2
        return np.asarray((np.minimum(squared, _FAR**2) if self.is_truncated else squared).mean(axis=1))

    def violation(self, x: FloatArray) -> FloatArray:
        """The sum of what angles exceed their tolerance by, degrees."""
        if not self.is_gated:
            return np.zeros(len(x))
        return np.asarray(np.maximum(0.0, self.angles_deg(x) - SQUARE_DEG).sum(axis=1))

    def residuals(self, x: FloatArray) -> FloatArray:
        """The distances, cut off alike; a tolerance by which angles exceed weighs as much as all points."""
        found = self._distances(x[None])[0]
        found = np.clip(found, -_FAR, _FAR) if self.is_truncated else found
        if not self.is_gated:
            return np.asarray(found)
        over = np.maximum(0.0, self.angles_deg(x[None])[0] - SQUARE_DEG) / SQUARE_DEG
        return np.concatenate([found, np.sqrt(len(found)) * over])

    def errors(self, x: FloatArray) -> tuple[float, float]:
        """Of the radius, mm, and the larger of both angles, degrees."""
        return abs(float(x[10]) - 60.0), float(self.angles_deg(x[None]).max())

    def exact(self) -> tuple[float, float]:
        """The same of surfaces fitted one by one, with the relations imposed."""
        kinds = ("plane", "plane", "cylinder")
        try:
            fits = [fit_robust(cloud, kind) for cloud, kind in zip(self.clouds, kinds, strict=True)]
        except FitError:
            return np.nan, np.nan
        square = [Relation(kind="perpendicular", surfaces=(0, 1)), Relation(kind="parallel", surfaces=(0, 2))]
        base, side, wide = (one.surface for one in impose(fits, square).fits)
        assert isinstance(base, Plane)
        assert isinstance(side, Plane)
        assert isinstance(wide, Cylinder)
        off = abs(np.arcsin(np.clip(base.normal_direction @ side.normal_direction, -1, 1)))
        lean = np.arcsin(np.clip(np.linalg.norm(np.cross(base.normal_direction, wide.direction)), 0, 1))
        return abs(wide.radius - 60.0), float(np.degrees(max(off, lean)))


def part_case(seed: int, outliers: float, *, is_truncated: bool, is_gated: bool) -> PartCase:
    """The part's points, a share of them anywhere within 30 mm of their surface's box, turned at random."""
    rng, kept = np.random.default_rng(seed), list[FloatArray]()
    figure_one(seed, SIGMA, _N, kept=kept)
    turn = Rotation.from_rotvec(rng.uniform(-0.1, 0.1, 3)).as_matrix()
    clouds = []
    for number in (BASE, SIDE, WIDE):
        cloud = kept[number]
        some = rng.random(len(cloud)) < outliers
        low, high = cloud.min(axis=0) - 30, cloud.max(axis=0) + 30
        cloud[some] = rng.uniform(low, high, (int(some.sum()), 3))
        clouds.append(cloud @ turn.T)
    return PartCase(tuple(clouds), turn, is_truncated, is_gated)


@dataclass(frozen=True, slots=True, eq=False)
class OpeningCase:
    """An upright opening in a wall: its left, right, bottom and top; beams that stop or go on there.

    A part of the beams is stopped before the wall and says nothing; some err. The value is in nats: constant
    between beams, so that no gradient leads anywhere.
    """

    at: FloatArray  # (m, 2) where beams meet the wall, metres
    nats: FloatArray  # (m,) by which each speaks for an opening there
    truth: FloatArray  # (4,)

    @property
    def lower(self) -> FloatArray:
        """The box: middle, width, bottom and height."""
        return np.array([-3.0, 0.4, -1.0, 0.4])

    @property
    def upper(self) -> FloatArray:
        """See `lower`."""
        return np.array([3.0, 3.0, 1.5, 3.0])

    def objective(self, x: FloatArray) -> FloatArray:
        """Less the evidence within, nats a beam."""
        middle, half = x[:, [0, 0]], x[:, [1, 1]] / 2 * [-1, 1]
        sides = np.concatenate([middle + half, x[:, [2]], x[:, [2]] + x[:, [3]]], axis=1)
        across = (self.at[:, 0] > sides[:, :1]) & (self.at[:, 0] < sides[:, 1:2])
        upward = (self.at[:, 1] > sides[:, 2:3]) & (self.at[:, 1] < sides[:, 3:])
        return np.asarray(-((across & upward) @ self.nats) / len(self.nats))

    def violation(self, x: FloatArray) -> FloatArray:
        """No gates."""
        return np.zeros(len(x))

    def residuals(self, x: FloatArray) -> FloatArray:
        """For least squares: the root of how far the value is above the least that beams could give."""
        least = -np.maximum(self.nats, 0.0).sum() / len(self.nats)
        return np.asarray(np.sqrt(np.maximum(self.objective(x[None]) - least, 0.0)) * np.ones(len(x)))

    def errors(self, x: FloatArray) -> tuple[float, float]:
        """The largest error of a side, mm, twice."""
        sides = np.array([x[0] - x[1] / 2, x[0] + x[1] / 2, x[2], x[2] + x[3]])
        off = 1e3 * float(np.abs(sides - self.truth).max())
        return off, off


def opening_case(seed: int) -> OpeningCase:
    """A doorway or window in 3,000 beams, two fifths of which clutter stops; 3 % err."""
    rng = np.random.default_rng(seed)
    at = np.column_stack([rng.uniform(-4, 4, 3000), rng.uniform(-1, 3, 3000)])
    left, bottom = rng.uniform(-2.5, 1.0), rng.uniform(-0.5, 1.0)
    truth = np.array([left, left + rng.uniform(0.7, 1.5), bottom, bottom + rng.uniform(0.9, 1.8)])
    inside = ((at > truth[[0, 2]]) & (at < truth[[1, 3]])).all(axis=1)
    inside ^= rng.random(len(at)) < 0.03
    hidden = np.zeros(len(at), dtype=bool)
    while hidden.mean() < 0.4:
        corner, size = rng.uniform([-4, -1], [4, 3]), rng.uniform(0.2, 0.8, 2)
        hidden |= ((at > corner) & (at < corner + size)).all(axis=1)
    return OpeningCase(at, np.where(hidden, 0.0, np.where(inside, 4.5, -6.0)), truth)


CASES: dict[str, Callable[[int], Case]] = {
    "smooth": lambda seed: part_case(seed, 0.0, is_truncated=False, is_gated=False),
    "smooth, gated": lambda seed: part_case(seed, 0.0, is_truncated=False, is_gated=True),
    "10 % outliers, truncated": lambda seed: part_case(seed, 0.1, is_truncated=True, is_gated=False),
    "30 % outliers, truncated": lambda seed: part_case(seed, 0.3, is_truncated=True, is_gated=False),
    "30 % outliers, gated": lambda seed: part_case(seed, 0.3, is_truncated=True, is_gated=True),
    "beams that flip": opening_case,
}
"""By name, of a seed."""


AT = (250, 500, 1000, 2000, 4000, 8000)
"""Evaluations after which the error is told."""

_ENOUGH = 0.01  # of the gates' tolerance, that least squares may break them by
_A_START = 400  # evaluations at most, of least squares from one start

Trace = list[tuple[int, FloatArray]]
"""The best place (d,), and after how many evaluations."""


class _SpentError(Exception):
    """The budget is spent."""


def evolve(case: Case, seed: int, budget: int = AT[-1]) -> Trace:
    """Evolution alone."""
    return [(one.evaluations, one.place) for one in _stages(case, seed, budget)]


def evolve_and_polish(case: Case, seed: int, budget: int = AT[-1]) -> Trace:
    """Evolution with half of each budget that is asked for, then least squares."""
    found = Trace()
    for total in (one for one in AT if one <= budget):
        *_, last = _stages(case, seed, total // 2)
        done = polish(case.residuals, last, case.lower, case.upper, budget=total // 2)
        places = np.array([last.place, done.place])
        broken = np.maximum(case.violation(places) - _ENOUGH * SQUARE_DEG, 0.0)
        best = np.lexsort((case.objective(places), broken))[0]
        found.append((total, places[best]))
    return found


def many_starts(case: Case, seed: int, budget: int = AT[-1]) -> Trace:
    """Levenberg-Marquardt from places drawn in the box, the best of all."""
    rng, spent, best, found = np.random.default_rng(seed), 0, np.inf, Trace()

    def counted(x: FloatArray) -> FloatArray:
        nonlocal spent, best
        if spent >= budget:
            raise _SpentError
        spent += 1
        off = case.residuals(x)
        own = float(off @ off)
        if own < best and ((x >= case.lower) & (x <= case.upper)).all():
            best = own
            found.append((spent, x.copy()))
        return off

    try:
        while True:
            start = rng.uniform(case.lower, case.upper)
            least_squares(counted, start, method="lm", x_scale=case.upper - case.lower, max_nfev=_A_START)
    except _SpentError:
        return found


ENGINES: dict[str, Callable[[Case, int, int], Trace]] = {
    "evolution": evolve,
    "evolution, then least squares": evolve_and_polish,
    "least squares from many starts": many_starts,
}
"""By name."""


def errors_at(case: Case, trace: Trace) -> FloatArray:
    """Errors (len(AT), 2) of the best place after so many evaluations; NaN before the first."""
    found = np.full((len(AT), 2), np.nan)
    for row, at in enumerate(AT):
        before = [place for spent, place in trace if spent <= at]
        if before:
            found[row] = case.errors(before[-1])
    return found


def measured(name: str, engine: str, seeds: range) -> tuple[FloatArray, float]:
    """Errors (seeds, len(AT), 2) of an engine on a case, and the processor's seconds a seed."""
    start, every = time.process_time(), []
    for seed in seeds:
        case = CASES[name](seed)
        every.append(errors_at(case, ENGINES[engine](case, seed, AT[-1])))
    return np.array(every), (time.process_time() - start) / len(seeds)


@suite("evolution", smallest="--seeds 1")
def evolution(
    first: int = 2000,
    seeds: int = 12,
) -> Iterator[str]:
    """Radius and angle of the part of figure 1, and sides of an opening, against evaluations."""
    yield from _lines(range(first, first + seeds))


def _lines(seeds: range) -> Iterator[str]:
    yield f"| case, engine | error | {' | '.join(map(str, AT))} | s |"
    yield f"|---|---|{'---|' * (len(AT) + 1)}"
    for name in CASES:
        for engine in ENGINES:
            every, seconds = measured(name, engine, seeds)
            is_part = isinstance(CASES[name](seeds[0]), PartCase)
            for column, what in enumerate(("R, mm", "angle, deg") if is_part else ("side, mm",)):
                low, middle, high = np.nanpercentile(every[:, :, column], [25, 50, 75], axis=0)
                cells = [f"{b:.3g} ({a:.2g}-{c:.2g})" for a, b, c in zip(low, middle, high, strict=True)]
                yield f"| {name}, {engine} | {what} | {' | '.join(cells)} | {seconds:.2f} |"
        exact = [case.exact() for case in (CASES[name](seed) for seed in seeds) if isinstance(case, PartCase)]
        if exact:
            radius, angle = np.nanmedian(exact, axis=0)
            failed = int(np.isnan(exact).any(axis=1).sum())
            yield f"| {name}, exact solver | R {radius:.3g} mm, angle {angle:.1g} deg | {failed} failed |"


def _stages(case: Case, seed: int, budget: int) -> Iterator[Progress]:
    rng = np.random.default_rng(seed)
    yield from search(
        case.objective, case.lower, case.upper, rng=rng, budget=budget, violation=case.violation
    )
