# SPDX-License-Identifier: MIT
"""Patterns of holes in plates with losses and outliers, and blank plates: what is found, and how exactly."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from benchmarks.features.hole_plates import PlateTruth, plate
from completion.templates.engine.template import Seen, Status, TemplateFit
from completion.templates.holes.patterns import KINDS
from completion.templates.holes.pipeline import find_holes

_SHOWN = 0.25  # of a rim: a hole that can be seen


@dataclass(frozen=True, slots=True)
class Score:
    """What became of one plate."""

    kind: str
    status: Status
    is_count_right: bool  # of all holes
    is_seen_right: bool  # of those from the first to the last that can be seen
    can_be_seen: bool  # three of them, four of a grid
    centre_rms: float  # mm
    radius_error: float
    z: float  # of the pitch, or the circle's radius
    evidence: float
    seconds: float


def score(truth: PlateTruth, *, rng: np.random.Generator) -> Score:
    """Find the pattern of one plate, and compare."""
    begin = time.process_time()
    fit = find_holes(truth.measured, [truth.kind], {}, rng=rng, budget=10**7)[0]
    seconds = time.process_time() - begin
    n_shown = int((truth.shown >= _SHOWN).sum())
    can_be_seen = n_shown >= (4 if truth.kind == "hole-grid" else 3)
    if not len(fit.x):
        return Score(truth.kind, fit.status, False, False, can_be_seen, *[np.nan] * 3, fit.evidence, seconds)
    centres = np.asarray(fit.geometry["centres"])
    gap = np.linalg.norm(centres[:, None] - truth.centres, axis=2)
    matched = gap.min(axis=1)
    is_right = bool(matched.max() < 0.5 * truth.radius)
    name = "circle_radius" if truth.kind == "bolt-circle" else "pitch"
    true = min(truth.pitches, key=lambda pitch: abs(pitch - fit.value(name)))
    return Score(
        truth.kind,
        fit.status,
        is_right and len(centres) == len(truth.centres),
        is_right and bool((gap.min(axis=0) < 0.5 * truth.radius)[_between(truth)].all()),
        can_be_seen,
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


def run(first_seed: int, n: int, **setting: float) -> None:
    """Print a table line a kind of pattern for n plates each."""
    for kind in KINDS:
        scores = [score(plate(rng, kind, **setting), rng=rng)  # type: ignore[arg-type]
                  for rng in map(np.random.default_rng, range(first_seed, first_seed + n))]  # fmt: skip
        found = [one for one in scores if one.status is Status.FOUND]
        whole = [one for one in found if np.isfinite(one.centre_rms)]
        can = [one for one in scores if one.can_be_seen]
        zs, seconds = [abs(one.z) for one in whole], [one.seconds for one in scores]
        rms = np.sqrt(np.mean([one.centre_rms**2 for one in whole])) if whole else np.nan
        print(
            f"{kind}: found {len(found)} of {n} (of {len(can)} that show enough: "
            f"{sum(one.status is Status.FOUND for one in can)}), placed {len(whole)}, all holes counted "
            f"{sum(one.is_count_right for one in found)}, those that show "
            f"{sum(one.is_seen_right for one in found)}; centres {rms:.3f} mm, "
            f"radius {np.median([one.radius_error for one in whole]):+.3f} mm, median |z| "
            f"{np.median(zs):.2f}, {np.mean(seconds):.1f} s",
            flush=True,
        )


def run_null(first_seed: int, n: int, **setting: float) -> dict[str, list[float]]:
    """Print what is found on n blank plates, and the tail of the greatest evidence of each kind."""
    evidence: dict[str, list[float]] = {kind: [] for kind in KINDS}
    false = dict.fromkeys(KINDS, 0)
    for seed in range(first_seed, first_seed + n):
        rng = np.random.default_rng(seed)
        fits = find_holes(plate(rng, "blank", **setting).measured, KINDS, {}, rng=rng, budget=10**7)  # type: ignore[arg-type]
        for kind in KINDS:
            own = [fit for fit in fits if fit.kind == kind]
            evidence[kind].append(max(_counted(fit) for fit in own))
            false[kind] += any(fit.status is Status.FOUND for fit in own)
    for kind, values in evidence.items():
        top = np.sort(values)[::-1]
        print(f"{kind}: false on {false[kind]} of {n}; greatest evidence {np.round(top[:10], 1).tolist()}, "
              f"above 0: {(top > 0).mean():.3f}", flush=True)  # fmt: skip
    return evidence


def _counted(fit: TemplateFit) -> float:
    """Evidence of a fit, of which enough was seen; -inf of others."""
    seen = sum(side.state is Seen.CONFIRMED for side in fit.sides)
    return fit.evidence if seen >= (4 if fit.kind == "hole-grid" else 3) else -np.inf
