# SPDX-License-Identifier: MIT
"""Relations of parts: figure 1 of Fisher (2004), rows and mirrors."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from benchmarks.cases.planes import axial_fit, plane_fit
from benchmarks.run import head, suite
from completion.fitting.result import SurfaceFit
from completion.relations.estimate import JointEstimate
from completion.relations.evidence import CHOSEN
from completion.relations.pipeline import infer
from completion.relations.relation import Relation, RelationStatus
from scenes.pose import Pose
from scenes.surfaces.catalogue import Surface

_TRUE = 1e-4  # mm and radians, within which a relation holds of the part as it is


def is_true(relation: Relation, truth: JointEstimate) -> bool:
    """Whether a relation holds of surfaces as they are, millimetres and radians."""
    return bool(np.all(np.abs(truth.constraint(relation).value) < _TRUE))


SIGMAS = (0.02, 0.1, 0.5)
"""Noise, millimetres, of parts of 100 mm."""
_UP, _NONE = np.array([0.0, 0.0, 1.0]), 1e-7
_Part = Callable[[np.random.Generator, float], tuple[list[SurfaceFit], list[Relation]]]


@suite("patterns", smallest="--parts 1")
def patterns(first: int = 100, parts: int = 50) -> Iterator[str]:
    """Rows and mirrors of parts: true patterns found, false ones accepted or implied."""
    yield from head(
        "parts", "noise, mm", "rows", "mirrors", "false accepted", "in parts", "false implied", "CPU s"
    )
    seeds = range(first, first + parts)
    for name, make in (("at random", random_part), ("a row each", row_part), ("one mirror", mirror_part)):
        for sigma in SIGMAS:
            n_found, n_true = Counter[str](), Counter[str]()
            n_false, with_false, seconds = Counter[RelationStatus](), 0, 0.0
            for seed in seeds:
                truth = JointEstimate(make(np.random.default_rng(seed), _NONE)[0], None, np.zeros(3))
                fits, meant = make(np.random.default_rng(seed), sigma)
                start = time.process_time()
                found = [one for one in infer(fits).relations if one.kind in CHOSEN and one.holds]
                seconds += time.process_time() - start
                for one in meant:
                    n_true[one.kind] += 1
                    n_found[one.kind] += _is_found(one, found)
                false = [one for one in found if np.abs(truth.constraint(one).value).max() > _TRUE]
                n_false.update(one.status for one in false)
                with_false += any(one.status is RelationStatus.ACCEPTED for one in false)
            shares = " | ".join(f"{n_found[kind]} of {n_true[kind]}" for kind in CHOSEN)
            yield (
                f"| {name} | {sigma:g} | {shares} | {n_false[RelationStatus.ACCEPTED]} "
                f"| {with_false} of {len(seeds)} | {n_false[RelationStatus.IMPLIED]} "
                f"| {seconds / len(seeds):.2f} |"
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
    moved: Surface = fit.surface.transform(Pose.from_parts(np.eye(3), np.array([*place, 0.0])))
    return replace(fit, surface=moved)
