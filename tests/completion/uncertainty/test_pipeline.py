# SPDX-License-Identifier: MIT
"""Covariances hold where neighbouring pixels err alike, and are those of the noise where they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import observe
from completion.observe.pixel_set import PixelSet, ScanPixels
from completion.observe.refits.refitting import refit_each
from completion.uncertainty.pipeline import state_fits
from completion.uncertainty.residual_modes import ResidualModes, find_modes, pooled_bend
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane

CAMERA = PinholeProjection.from_fov(120, 90, 60)
SIGMA = 0.002
CORNER = (
    Plane(np.array([-0.8, 0, 3.0]), np.array([0.6, 0, -0.8])),
    Plane(np.array([0.8, 0, 3.0]), np.array([-0.6, 0, -0.8])),
    Plane(np.array([0.0, 0.7, 2.0]), np.array([0.0, -1.0, 0.0])),
)


def corner_seen(seed: int, bend_m: float = 0.0) -> tuple[list[MergedSurface], list]:
    """Three planes before a camera, each fitted to its own pixels, with noise and a smooth error."""
    rng = np.random.default_rng(seed)
    rays = CAMERA.directions().reshape(-1, 3)
    every = np.stack([one.ray_ranges(np.zeros(3), rays) for one in CORNER])
    every = np.where(np.isfinite(every) & (every > 0), every, np.inf)
    which = np.argmin(every, axis=0)
    ranges = np.min(every, axis=0) + SIGMA * rng.normal(size=len(rays))
    rows, columns = CAMERA.shape
    y, x = np.mgrid[-1 : 1 : rows * 1j, -1 : 1 : columns * 1j]
    shapes = np.stack([x, y, x * y, x * x - 1 / 3, y * y - 1 / 3, x**3 - 0.6 * x, y**3 - 0.6 * y])
    field = np.tensordot(rng.normal(size=len(shapes)), shapes, axes=1)
    ranges += bend_m * (field / np.sqrt(np.mean(field**2))).ravel()
    scan = RangeImage(ranges.reshape(CAMERA.shape), CAMERA, Pose.identity(), sigma_m=SIGMA)
    seen = observe(scan, Pose.identity())
    pixels = [ScanPixels.of([PixelSet.of((which == k).reshape(CAMERA.shape))]) for k in range(3)]
    fits = refit_each(CORNER, [seen], pixels, 0.0, n_rounds=2)
    return [MergedSurface(fit, own, 1) for fit, own in zip(fits, pixels, strict=True)], [seen]


def misfits(seeds: range, bend_m: float) -> np.ndarray:
    """How far normals are from true ones, in the deviations stated of them: two slopes a surface."""
    found = []
    for seed in seeds:
        surfaces, seen = corner_seen(seed, bend_m)
        for stated, true in zip(state_fits(surfaces, seen, 0.0), CORNER, strict=True):
            plane = stated.fit.surface
            across = np.stack([plane.u_direction, plane.v_direction])
            slopes = -across @ (true.normal_direction / (true.normal_direction @ plane.normal_direction))
            found.extend(slopes / np.sqrt(np.diag(stated.fit.covariance)[1:]))
    return np.array(found)


def test_noise_alone_is_stated_as_it_is():
    z = misfits(range(12), 0.0)
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.25


def test_smooth_errors_are_stated_though_no_block_shows_them():
    bent = misfits(range(12), 0.004)
    assert 0.25 < np.sqrt(np.mean(bent**2)) < 1.5
    surfaces, seen = corner_seen(0, 0.004)
    before, after = surfaces[0].fit, state_fits(surfaces, seen, 0.0)[0]
    assert after.fit.covariance[1, 1] > 4 * before.covariance[1, 1]
    assert after.freedom == pytest.approx(9.0, rel=0.3)
    assert after.total.covariance[1, 1] == pytest.approx(after.fit.covariance[1, 1])  # no known sensor


def test_relief_that_says_more_stays():
    surfaces, seen = corner_seen(1)
    uneven = replace(surfaces[0].fit, covariance=surfaces[0].fit.covariance * 1e6)
    stated = state_fits([replace(surfaces[0], fit=uneven)], seen, 0.0)[0]
    assert stated.fit is uneven
    assert stated.freedom == np.inf


def test_one_bad_surface_does_not_speak_for_a_scan():
    good = [ResidualModes(np.full(3, 2.0), 1.0, 3000, np.eye(3)) for _ in range(8)]
    bad = ResidualModes(np.full(3, 200.0), 1.0, 3000, np.eye(3))
    assert pooled_bend([]) == 0.0
    assert pooled_bend(good) == pytest.approx(good[0].bend, rel=0.05)
    assert pooled_bend([*good, bad]) < 2.5 * good[0].bend


def test_cylinders_have_modes_and_what_tells_none_has_none():
    post = Cylinder(np.array([0.0, 0, 2.0]), np.array([0, 1.0, 0]), 0.4)
    rays = CAMERA.directions().reshape(-1, 3)
    ranges = post.ray_ranges(np.zeros(3), rays)
    ranges = np.where(
        np.isfinite(ranges), ranges + SIGMA * np.random.default_rng(0).normal(size=len(rays)), np.inf
    )
    scan = RangeImage(ranges.reshape(CAMERA.shape), CAMERA, Pose.identity(), sigma_m=SIGMA)
    seen = observe(scan, Pose.identity())
    pixels = np.flatnonzero(np.isfinite(ranges))
    own = ScanPixels.of([PixelSet.of(np.isfinite(scan.ranges))])
    (fit,) = refit_each([post], [seen], [own], 0.0)
    modes = find_modes(fit, seen, pixels, 0.0)
    assert modes.information.shape == (5, 5)
    assert modes.square == pytest.approx(1.0, rel=0.1)
    assert np.square(modes.beyond).max() < 16
    assert find_modes(fit, seen, pixels[:7], 0.0) is None


def test_rigid_motion_and_order_change_nothing():
    surfaces, seen = corner_seen(2, 0.002)
    forward = state_fits(surfaces, seen, 0.0)
    backward = state_fits(surfaces[::-1], seen, 0.0)[::-1]
    for one, two in zip(forward, backward, strict=True):
        np.testing.assert_allclose(one.fit.covariance, two.fit.covariance, rtol=1e-12)
