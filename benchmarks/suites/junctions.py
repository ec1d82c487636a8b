# SPDX-License-Identifier: MIT
"""Junctions, elbows, stairs, columns and free-form patches: found, refused, how exact, how honest."""

from __future__ import annotations

import resource
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.cases.junctions import PLAIN, Truth, elbow, junction, plain
from benchmarks.cases.patches import END, FLOOR, KINDS, WALL, PatchCase, case_of
from benchmarks.cases.solids import CONTENTS, solid_room
from benchmarks.run import head, suite
from benchmarks.store import each
from benchmarks.suites.holes import exact_parts
from benchmarks.suites.parts import Part
from completion.features.engine.template import Measured, Status, TemplateFit
from completion.features.junctions.pipeline import find_junctions
from completion.features.pipeline import find_features
from completion.features.solids import find_solids
from completion.fitting.euclidean import fit_plane
from completion.fitting.patches.joins import Boundary, Join
from completion.fitting.patches.pipeline import PatchFit, fit_patch
from completion.fitting.patches.rounds import feet_of
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane
from tests.completion.features.solids.solid_points import column_points, stairs_points

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


class _Trial(NamedTuple):
    """Of one trial: whether it was refused or wrong; errors, and errors by predicted deviations."""

    is_refused: bool
    is_wrong: bool
    errors: FloatArray
    shares: FloatArray
    cpu_s: float


def _tried(subject: str, sigma: float, share: float, first: int, k: int) -> _Trial:
    """One trial of a subject."""
    begin, (kind, made) = time.process_time(), SUBJECTS[subject]
    truth = made(np.random.default_rng(first + k), k, sigma, share)
    fit, none = fitted(truth.points, kind, sigma), np.zeros(0)
    if fit.status is not Status.FOUND:
        return _Trial(True, False, none, none, time.process_time() - begin)
    errors, shares, right = (junction_errors if kind == "junction" else elbow_errors)(fit, truth)
    return _Trial(False, not right, np.asarray(errors), np.asarray(shares), time.process_time() - begin)


def study(subject: str, first: int, n: int) -> Iterator[str]:
    """A line for each noise and share of outliers."""
    for sigma in SIGMAS:
        for share in OUTLIERS:
            trials = list(each(_tried, subject, sigma, share, first, range(n)))
            right = [trial for trial in trials if not trial.is_refused and not trial.is_wrong]
            row = Row(
                refused=sum(trial.is_refused for trial in trials),
                wrong=sum(trial.is_wrong for trial in trials),
                errors=[trial.errors for trial in right],
                shares=[trial.shares for trial in right],
            )
            seconds = np.mean([trial.cpu_s for trial in trials])
            yield f"{subject} sigma {sigma} outliers {share:.0%}: {row.told()} ({seconds:.1f} s)"


def _nulls(kind: str, first: int, n: int) -> Iterator[str]:
    """How often plain surfaces are taken for a junction or an elbow, n of each kind."""
    for name in PLAIN:
        results = list(each(_on_plain, name, kind, range(first, first + n)))
        yield from (text for _, text in results if text)
        yield f"{kind} on {n} of {name}: {dict(Counter(status for status, _ in results))}"


def _on_plain(name: str, kind: str, seed: int) -> tuple[str, str]:
    """Status of the best fit to a plain surface, and what is false of it."""
    rng = np.random.default_rng(seed)
    sigma, share = float(rng.choice(SIGMAS)), float(rng.choice(OUTLIERS))
    fit = fitted(plain(name, rng, sigma, share).points, kind, sigma)
    false = f"  false {kind} on {name}: seed {seed} {fit.x[:2]} {fit.evidence:.1f}"
    return str(fit.status), false if fit.status is Status.FOUND else ""


@suite("junctions")
def junctions(first: int = 10_000, n: int = 20) -> Iterator[str]:
    """Junctions and fillets by noise and outliers, and surfaces that have none."""
    for subject in ("S-shaped", "same-sided", "fillet"):
        yield from study(subject, first, n)
    yield from _nulls("junction", first, 5 * n)


