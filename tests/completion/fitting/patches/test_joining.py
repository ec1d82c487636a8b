# SPDX-License-Identifier: MIT
"""Equations of joins: their derivatives, their independence, and the solution against a dense one."""

import numpy as np
import pytest
from scipy.linalg import null_space

from completion.fitting.patches.joins import (
    Boundary,
    JoinKind,
    check_boundaries,
    equations_of,
    join_equations,
)
from completion.fitting.patches.rounds import BorderedSystem, normal_equations, thin_plate
from completion.fitting.patches.spline import SplinePatch, basis
from scenes.checks import InputError
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere
from tests.helpers.patch_examples import BLEND, END, FLOOR, WALL

AXIS = (0, 0.1, 1)


@pytest.mark.parametrize(
    "surface",
    [
        Cylinder((0, 0, 0), AXIS, 2.0),
        Cylinder((0, 0, 0), AXIS, 2.0, concave=True),
        Plane((0, 0, 1), (1, 2, 3)),
    ],
)
@pytest.mark.parametrize("join", list(JoinKind))
def test_derivatives_are_those_of_differences(surface, join) -> None:
    rng, about, splines = np.random.default_rng(0), np.linspace(0, 1, 9), basis(9, 5)
    outer = np.column_stack([2 * np.cos(about), 2 * np.sin(about), about]) + 0.1 * rng.normal(size=(9, 3))
    inner = outer + 0.2 * rng.normal(size=(9, 3))
    boundary = Boundary(surface, join)
    equations = join_equations(boundary, outer, inner, splines)
    for _ in range(3):
        by = rng.normal(size=(2, 9, 3))
        after, before = (
            join_equations(boundary, outer + s * by[0], inner + s * by[1], splines).misfit
            for s in (1e-6, -1e-6)
        )
        slope = np.einsum("qjc,jc->q", equations.by_outer, by[0]) + np.einsum(
            "qjc,jc->q", equations.by_inner, by[1]
        )
        assert slope == pytest.approx((after - before) / 2e-6, abs=1e-7)


def test_redundant_equations_are_dropped_and_entailed_by_the_rest() -> None:
    patch = SplinePatch(np.random.default_rng(1).normal(size=(7, 8, 3)))
    every = equations_of(patch, BLEND)
    independent = every.independent()
    assert len(independent.rows) == np.linalg.matrix_rank(every.rows) < len(every.rows)
    moved = independent.impose(patch.controls.ravel())
    assert every.rows @ moved[every.columns] == pytest.approx(every.value, abs=1e-12)


def test_the_sparse_solution_is_the_dense_one() -> None:
    rng = np.random.default_rng(2)
    patch = SplinePatch(rng.normal(size=(6, 5, 3)))
    uv, points = rng.uniform(0, 1, (300, 2)), rng.normal(size=(300, 3))
    normals = rng.normal(size=(300, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    held = normal_equations(patch.bases, uv, points, normals)
    along_u, along_v = (splines.values(uv[:, k]) for k, splines in enumerate(patch.bases))
    value = np.einsum("ni,nj->nij", along_u, along_v).reshape(300, -1)
    wide = np.einsum("nk,nc->nkc", value, normals).reshape(300, -1)
    form = wide.T @ wide + 0.05**2 * np.kron(value.T @ value, np.eye(3))
    assert held.matrix.toarray() == pytest.approx(form, abs=1e-10)
    equations = equations_of(patch, BLEND).independent()
    matrix = held.matrix + 1e-3 * thin_plate(patch.bases)
    solution = BorderedSystem(matrix, equations).solve(held.right, equations.value)
    rows = np.zeros((len(equations.rows), 90))
    rows[:, equations.columns] = equations.rows
    free, start = null_space(rows), np.linalg.lstsq(rows, equations.value, rcond=None)[0]
    dense = matrix.toarray()
    best = start + free @ np.linalg.solve(free.T @ dense @ free, free.T @ (held.right - dense @ start))
    assert solution == pytest.approx(best, abs=1e-8)


def test_joins_that_exclude_each_other_are_refused() -> None:
    slope = Plane((0, 0, 0), (0, 1, 0.2))
    with pytest.raises(InputError, match=r"u0 \(tangent\) and v1 \(tangent\) exclude .* meet at 90 deg"):
        check_boundaries({"u0": Boundary(WALL, "tangent"), "v1": Boundary(END, "tangent")})
    with pytest.raises(InputError, match=r"square to the last digits"):
        check_boundaries({"u1": Boundary(FLOOR, "tangent"), "v0": Boundary(slope, "orthogonal")})
    check_boundaries({"u0": Boundary(FLOOR, "tangent"), "v0": Boundary(FLOOR, "tangent")})
    check_boundaries({"u1": Boundary(FLOOR, "tangent"), "v0": Boundary(slope, "connected")})
    with pytest.raises(InputError, match="has the boundaries u0, u1, v0, v1, not 'w0'"):
        check_boundaries({"w0": Boundary(FLOOR, "tangent")})
    with pytest.raises(InputError, match="joined to planes and cylinders, not to a sphere"):
        Boundary(Sphere((0, 0, 0), 1.0), "tangent")
    with pytest.raises(InputError, match="a join is one of connected, tangent, orthogonal, got 'smooth'"):
        Boundary(FLOOR, "smooth")
