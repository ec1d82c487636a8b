# SPDX-License-Identifier: MIT
"""Patterns of holes in plates with losses and outliers, and blank plates: what is found, and how exactly."""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from types import FrameType

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.cases.plates import SIZE, PlateTruth, plate
from benchmarks.run import suite
from benchmarks.store import each
from benchmarks.suites.parts import Part, parts, read_part
from completion.features.engine.template import Measured, Seen, Status, TemplateFit
from completion.features.holes.patterns import KINDS, LEAST_SEEN
from completion.features.holes.pipeline import find_holes
from scenes.surfaces.catalogue import Cylinder

_SHOWN, _COUNTABLE = 0.25, 1 / 3  # of a rim: a hole that can be seen; one that can be counted by itself


@dataclass(frozen=True, slots=True)
class Score:
    """What became of one plate."""

    kind: str
    status: Status
    is_count_right: bool  # of all holes
    is_range_right: bool  # whether the least and the most that are told hold it
    is_seen_right: bool  # of those from the first to the last that can be seen
    can_be_seen: bool  # three of them, four of a grid
    can_be_counted: bool  # each hole by itself
    centre_rms: float  # mm
    radius_error: float
    z: float  # of the pitch, or the circle's radius
    evidence: float
    seconds: float


def plate_score(kind: str, seed: int) -> Score:
    """Find the pattern of the plate of a seed, and compare."""
    rng = np.random.default_rng(seed)
    return score(plate(rng, kind), rng=rng)  # type: ignore[arg-type]


def score(truth: PlateTruth, *, rng: np.random.Generator) -> Score:
    """Find the pattern of one plate, and compare."""
    begin = time.process_time()
    fit = find_holes(truth.measured, [truth.kind], {}, rng=rng, budget=10**7)[0]
    seconds = time.process_time() - begin
    n_shown = int((truth.shown >= _SHOWN).sum())
    can_be_seen = n_shown >= (4 if truth.kind == "hole-grid" else 3)
    able = (can_be_seen, bool((truth.shown >= _COUNTABLE).all()))
    if not len(fit.x):
        return Score(truth.kind, fit.status, *[False] * 3, *able, *[np.nan] * 3, fit.evidence, seconds)
    centres = np.asarray(fit.geometry["centres"])
    gap = np.linalg.norm(centres[:, None] - truth.centres, axis=2)
    matched = gap.min(axis=1)
    is_right = bool(matched.max() < 0.5 * truth.radius)
    name = "circle_radius" if truth.kind == "bolt-circle" else "pitch"
    true = min(truth.pitches, key=lambda pitch: abs(pitch - fit.value(name)))
    least, most = (int(n) for n in np.asarray(fit.geometry["count_range"]))
    return Score(
        truth.kind,
        fit.status,
        is_right and len(centres) == len(truth.centres),
        is_right and least <= len(truth.centres) <= most,
        is_right and bool((gap.min(axis=0) < 0.5 * truth.radius)[_between(truth)].all()),
        *able,
        float(np.sqrt((matched**2).mean())) if is_right else np.inf,
        fit.value("radius") - truth.radius,
        (fit.value(name) - true) / max(fit.deviation(name), 1e-12),
        fit.evidence,
        seconds,
    )


def _between(truth: PlateTruth) -> np.ndarray:
    """The holes from the first to the last that can be seen (all of a circle, once three are)."""
    shown = truth.shown >= _SHOWN
    if truth.kind == "bolt-circle" or not shown.any():
        return np.ones(len(shown), dtype=np.bool_)
    if truth.kind == "hole-row":
        first, last = np.flatnonzero(shown)[[0, -1]]
        return (np.arange(len(shown)) >= first) & (np.arange(len(shown)) <= last)
    return shown


