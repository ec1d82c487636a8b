# SPDX-License-Identifier: MIT
"""Junctions and elbows over noise and outliers: refused, wrong, how exact and honest; plain surfaces."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.features.junction_points import PLAIN, Truth, elbow, junction, plain
from completion.templates.engine.measured import Measured
from completion.templates.engine.template import Status, TemplateFit
from completion.templates.junctions.pipeline import find_junctions

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
