# SPDX-License-Identifier: MIT
"""Junctions and elbows over noise and outliers: refused, wrong, how exact and honest; plain surfaces."""

from __future__ import annotations

import resource
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.features.holes import exact_parts
from benchmarks.features.junction_points import PLAIN, Truth, elbow, junction, plain
from benchmarks.parts import Part
from completion.templates.engine.measured import Measured
from completion.templates.engine.template import Status, TemplateFit
from completion.templates.junctions.pipeline import find_junctions
from scenes.surfaces.catalogue import Cylinder, Plane

SIGMAS, OUTLIERS = (0.1, 0.5, 1.0), (0.0, 0.1, 0.3)
_RIGHT = 0.2  # of a radius, within which it counts as right
_BENDS = ((38.0, 90.0), (75.0, 45.0), (60.0, 60.0))  # mm, degrees; the tube's radius is 25


@dataclass
class Row:
    """Trials of one cell."""

    errors: list[np.ndarray] = field(default_factory=list)
    shares: list[np.ndarray] = field(default_factory=list)  # of the predicted deviations
    refused: int = 0
    wrong: int = 0

    def told(self) -> str:
        """The cell in words."""
        if not self.errors:
            return f"refused {self.refused} wrong {self.wrong}"
        rms = np.sqrt(np.mean(np.square(self.errors), axis=0))
        share = np.sqrt(np.nanmean(np.square(self.shares), axis=0))
        numbers = " ".join(f"{one:.3g}" for one in rms)
        return (
            f"refused {self.refused} wrong {self.wrong} RMS {numbers}"
            f" by predicted {' '.join(f'{one:.2f}' for one in share)}"
        )


def fitted(points: np.ndarray, kind: str, sigma: float) -> TemplateFit:
    """The best fit to points."""
    spacing = float(np.sqrt(np.prod(np.sort(np.ptp(points, axis=0))[1:]) / len(points)))
    return find_junctions(Measured(points, sigma, spacing), [kind], rng=np.random.default_rng(0))[0]


def junction_errors(fit: TemplateFit, truth: Truth) -> tuple[np.ndarray, np.ndarray, bool]:
    """Errors of R1, R2, joint (mm) and axis (degrees), by what was predicted, and whether it is right."""
    off = fit.x[2:5] - truth.joint
    off = off - (off @ truth.axis) * truth.axis
    angle = float(np.degrees(np.arccos(min(1.0, abs(float(fit.x[5:] @ truth.axis))))))
    radii = [
        found - true if np.isfinite(true) else 0.0 for found, true in zip(fit.x[:2], truth.radii, strict=True)
    ]
    errors = np.array([*radii, np.linalg.norm(off), angle])
    variance = np.diag(fit.covariance)
    deviations = np.sqrt(
        [variance[0], variance[1], variance[2:5].sum(), np.degrees(np.degrees(variance[5:].sum()))]
    )
    right = all(
        abs(found - true) < _RIGHT * true if np.isfinite(true) else found > 20 * truth.radii[0]
        for found, true in zip(fit.x[:2], truth.radii, strict=True)
    )
    return errors, errors / np.where(deviations > 0, deviations, np.nan), right


def elbow_errors(fit: TemplateFit, truth: Truth) -> tuple[np.ndarray, np.ndarray, bool]:
    """Errors of the bend, the tube, the corner (mm) and the angle (degrees), likewise."""
    off = fit.x[3:6] - truth.joint
    angle = fit.value("angle") - truth.angle
    radii = fit.x[1:3] - truth.radii
    errors = np.array([*radii, np.linalg.norm(off), np.degrees(angle)])
    variance = np.diag(fit.covariance)
    deviations = np.sqrt([variance[1], variance[2], variance[3:6].sum(), np.degrees(np.degrees(variance[0]))])
    right = bool((np.abs(radii) < _RIGHT * np.array(truth.radii)).all() and abs(np.degrees(angle)) < 10)
    return errors, errors / deviations, right


Made = Callable[[np.random.Generator, int, float, float], Truth]
SUBJECTS: dict[str, tuple[str, Made]] = {
    "S-shaped": ("junction", lambda rng, _, sigma, share: junction(rng, sigma, share)),
    "same-sided": ("junction", lambda rng, _, sigma, share: junction(rng, sigma, share, is_s_shaped=False)),
    "fillet": ("junction", lambda rng, _, sigma, share: junction(rng, sigma, share, radii=(25.0, np.inf))),
    "elbow": (
        "elbow",
        lambda rng, k, sigma, share: elbow(
            rng, sigma, share, bend=_BENDS[k % 3][0], angle_deg=_BENDS[k % 3][1]
        ),
    ),
}


