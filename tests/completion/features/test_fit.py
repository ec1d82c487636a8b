# SPDX-License-Identifier: MIT
"""Fits of templates: a wedge of two faces found as its noise allows, refused where a plane does as well."""

import numpy as np
import pytest

from completion.features.engine.search import Gate
from completion.features.engine.template import FeatureStatus, Measurements, PixelBeams, SideState
from completion.features.engine.template_fit import fit_template
from scenes.checks import InputError

SIGMA = 0.004


class Wedge:
    """Two planes through the y axis: their ridge, and how each rises."""

    kind, names, faces = "wedge", ("ridge", "height", "left", "right"), ("left", "right")

    def __init__(self, shift=0.0):
        self.shift = shift

    def bounds(self, _measured):
        low, high = np.array([-0.5, -0.5, 0.0, 0.0]), np.array([0.5, 0.5, 1.5, 1.5])
        return low + [self.shift, 0, 0, 0], high + [self.shift, 0, 0, 0]

    def distance(self, points, x):
        ridge, height, left, right = x
        along, up = points[:, 0] - ridge, points[:, 2] - height
        on_left = np.cos(left) * up - np.sin(left) * along  # falls to the left
        on_right = np.cos(right) * up + np.sin(right) * along
        below = np.maximum(on_left, on_right)
        return below, np.where(on_left >= on_right, 1, 2)


TRUTH = np.array([0.1, 0.2, 0.5, 0.8])


def wedge_points(seed, n=1500, outliers=0.0, halves=(1, 2)):
    rng = np.random.default_rng(seed)
    along, across = rng.uniform(-1, 1, (2, n))
    if halves == (1,):
        along = -np.abs(along)
    up = np.where(along < 0, np.tan(TRUTH[2]), -np.tan(TRUTH[3])) * along
    points = np.column_stack([TRUTH[0] + along, across, TRUTH[1] + up]) + rng.normal(0, SIGMA, (n, 3))
    wrong = rng.uniform(size=n) < outliers
    points[wrong] = rng.uniform(points.min(axis=0), points.max(axis=0), (wrong.sum(), 3))
    return points


def fitted(points, given=None, template=None, seed=0, beams=None, **options):
    measured = Measurements(points, SIGMA, 0.05, beams=beams)
    rng = np.random.default_rng(seed)
    return fit_template(
        template or Wedge(), measured, given or {}, rng=rng, **{"budget": 8000, "starts": None} | options
    )


def test_it_is_found_among_outliers_and_its_deviations_hold():
    errors = []
    for seed in range(6):
        fit = fitted(wedge_points(seed, outliers=0.2), seed=seed)
        assert fit.status is FeatureStatus.FOUND
        assert fit.is_complete
        errors.append((fit.x - TRUTH) / np.sqrt(np.diag(fit.covariance)))
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) < 1.6
    assert fit.unseen == ()
    assert set(np.unique(fit.assignment)) == {0, 1, 2}


def test_what_is_given_is_held_and_what_is_equal_is_one():
    held = fitted(wedge_points(0), {"left": 0.5})
    assert held.value("left") == 0.5
    assert held.deviation("left") == 0
    assert held.held == ("left",)
    fit = fitted(wedge_points(0), equal=[("left", "right")])
    assert fit.value("left") == fit.value("right")


def test_all_given_is_judged_without_a_search():
    fit = fitted(wedge_points(0), dict(zip(Wedge.names, TRUTH, strict=True)))
    assert fit.status is FeatureStatus.FOUND
    np.testing.assert_array_equal(fit.covariance, 0)


def test_it_moves_with_its_points_and_grows_with_them():
    base = fitted(wedge_points(0))
    moved = fitted(wedge_points(0) + [3.0, 1.0, 0.0], template=Wedge(3.0))
    np.testing.assert_allclose(moved.x - [3.0, 0, 0, 0], base.x, atol=1e-5)


def test_a_plane_is_no_wedge():
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.uniform(-1, 1, (800, 2)), rng.normal(0, SIGMA, 800)])
    fit = fitted(flat)
    assert fit.status is not FeatureStatus.FOUND
    assert "plane" in fit.reason


def test_a_face_without_points_is_unseen_and_what_it_bounds_is_open():
    fit = fitted(wedge_points(2, halves=(1,)))
    assert fit.status is not FeatureStatus.FOUND
    assert "right" in fit.unseen or "left" in fit.unseen


def test_hiding_a_face_raises_its_deviation_and_lowers_evidence():
    points = wedge_points(3)
    whole = fitted(points)
    part = fitted(points[(points[:, 0] < 0.1) | (points[:, 0] < 0.35)])
    assert part.deviation("right") > whole.deviation("right")
    assert part.evidence < whole.evidence


def test_beams_through_a_face_contradict_it():
    points = wedge_points(4)
    seen = points[points[:, 0] < 0.1]
    x = np.random.default_rng(4).uniform([0.3, -1], [0.9, 1], (400, 2))
    origins = np.column_stack([x, np.full(400, 2.0)])
    down = np.tile([0.0, 0.0, -1.0], (400, 1))
    beams = PixelBeams(origins, down, np.full(400, 5.0))
    fit = fitted(seen, dict(zip(Wedge.names, TRUTH, strict=True)), beams=beams)
    states = {side.name: side.state for side in fit.sides}
    assert states == {"left": SideState.CONFIRMED, "right": SideState.CONTRADICTED}


def test_a_budget_that_ends_it_is_said_and_never_overspent():
    short = fitted(wedge_points(0), budget=120)
    assert not short.is_complete
    assert short.evaluations <= 120 + 2 * 4 + 2
    assert fitted(wedge_points(0)).is_complete


def test_gates_are_obeyed_or_the_fit_is_refused():
    tied = fitted(wedge_points(0), gates=[Gate(lambda x: x[2] - x[3], 0.02)])
    assert abs(tied.value("left") - tied.value("right")) <= 0.02 + 1e-9
    never = fitted(wedge_points(0), gates=[Gate(lambda x: x[0] - 9.0, 0.02)])
    assert never.status is FeatureStatus.NONE
    assert "constraints" in never.reason


def test_the_same_seed_gives_the_same_bytes():
    first, second = (fitted(wedge_points(5, outliers=0.1)) for _ in range(2))
    assert first.x.tobytes() == second.x.tobytes()
    assert first.covariance.tobytes() == second.covariance.tobytes()


def test_an_interrupt_gives_the_best_so_far():
    class Interrupted(Wedge):
        calls = 0

        def distance(self, points, x):
            self.calls += 1
            if self.calls == 400:
                raise KeyboardInterrupt
            return super().distance(points, x)

    fit = fitted(wedge_points(0), template=Interrupted())
    assert not fit.is_complete
    assert fit.evidence > 0


def test_too_few_points_are_refused():
    with pytest.raises(InputError, match="needs 8 points"):
        fitted(np.zeros((5, 3)))
