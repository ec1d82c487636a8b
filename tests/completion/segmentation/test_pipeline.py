# SPDX-License-Identifier: MIT
from dataclasses import replace

import numpy as np
import pytest

from completion.merging.pipeline import merge
from completion.observe.observation import Observation, observe
from completion.observe.range_noise import estimate_noise
from completion.observe.refitting import refit
from completion.observe.tolerance import EvidenceOptions
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import SegmentationOptions
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane, surfaces_close
from tests.helpers.completion_examples import example, scene

CAMERA = PinholeProjection.from_fov(160, 120, 60)


def wall(depth: FloatArray | float, sigma: float | None = 0.0) -> RangeImage:
    """A scan that sees z-depths `depth`."""
    cosine = CAMERA.directions()[..., 2]
    return RangeImage(np.broadcast_to(depth, CAMERA.shape) / cosine, CAMERA, Pose.identity(), sigma_m=sigma)


def observed(scan: RangeImage) -> Observation:
    return observe(scan, Pose.identity())


def merged(observation: Observation, options: SegmentationOptions = SegmentationOptions()):  # noqa: B008
    return merge([observation], [segment(observation, options)], EvidenceOptions().tolerance())


@pytest.mark.parametrize("sigma", [0.001, 0.004])
def test_noise_is_read_off_the_scan(sigma):
    rng = np.random.default_rng(0)
    scan = wall(2.0)
    noisy = replace(scan, ranges=scan.ranges + rng.normal(0, sigma, scan.shape), sigma_m=None)
    noise = estimate_noise(noisy)
    assert noise.sigma(np.array([2.2]))[0] == pytest.approx(sigma, rel=0.15)


def test_steps_of_the_depth_count_as_noise():
    row = np.arange(120)[:, None]
    step = 0.02
    depth = np.round((3.0 + row * 0.0005) / step) * step  # a slightly tilted wall, a step every 40 rows
    noise = estimate_noise(wall(depth, None))
    assert noise.sigma(np.array([3.2]))[0] == pytest.approx(step / np.sqrt(12), rel=0.5)


def test_regions_of_a_noise_free_scan_are_the_true_surfaces():
    scan = example("two_cylinders")
    truth = scene("two_cylinders")
    regions = segment(observed(scan), SegmentationOptions())
    kinds = [region.fit.surface.kind for region in regions]
    assert kinds.count("cylinder") >= 2
    for region in regions:
        labels, count = np.unique(region.pixels.pick(scan.truth.surface), return_counts=True)
        surface = truth.surfaces[labels[np.argmax(count)]]
        same = [
            np.abs(surface.distance(observed(scan).scan.points()[scan.truth.surface == i])).max() < 1e-3
            for i in labels
        ]
        assert count[same].sum() / count.sum() > 0.99  # the board and its stands share their front plane
        assert isinstance(region.fit.surface, type(surface))
        if isinstance(surface, Cylinder):
            assert region.fit.surface.radius == pytest.approx(surface.radius, abs=1e-4)


def test_each_pixel_belongs_to_one_region_at_most():
    regions = segment(observed(example("chair_before_wall")), SegmentationOptions())
    assert np.sum([region.pixels.mask for region in regions], axis=0).max() == 1


def test_a_plane_is_no_cylinder_even_with_noise():
    rng = np.random.default_rng(1)
    scan = wall(2.0, 0.003)
    noisy = replace(scan, ranges=scan.ranges + rng.normal(0, 0.003, scan.shape))
    (surface,) = merged(observed(noisy))
    assert isinstance(surface.fit.surface, Plane)
    assert surface.n_pixels > 0.98 * scan.ranges.size


def test_parts_of_one_cylinder_join_across_the_board():
    cylinders = [
        s
        for s in merged(observed(example("two_cylinders", pixels=320)))
        if isinstance(s.fit.surface, Cylinder)
    ]
    assert sorted(round(c.fit.surface.radius, 3) for c in cylinders) == [0.16, 0.22]
    assert all(c.n_parts == 2 for c in cylinders)


def split_wall(step: float, gap: float) -> RangeImage:
    """A wall at 3 m cut by a strip at depth `gap`; the right part stands `step` metres further back."""
    depth = np.full(CAMERA.shape, 3.0)
    depth[:, 90:] += step
    depth[:, 70:90] = gap
    return wall(depth)


