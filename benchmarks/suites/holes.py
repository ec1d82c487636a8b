# SPDX-License-Identifier: MIT
"""Patterns of holes in plates with losses and outliers, and blank plates: what is found, and how exactly."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.cases.plates import PlateTruth, plate
from benchmarks.run import suite
from benchmarks.store import each
from completion.features.engine.template import FeatureStatus, SideState, TemplateFit
from completion.features.holes.patterns import KINDS, LEAST_SEEN
from completion.features.holes.pipeline import find_holes

_SHOWN, _COUNTABLE = 0.25, 1 / 3  # of a rim: a hole that can be seen; one that can be counted by itself


@dataclass(frozen=True, slots=True)
class Score:
    """What became of one plate."""

    kind: str
    status: FeatureStatus
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
    return score(plate(rng, kind), rng=rng)


def score(truth: PlateTruth, *, rng: np.random.Generator) -> Score:
    """Find the pattern of one plate, and compare."""
    begin = time.process_time()
    fit = find_holes(truth.measured, [truth.kind], {}, rng=rng, budget=10**7)[0]
    seconds = time.process_time() - begin
    n_shown = int((truth.shown >= _SHOWN).sum())
    can_be_seen = n_shown >= (4 if truth.kind == "hole-grid" else 3)
    able = (can_be_seen, bool((truth.shown >= _COUNTABLE).all()))
    if not len(fit.x):
        nothing = (False, False, False, *able, np.nan, np.nan, np.nan)
        return Score(truth.kind, fit.status, *nothing, fit.evidence, seconds)
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
        return np.asarray((np.arange(len(shown)) >= first) & (np.arange(len(shown)) <= last))
    return np.asarray(shown)


@suite("holes", smallest="--n 1")
def holes(first: int = 10_000, n: int = 20) -> Iterator[str]:
    """Rows, grids and bolt circles of holes in plates of which a third is lost, n plates each."""
    for kind in KINDS:
        scores = list(each(plate_score, kind, range(first, first + n)))
        found = [one for one in scores if one.status is FeatureStatus.FOUND]
        whole = [one for one in found if np.isfinite(one.centre_rms)]
        can = [one for one in scores if one.can_be_seen]
        countable = [one for one in scores if one.can_be_counted]
        zs, seconds = [abs(one.z) for one in whole], [one.seconds for one in scores]
        rms = np.sqrt(np.mean([one.centre_rms**2 for one in whole])) if whole else np.nan
        by_itself = sum(one.is_count_right and one.status is FeatureStatus.FOUND for one in countable)
        yield (
            f"{kind}: found {len(found)} of {n} (of {len(can)} that show enough: "
            f"{sum(one.status is FeatureStatus.FOUND for one in can)}), placed {len(whole)}, "
            f"all holes counted {sum(one.is_count_right for one in found)}, within what is told "
            f"{sum(one.is_range_right for one in found)}, those that show "
            f"{sum(one.is_seen_right for one in found)}; of {len(countable)} whose holes each show a third: "
            f"{by_itself}; centres {rms:.3f} mm, "
            f"radius {np.median([one.radius_error for one in whole]):+.3f} mm, median |z| "
            f"{np.median(zs):.2f}, {np.mean(seconds):.1f} s"
        )


_ROWS: dict[str, dict[str, Any]] = {
    "rows of 4 to 7, nothing lost": {"counts": (4, 7), "lost": 0.0},
    "rows of 4 to 7, half of the holes lost": {"counts": (4, 7), "half_lost": True},
    "single holes": {"counts": (1, 1)},
}


@suite("hole-rows", smallest="--n 1")
def hole_rows(first: int = 10_000, n: int = 20) -> Iterator[str]:
    """Rows by how much of them was lost, and rows found of single holes; n plates each."""
    for name in _ROWS:
        scores = list(each(_row_score, name, range(first, first + n)))
        found = [one for one in scores if one.status is FeatureStatus.FOUND]
        can = [one for one in scores if one.can_be_seen]
        yield (
            f"{name}: found {len(found)} of {n}, within what is told "
            f"{sum(one.is_range_right for one in found)}, all holes counted "
            f"{sum(one.is_count_right for one in found)}; of {len(can)} with three holes that can be seen: "
            f"{sum(one.is_range_right and one.status is FeatureStatus.FOUND for one in can)}"
        )


def _row_score(name: str, seed: int) -> Score:
    """The same of one plate under a named condition."""
    rng = np.random.default_rng(seed)
    return score(plate(rng, "hole-row", **_ROWS[name]), rng=rng)


@suite("hole-nulls", smallest="--n 1")
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
    found = [any(fit.status is FeatureStatus.FOUND for fit in kind) for kind in own]
    return [float(max(_counted(fit) for fit in kind)) for kind in own], found


def _counted(fit: TemplateFit) -> float:
    """Evidence of a fit, of which enough was seen and that nothing but the null refuses; -inf of others."""
    seen = sum(side.state is SideState.CONFIRMED for side in fit.sides)
    by_null = fit.status is FeatureStatus.FOUND or "lost patches make" in fit.reason
    return fit.evidence if seen >= LEAST_SEEN.get(fit.kind, 3) and by_null else -np.inf
