# SPDX-License-Identifier: MIT
"""Relations of parts: figure 1 of Fisher (2004), rows and mirrors."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.cases.planes import BASE, BORE, FRONT, SIDE, TOP, WIDE, axial_fit, figure_one, plane_fit
from benchmarks.run import head, suite
from completion.fitting.quadrics import fit_by_quadric
from completion.fitting.result import SurfaceFit
from completion.relations.estimate import Estimate
from completion.relations.evidence import CHOSEN
from completion.relations.pipeline import impose, infer
from completion.relations.relation import Relation, Status
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Surface

SIGMAS = (0.1, 0.2, 0.5)
"""Noise, millimetres."""

WRONG = (
    Relation(kind="angle", surfaces=(BASE, SIDE), value=float(np.radians(88.0))),
    Relation(kind="equal_radius", surfaces=(WIDE, BORE)),
    Relation(kind="distance", surfaces=(BASE, TOP), value=41.0),
    Relation(kind="radius", surfaces=(WIDE,), value=59.0),
    Relation(kind="parallel", surfaces=(SIDE, FRONT)),
)
"""What is not so; each is stated by itself."""

_TRUE = 1e-4  # mm and radians, within which a relation holds of the part as it is


@suite("part-relations")
def part_relations(parts: int = 100) -> Iterator[str]:
    """The part of figure 1 of Fisher (2004), and fits from any start."""
    yield from part_table(parts)
    yield ""
    yield from start_table(parts)


def part_table(n_parts: int) -> Iterator[str]:
    """Rows: rms error of R60 alone, related and as stated; what true and wrong relations came to."""
    truth = Estimate(figure_one(0, 1e-7), None, np.zeros(3))
    yield from head(
        "noise, mm", "R60 alone", "related", "stated", "free", "true rejected", "wrong accepted", "CPU s"
    )
    for k, sigma in enumerate(SIGMAS):
        alone, related, told, free = list[float](), list[float](), list[float](), list[int]()
        n_true, n_rejected, n_wrong, seconds = 0, 0, 0, 0.0
        for seed in range(k * n_parts, (k + 1) * n_parts):
            fits = figure_one(seed, sigma)
            start = time.process_time()
            graph = infer(fits)
            seconds += time.process_time() - start
            alone.append(_radius(fits[WIDE].surface) - 60.0)
            related.append(_radius(graph.fits[WIDE].surface) - 60.0)
            told.append(graph.fits[WIDE].parameter_deviations()["radius"])
            free.append(graph.free)
            true = [one for one in graph.relations if is_true(one, truth)]
            n_true += len(true)
            n_rejected += sum(one.status is Status.REJECTED for one in true)
            for wrong in WRONG:
                n_wrong += sum(one.holds for one in infer(fits, [wrong]).relations if one.is_given)
        yield (
            f"| {sigma:g} | {_rms(alone):.4f} | {_rms(related):.4f} | {_rms(told):.4f} "
            f"| {min(free)}-{max(free)} | {n_rejected} of {n_true} | {n_wrong} of {len(WRONG) * n_parts} "
            f"| {seconds / n_parts:.3f} |"
        )


def start_table(n_starts: int, sigma: float = 0.2) -> Iterator[str]:
    """Fits that begin elsewhere: how far apart the related surfaces are, in their standard deviations."""
    rng = np.random.default_rng(0)
    whole = infer(figure_one(0, sigma))
    off, failed = list[float](), 0
    for number in range(n_starts):

        def begin(surface: Surface, points: FloatArray, number: int = number) -> Surface:
            return _by_quadric(surface, points) if number == 0 else _perturbed(surface, rng)

        try:
            found = infer(figure_one(0, sigma, begin=begin))
        except ValueError:
            failed += 1
            continue
        off.append(max(_apart(one, other) for one, other in zip(found.fits, whole.fits, strict=True)))
    yield from head("starts", "fits that failed", "first: elliptic quadric, sd", "greatest difference, sd")
    yield f"| {n_starts} | {failed} | {off[0]:.2g} | {max(off):.2g} |"


@suite("relation-cost")
def relation_cost() -> Iterator[str]:
    """CPU seconds to infer the relations of many planes, and to impose twenty stated ones."""
    yield from head("surfaces", "accepted", "CPU s", "20 stated, CPU s")
    for n in (20, 100, 400):
        fits = _many_planes(n)
        start = time.process_time()
        graph = infer(fits)
        middle = time.process_time()
        impose(fits, list(graph.accepted)[:20])
        yield (
            f"| {n} | {graph.numbered(Status.ACCEPTED)} | {middle - start:.2f} "
            f"| {time.process_time() - middle:.3f} |"
        )


def _many_planes(n: int) -> list[SurfaceFit]:
    """Faces of boxes that stand at three turns about the upright, in metres."""
    rng = np.random.default_rng(n)
    fits = []
    for _ in range(n):
        turn = np.radians(rng.choice([0.0, 30.0, 45.0]))
        axes = Rotation.from_rotvec([0, 0, turn]).as_matrix()
        normal, along = axes[rng.permutation(3)[:2]]
        centre = tuple(rng.uniform(-10, 10, 3))
        fits.append(plane_fit(rng, centre, tuple(normal), tuple(along), (2.0, 1.5), sigma=2e-3, n=400))
    return fits


def _perturbed(surface: Surface, rng: np.random.Generator) -> Surface:
    """The surface turned by up to 10 deg, moved by up to a tenth of its radius, that changed by a fifth."""
    assert isinstance(surface, Cylinder | Cone)
    turn = Rotation.from_rotvec(rng.uniform(-0.1, 0.1, 3)).as_matrix()
    radius = surface.radius * rng.uniform(0.8, 1.2)
    point = surface.point + rng.uniform(-0.1, 0.1, 3) * surface.radius
    if isinstance(surface, Cone):
        return Cone(point, turn @ surface.direction, radius, surface.half_angle * rng.uniform(0.7, 1.3))
    return Cylinder(point, turn @ surface.direction, radius)


def _by_quadric(surface: Surface, points: FloatArray) -> Surface:
    """Of a cylinder the elliptic one that is fitted in closed form, made round; a cone as it is."""
    if not isinstance(surface, Cylinder):
        return surface
    found = fit_by_quadric(points, "elliptic-cylinder", "taubin").surface
    assert isinstance(found, EllipticCylinder)
    return Cylinder(found.point, found.direction, float(np.sqrt(np.prod(found.radii))))


def _apart(one: SurfaceFit, other: SurfaceFit) -> float:
    """How far two fits are apart in the deviations of the first, at points of the other."""
    points = other.surface.from_uv(np.random.default_rng(1).uniform(-1.0, 1.0, (50, 2)))
    off = np.abs(one.surface.distance(points))
    return float(np.max(off / np.maximum(one.standard_deviation(points), 1e-12)))


def is_true(relation: Relation, truth: Estimate) -> bool:
    """Whether a relation holds of surfaces as they are, millimetres and radians."""
    return bool(np.all(np.abs(truth.constraint(relation).value) < _TRUE))


def _radius(surface: Surface) -> float:
    assert isinstance(surface, Cylinder)
    return surface.radius


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


SIGMAS_OF_PATTERN_STUDY = (0.02, 0.1, 0.5)
"""Noise, millimetres, of parts of 100 mm."""
_UP, _NONE = np.array([0.0, 0.0, 1.0]), 1e-7
_Part = Callable[[np.random.Generator, float], tuple[list[SurfaceFit], list[Relation]]]


@suite("patterns")
def patterns(first: int = 100, parts: int = 50) -> Iterator[str]:
    """Rows and mirrors of parts: true patterns found, false ones accepted or implied."""
    yield from head(
        "parts", "noise, mm", "rows", "mirrors", "false accepted", "in parts", "false implied", "CPU s"
    )
    seeds = range(first, first + parts)
    for name, make in (("at random", random_part), ("a row each", row_part), ("one mirror", mirror_part)):
        for sigma in SIGMAS_OF_PATTERN_STUDY:
            n_found, n_true = Counter[str](), Counter[str]()
            n_false, with_false, seconds = Counter[Status](), 0, 0.0
            for seed in seeds:
                truth = Estimate(make(np.random.default_rng(seed), _NONE)[0], None, np.zeros(3))
                fits, meant = make(np.random.default_rng(seed), sigma)
                start = time.process_time()
                found = [one for one in infer(fits).relations if one.kind in CHOSEN and one.holds]
                seconds += time.process_time() - start
                for one in meant:
                    n_true[one.kind] += 1
                    n_found[one.kind] += _is_found(one, found)
                false = [one for one in found if np.abs(truth.constraint(one).value).max() > _TRUE]
                n_false.update(one.status for one in false)
                with_false += any(one.status is Status.ACCEPTED for one in false)
            shares = " | ".join(f"{n_found[kind]} of {n_true[kind]}" for kind in CHOSEN)
            yield (
                f"| {name} | {sigma:g} | {shares} | {n_false[Status.ACCEPTED]} "
                f"| {with_false} of {len(seeds)} | {n_false[Status.IMPLIED]} | {seconds / len(seeds):.2f} |"
            )


def random_part(rng: np.random.Generator, sigma: float) -> tuple[list[SurfaceFit], list[Relation]]:
    """Six planes a direction, four inclined ones, and eight equal holes along z, all at random."""
    fits = []
    for axis in range(3):
        unit = np.eye(3)[axis]
        fits += [_plane(rng, unit, unit * place, sigma) for place in rng.uniform(-50, 50, 6)]
    for angle, place in zip(
        np.radians(rng.choice([30, 45, 60, 120], 4)), rng.uniform(-50, 50, 4), strict=True
    ):
        normal = np.array([np.cos(angle), 0.0, np.sin(angle)])
        fits.append(_plane(rng, normal, normal * place, sigma))
    fits += [_hole(rng, (x, y), 4.0, sigma) for x, y in rng.uniform(-50, 50, (8, 2))]
    return fits, []


def row_part(rng: np.random.Generator, sigma: float) -> tuple[list[SurfaceFit], list[Relation]]:
    """Six ribs and five holes, each at one pitch, between planes and holes at random."""
    pitch, thickness, begin = rng.uniform(10, 15), rng.uniform(2, 6), rng.uniform(-50, -40)
    unit = np.array([1.0, 0.0, 0.0])
    places = begin + pitch * np.arange(6)
    fits = [_plane(rng, unit, unit * place, sigma) for place in (*places, *(places + thickness))]
    step = np.array([rng.uniform(12, 16), rng.uniform(-5, 5)])
    first = np.array([rng.uniform(-40, -30), rng.uniform(-20, 20)])
    fits += [_hole(rng, tuple(first + k * step), 3.0, sigma) for k in range(5)]
    fits += [_plane(rng, _UP, _UP * place, sigma) for place in rng.uniform(-50, 50, 4)]
    fits += [_hole(rng, tuple(place), 3.0, sigma) for place in rng.uniform(-50, 50, (3, 2))]
    rows = [tuple(range(6)), tuple(range(6, 12)), tuple(range(12, 17))]
    return fits, [Relation(kind="regular", surfaces=row) for row in rows]


def mirror_part(rng: np.random.Generator, sigma: float) -> tuple[list[SurfaceFit], list[Relation]]:
    """Sides, slopes, a slot and two pairs of holes alike in one mirror, among planes and holes at random."""
    middle, fits, meant = rng.uniform(-5, 5), list[SurfaceFit](), list[Relation]()
    for half, angle in ((rng.uniform(40, 50), 0.0), (rng.uniform(10, 15), 0.0), (rng.uniform(25, 35), 60.0)):
        for side in (-1, 1):
            normal = np.array([side * np.cos(np.radians(angle)), 0.0, np.sin(np.radians(angle))])
            fits.append(_plane(rng, normal, np.array([middle + side * half, 0.0, 0.0]), sigma))
    for _ in range(2):
        half, along = rng.uniform(15, 40), rng.uniform(-45, 45)
        fits += [_hole(rng, (middle + side * half, along), 4.0, sigma) for side in (-1, 1)]
    meant = [Relation(kind="symmetric", surfaces=(0, 1, k, k + 1)) for k in range(2, 10, 2)]
    fits += [_plane(rng, np.eye(3)[axis], np.eye(3)[axis] * place, sigma)
             for axis in (1, 2) for place in rng.uniform(-50, 50, 4)]  # fmt: skip
    fits += [_hole(rng, tuple(place), 4.0, sigma) for place in rng.uniform(-50, 50, (3, 2))]
    return fits, meant


def _is_found(meant: Relation, found: list[Relation]) -> bool:
    """Whether a row is part of one that was found, or pairs are joined by mirrors that were found."""
    if meant.kind == "regular":
        return any(set(meant.surfaces) <= set(one.surfaces) for one in found if one.kind == "regular")
    joined = {frozenset(meant.surfaces[:2])}
    for _ in found:
        for one in found:
            pairs = {frozenset(one.surfaces[k : k + 2]) for k in range(0, len(one.surfaces), 2)}
            if one.kind == "symmetric" and pairs & joined:
                joined |= pairs
    return frozenset(meant.surfaces[2:]) in joined


def _plane(rng: np.random.Generator, normal: np.ndarray, centre: np.ndarray, sigma: float) -> SurfaceFit:
    along = np.cross(normal, [0.0, 1.0, 0.0] if abs(normal[1]) < 0.5 else [1.0, 0.0, 0.0])
    aside = np.cross(normal, along) * rng.uniform(-20, 20) + along * rng.uniform(-20, 20)
    unit = along / np.linalg.norm(along)
    return plane_fit(rng, tuple(centre + aside), tuple(normal), tuple(unit), (30, 20), sigma=sigma, n=400)


def _hole(rng: np.random.Generator, place: tuple[float, ...], radius: float, sigma: float) -> SurfaceFit:
    fit = axial_fit(rng, radius, 2 * np.pi, (0, 15), sigma=sigma, n=400)
    moved: Surface = fit.surface.transformed(Pose.from_parts(np.eye(3), np.array([*place, 0.0])))
    return replace(fit, surface=moved)
