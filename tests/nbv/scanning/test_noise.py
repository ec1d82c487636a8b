# SPDX-License-Identifier: MIT
"""Noise, pointing and quantisation: measured spreads and levels against the published formulas."""

import numpy as np
import pytest

from nbv.scanning.effects import Effects, PointingNoise, Quantisation, named_effects
from nbv.scanning.noise_models import (
    ConstantNoise,
    KhoshelhamNoise,
    NguyenNoise,
    StereoNoise,
    TerrestrialNoise,
    range_sigma_m,
)
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, SphericalSensor
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.world.scene import Scene

EAST = Pose.looking_at((0, 0, 0), (1, 0, 0))
NARROW = PinholeSensor(fov_deg=1.0, width=200, height=200, max_range_m=100.0)  # one depth, one incidence
N = 200 * 200


def nguyen(z, theta):
    steep = 1e-4 / np.sqrt(z) * theta**2 / (np.pi / 2 - theta) ** 2
    return 0.0012 + 0.0019 * (z - 0.4) ** 2 + (steep if theta > np.pi / 3 else 0.0)


FORMULAS = {
    "gaussian-2mm": lambda _z, _theta, _rho: 0.002,
    "constant-2mm-20ppm": lambda z, _theta, _rho: 0.002 + 20e-6 * z,
    "constant-ppm": lambda z, _theta, _rho: 0.001 + 10e-6 * z,
    "nguyen2012": lambda z, theta, _rho: nguyen(z, theta),
    "stereo-0.08px-640px-50mm": lambda z, _theta, _rho: z**2 * 0.08 / (640 * 0.05),
    "terrestrial-1mm-0.01mm": lambda z, theta, rho: np.hypot(1e-3, 1e-5 * z**2 / (rho * np.cos(theta))),
    "khoshelham2012": lambda z, _theta, _rho: 1.425e-3 * z**2,
}
GREY = ((0.5 + 0.055) / 1.055) ** 2.4  # reflectivity of the mid grey that a scene without colour has


