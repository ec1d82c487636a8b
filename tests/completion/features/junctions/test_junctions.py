# SPDX-License-Identifier: MIT
"""Junctions and elbows: as exact as predicted, held where given, refused where there is none."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.cases.junctions import elbow, junction, plain
from completion.features.engine.template import FeatureStatus, Measurements, SideState
from completion.features.junctions import pipeline
from completion.features.junctions.elbows import fit_elbow
from completion.features.junctions.pipeline import JunctionCandidate, find_junctions
from completion.features.junctions.tangent import fit_junction
from scenes.checks import InputError
from tests.helpers.long_cases import first_in_gate

SPACING = 3.0


def fitted(points, given=None, sigma=0.3):
    return fit_junction(Measurements(points, sigma, SPACING), given or {})


@pytest.mark.parametrize(
    ("radii", "is_s_shaped"),
    first_in_gate(1, [((25.0, 40.0), True), ((25.0, 40.0), False), ((25.0, np.inf), True)]),
)
def test_a_junction_is_as_exact_as_predicted(radii, is_s_shaped):
    rng = np.random.default_rng(11)
    truth = junction(rng, 0.3, 0.1, radii=radii, is_s_shaped=is_s_shaped, n=800)
    fit = fitted(truth.points)
    assert fit.status is FeatureStatus.FOUND
    assert np.isinf(fit.value("radius_2")) == np.isinf(radii[1])
    assert abs(fit.value("radius_1") - 25) < 4 * fit.deviation("radius_1")
    if np.isfinite(radii[1]):
        assert fit.geometry["is_s_shaped"] is is_s_shaped
        assert abs(fit.value("radius_2") - 40) < 4 * fit.deviation("radius_2")
    off = fit.x[2:5] - truth.joint
    off = off - (off @ truth.axis) * truth.axis
    assert np.linalg.norm(off) < 4 * np.sqrt(np.trace(fit.covariance[2:5, 2:5]))
    assert abs(fit.x[5:] @ truth.axis) > 0.9999
    assert np.mean(fit.assignment > 0) == pytest.approx(0.9, abs=0.05)


@pytest.mark.long
def test_it_moves_turns_and_grows_with_its_points():
    truth = junction(np.random.default_rng(12), 0.3, 0.0, n=600)
    base = fitted(truth.points)
    turn = Rotation.from_rotvec([0.4, 1.0, -0.3]).as_matrix()
    moved = fit_junction(Measurements(7 * truth.points @ turn.T + [5, 6, 7], 2.1, 7 * SPACING), {})
    np.testing.assert_allclose(moved.x[:2], 7 * base.x[:2], rtol=1e-4)
    np.testing.assert_allclose(moved.x[2:5], 7 * turn @ base.x[2:5] + [5, 6, 7], atol=0.05)
    assert abs(moved.x[5:] @ turn @ base.x[5:]) == pytest.approx(1, abs=1e-6)
    assert moved.evidence == pytest.approx(base.evidence, rel=0.15)  # cells of neighbours lie otherwise


def test_what_is_given_is_held_exactly():
    truth = junction(np.random.default_rng(13), 0.5, 0.1, n=600)
    held = fitted(truth.points, {"radius_1": 40.0})
    assert held.value("radius_1") == pytest.approx(40.0, rel=1e-12)
    assert held.deviation("radius_1") == 0
    assert held.value("radius_2") == pytest.approx(25.0, abs=1.0)
    assert 0 < held.deviation("radius_2") < 1.0


@pytest.mark.long
def test_equal_radii_are_one_cylinder_whose_joint_is_unseen():
    truth = junction(np.random.default_rng(14), 0.3, 0.0, radii=(30.0, 30.0), is_s_shaped=False, n=900)
    fit = fitted(truth.points)
    assert fit.status is FeatureStatus.NONE
    assert "cylinder" in fit.reason
    joint = next(side for side in fit.sides if side.name == "joint")
    assert joint.deviation > 2.0 or joint.state is SideState.UNSEEN


@pytest.mark.parametrize("kind", first_in_gate(1, ["cylinder", "edge"]))
def test_plain_surfaces_are_refused_with_a_reason(kind):
    fit = fitted(plain(kind, np.random.default_rng(15), 0.3, 0.1, n=500).points)
    assert fit.status is not FeatureStatus.FOUND
    assert fit.reason


@pytest.mark.long
def test_hiding_a_side_raises_its_deviation_and_never_evidence():
    truth = junction(np.random.default_rng(16), 0.3, 0.0, n=900)
    whole = fitted(truth.points)
    kept = np.ones(900, dtype=bool)
    second = np.flatnonzero(whole.assignment == 2)
    kept[second[: len(second) * 2 // 3]] = False
    part = fitted(truth.points[kept])
    assert part.deviation("radius_2") > whole.deviation("radius_2")
    assert part.evidence < whole.evidence


@pytest.mark.long
@pytest.mark.parametrize("seed", [103, 104])
def test_among_many_outliers_a_short_arc_at_the_end_is_not_taken_for_a_side(seed):
    truth = junction(np.random.default_rng(seed), 1.0, 0.3, is_s_shaped=False)
    fit = find_junctions(Measurements(truth.points, 1.0, 1.5), ["junction"], rng=np.random.default_rng(0))[0]
    assert fit.status is FeatureStatus.AMBIGUOUS or abs(fit.value("radius_1") - 25) < 5
    assert abs(fit.value("radius_1") - 25) < 5 or "nearly as likely" in fit.reason


@pytest.mark.long
def test_a_folded_edge_does_not_explain_a_fillet_among_outliers():
    truth = junction(np.random.default_rng(106), 1.0, 0.3, radii=(25.0, np.inf))
    fit = fit_junction(Measurements(truth.points, 1.0, 1.5), {})
    assert fit.status is FeatureStatus.FOUND, fit.reason
    assert abs(fit.value("radius_1") - 25) < 4 * fit.deviation("radius_1")


@pytest.mark.long
def test_an_elbow_is_measured_from_one_side():
    truth = elbow(np.random.default_rng(17), 0.3, 0.1, n=1000)
    fit = fit_elbow(Measurements(truth.points, 0.3, SPACING), {})
    assert fit.status is FeatureStatus.FOUND
    for name, true in (("angle", truth.angle), ("bend_radius", 75.0), ("tube_radius", 25.0)):
        assert abs(fit.value(name) - true) < 4 * fit.deviation(name)
    np.testing.assert_allclose(fit.x[3:6], truth.joint, atol=1.0)
    assert abs(fit.x[6:] @ truth.axis) > 0.9995
    held = fit_elbow(Measurements(truth.points, 0.3, SPACING), {"tube_radius": 25.0, "angle": np.pi / 2})
    assert held.value("tube_radius") == pytest.approx(25.0, rel=1e-12)
    assert held.deviation("angle") == 0
    assert held.deviation("bend_radius") < fit.deviation("bend_radius")


@pytest.mark.long
def test_a_straight_pipe_is_no_elbow():
    fit = fit_elbow(
        Measurements(plain("cylinder", np.random.default_rng(18), 0.3, 0.0, n=900).points, 0.3, 3.0), {}
    )
    assert fit.status is not FeatureStatus.FOUND


@pytest.mark.long
def test_every_fillet_of_a_part_is_found():
    """A floor and two walls, the corners between them rounded by 6 and 9."""
    rng = np.random.default_rng(19)
    profile = []
    for length, start, way in (
        (40.0, (6.0, 0.0), (1.0, 0.0)),
        (40.0, (0.0, 46.0), (0.0, -1.0)),
        (35.0, (55.0, 9.0), (0.0, 1.0)),
    ):
        t = rng.uniform(0, length, 350)[:, None]
        profile.append(np.array(start) + t * np.array(way))
    for radius, middle, first in ((6.0, (6.0, 6.0), np.pi), (9.0, (46.0, 9.0), 1.5 * np.pi)):
        t = first + rng.uniform(0, np.pi / 2, 160)
        profile.append(np.array(middle) + radius * np.column_stack([np.cos(t), np.sin(t)]))
    flat = np.concatenate(profile)
    points = np.column_stack([flat, rng.uniform(0, 30, len(flat))]) + rng.normal(0, 0.03, (len(flat), 3))
    fits = find_junctions(Measurements(points, 0.03, 1.6), ["junction"], rng=rng)
    radii = sorted(
        round(float(fit.value("radius_1")), 1) for fit in fits if fit.status is FeatureStatus.FOUND
    )
    assert set(np.round(radii)) == {6.0, 9.0}
    assert all(np.isinf(fit.value("radius_2")) for fit in fits)


@pytest.mark.long
def test_candidates_that_the_budget_leaves_are_said(monkeypatch):
    points = plain("plane", np.random.default_rng(20), 0.3, 0.0, n=100).points
    left = JunctionCandidate("junction", np.arange(50), 1.0)
    monkeypatch.setitem(pipeline._CANDIDATES, "junction", lambda _cloud, _patches: [left])
    for budget, is_complete in ((1, False), (100_000, True)):
        fits = find_junctions(
            Measurements(points, 0.3, 8.0), ["junction"], rng=np.random.default_rng(0), budget=budget
        )
        assert [fit.is_complete for fit in fits] == [is_complete]


def test_what_cannot_be_is_refused():
    measured = Measurements(np.zeros((40, 3)), 0.1, 1.0)
    with pytest.raises(InputError, match="no junction weld"):
        find_junctions(measured, ["weld"], rng=np.random.default_rng(0))
    with pytest.raises(InputError, match="above 0"):
        find_junctions(measured, ["junction"], {"radius_1": -2.0}, rng=np.random.default_rng(0))
    few = find_junctions(
        Measurements(np.eye(3), 0.1, 1.0), ["elbow", "junction"], rng=np.random.default_rng(0)
    )
    assert all(fit.status is FeatureStatus.NONE and "too few" in fit.reason for fit in few)
