# SPDX-License-Identifier: MIT
"""Laws of the pieces that segmentation and merging are made of."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from skimage.measure import label as slow_parts

from completion.fitting.euclidean import fit_cylinder, fit_plane
from completion.merging.agreement import (
    FittedPart,
    PoseDoubt,
    compare,
    compare_at_points,
    lies_on,
    log_evidence_of_height,
)
from completion.merging.candidates import find_candidates
from completion.merging.pipeline import merge
from completion.observe.observation import observe
from completion.observe.packed_surfaces import pack, unpack
from completion.observe.range_noise import RangeNoise
from completion.observe.rays import Noise, rays_of
from completion.observe.refitting import refit
from completion.observe.tiles import LEAST_TILE, MOST_TILE, cut_tiles, tile_side
from completion.observe.tolerance import EvidenceOptions
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import SegmentationOptions, number_parts
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere, surfaces_close
from tests.helpers.completion_examples import example

CAMERA = PinholeProjection.from_fov(160, 120, 60)
PANORAMA = SphericalProjection.regular(180, 60, 180.0, (-30.0, 30.0))
TILTED = Plane((0.2, 0.1, 3.0), (0.3, -0.2, -1.0))
PIPE = Cylinder((0.1, 0.0, 3.0), (0.2, 1.0, 0.1), 0.5)


def seen(surface, projection=CAMERA, sigma=0.0, rng=0, missing=0.0) -> RangeImage:
    """A scan of one surface and nothing else."""
    rays = projection.directions().reshape(-1, 3)
    ranges = surface.ray_ranges(np.zeros_like(rays), rays).reshape(projection.shape)
    generator = np.random.default_rng(rng)
    ranges = ranges + generator.normal(0, sigma, ranges.shape) if sigma else ranges
    ranges = np.where(generator.random(ranges.shape) < missing, np.inf, ranges)
    return RangeImage(ranges, projection, Pose.identity(), sigma_m=sigma)


def regions_of(scan: RangeImage, **options):
    return segment(observe(scan, Pose.identity()), SegmentationOptions(**options))


@pytest.mark.parametrize("projection", [CAMERA, PANORAMA], ids=["pinhole", "panorama"])
def test_tiles_of_a_plane_have_that_plane(projection):
    scan = seen(TILTED, projection)
    tiles = cut_tiles(scan.ranges, rays_of(scan), Noise(1e-3, 0.0, 0.0), 0.0, 6)
    known = np.isfinite(tiles.plane[..., 0])
    true = TILTED.normal_direction / (TILTED.point @ TILTED.normal_direction)
    np.testing.assert_allclose(tiles.plane[known], np.broadcast_to(true, (known.sum(), 3)), atol=1e-8)
    assert known.mean() > 0.5
    assert tiles.misfit[known].max() < 1e-8


def test_misfit_of_noise_is_one():
    scan = seen(TILTED, sigma=0.003)
    tiles = cut_tiles(scan.ranges, rays_of(scan), Noise(0.003, 0.0, 0.0), 0.0, 6)
    n_tiles = tiles.misfit.size
    assert tiles.misfit.mean() == pytest.approx(1, abs=4 * np.sqrt(2 / 33 / n_tiles))


def test_tiles_grow_with_the_noise_within_limits():
    ranges = np.full((60, 60), 3.0)
    sides = [tile_side(ranges, Noise(sigma, 0.0, 0.0), 0.002) for sigma in (0.0, 1e-3, 5e-3, 1.0)]
    assert sides == sorted(sides)
    assert (sides[0], sides[-1]) == (LEAST_TILE, MOST_TILE)
    assert tile_side(np.full((4, 4), np.inf), Noise(0.0, 0.0, 0.0), 0.002) == LEAST_TILE


@pytest.mark.parametrize("surface", [TILTED, PIPE, Cylinder((0, 0, 1.0), (0, 1, 0), 2.0, None, True)])
def test_packing_is_undone_by_unpacking(surface):
    origin = np.array([0.1, -0.2, 0.3])
    again = unpack(pack(surface, origin), surface.from_uv(np.zeros((1, 2)))[0], origin)
    assert surfaces_close(surface, again, angle=1e-12, length=1e-12)


def test_only_planes_and_cylinders_are_packed_and_refitted():
    with pytest.raises(TypeError, match="cannot pack a Sphere"):
        pack(Sphere((0, 0, 3), 1.0), np.zeros(3))
    observation = observe(seen(TILTED), Pose.identity())
    labels = np.ones(CAMERA.shape, np.int32)
    with pytest.raises(TypeError, match="cannot refit a Sphere"):
        refit([Sphere((0, 0, 3), 1.0)], [observation], [labels], 0.001)


@pytest.mark.parametrize("surface", [TILTED, PIPE], ids=["plane", "cylinder"])
def test_refit_is_unbiased_and_says_how_sure_it_is(surface):
    """Over 60 noisy scans: errors in units of the predicted deviation have mean 0 and spread 1."""
    n_trials, errors = 60, []
    for seed in range(n_trials):
        scan = seen(surface, PinholeProjection.from_fov(64, 48, 40), 0.005, seed)
        labels = scan.valid.astype(np.int32)
        (fit,) = refit([surface], [observe(scan, Pose.identity())], [labels], 0.0, 3)
        deviations = fit.parameter_deviations()
        if isinstance(surface, Cylinder):
            errors.append((fit.surface.radius - surface.radius) / deviations["radius"])
        else:
            point = fit.surface.point[None]
            errors.append(surface.distance(point)[0] / fit.standard_deviation(point)[0])
    assert abs(np.mean(errors)) < 4 / np.sqrt(n_trials)
    assert np.std(errors) == pytest.approx(1, abs=4 / np.sqrt(2 * n_trials))


def test_refit_from_too_few_pixels_gives_none():
    observation = observe(seen(TILTED), Pose.identity())
    labels = np.zeros(CAMERA.shape, np.int32)
    labels[3, 3:5] = 1
    assert refit([TILTED], [observation], [labels], 0.001) == [None]


def test_warped_walls_have_wider_covariances():
    waves = 0.01 * np.sin(np.arange(160) / 12.0)
    flat = seen(TILTED, sigma=0.002)
    warped = replace(flat, ranges=flat.ranges + waves)
    labels = np.ones(CAMERA.shape, np.int32)
    inflation = [
        refit([TILTED], [observe(scan, Pose.identity())], [labels], 0.001)[0].inflation
        for scan in (flat, warped)
    ]
    assert inflation[0] < 1.5
    assert inflation[1] > 20


@pytest.mark.parametrize("n_labels", [1, 2, 9])
@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (37, 1), (60, 80)])
def test_connected_parts_are_those_of_scikit_image(shape, n_labels):
    labels = np.random.default_rng(0).integers(0, n_labels + 1, shape).astype(np.int32)
    chequered = (np.indices(shape).sum(axis=0) % 2 + 1).astype(np.int32)
    for image in (labels, chequered, np.zeros_like(labels), np.ones_like(labels)):
        parts, n_parts = number_parts(image)
        assert np.array_equal(parts, slow_parts(image, connectivity=1, background=0))
        assert n_parts == parts.max()


def half_planes(step: float, sigma: float, seed: int) -> tuple[FittedPart, FittedPart]:
    """Two patches of a plane a metre apart, one of them raised by a step."""
    rng = np.random.default_rng(seed)
    uv = rng.uniform(0, 0.5, (2, 400, 2)) + np.array([[[0, 0]], [[1.5, 0.0]]])
    heights = rng.normal(0, sigma, (2, 400, 1)) + np.array([0, step])[:, None, None]
    clouds = np.concatenate([uv, heights], axis=2)
    return tuple(FittedPart.of(fit_plane(c, np.array([0, 0, 9.0])), c, sigma, 0.001) for c in clouds)


def test_parts_of_one_plane_agree_and_a_step_tells_them_apart():
    """At most one in a hundred is split or merged falsely; 1 mm of warp tilts half a metre by 0.4 deg."""
    same = [compare(*half_planes(0.0, 0.002, seed)) for seed in range(100)]
    raised = [compare(*half_planes(0.05, 0.002, seed)) for seed in range(100)]
    assert sum(found.chi2 > 1 for found in same) <= 1
    assert sum(found.log_evidence > np.log(20) for found in same) >= 99
    assert sum(found.chi2 <= 1 for found in raised) <= 1


@pytest.mark.parametrize("seed", range(10))
def test_planes_compare_in_closed_form_as_by_least_squares(seed):
    one, other = half_planes(0.02, 0.002, seed)
    turned = Plane(other.fit.surface.point + [0.1, -0.2, 0.0], other.fit.surface.normal_direction, (1, 3, 0))
    other = FittedPart.of(replace(other.fit, surface=turned), other.points, other.scale, 0.001)
    found, expected = compare(one, other), compare_at_points(one, other)
    assert found.chi2 == pytest.approx(expected.chi2, rel=1e-7)
    assert found.log_evidence == pytest.approx(expected.log_evidence, rel=1e-7)


def test_agreement_is_symmetric_and_sees_the_side():
    one, other = half_planes(0.003, 0.002, 0)
    assert compare(one, other).chi2 == pytest.approx(compare(other, one).chi2, rel=0.02)
    back = FittedPart.of(fit_plane(other.points, np.array([0, 0, -9.0])), other.points, 0.002, 0.001)
    assert compare(one, back).chi2 == np.inf
    assert not lies_on(back, one)
    assert lies_on(other, one) or compare(one, other).chi2 > 0


def test_a_pose_that_is_off_lets_scans_lie_apart_but_small_parts_tilt_no_more():
    """A step of 4 cm joins between scans whose poses may be off by 2 cm, and not within one of them.

    Tilted by 13 degrees, half a metre long, no parts join, however far off the poses may be in position.
    """

    def of_scans(parts, one, other, shift=0.02):
        doubts = (PoseDoubt(number, shift, shift / 3.0) for number in (one, other))
        return [replace(part, doubt=doubt) for part, doubt in zip(parts, doubts, strict=True)]

    raised = half_planes(0.04, 0.002, 0)
    assert compare(*of_scans(raised, 0, 1)).chi2 < 1
    assert compare(*of_scans(raised, 0, 0)).chi2 > 1
    assert compare(*of_scans(raised, 0, 0)).chi2 == compare(*raised).chi2
    low = half_planes(0.02, 0.002, 0)[::-1]
    assert lies_on(*of_scans(low, 0, 1))
    assert not lies_on(*of_scans(low, 1, 1))
    one, other = half_planes(0.0, 0.002, 0)
    lean = np.tan(np.radians(13.0))
    points = other.points + np.outer(lean * (other.points[:, 1] - 0.25), [0, 0, 1.0])
    tilted = FittedPart.of(fit_plane(points, np.array([0, 0, 9.0])), points, 0.002, 0.001)
    for shift in (0.005, 0.02, 0.05):
        assert compare(*of_scans((one, tilted), 0, 1, shift)).chi2 > 1
    warped = FittedPart.of(
        tilted.fit, points, 0.002, 0.05
    )  # as if each part were warped by what the pose is off
    assert compare(one, warped).chi2 < 1


def test_the_height_of_a_small_part_is_evidence_where_the_surface_is_known_and_none_far_away():
    """Half a metre with a warp of 1 cm is known to decimetres 4 m away: there it may lie anywhere."""

    def crumb(x, height):
        rng = np.random.default_rng(1)
        points = np.concatenate([rng.uniform(0, 0.1, (60, 2)) + [x, 0.2], np.full((60, 1), height)], axis=1)
        return FittedPart.of(fit_plane(points, np.array([0, 0, 9.0])), points, 0.002, 0.001)

    patch, _ = half_planes(0.0, 0.002, 0)
    wide = FittedPart.of(patch.fit, patch.points, patch.scale, 0.01)  # half a metre, known by a warp of 1 cm
    assert log_evidence_of_height(crumb(0.6, 0.0), patch) > np.log(20)
    assert log_evidence_of_height(crumb(0.6, 0.05), patch) < 0
    assert log_evidence_of_height(crumb(10.0, 0.0), wide) < log_evidence_of_height(crumb(0.6, 0.0), patch)
    assert lies_on(crumb(4.0, 0.1), wide)  # it does not contradict that it is one
    assert log_evidence_of_height(crumb(4.0, 0.1), wide) < np.log(20)


def test_two_sides_of_a_cylinder_agree_and_another_radius_does_not():
    rng = np.random.default_rng(0)

    def side(cylinder, angle):
        uv = np.column_stack(
            [cylinder.radius * (angle + rng.uniform(-0.5, 0.5, 600)), rng.uniform(0, 1, 600)]
        )
        points = cylinder.from_uv(uv)
        points += rng.normal(0, 0.001, (600, 1)) * cylinder.normal(points)
        return FittedPart.of(fit_cylinder(points, cylinder), points, 0.001, 0.001)

    wide = Cylinder(PIPE.point, PIPE.direction, 0.7)
    left, right, other = side(PIPE, -0.9), side(PIPE, 0.9), side(wide, 0.9)
    assert find_candidates([left, right]).tolist() == [[0, 1]]
    assert compare(left, right).chi2 <= 1
    assert compare(left, other).chi2 > 1


@pytest.mark.parametrize("missing", [0.0, 0.2], ids=["whole", "a fifth missing"])
@pytest.mark.parametrize("surface", [TILTED, PIPE], ids=["plane", "cylinder"])
def test_one_surface_is_one_region(surface, missing):
    scan = seen(surface, sigma=0.002, missing=missing)
    (found,) = merge([observe(scan, Pose.identity())], [regions_of(scan)], EvidenceOptions().tolerance())
    assert found.fit.surface.kind == surface.kind
    assert found.n_pixels > 0.97 * scan.valid.sum()


def test_a_concave_vault_is_one_concave_cylinder():
    vault = Cylinder((0, 0, 0), (0.1, 0, 1.0), 2.0, None, True)
    found = regions_of(seen(vault, sigma=0.004))
    assert [region.fit.surface.kind for region in found] == ["cylinder"]
    assert found[0].fit.surface.concave
    assert found[0].fit.surface.radius == pytest.approx(2.0, abs=0.01)


def test_a_shallow_arc_is_a_wall_unless_asked_otherwise():
    tank = Cylinder((0, 0, 13.0), (0, 1, 0), 10.0)  # 19 deg of it in view
    scan = seen(tank, PinholeProjection.from_fov(160, 120, 40), 0.002)
    kinds = [{r.fit.surface.kind for r in regions_of(scan, min_arc_deg=arc)} for arc in (30.0, 5.0)]
    assert kinds == [{"plane"}, {"cylinder"}]


def test_a_bent_depth_camera_gives_one_wall():
    """A warp of twice the noise, as depth cameras have it, leaves no islands; known noise would."""
    rng = np.random.default_rng(0)
    scan = seen(Plane((0, 0, 3.0), (0, 0, -1.0)), PinholeProjection.from_fov(320, 240, 60))
    noise = RangeNoise(0.0, 0.0012)
    warp = 2 * np.sin(np.arange(320) / 25.0) * np.cos(np.arange(240) / 20.0)[:, None]
    strayed = scan.ranges + noise.sigma(scan.ranges) * (rng.normal(0, 1, scan.shape) + warp)
    found = regions_of(replace(scan, ranges=strayed, sigma_m=None))
    assert len(found) == 1
    assert found[0].n_pixels > 0.95 * scan.ranges.size


def test_veils_between_foreground_and_wall_belong_to_no_surface():
    depth = np.full(CAMERA.shape, 4.0)
    depth[40:80, 50:110] = 2.0
    depth[40:80, 49] = 3.0  # mixed pixels
    depth[40:80, 110] = 2.7
    scan = RangeImage(depth / CAMERA.directions()[..., 2], CAMERA, Pose.identity(), sigma_m=0.002)
    found = regions_of(scan)
    assert sorted(region.n_pixels for region in found) == [40 * 60, 160 * 120 - 40 * 62]


def test_same_bytes_from_two_threads_at_once():
    scans = [example("two_cylinders", "gaussian-2mm"), example("chair_before_wall")]

    def found(scan):
        observation = observe(scan, scan.world_from_sensor)
        surfaces = merge(
            [observation], [segment(observation, SegmentationOptions())], EvidenceOptions().tolerance()
        )
        return b"".join(s.pixels[0].flat.tobytes() + s.fit.covariance.tobytes() for s in surfaces)

    alone = [found(scan) for scan in scans]
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(found, scans)) == alone
