# SPDX-License-Identifier: MIT
"""Covariances hold where neighbouring pixels err alike, and are those of the noise where they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import PixelSet, ScanPixels, observe
from completion.observe.refitting import refit_each
from completion.uncertainty.pipeline import LENGTHS, ResidualModes, bumps, find_modes, fit_field, state_fits
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
        stated = state_fits(surfaces, seen, 0.0)
        for number, true in enumerate(CORNER):
            fit = stated.total(number)
            plane = fit.surface
            across = np.stack([plane.u_direction, plane.v_direction])
            slopes = -across @ (true.normal_direction / (true.normal_direction @ plane.normal_direction))
            found.extend(slopes / np.sqrt(np.diag(fit.covariance)[1:]))
    return np.array(found)


def test_noise_alone_is_stated_as_it_is():
    z = misfits(range(12), 0.0)
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.25


def test_smooth_errors_are_stated_though_no_block_shows_them():
    bent = misfits(range(12), 0.004)
    assert 0.25 < np.sqrt(np.mean(bent**2)) < 2.0  # three surfaces tell little of a bend over the image
    surfaces, seen = corner_seen(0, 0.004)
    stated = state_fits(surfaces, seen, 0.0)
    assert stated.total(0).covariance[1, 1] > 4 * surfaces[0].fit.covariance[1, 1]
    assert 1 < min(stated.freedom) < 100


def test_surfaces_of_a_scan_share_what_its_image_errs():
    surfaces, seen = corner_seen(0, 0.004)
    stated = state_fits(surfaces, seen, 0.0)
    smooth = stated.smooth.covariance_of(range(len(surfaces)))
    assert np.abs(smooth[:3, 3:6]).max() > 0
    values = np.linalg.eigvalsh(smooth / np.sqrt(np.outer(*[np.diag(smooth)] * 2)))
    assert values.min() > -1e-9
    np.testing.assert_allclose(stated.smooth.covariance_of([2, 0])[:3, 3:], smooth[6:9, :3], rtol=1e-12)


def test_a_field_is_found_as_large_and_as_long_as_it_is():
    """From the components that fields of a known size and length leave in residuals of eight surfaces."""
    rng = np.random.default_rng(3)
    seen = [modes_of_square(rng, corner) for corner in np.mgrid[-1:0.6:3j, -0.7:0.2:3j].reshape(2, -1).T]
    for length in (0.35, 1.0):
        found = []
        for _ in range(20):
            drawn = rng.normal(size=bumps(seen[0].places, length).shape[1])
            some = [
                replace(
                    one, beyond=0.8 * one.taken_on(bumps(one.places, length))[3:] @ drawn + rng.normal(size=7)
                )
                for one in seen
            ]
            field = fit_field(some)
            found.append((sum(field.squares.values()), max(field.squares, key=field.squares.get)))
        assert 0.3 < np.sqrt(np.median([one[0] for one in found])) / 0.8 < 2.5
        assert np.median([one[1] for one in found]) == pytest.approx(length, rel=1.05)


def modes_of_square(rng, corner) -> ResidualModes:
    """Of a square of an image that a plane fills, 20,000 pixels."""
    places = corner + rng.uniform(0, 0.4, (400, 2))
    u, v = (5 * (places - corner - 0.2)).T
    columns = np.column_stack([np.ones(400), u, v, u * u, u * v, v * v, u**3, u * u * v, u * v * v, v**3])
    shapes = np.linalg.qr(columns)[0] * np.sqrt(400 / 20_000)
    return ResidualModes(np.zeros(7), 1.0, 20_000, np.eye(3), shapes, places, np.ones(400))


def test_noise_has_hardly_any_field_and_one_bad_surface_does_not_speak_for_all():
    rng = np.random.default_rng(4)
    seen = [modes_of_square(rng, corner) for corner in np.mgrid[-1:0.6:3j, -0.7:0.2:3j].reshape(2, -1).T]
    plain = [replace(one, beyond=rng.normal(size=7)) for one in seen]
    quiet = sum(fit_field(plain).squares.values())
    assert quiet < 0.05  # what is longer than the image shows in none of them
    assert fit_field([]).squares == {}
    bad = replace(plain[0], beyond=plain[0].beyond + 200.0)
    assert sum(fit_field([bad, *plain[1:]]).squares.values()) < 0.5 * sum(
        fit_field([bad] * 9).squares.values()
    )


def test_bumps_add_up_to_one_everywhere():
    places = np.random.default_rng(0).uniform(-1, 1, (200, 2))
    for length in LENGTHS:
        np.testing.assert_allclose(np.square(bumps(places, length)).sum(axis=1), 1.0, atol=0.05)


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
    assert modes.shapes.shape[1] == 12
    assert modes.square == pytest.approx(1.0, rel=0.1)
    assert np.square(modes.beyond).max() < 16
    assert find_modes(fit, seen, pixels[:7], 0.0) is None


def test_order_changes_nothing():
    surfaces, seen = corner_seen(2, 0.002)
    forward = state_fits(surfaces, seen, 0.0)
    backward = state_fits(surfaces[::-1], seen, 0.0)
    for number in range(3):
        one, two = forward.total(number).covariance, backward.total(2 - number).covariance
        np.testing.assert_allclose(one, two, rtol=1e-9)


def test_nothing_is_stated_of_nothing():
    stated = state_fits([], [], 0.0)
    assert stated.fits == ()
    assert stated.smooth.covariance_of([]).shape == (0, 0)