def wall(distance: float, incidence_deg: float) -> Scene:
    """A large wall that meets the x axis at this distance and incidence."""
    turn = np.radians(incidence_deg)
    along, up = np.array([np.sin(turn), np.cos(turn), 0]), np.array([0, 0, 1.0])
    centre = np.array([distance, 0, 0])
    vertices = [centre + 20 * (a * along + b * up) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh = LabelledMesh(np.array(vertices), np.array([[0, 1, 2], [0, 2, 3]]))
    return Scene(mesh, (None,), ("wall",), "wall", "object")


@pytest.mark.parametrize("name", FORMULAS)
@pytest.mark.parametrize(("depth", "incidence_deg"), [(1.0, 0), (3.0, 45), (2.0, 75), (4.0, 20)])
def test_the_measured_spread_follows_the_formula(name, depth, incidence_deg):
    effects = named_effects(name)
    formula = FORMULAS[name]
    scan = scan_scene(wall(depth, incidence_deg), EAST, NARROW, effects=effects, rng=3)
    axis = NARROW.projection.directions()[..., 2]
    depths = (scan.truth.ranges * axis) if name in ("nguyen2012", "khoshelham2012") else scan.truth.ranges
    expected = np.vectorize(formula)(depths, scan.truth.incidence, GREY)
    measured = np.linalg.norm(scan.points() - scan.true_points(), axis=-1)
    error = scan.ranges - scan.truth.ranges
    if effects.pointing is not None:  # sideways too: depth is what the axial formula speaks of
        error = scan.points_in_sensor()[..., 2] - depths
    spread = (error / expected)[scan.valid]
    assert scan.valid.all()
    assert abs(spread.mean()) < 3.5 / np.sqrt(N)
    added = 0.0
    if effects.quantisation is not None:
        added = (2.85e-3 / 1.425e-3) ** 2 / 12  # variance of an even spread over a step, in units of sigma^2
    assert abs(spread.std() - np.sqrt(1 + added)) < 3 * np.sqrt(1 + added) / np.sqrt(2 * N) + 0.01 * added
    assert scan.sigma_m == pytest.approx(np.sqrt(np.mean(expected**2) * (1 + added)), rel=1e-3)
    assert (measured > 0).any()


def test_nguyen_moves_points_sideways_by_its_lateral_formula():
    depth, theta = 2.0, np.radians(70)
    scan = scan_scene(wall(depth, 70), EAST, NARROW, noise="nguyen2012", rng=5)
    rays, points = NARROW.projection.directions(), scan.points_in_sensor()
    shift_px = NARROW.projection.fx * (points[..., :2] / points[..., 2:] - rays[..., :2] / rays[..., 2:])
    sigma = 0.8 + 0.035 * theta / (np.pi / 2 - theta)
    for axis in range(2):
        assert abs(shift_px[..., axis].std() - sigma) < 3 * sigma / np.sqrt(2 * N) + 0.01 * sigma
        assert abs(shift_px[..., axis].mean()) < 3 * sigma / np.sqrt(N)


def test_encoder_noise_turns_the_points_and_keeps_their_range():
    projection = SphericalProjection.regular(200, 200, 20.0, (-10.0, 10.0))
    rays = projection.directions()
    noise = PointingNoise(sd_deg=0.01)
    points = noise.displace(
        np.full((200, 200), 30.0), rays[..., 0] * 0, projection, rays, np.random.default_rng(1)
    )
    assert np.abs(np.linalg.norm(points, axis=-1) - 30).max() < 1e-12
    azimuth = np.arctan2(points[..., 0], points[..., 2]) - np.arctan2(rays[..., 0], rays[..., 2])
    elevation = np.arcsin(-points[..., 1] / 30) - np.arcsin(-rays[..., 1])
    for error in (azimuth, elevation):
        assert abs(np.degrees(error).std() - 0.01) < 3 * 0.01 / np.sqrt(2 * N)


def test_pointing_noise_of_a_scanner_leaves_the_rays_of_the_pixels():
    sensor = SphericalSensor(90, -30, 30, 60, 40)
    scan = scan_scene(wall(5, 0), EAST, sensor, effects=Effects(pointing=PointingNoise(sd_deg=0.1)), rng=0)
    assert scan.sensor_points is not None
    assert (scan.ranges == scan.truth.ranges)[scan.valid].mean() > 0.3
    assert np.abs(scan.ranges - scan.truth.ranges)[scan.valid].max() < 1e-12
    assert np.linalg.norm(scan.points() - scan.true_points(), axis=-1)[scan.valid].max() > 0.005


def test_depth_noise_is_turned_into_range_noise_off_the_axis():
    model = NguyenNoise()
    r, cosine = np.array([2.0]), 0.8
    assert np.allclose(range_sigma_m(model, r, r * 0, cosine), model.sigma_m(r * cosine, r * 0) / cosine)
    flat = ConstantNoise(constant_m=0.001)
    assert range_sigma_m(flat, r, r * 0, cosine) == 0.001


@pytest.mark.parametrize(
    "model", [NguyenNoise(), TerrestrialNoise(constant_m=1e-3, signal_per_m=1e-5), KhoshelhamNoise()]
)
def test_incidence_is_clipped_before_the_pole(model):
    sigma = model.sigma_m(np.ones(2), np.array([np.radians(89), np.pi / 2]), 1.0)
    assert np.isfinite(sigma).all()
    assert sigma[0] == pytest.approx(sigma[1])
    assert np.isfinite(PointingNoise(slope_px=1.0).sigma_rad(np.array([np.pi / 2]), 0.001)).all()


def test_levels_of_a_quantised_depth_are_even_in_disparity():
    step = Quantisation(inverse_depth_step_per_m=2.85e-3)
    z = np.linspace(0.5, 5.0, 50_000)
    levels = np.unique(step.round_ranges(z))
    assert np.abs(np.round(1 / levels / 2.85e-3) - 1 / levels / 2.85e-3).max() < 1e-9
    assert np.abs(np.diff(levels) / (2.85e-3 * levels[1:] * levels[:-1]) - 1).max() < 1e-9
    assert np.abs(step.round_ranges(z) - z).max() <= 0.51 * step.step_m(z).max()
    assert (step.round_ranges(np.array([np.inf])) == np.inf).all()
    off_axis = step.round_ranges(z / 0.8, 0.8)
    assert np.allclose(off_axis * 0.8, step.round_ranges(z))
    assert np.allclose(step.step_m(z / 0.8, 0.8) * 0.8, step.step_m(z))


def test_levels_of_a_quantised_range_are_its_multiples():
    step = Quantisation(range_step_m=0.002)
    rounded = step.round_ranges(np.array([1.0009, 1.0011, np.inf]))
    assert rounded == pytest.approx([1.0, 1.002, np.inf])
    assert step.step_m(np.ones(2)).tolist() == [0.002, 0.002]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Quantisation(), "range_step_m or inverse_depth_step_per_m"),
        (lambda: Quantisation(range_step_m=1.0, inverse_depth_step_per_m=1.0), "not both"),
        (lambda: Quantisation(range_step_m=-1.0), "range_step_m must be 0 or more"),
        (lambda: ConstantNoise(constant_m=-1.0), "constant_m must be 0 or more"),
        (lambda: StereoNoise(subpixel_px=0.1, focal_px=0.0, baseline_m=0.1), "focal_px must be 1 or more"),
        (lambda: NguyenNoise(steep_from_deg=100.0), "steep_from_deg must be between 0 and 90"),
        (lambda: TerrestrialNoise(constant_m=1.0, signal_per_m=np.nan), "signal_per_m must be 0 or more"),
        (lambda: KhoshelhamNoise(per_m=-1.0), "per_m must be 0 or more"),
        (lambda: PointingNoise(sd_deg=-1.0), "sd_deg must be between 0 and 45"),
    ],
)
def test_impossible_parameters_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize("name", ["gaussian", "gaussian--1mm", "Nguyen", "", "stereo-1px-1px"])
def test_unknown_models_are_refused(name):
    with pytest.raises(InputError, match=r"no noise model named .*nguyen2012.*stereo-<n>px"):
        named_effects(name)


def test_a_camera_keeps_depth_when_pixels_err():
    projection = PinholeProjection.from_fov(8, 8, 60)
    rays = projection.directions()
    points = PointingNoise(sd_px=1.0).displace(
        2 / rays[..., 2], rays[..., 2] * 0, projection, rays, np.random.default_rng(0)
    )
    assert np.abs(points[..., 2] - 2).max() < 1e-12
    assert np.abs(points - rays * (2 / rays[..., 2:])).max() > 0.05