@suite("holes")
def holes(first: int = 10_000, n: int = 20) -> Iterator[str]:
    """Rows, grids and bolt circles of holes in plates of which a third is lost, n plates each."""
    for kind in KINDS:
        scores = list(each(plate_score, kind, range(first, first + n)))
        found = [one for one in scores if one.status is Status.FOUND]
        whole = [one for one in found if np.isfinite(one.centre_rms)]
        can = [one for one in scores if one.can_be_seen]
        countable = [one for one in scores if one.can_be_counted]
        zs, seconds = [abs(one.z) for one in whole], [one.seconds for one in scores]
        rms = np.sqrt(np.mean([one.centre_rms**2 for one in whole])) if whole else np.nan
        by_itself = sum(one.is_count_right and one.status is Status.FOUND for one in countable)
        yield (
            f"{kind}: found {len(found)} of {n} (of {len(can)} that show enough: "
            f"{sum(one.status is Status.FOUND for one in can)}), placed {len(whole)}, all holes counted "
            f"{sum(one.is_count_right for one in found)}, within what is told "
            f"{sum(one.is_range_right for one in found)}, those that show "
            f"{sum(one.is_seen_right for one in found)}; of {len(countable)} whose holes each show a third: "
            f"{by_itself}; centres {rms:.3f} mm, "
            f"radius {np.median([one.radius_error for one in whole]):+.3f} mm, median |z| "
            f"{np.median(zs):.2f}, {np.mean(seconds):.1f} s"
        )


@suite("hole-nulls")
def hole_nulls(first: int = 10_000, n: int = 20) -> Iterator[str]:
    """Patterns found on n blank plates, and the tail of the greatest evidence of each kind."""
    results = list(each(_on_blank, range(first, first + n)))
    for k, kind in enumerate(KINDS):
        top = np.sort([evidence[k] for evidence, _ in results])[::-1]
        yield (
            f"{kind}: false on {sum(false[k] for _, false in results)} of {n}; greatest evidence "
            f"{np.round(top[:10], 1).tolist()}, above 0: {(top > 0).mean():.3f}"
        )


def _on_blank(seed: int) -> tuple[list[float], list[bool]]:
    """By kind the greatest evidence on a blank plate, and whether one was found."""
    rng = np.random.default_rng(seed)
    fits = find_holes(plate(rng, "blank").measured, KINDS, {}, rng=rng, budget=10**7)
    own = [[fit for fit in fits if fit.kind == kind] for kind in KINDS]
    found = [any(fit.status is Status.FOUND for fit in kind) for kind in own]
    return [float(max(_counted(fit) for fit in kind)) for kind in own], found


def _counted(fit: TemplateFit) -> float:
    """Evidence of a fit, of which enough was seen and that nothing but the null refuses; -inf of others."""
    seen = sum(side.state is Seen.CONFIRMED for side in fit.sides)
    by_null = fit.status is Status.FOUND or "lost patches make" in fit.reason
    return fit.evidence if seen >= LEAST_SEEN.get(fit.kind, 3) and by_null else -np.inf