def study(subject: str, first_seed: int, n: int) -> None:
    """Print a row for each noise and share of outliers."""
    kind, made = SUBJECTS[subject]
    errors_of = junction_errors if kind == "junction" else elbow_errors
    for sigma in SIGMAS:
        for share in OUTLIERS:
            row, begin = Row(), time.process_time()
            for k in range(n):
                truth = made(np.random.default_rng(first_seed + k), k, sigma, share)
                fit = fitted(truth.points, kind, sigma)
                if fit.status is not Status.FOUND:
                    row.refused += 1
                    continue
                errors, shares, right = errors_of(fit, truth)
                if not right:
                    row.wrong += 1
                    continue
                row.errors.append(errors)
                row.shares.append(shares)
            seconds = (time.process_time() - begin) / n
            print(f"{subject} sigma {sigma} outliers {share:.0%}: {row.told()} ({seconds:.1f} s)", flush=True)


def nulls(kind: str, first_seed: int, n: int) -> None:
    """Print how often plain surfaces are taken for a junction or an elbow, n of each kind."""
    for name in PLAIN:
        count: Counter[str] = Counter()
        for k in range(n):
            rng = np.random.default_rng(first_seed + k)
            sigma, share = float(rng.choice(SIGMAS)), float(rng.choice(OUTLIERS))
            truth = plain(name, rng, sigma, share)
            fit = fitted(truth.points, kind, sigma)
            count[str(fit.status)] += 1
            if fit.status is Status.FOUND:
                print(f"  false {kind} on {name}: seed {first_seed + k} {fit.x[:2]} {fit.evidence:.1f}")
        print(f"{kind} on {n} of {name}: {dict(count)}", flush=True)


def run(first_seed: int, n: int) -> None:
    """Junctions and fillets, and what is none."""
    for subject in ("S-shaped", "same-sided", "fillet"):
        study(subject, first_seed, n)
    nulls("junction", first_seed, 5 * n)


