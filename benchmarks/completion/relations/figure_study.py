# SPDX-License-Identifier: MIT
"""The part of figure 1, many times: how well R60 is known, wrong statements, starts; many surfaces."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.completion.relations.figure_one import (
    BASE,
    BORE,
    FRONT,
    SIDE,
    TOP,
    WIDE,
    figure_one,
    plane_fit,
)
from completion.fitting.quadrics import fit_by_quadric
from completion.fitting.result import SurfaceFit
from completion.relations.engine.estimate import Estimate
from completion.relations.engine.relation import Relation, Status
from completion.relations.pipeline import impose, infer
from scenes.checks import FloatArray
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


def part_table(n_parts: int) -> Iterator[str]:
    """Rows: rms error of R60 alone, related and as stated; what true and wrong relations came to."""
    truth = Estimate(figure_one(0, 1e-7), None, np.zeros(3))
    yield "| noise, mm | R60 alone | related | stated | free | true rejected | wrong accepted | CPU s |"
    yield "|---|---|---|---|---|---|---|---|"
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
    yield "| starts | fits that failed | first: elliptic quadric, sd | greatest difference, sd |"
    yield "|---|---|---|---|"
    yield f"| {n_starts} | {failed} | {off[0]:.2g} | {max(off):.2g} |"


def cost_table(sizes: tuple[int, ...] = (20, 100, 400)) -> Iterator[str]:
    """CPU seconds to infer the relations of many planes, and to impose twenty stated ones."""
    yield "| surfaces | accepted | CPU s | 20 stated, CPU s |"
    yield "|---|---|---|---|"
    for n in sizes:
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