def exact_parts(seconds: float) -> Iterator[tuple[Part, Measured]]:
    """Every part of the data set as it was measured, each with so much CPU time until TimeoutError."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise TimeoutError

    signal.signal(signal.SIGPROF, stop)
    for path in parts():
        part = read_part(path)
        near = cKDTree(part.points).query(part.points[::10], k=2)[0][:, 1]
        signal.setitimer(signal.ITIMER_PROF, seconds)
        yield part, Measured(part.points, noise=0.0, spacing=float(np.median(near)))
        signal.setitimer(signal.ITIMER_PROF, 0)


@suite("hole-parts")
def hole_parts(seconds: float = 20.0) -> Iterator[str]:
    """Patterns of holes found on the parts of the data set, and how many lie on true bores or bosses."""
    total = np.zeros(4, dtype=int)
    for part, measured in exact_parts(seconds):
        begin, true = time.process_time(), _rounds(part)
        try:
            fits = find_holes(measured, KINDS, {}, rng=np.random.default_rng(0), budget=10**7)
        except TimeoutError:
            fits, total[3] = [], total[3] + 1
            yield f"{part.name}: no more time"
        found = [fit for fit in fits if fit.status is Status.FOUND]
        right = [_is_on(fit, true) for fit in found]
        total[:3] += len(found), sum(right), sum(fit.status is Status.AMBIGUOUS for fit in fits)
        for fit, is_right in zip(found, right, strict=True):
            yield (f"{part.name}: {fit.kind} of {fit.geometry['count']}, radius {fit.value('radius'):.4g}, "
                  f"{'on' if is_right else 'NOT on'} true cylinders; {fit.reason}")  # fmt: skip
        for fit in fits:
            if fit.status is Status.AMBIGUOUS:
                yield f"{part.name}: ambiguous {fit.kind} of {fit.geometry['count']}, {fit.reason}"
        yield (f"{part.name}: {len(part.points)} points, {len(true)} whole cylinders, "
              f"{time.process_time() - begin:.1f} s")  # fmt: skip
    yield f"found {total[0]}, right {total[1]}, ambiguous {total[2]}; {total[3]} parts had no time"


def _rounds(part: Part) -> list[Cylinder]:
    """The true cylinders of which nearly the whole turn is there, halves of one put together."""
    kinds = list[tuple[Cylinder, np.ndarray]]()
    for number, one in enumerate(part.surfaces):
        own = part.points[part.label == number]
        if not isinstance(one, Cylinder) or len(own) < 8:
            continue
        across = np.linalg.svd(one.direction[None])[2][1:]
        turn = np.arctan2(*((own - one.point) @ across.T).T)
        for k, (other, turns) in enumerate(kinds):
            gap = np.cross(other.point - one.point, other.direction)
            if np.linalg.norm(gap) < 0.02 * one.radius and abs(other.radius / one.radius - 1) < 0.01:
                mine = np.linalg.svd(other.direction[None])[2][1:]
                turn = np.arctan2(*((own - other.point) @ mine.T).T)
                kinds[k] = (other, np.concatenate([turns, turn]))
                break
        else:
            kinds.append((one, turn))
    return [one for one, turn in kinds if (np.histogram(turn, 24, (-np.pi, np.pi))[0] > 0).sum() >= 20]


def _is_on(fit: TemplateFit, true: list[Cylinder]) -> bool:
    """Whether each hole of a fit is one of the true cylinders."""
    axis, radius = np.asarray(fit.geometry["axis"]), fit.value("radius")
    like = [one for one in true
            if abs(one.radius / radius - 1) < 0.05 and abs(float(one.direction @ axis)) > 0.99]  # fmt: skip
    return all(
        any(np.linalg.norm(np.cross(centre - one.point, one.direction)) < 0.1 * radius for one in like)
        for centre in np.asarray(fit.geometry["centres"])
    )


def hole_growth() -> Iterator[str]:
    """CPU time and peak memory for a row of six holes, by the number of points of its plate."""
    before = None
    for n in (10_000, 30_000, 100_000, 300_000, 1_000_000):
        rng = np.random.default_rng(0)
        flat = rng.uniform(0, 1, (n, 2)) * SIZE
        holes = np.column_stack([20 + 18 * np.arange(6), np.full(6, 0.5 * SIZE[1])])
        flat = flat[cKDTree(holes).query(flat)[0] > 5.0]
        spacing = float(np.sqrt(SIZE[0] * SIZE[1] / n))
        points = np.column_stack([flat, rng.normal(0, 0.1 * spacing, len(flat))])
        begin = time.process_time()
        fit = find_holes(
            Measured(points, 0.1 * spacing, 0.5 * spacing), KINDS[:1], {}, rng=rng, budget=10**7
        )[0]
        seconds = time.process_time() - begin
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        power = "" if before is None else f", as n^{np.log(seconds / before[1]) / np.log(n / before[0]):.2f}"
        yield (f"{n} points: {fit.status}, {fit.geometry.get('count')} holes, {seconds:.2f} s{power}, "
              f"peak {peak:.0f} MB")  # fmt: skip
        before = (n, seconds)