@suite("elbows")
def elbows(first: int = 10_000, n: int = 20) -> Iterator[str]:
    """Elbows of pipes by noise and outliers, and surfaces that have none."""
    yield from study("elbow", first, n)
    yield from _nulls("elbow", first, max(1, n // 2))


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


@suite("junction-parts")
def junction_parts(seconds: float = 30.0) -> Iterator[str]:
    """Junctions of the parts of the data set: how many are found, and how many of those are true."""
    total = np.zeros(5, dtype=int)
    for part, measured in exact_parts(seconds):
        begin, true = time.process_time(), touches(part, measured.spacing)
        try:
            fits = find_junctions(measured, ["junction"], rng=np.random.default_rng(0))
        except TimeoutError:
            fits, total[4] = [], total[4] + 1
            yield f"{part.name}: no more time"
        found = [fit for fit in fits if fit.status is Status.FOUND]
        hits = [[k for k, one in enumerate(true) if _hits(fit, one, measured.spacing)] for fit in found]
        met = {k for each in hits for k in each}
        total[:4] += len(true), len(met), len(found), sum(bool(each) for each in hits)
        others = [f"{fit.x[0]:.3g}/{fit.x[1]:.3g}" for fit, each in zip(found, hits, strict=True) if not each]
        yield (
            f"{part.name}: {len(part.points)} points, {len(met)} of {len(true)} junctions met, {len(found)} "
            f"found, others {' '.join(others) or 'none'}, {time.process_time() - begin:.1f} s"
        )
    yield f"true {total[0]}, met {total[1]}; found {total[2]}, true {total[3]}; {total[4]} had no time"


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


def junction_growth() -> Iterator[str]:
    """CPU time and peak memory by the number of points, of one fillet and of a block with four."""
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
            yield (f"{name}, {n} points: {n_found} found, {seconds:.2f} s, as n^{power:.2f}, "
                  f"peak {peak:.0f} MB")  # fmt: skip
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


_TRUE = {"stairs": {"going": 0.28, "rise": 0.17}, "column": {"width": 0.6, "radius": 0.2}}
_POINTS = {"stairs": stairs_points, "column": column_points}
_SPACING = 0.03


@suite("solids")
def solids(first: int = 10_000, n: int = 20) -> Iterator[str]:
    """Stairs and columns among points, by noise and outliers; floors and walls that are neither."""
    first_seed = first
    for kind, true in _TRUE.items():
        for sigma in (0.002, 0.005, 0.01):
            for share in (0.0, 0.1, 0.3):
                errors, shares, refused = [], [], 0
                for seed in range(first_seed, first_seed + n):
                    points = _POINTS[kind](np.random.default_rng(seed), sigma=sigma, outliers=share)
                    measured = Measured(points, sigma, _SPACING)
                    fit = find_solids(measured, [kind], rng=np.random.default_rng(0))[0]
                    if fit.status is not Status.FOUND:
                        refused += 1
                        continue
                    off = np.array([fit.value(name) - value for name, value in true.items()])
                    errors.append(off)
                    shares.append(off / [fit.deviation(name) for name in true])
                rms = [np.sqrt(np.mean(np.square(one), axis=0)).round(5) for one in (errors, shares)]
                yield (
                    f"{kind} sigma {sigma} outliers {share:.0%}: refused {refused} {' '.join(true)} RMS "
                    f"{rms[0]} by predicted {rms[1].round(2)}"
                )
    for kind in _TRUE:
        false = 0
        for seed in range(first_seed, first_seed + 2 * n):
            points = room_points(np.random.default_rng(seed))
            fit = find_solids(Measured(points, 0.005, _SPACING), [kind], rng=np.random.default_rng(0))[0]
            false += fit.status is Status.FOUND
        yield f"{kind} on {2 * n} floors with walls, boxes or a pole: {false} false"


@suite("solid-rooms")
def solid_rooms(first: int = 10_000, n: int = 20) -> Iterator[str]:
    """Columns and stairs in scanned rooms: how often they are found, how exactly, and where none are."""
    first_seed = first
    for kind in _TRUE:
        for content in CONTENTS:
            rows, status, cpu = [], Counter[str](), time.process_time()
            for seed in range(first_seed, first_seed + n):
                scan, true = solid_room(seed, content)
                fit = find_features([scan], [kind], rng=0).fits[0]
                status[str(fit.status)] += 1
                if content == kind and fit.status is not Status.NONE:
                    rows.append([abs(fit.value(name) - value) for name, value in true.items()])
            said = ", ".join(f"{number} {name}" for name, number in sorted(status.items()))
            names, off = " and ".join(_TRUE[kind]), ""
            if rows:
                off = f"; {names} off by {np.round(1e3 * np.median(rows, axis=0), 1)} mm"
            each = (time.process_time() - cpu) / n
            yield f"{kind} in rooms with {content}: {said}{off}; {each:.1f} CPU s each"


def room_points(rng: np.random.Generator, n: int = 1_500) -> np.ndarray:
    """Points (m, 3) of a floor with a wall, and a box or a round pole on it."""
    floor = np.column_stack([rng.uniform(-1.5, 1.5, (n, 2)), np.zeros(n)])
    wall = np.column_stack([np.full(n, 1.5), rng.uniform(-1.5, 1.5, n), rng.uniform(0, 2.5, n)])
    angle, radius = rng.uniform(0, 2 * np.pi, n), rng.uniform(0.1, 0.3)
    pole = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0, 2.5, n)])
    size = rng.uniform(0.3, 0.8, 3)
    box = rng.uniform(-0.5, 0.5, (n, 3))
    box[np.arange(n), rng.integers(0, 3, n)] = rng.choice([-0.5, 0.5], n)
    box = box * size + [0, 0, size[2] / 2]
    points = np.concatenate([floor, wall, (pole, box)[int(rng.integers(2))]])
    return points + rng.normal(0, 0.005, points.shape)


