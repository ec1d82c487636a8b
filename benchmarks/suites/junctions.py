# SPDX-License-Identifier: MIT
"""Junctions, elbows, stairs, columns and free-form patches: found, refused, how exact, how honest."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.cases.junctions import PLAIN, Truth, elbow, junction, plain
from benchmarks.cases.patches import END, FLOOR, KINDS, WALL, PatchCase, case_of
from benchmarks.cases.plates import SIZE
from benchmarks.cases.solids import CONTENTS, solid_room
from benchmarks.run import head, row, suite
from benchmarks.store import each, peak_bytes
from completion.features.engine.template import FeatureStatus, Measurements, TemplateFit
from completion.features.holes.pipeline import find_holes
from completion.features.junctions.pipeline import find_junctions
from completion.features.pipeline import find_features
from completion.fitting.euclidean import fit_plane
from completion.fitting.patches.joins import Boundary, JoinKind
from completion.fitting.patches.pipeline import PatchFit, fit_patch
from completion.fitting.patches.rounds import feet_of
from scenes.checks import FloatArray
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

    def in_words(self) -> str:
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
    return find_junctions(Measurements(points, sigma, spacing), [kind], rng=np.random.default_rng(0))[0]


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
    if fit.status is not FeatureStatus.FOUND:
        return _Trial(True, False, none, none, time.process_time() - begin)
    errors, shares, right = (junction_errors if kind == "junction" else elbow_errors)(fit, truth)
    return _Trial(False, not right, np.asarray(errors), np.asarray(shares), time.process_time() - begin)


def study(subject: str, first: int, n: int) -> Iterator[str]:
    """A line for each noise and share of outliers."""
    for sigma in SIGMAS:
        for share in OUTLIERS:
            trials = list(each(_tried, subject, sigma, share, first, range(n)))
            right = [trial for trial in trials if not trial.is_refused and not trial.is_wrong]
            cell = Row(
                refused=sum(trial.is_refused for trial in trials),
                wrong=sum(trial.is_wrong for trial in trials),
                errors=[trial.errors for trial in right],
                shares=[trial.shares for trial in right],
            )
            seconds = np.mean([trial.cpu_s for trial in trials])
            yield f"{subject} sigma {sigma} outliers {share:.0%}: {cell.in_words()} ({seconds:.1f} s)"


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
    return str(fit.status), false if fit.status is FeatureStatus.FOUND else ""


@suite("junctions", smallest="--n 1")
def junctions(first: int = 10_000, n: int = 20) -> Iterator[str]:
    """Junctions and fillets by noise and outliers, and surfaces that have none."""
    for subject in ("S-shaped", "same-sided", "fillet"):
        yield from study(subject, first, n)
    yield from _nulls("junction", first, 5 * n)


@suite("elbows", smallest="--n 1")
def elbows(first: int = 10_000, n: int = 20) -> Iterator[str]:
    """Elbows of pipes by noise and outliers, and surfaces that have none."""
    yield from study("elbow", first, n)
    yield from _nulls("elbow", first, max(1, n // 2))


@suite("growth", smallest="--points 10000")
def growth(points: str = "10000,30000,100000,300000,1000000") -> Iterator[str]:
    """CPU time and peak memory by the number of points: a row of six holes, a fillet, a rounded block."""
    yield from head("of", "points", "found", "CPU s", "MB at the peak")
    for name, (make, find) in _GROWING.items():
        for n in map(int, points.split(",")):
            measured, begin = make(n), time.process_time()
            fits = find(measured)
            seconds, n_found = (
                time.process_time() - begin,
                sum(fit.status is FeatureStatus.FOUND for fit in fits),
            )
            yield row(name, n, n_found, f"{seconds:.2f}", f"{(peak_bytes() or 0) / 1e6:.0f}")


def _row_of_holes(n: int) -> Measurements:
    """Points of a plate with a row of six holes."""
    rng = np.random.default_rng(0)
    flat = rng.uniform(0, 1, (n, 2)) * SIZE
    centres = np.column_stack([20 + 18 * np.arange(6), np.full(6, 0.5 * SIZE[1])])
    flat = flat[cKDTree(centres).query(flat)[0] > 5.0]
    spacing = float(np.sqrt(SIZE[0] * SIZE[1] / n))
    points = np.column_stack([flat, rng.normal(0, 0.1 * spacing, len(flat))])
    return Measurements(points, 0.1 * spacing, 0.5 * spacing)


def _fillet(n: int) -> Measurements:
    """Points of a plane and a quarter of a cylinder."""
    truth = junction(np.random.default_rng(0), 0.0, 0.0, radii=(25.0, np.inf), n=n)
    spacing = float(np.sqrt(60 * (30 + 26) / n))
    points = truth.points + np.random.default_rng(1).normal(0, 0.05 * spacing, (n, 3))
    return Measurements(points, 0.05 * spacing, spacing)


def _block(n: int) -> Measurements:
    """Points of a block of 100 by 60, its four long edges rounded by 10."""
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
    return Measurements(points + rng.normal(0, 0.05 * spacing, (n, 3)), 0.05 * spacing, spacing)


def _junctions_in(measured: Measurements) -> Sequence[TemplateFit]:
    return find_junctions(measured, ["junction"], rng=np.random.default_rng(0))


def _holes_in(measured: Measurements) -> Sequence[TemplateFit]:
    return find_holes(measured, ["hole-row"], {}, rng=np.random.default_rng(0), budget=10**7)


_GROWING = {
    "row of six holes": (_row_of_holes, _holes_in),
    "one fillet": (_fillet, _junctions_in),
    "rounded block": (_block, _junctions_in),
}


_TRUE = {"stairs": {"going": 0.28, "rise": 0.17}, "column": {"width": 0.6, "radius": 0.2}}


@suite("solid-rooms", smallest="--n 1")
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
                if content == kind and fit.status is not FeatureStatus.NONE:
                    rows.append([abs(fit.value(name) - value) for name, value in true.items()])
            said = ", ".join(f"{number} {name}" for name, number in sorted(status.items()))
            names, off = " and ".join(_TRUE[kind]), ""
            if rows:
                off = f"; {names} off by {np.round(1e3 * np.median(rows, axis=0), 1)} mm"
            each = (time.process_time() - cpu) / n
            yield f"{kind} in rooms with {content}: {said}{off}; {each:.1f} CPU s each"


SIGMAS = (0.02, 0.1, 0.5)
_TOLD = 400  # points at which error and deviation are compared


@suite("patches", smallest="--seeds 1 --points 2000")
def patches(
    first: int = 1000,
    seeds: int = 10,
    points: int = 20_000,
) -> Iterator[str]:
    """Free-form patches between planes and cylinders."""
    yield from head(
        "patch, noise mm | plane angle, rad | cylinder angle, rad | gap, mm | ratio, median (most) | error, "
        "mm | z | doubts"
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


_SIDES: tuple[Literal["u0", "u1", "v0"], ...] = ("u0", "u1", "v0")


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
        planes = [_plane_of(fit.surface) for fit in fits]
        normals = np.array([plane.normal_direction for plane in planes])
        left, _, right = np.linalg.svd(normals)
        square = left @ right
        joins_of = dict(zip(_SIDES, (JoinKind.TANGENT, JoinKind.TANGENT, JoinKind.ORTHOGONAL), strict=True))
        given = {
            side: Boundary(Plane(plane.point, normal), joins_of[side], fit.parameter_deviations())
            for side, plane, fit, normal in zip(joins_of, planes, fits, square, strict=True)
        }
        points = _upright_blend(sigma, seed)
        found = fit_patch(points, given, free=True)  # type: ignore[arg-type]
        freed = np.array([_plane_of(found.boundaries[side].surface).normal_direction for side in _SIDES])
        for number, directions in enumerate((normals, square, freed)):
            angles[number, k] = np.degrees(np.linalg.norm(np.cross(directions, truth), axis=1))
        ratios.append(found.ratio)
        joins.append(max(one.angle for one in found.joins.values()))
    alone, squared, together = np.sqrt(np.mean(angles**2, axis=(1, 2)))
    return f"{alone:.4f} | {squared:.4f} | {together:.4f} | {np.median(ratios):.4f} | {max(joins):.0e}"


def _upright_blend(sigma: float, seed: int) -> FloatArray:
    """A blend's points where its planes are those of the axes."""
    case = case_of("blend", seed, sigma, 20_000)
    planes = [_plane_of(case.boundaries[side].surface) for side in ("u0", "v0", "u1")]
    frame = np.array([plane.normal_direction for plane in planes])
    return np.asarray((case.points - planes[0].point) @ frame.T)


def _plane_of(surface: object) -> Plane:
    assert isinstance(surface, Plane)
    return surface
