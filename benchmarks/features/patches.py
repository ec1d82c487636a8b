# SPDX-License-Identifier: MIT
"""`python -m benchmarks.features patches`: joins, residuals, deviations and time of free-form patches."""

from __future__ import annotations

import time
from typing import Annotated

import numpy as np
import typer

from benchmarks.features.patch_cases import END, FLOOR, KINDS, WALL, PatchCase, case_of
from completion.fitting.euclidean import fit_plane
from completion.fitting.patches.joins import Boundary, Join
from completion.fitting.patches.pipeline import PatchFit, fit_patch
from completion.fitting.patches.rounds import feet_of
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane

SIGMAS = (0.02, 0.1, 0.5)
_TOLD = 400  # points at which error and deviation are compared


def patches(
    first: Annotated[int, typer.Option("--first")] = 1000,
    seeds: Annotated[int, typer.Option("--seeds")] = 10,
    points: Annotated[int, typer.Option("--points")] = 20_000,
) -> None:
    """Free-form patches between planes and cylinders."""
    print("| patch, noise mm | plane angle, rad | cylinder angle, rad | gap, mm | ratio, median (most) "
          "| error, mm | z | doubts |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for kind in KINDS:
        for sigma in SIGMAS:
            cases = [case_of(kind, seed, sigma, points) for seed in range(first, first + seeds)]
            print(f"| {kind}, {sigma:g} | {_row(cases)} |", flush=True)
    print()
    for n, controls in ((20_000, 10), (100_000, 20)):
        case = case_of("blend", first, 0.1, n)
        start = time.process_time()
        found = fit_patch(case.points, case.boundaries, controls=(controls, controls))  # type: ignore[arg-type]
        spent = time.process_time() - start
        print(f"{n} points, {controls} x {controls}: {spent:.1f} s of the processor, ratio {found.ratio:.4f}")
    print()
    print("| noise, mm | planes fitted alone, deg | made square | with the patch | ratio | angle, rad |")
    print("|---|---|---|---|---|---|")
    for sigma in SIGMAS[1:]:
        print(f"| {sigma:g} | {_free_row(sigma, range(first, first + seeds))} |", flush=True)


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
