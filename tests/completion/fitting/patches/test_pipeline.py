# SPDX-License-Identifier: MIT
"""Patches: exact joins, residuals near a free patch's, equivariance, deviations, free surfaces, refusals."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from completion import fit_patch, fit_plane
from completion.fitting.patches.joins import Boundary, JoinKind
from completion.fitting.result import FitError
from scenes.checks import InputError
from scenes.surfaces.catalogue import Plane
from tests.helpers.long_cases import first_in_gate
from tests.helpers.patch_examples import BLEND, COLLAR, FLOOR, TUBE, blend, collar

SIGMA = 0.1


@pytest.fixture(scope="module")
def blended():
    return fit_patch(blend(6000, SIGMA, 0), BLEND)


def test_planes_are_met_exactly_and_the_points_nearly_as_well_as_by_a_free_patch(blended) -> None:
    for side in BLEND:
        assert blended.joins[side].angle < 1e-12
        assert blended.joins[side].gap < 1e-12
    assert blended.ratio < 1.02
    assert blended.rms == pytest.approx(SIGMA, rel=4 / np.sqrt(2 * blended.n))
    assert blended.warnings == ()
    assert blended.n > 0.98 * 6000


@pytest.mark.long
def test_deviations_are_those_of_the_dense_formula_and_hold(blended) -> None:
    rng = np.random.default_rng(5)
    uv = rng.uniform(0.05, 0.95, (40, 2))
    truth = blend(40_000, 0.0, 9)
    other = fit_patch(blend(6000, SIGMA, 1), BLEND)
    off = []
    for patch_fit in (blended, other):
        at, normal = patch_fit.patch.at(uv), patch_fit.patch.normals(uv)
        near = truth[np.argmin(((at[:, None] - truth) ** 2).sum(axis=2), axis=1)]
        off.append(np.einsum("ij,ij->i", at - near, normal) / patch_fit.deviation(uv))
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.7  # errors of neighbours are alike
    assert blended.deviation(np.array([[0.0, 0.5]])) < 1e-9  # across the wall, which is exact
    with pytest.raises(InputError, match=r"parameters with shape \(k, 2\)"):
        blended.deviation(np.array([0.5, 2.0]))


@pytest.mark.long
def test_moved_and_enlarged_points_give_the_moved_patch(blended) -> None:
    turn, shift, factor = (
        Rotation.from_rotvec([0.3, -1.0, 0.7]).as_matrix(),
        np.array([40.0, -7.0, 3.0]),
        0.01,
    )
    moved = {
        side: replace(boundary, surface=Plane(factor * turn @ boundary.surface.point + shift,
                                         turn @ boundary.surface.normal_direction))
        for side, boundary in BLEND.items()
    }  # fmt: skip
    patch_fit = fit_patch(factor * blend(6000, SIGMA, 0) @ turn.T + shift, moved)
    assert patch_fit.rms == pytest.approx(factor * blended.rms, rel=1e-3)
    assert max(join.angle for join in patch_fit.joins.values()) < 1e-11
    uv = np.random.default_rng(0).uniform(0.1, 0.9, (50, 2))
    at = (patch_fit.patch.at(uv) - shift) @ turn / factor
    assert np.linalg.norm(at - blended.patch.at(uv), axis=1).max() < SIGMA


@pytest.mark.parametrize("join", first_in_gate(1, list(JoinKind)))
def test_a_cylinder_is_met_within_a_millionth(join) -> None:
    given = COLLAR if join is JoinKind.TANGENT else {"u0": Boundary(TUBE, join)}
    points = collar(4000, SIGMA, 1)
    if join is not JoinKind.TANGENT:  # a flange that leaves the tube at right angles
        rng = np.random.default_rng(0)
        about, reach = rng.uniform(0, 1, (2, 4000))
        radius = TUBE.radius + 30 * reach
        points = np.column_stack([radius * np.cos(about), radius * np.sin(about), 5 * np.sin(3 * about)])
        points[:, 2] += 4 * reach**2 + SIGMA * rng.normal(size=4000)
    patch_fit = fit_patch(points, given)
    assert patch_fit.ratio < 1.05
    assert patch_fit.joins["u0"].gap < 1e-6 * TUBE.radius
    assert (
        np.isnan(patch_fit.joins["u0"].angle)
        if join is JoinKind.CONNECTED
        else patch_fit.joins["u0"].angle < 1e-6
    )


@pytest.mark.long
def test_one_plane_all_round_a_bump() -> None:
    rng = np.random.default_rng(0)
    xy = rng.uniform(-1, 1, (4000, 2))
    height = 15 * ((1 - xy**2) ** 2).prod(axis=1)
    floor = Boundary(FLOOR, JoinKind.TANGENT)
    patch_fit = fit_patch(
        np.column_stack([80 * xy[:, 0], 50 * xy[:, 1], height + 0.05 * rng.normal(size=4000)]),
        dict.fromkeys(("u0", "u1", "v0", "v1"), floor),
    )
    assert max(join.angle for join in patch_fit.joins.values()) < 1e-12
    assert patch_fit.ratio < 1.05


@pytest.mark.long
def test_points_may_stop_short_of_a_surface_and_have_holes() -> None:
    points = blend(6000, SIGMA, 3)
    points = points[(points[:, 1] > 5) & (np.linalg.norm(points - points[0], axis=1) > 15)]
    patch_fit = fit_patch(points, BLEND)
    assert max(join.angle for join in patch_fit.joins.values()) < 1e-12
    assert patch_fit.patch.at(np.array([[0.5, 0.0]]))[0, 1] == pytest.approx(0.0, abs=1e-12)
    assert patch_fit.ratio < 1.05


@pytest.mark.long
def test_free_surfaces_come_nearer_to_the_truth_and_are_met_exactly() -> None:
    before, after = [], []
    for seed, off in enumerate(((0.012, 0.004, -0.01), (-0.009, 0.0, 0.011))):
        rng, given = np.random.default_rng(seed), {}
        turn = Rotation.from_rotvec(off).as_matrix()
        for side, boundary in BLEND.items():
            normal = boundary.surface.normal_direction
            moved = Plane(boundary.surface.point + rng.normal(0, 0.3) * normal, turn @ normal)
            given[side] = replace(
                boundary, surface=moved, deviations={"offset": 0.3, "normal": 0.01 * np.sqrt(2)}
            )
        patch_fit = fit_patch(blend(2500, SIGMA, seed), given, free=True)
        assert max(join.angle for join in patch_fit.joins.values()) < 1e-11
        assert patch_fit.ratio < 1.05
        for placed, kept in ((given, before), (patch_fit.boundaries, after)):
            axes = [placed[side].surface.normal_direction for side in ("u0", "v0", "u1")]
            kept.append(Rotation.from_matrix(np.column_stack(axes)).as_rotvec())
    gain = np.mean(np.square(after), axis=0) / np.mean(np.square(before), axis=0)
    assert (gain[[0, 2]] < 0.25).all()  # about the blend's own axis a patch tells next to nothing


@pytest.mark.long
def test_a_fit_of_a_plane_is_what_free_surfaces_need() -> None:
    rng = np.random.default_rng(0)
    wall = fit_plane(np.column_stack([rng.normal(0, SIGMA, 300), rng.uniform(0, 100, (300, 2))]))
    known = Boundary(wall.surface, JoinKind.TANGENT, wall.parameter_deviations())
    patch_fit = fit_patch(blend(2000, SIGMA, 0), {"u0": known}, free=True)
    assert abs(patch_fit.boundaries["u0"].surface.normal_direction[0]) == pytest.approx(1.0, abs=1e-5)
    with pytest.raises(
        InputError, match="u0: a free surface needs to be known by its standard deviations offset"
    ):
        fit_patch(blend(2000, SIGMA, 0), {"u0": replace(known, deviations={})}, free=True)


def test_a_wrong_surface_is_said() -> None:
    moved = {"u0": Boundary(Plane((-5, 0, 0), (1, 0, 0)), JoinKind.TANGENT)}
    patch_fit = fit_patch(blend(2000, SIGMA, 0), moved, controls=(6, 6))
    assert any("times that of a patch joined to nothing" in warning for warning in patch_fit.warnings)
    cut = {"v0": Boundary(Plane((0, 20, 0), (0, 1, 0)), JoinKind.ORTHOGONAL)}
    warnings = fit_patch(blend(2000, SIGMA, 0), cut, controls=(6, 6)).warnings
    assert re.match(r"\d+ % of the points lie beyond the boundaries", warnings[0])
    assert "the patch is folded" in warnings[1]
    with pytest.raises(FitError, match=r"u0: where the points end next to its plane they are .* from it"):
        fit_patch(blend(500, SIGMA, 0), {"u0": Boundary(Plane((9000, 0, 0), (1, 0, 0)), JoinKind.TANGENT)})


def test_points_that_bear_no_patch_are_refused() -> None:
    line = np.linspace(0, 1, 50)[:, None] * np.ones(3)
    for points, text in ((line[:10], "10 points bear no patch"), (line, "lie on one line or in one spot")):
        with pytest.raises(FitError, match=text):
            fit_patch(points, BLEND)
    with pytest.raises(InputError, match=r"3 controls along u: from 4 \(degree 3\) to 64 are possible"):
        fit_patch(blend(500, SIGMA, 0), BLEND, controls=(3, 10))
    with pytest.raises(InputError, match="not finite"):
        fit_patch(np.full((50, 3), np.nan), BLEND)


@pytest.mark.long
def test_the_same_points_give_the_same_bytes(blended) -> None:
    assert (
        fit_patch(blend(6000, SIGMA, 0), BLEND).patch.controls.tobytes() == blended.patch.controls.tobytes()
    )
