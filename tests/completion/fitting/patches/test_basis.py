# SPDX-License-Identifier: MIT
"""Bases and patches against scipy's B-splines and finite differences."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from completion.fitting.patches.spline import SplinePatch, basis, side_places, side_rows
from scenes.checks import InputError


@pytest.mark.parametrize(("n", "degree"), [(4, 3), (9, 3), (6, 5), (12, 5)])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_values_are_those_of_scipy(n, degree, order) -> None:
    splines, at = basis(n, degree), np.linspace(0, 1, 43)
    oracle = np.array([BSpline(splines.knots, row, degree)(at, nu=order) for row in np.eye(n)]).T
    assert splines.values(at, order) == pytest.approx(oracle, abs=1e-11 * n**order)


def test_gram_is_the_integral() -> None:
    splines, at = basis(7, 3), (np.arange(20_000) + 0.5) / 20_000
    bent = splines.values(at, 2)
    assert splines.gram(2) == pytest.approx(bent.T @ bent / len(at), rel=1e-4, abs=1e-2)


def test_a_patch_has_points_derivatives_and_sides() -> None:
    controls = np.random.default_rng(0).normal(size=(6, 7, 3))
    patch = SplinePatch(controls, (3, 5))
    along_u, along_v = (basis_of.values(np.array([0.3]))[0] for basis_of in patch.bases)
    uv, step = np.array([[0.3, 0.3]]), np.array([[1e-6, 0.0]])
    assert patch.at(uv)[0] == pytest.approx(np.einsum("i,j,ijk->k", along_u, along_v, controls))
    slope = (patch.at(uv + step) - patch.at(uv - step)) / 2e-6
    assert patch.at(uv, (1, 0)) == pytest.approx(slope, abs=1e-7)
    ends = patch.at(side_places("v1", np.array([0.0, 1.0])))
    assert ends == pytest.approx(controls[[0, -1], -1])
    outer, inner = side_rows("v1", 6, 7)
    assert controls.reshape(-1, 3)[outer] == pytest.approx(controls[:, -1])
    assert controls.reshape(-1, 3)[inner] == pytest.approx(controls[:, -2])


def test_too_few_controls_are_refused() -> None:
    with pytest.raises(InputError, match="3 controls are too few along a side of degree 3; at least 4"):
        SplinePatch(np.zeros((3, 4, 3)))
    with pytest.raises(InputError, match=r"shape \(n, m, 3\), got \(4, 4\)"):
        SplinePatch(np.zeros((4, 4)))