SIGMAS = (0.02, 0.1, 0.5)
_TOLD = 400  # points at which error and deviation are compared


@suite("patches")
def patches(
    first: int = 1000,
    seeds: int = 10,
    points: int = 20_000,
) -> Iterator[str]:
    """Free-form patches between planes and cylinders."""
    yield from head(
        "patch, noise mm",
        "plane angle, rad",
        "cylinder angle, rad",
        "gap, mm",
        "ratio, median (most)",
        "error, mm",
        "z",
        "doubts",
    )
    for kind in KINDS:
        for sigma in SIGMAS:
            cases = [case_of(kind, seed, sigma, points) for seed in range(first, first + seeds)]
            yield f"| {kind}, {sigma:g} | {_row(cases)} |"
    yield ""
    for n, controls in ((20_000, 10), (100_000, 20)):
        case = case_of("blend", first, 0.1, n)
        start = time.process_time()
        found = fit_patch(case.points, case.boundaries, controls=(controls, controls))  # type: ignore[arg-type]
        spent = time.process_time() - start
        yield f"{n} points, {controls} x {controls}: {spent:.1f} s of the processor, ratio {found.ratio:.4f}"
    yield ""
    yield from head(
        "noise, mm", "planes fitted alone, deg", "made square", "with the patch", "ratio", "angle, rad"
    )
    for sigma in SIGMAS[1:]:
        yield f"| {sigma:g} | {_free_row(sigma, range(first, first + seeds))} |"