def run_elbows(first_seed: int, n: int) -> None:
    """Elbows, and what is none."""
    study("elbow", first_seed, n)
    nulls("elbow", first_seed, max(1, n // 2))


@dataclass(frozen=True)
class Touch:
    """A cylinder of a part that runs without an edge into another, or into a plane."""

    radius: float  # the smaller
    place: np.ndarray  # (3,) in the middle of the common border
    axis: np.ndarray  # (3,)


def touches(part: Part, spacing: float) -> list[Touch]:
    """The true junctions of a part: labelled patches that have one normal along a common border."""
    kept = [(one, part.points[part.label == k]) for k, one in enumerate(part.surfaces)]
    kept = [(one, own) for one, own in kept if isinstance(one, Cylinder | Plane) and len(own) >= 20]
    found = []
    for i, (one, own) in enumerate(kept):
        for other, beside in kept[:i]:
            rounds = [each for each in (one, other) if isinstance(each, Cylinder)]
            border = own[cKDTree(beside).query(own)[0] < 2.5 * spacing]
            if not rounds or len(border) < 6:
                continue
            cosine = np.abs(np.einsum("ij,ij->i", one.normal(border), other.normal(border)))
            if np.median(cosine) < np.cos(np.radians(6)) or not _is_tangent(one, other):
                continue
            small = min(rounds, key=lambda each: each.radius)
            found.append(Touch(small.radius, border.mean(axis=0), small.direction))
    return found


def _is_tangent(one: Cylinder | Plane, other: Cylinder | Plane) -> bool:
    """Whether two surfaces touch along a line: axes parallel, and not the same cylinder."""
    if isinstance(one, Cylinder) and isinstance(other, Cylinder):
        gap = np.linalg.norm(np.cross(one.point - other.point, one.direction))
        is_same = abs(one.radius - other.radius) < 0.01 * one.radius and gap < 0.02 * one.radius
        return abs(float(one.direction @ other.direction)) > 0.99 and not is_same
    flat, round_ = (one, other) if isinstance(one, Plane) else (other, one)
    return abs(float(flat.normal(flat.point[None])[0] @ round_.direction)) < 0.1


def run_parts(seconds: float = 30.0) -> None:
    """Print how many junctions of the data set's parts are found, and how many of those are true."""
    total = np.zeros(5, dtype=int)
    for part, measured in exact_parts(seconds):
        begin, true = time.process_time(), touches(part, measured.spacing)
        try:
            fits = find_junctions(measured, ["junction"], rng=np.random.default_rng(0))
        except TimeoutError:
            fits, total[4] = [], total[4] + 1
            print(f"{part.name}: no more time")
        found = [fit for fit in fits if fit.status is Status.FOUND]
        hits = [[k for k, one in enumerate(true) if _hits(fit, one, measured.spacing)] for fit in found]
        met = {k for each in hits for k in each}
        total[:4] += len(true), len(met), len(found), sum(bool(each) for each in hits)
        others = [f"{fit.x[0]:.3g}/{fit.x[1]:.3g}" for fit, each in zip(found, hits, strict=True) if not each]
        print(
            f"{part.name}: {len(part.points)} points, {len(met)} of {len(true)} junctions met, {len(found)} "
            f"found, others {' '.join(others) or 'none'}, {time.process_time() - begin:.1f} s",
            flush=True,
        )
    print(f"true {total[0]}, met {total[1]}; found {total[2]}, true {total[3]}; {total[4]} had no time")


def _hits(fit: TemplateFit, one: Touch, spacing: float) -> bool:
    """Whether a fit is a true junction: its radius, its line and its place along it."""
    ends = np.asarray(fit.geometry["joint"])
    length = float(np.linalg.norm(ends[1] - ends[0]))
    axis = (ends[1] - ends[0]) / max(length, 1e-9)
    gap = one.place - ends.mean(axis=0)
    across = float(np.linalg.norm(gap - (gap @ axis) * axis))
    return bool(
        abs(fit.x[0] - one.radius) < 0.1 * one.radius
        and across < max(3 * spacing, 0.3 * one.radius)
        and abs(axis @ one.axis) > 0.98
        and abs(float(gap @ axis)) < length
    )


def run_growth() -> None:
    """Print CPU time and peak memory by the number of points, of one fillet and of a block with four."""
    for name, made in (("one fillet", _fillet), ("a rounded block", _block)):
        before = None
        for n in (10_000, 30_000, 100_000, 300_000, 1_000_000):
            points, spacing = made(n)
            begin = time.process_time()
            fits = find_junctions(
                Measured(points, 0.05 * spacing, spacing), ["junction"], rng=np.random.default_rng(0)
            )
            seconds, n_found = time.process_time() - begin, sum(fit.status is Status.FOUND for fit in fits)
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            power = np.nan if before is None else np.log(seconds / before[1]) / np.log(n / before[0])
            print(f"{name}, {n} points: {n_found} found, {seconds:.2f} s, as n^{power:.2f}, "
                  f"peak {peak:.0f} MB", flush=True)  # fmt: skip
            before = (n, seconds)


def _fillet(n: int) -> tuple[np.ndarray, float]:
    """Points (n, 3) of a plane and a quarter of a cylinder, and how far apart they are."""
    truth = junction(np.random.default_rng(0), 0.0, 0.0, radii=(25.0, np.inf), n=n)
    spacing = float(np.sqrt(60 * (30 + 26) / n))
    return truth.points + np.random.default_rng(1).normal(0, 0.05 * spacing, (n, 3)), spacing


def _block(n: int) -> tuple[np.ndarray, float]:
    """Points (n, 3) of a block of 100 by 60, its four long edges rounded by 10, and their distance."""
    rng, flats, radius = np.random.default_rng(0), (80.0, 40.0, 80.0, 40.0), 10.0
    arc = radius * np.pi / 2
    lengths = np.array([length for flat in flats for length in (flat, arc)])
    at = rng.uniform(0, lengths.sum(), n)
    piece = np.searchsorted(lengths.cumsum(), at)
    s = at - (lengths.cumsum() - lengths)[piece]
    x, y, turn = np.zeros(n), np.zeros(n), 0.0
    place = np.array([-40.0, -30.0])
    for k, length in enumerate(lengths):
        on, along = piece == k, np.array([np.cos(turn), np.sin(turn)])
        inward = np.array([-along[1], along[0]])
        if k % 2 == 0:
            ends = place + s[on, None] * along
            place = place + length * along
        else:
            bent = s[on, None] / radius
            ends = place + radius * (np.sin(bent) * along + (1 - np.cos(bent)) * inward)
            place, turn = place + radius * (along + inward), turn + np.pi / 2
        x[on], y[on] = ends.T
    spacing = float(np.sqrt(lengths.sum() * 100 / n))
    points = np.column_stack([x, y, rng.uniform(0, 100, n)])
    return points + rng.normal(0, 0.05 * spacing, (n, 3)), spacing