@pytest.mark.parametrize(
    ("step", "gap", "n_walls"),
    [(0.0, 1.5, 1), (0.1, 1.5, 2), (0.0, 4.0, 2)],
    ids=["one wall behind a post", "a step behind the post", "a slit that beams went through"],
)
def test_parts_join_only_when_one_surface_explains_them_and_nothing_was_seen_between(step, gap, n_walls):
    surfaces = merged(observed(split_wall(step, gap)))
    assert len(surfaces) == n_walls + 1


def test_options_change_the_regions():
    observation = observed(example("chair_before_wall"))
    usual = segment(observation, SegmentationOptions())
    assert len(segment(observation, SegmentationOptions(max_regions=2))) == 2
    assert len(segment(observation, SegmentationOptions(min_pixels=2000))) < len(usual)
    noisy = observed(example("two_cylinders", "gaussian-2mm"))
    base = segment(noisy, SegmentationOptions())
    strict = segment(noisy, SegmentationOptions(n_sigma=0.7, flatness_m=1e-5))
    assert sum(r.n_pixels for r in strict) < sum(r.n_pixels for r in base)
    flat = segment(noisy, SegmentationOptions(min_arc_deg=360))
    assert all(isinstance(r.fit.surface, Plane) for r in flat)
    loose = segment(noisy, SegmentationOptions(flatness_m=0.05))
    assert [r.n_pixels for r in loose] != [r.n_pixels for r in base]
    narrow = segment(noisy, SegmentationOptions(max_angle_deg=2))
    assert [r.n_pixels for r in narrow] != [r.n_pixels for r in base]


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (30, 40)])
def test_empty_and_tiny_scans_have_no_regions(shape):
    camera = PinholeProjection(shape[1], shape[0], 50, 50, 0, 0)
    for ranges in (np.full(shape, np.inf), np.full(shape, np.nan)):
        assert segment(observed(RangeImage(ranges, camera, Pose.identity())), SegmentationOptions()) == []
    whole = RangeImage(np.ones(shape), camera, Pose.identity(), sigma_m=0.0)
    if min(shape) == 1:
        assert segment(observed(whole), SegmentationOptions()) == []


def test_pure_noise_gives_no_surface():
    rng = np.random.default_rng(0)
    scan = RangeImage(rng.uniform(1, 5, CAMERA.shape), CAMERA, Pose.identity(), sigma_m=0.0)
    assert segment(observed(scan), SegmentationOptions()) == []


def test_segmentation_moves_with_the_world():
    scan = example("two_occluders")
    moved = scan.transform(Pose.looking_at((100, 20, 3), (7, -5, 1)))
    for one, other in zip(
        segment(observe(scan, scan.world_from_sensor), SegmentationOptions()),
        segment(observe(moved, moved.world_from_sensor), SegmentationOptions()),
        strict=True,
    ):
        assert np.array_equal(one.pixels.flat, other.pixels.flat)
        assert surfaces_close(one.fit.surface, other.fit.surface, angle=1e-8, length=1e-8)


@pytest.mark.parametrize("noise", ["none", "gaussian-2mm"])
@pytest.mark.parametrize("name", ["two_cylinders", "two_occluders"])
def test_rounding_of_the_ranges_moves_no_pixel(name, noise):
    """No decision hangs on the last bits: noise-free scans are full of ties."""
    scan = example(name, noise)
    rng = np.random.default_rng(0)
    usual = merged(observed(scan))
    for _ in range(3):
        rounded = replace(scan, ranges=scan.ranges * (1 + 1e-13 * rng.normal(size=scan.shape)))
        for one, other in zip(usual, merged(observed(rounded)), strict=True):
            assert np.array_equal(one.pixels[0].flat, other.pixels[0].flat)
            assert surfaces_close(one.fit.surface, other.fit.surface, angle=1e-9, length=1e-9)


@pytest.mark.parametrize(("n_columns", "is_determined"), [(1, False), (2, True), (3, True), (30, True)])
def test_narrow_surfaces_are_fitted_with_all_their_pixels_or_not_at_all(n_columns, is_determined):
    """Every third pixel of an image whose width three divides may stand in one column."""
    camera = PinholeProjection.from_fov(159, 120, 60)
    noise = np.random.default_rng(0).normal(0, 0.002, camera.shape)
    scan = RangeImage(2.0 / camera.directions()[..., 2] + noise, camera, Pose.identity(), sigma_m=0.002)
    labels = np.zeros(camera.shape, np.int32)
    labels[:, 30 : 30 + n_columns] = 1
    (found,) = refit([Plane((0, 0, 2), (0, 0, -1))], [observed(scan)], [labels], 0.001)
    assert (found is not None) == is_determined
    if found is not None:
        assert (np.linalg.eigvalsh(found.covariance) > 0).all()