def _row(cases: list[PatchCase]) -> str:
    angles = {Plane: [0.0], Cylinder: [0.0]}
    gaps, ratios, errors, z, doubts = [], [], [], [], 0
    for case in cases:
        found = fit_patch(case.points, case.boundaries)  # type: ignore[arg-type]
        for side, one in found.boundaries.items():
            angles[type(one.surface)].append(np.nan_to_num(found.joins[side].angle))
            gaps.append(found.joins[side].gap)
        off, sd = _errors(found, case)
        ratios.append(found.ratio)
        errors.append(float(np.sqrt(np.mean(off**2))))
        z.append(float(np.sqrt(np.mean((off / sd) ** 2))))
        doubts += len(found.warnings)
    plane, tube = (f"{max(some):.0e}" if len(some) > 1 else "-" for some in angles.values())
    return (
        f"{plane} | {tube} | {max(gaps):.0e} | {np.median(ratios):.4f} ({max(ratios):.4f}) "
        f"| {np.median(errors):.4f} | {np.median(z):.2f} | {doubts}"
    )


def _errors(found: PatchFit, case: PatchCase) -> tuple[FloatArray, FloatArray]:
    """How far exact points are off the patch, and its deviation there."""
    places = np.linspace(0.0, 1.0, 60)
    grid = np.stack(np.meshgrid(places, places, indexing="ij"), axis=-1).reshape(-1, 2)
    some = case.exact[:: max(1, len(case.exact) // _TOLD)]
    apart = ((found.patch.at(grid)[:, None] - some) ** 2).sum(axis=2)
    feet = feet_of(found.patch, some, grid[np.argmin(apart, axis=0)], 4)
    inside = feet.is_inside & ((feet.uv > 0.02) & (feet.uv < 0.98)).all(axis=1)
    return feet.distance[inside], found.deviation(feet.uv[inside])


def _free_row(sigma: float, seeds: range) -> str:
    """Three planes from 200 points each, square to each other, and a blend of 20,000 points between them."""
    angles = np.zeros((3, len(seeds), 3))
    ratios, joins = [], []
    truth = np.array([WALL.normal_direction, FLOOR.normal_direction, END.normal_direction])
    for k, seed in enumerate(seeds):
        rng = np.random.default_rng(seed)
        places, off = rng.uniform(0, 100, (3, 200, 2)), sigma * rng.normal(size=(3, 200))
        clouds = [
            np.column_stack([off[0], places[0, :, 0], 40 + places[0, :, 1]]),
            np.column_stack([40 + places[1, :, 0], places[1, :, 1], off[1]]),
            np.column_stack([20 + places[2, :, 0], off[2], 20 + places[2, :, 1]]),
        ]
        fits = [fit_plane(cloud, np.array([200.0, 200.0, 200.0])) for cloud in clouds]
        normals = np.array([one.surface.normal_direction for one in fits])
        left, _, right = np.linalg.svd(normals)
        square = left @ right
        joins_of = {"u0": Join.TANGENT, "u1": Join.TANGENT, "v0": Join.ORTHOGONAL}
        given = {
            side: Boundary(Plane(fit.surface.point, normal), joins_of[side], fit.parameter_deviations())
            for side, fit, normal in zip(joins_of, fits, square, strict=True)
        }
        points = _upright_blend(sigma, seed)
        found = fit_patch(points, given, free=True)  # type: ignore[arg-type]
        freed = np.array([found.boundaries[side].surface.normal_direction for side in joins_of])  # type: ignore[index, union-attr]
        for row, own in enumerate((normals, square, freed)):
            angles[row, k] = np.degrees(np.linalg.norm(np.cross(own, truth), axis=1))
        ratios.append(found.ratio)
        joins.append(max(one.angle for one in found.joins.values()))
    alone, squared, together = np.sqrt(np.mean(angles**2, axis=(1, 2)))
    return f"{alone:.4f} | {squared:.4f} | {together:.4f} | {np.median(ratios):.4f} | {max(joins):.0e}"


def _upright_blend(sigma: float, seed: int) -> FloatArray:
    """A blend's points where its planes are those of the axes."""
    case = case_of("blend", seed, sigma, 20_000)
    frame = np.array([case.boundaries[side].surface.normal_direction for side in ("u0", "v0", "u1")])  # type: ignore[union-attr]
    return (case.points - case.boundaries["u0"].surface.point) @ frame.T
