# SPDX-License-Identifier: MIT
"""Field of view: what a camera is said not to see, none of its rays meets."""

import numpy as np
import pytest

from completion.evidence.sight import Ball, Views, ball_around, sight_of
from completion.observe.observation import observe
from completion.observe.tolerance import EvidenceOptions
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage


def eye_of(projection, pose=None):
    scan = RangeImage(np.full(projection.shape, 2.0), projection, pose or Pose.identity(), sigma_m=0.001)
    return sight_of(observe(scan, Pose.identity()), EvidenceOptions().tolerance()).eye


@pytest.mark.parametrize("fy", [60.0, -60.0])
def test_no_ray_meets_a_ball_that_is_not_seen_and_most_others_are_met(fy):
    camera = PinholeProjection(64, 48, 60.0, fy, 20.0, 30.0)
    pose = Pose.looking_at([1.0, 2.0, 1.5], [2.0, 2.5, 1.2])
    eye, rng = eye_of(camera, pose), np.random.default_rng(0)
    rays = pose.rotate(camera.directions().reshape(-1, 3))
    n_said, n_met, n_reached, n_reaching = 0, 0, 0, 0
    views = Views.of([eye, eye], [2.0, -np.inf])
    for middle, radius in zip(rng.uniform(-4, 6, (400, 3)), rng.uniform(0.05, 2, 400), strict=True):
        away = middle - pose.translation
        along = np.maximum(rays @ away, 0.0)
        met = (np.linalg.norm(along[:, None] * rays - away, axis=1) <= radius).any()
        ball = Ball(tuple(middle), radius)
        reaching = met and np.linalg.norm(away) - radius < 2.0
        said, reached = (int(told(ball).sum()) for told in (views.may_see, views.may_reach))
        assert said >= 2 * met
        assert reached >= reaching
        assert reached <= said // 2
        n_said, n_met = n_said + said // 2, n_met + met
        n_reached, n_reaching = n_reached + reached, n_reaching + reaching
    assert n_met <= n_said <= 1.6 * n_met
    assert n_reaching <= n_reached <= 1.6 * n_reaching < n_met


def test_a_turning_scanner_may_see_all():
    angles = np.radians(np.linspace(-60, 60, 12)), np.radians(np.arange(0, 360, 10))
    eye = eye_of(SphericalProjection(elevations=angles[0], azimuths=angles[1]))
    views, ball = Views.of([eye, eye], [60.0, 40.0]), Ball((0.0, 0.0, -50.0), 0.1)
    assert views.may_see(ball).tolist() == [True, True]
    assert views.may_reach(ball).tolist() == [True, False]


def test_a_ball_holds_all_cells_to_their_corners():
    centres = np.random.default_rng(1).uniform(-1, 1, (50, 3))
    ball = ball_around(np.stack([centres.min(axis=0), centres.max(axis=0)]), np.array([0.1, 0.2]))
    distance = np.linalg.norm(centres - ball.middle, axis=1) + np.hypot(0.1, 0.2) / 2
    assert (distance <= ball.radius).all()
