# SPDX-License-Identifier: MIT
"""Requirements: predicted density and deviation against simulated scans, and what each limit changes."""

import numpy as np
import pytest

from nbv.cover.pipeline import CoverOptions
from nbv.coverage.measurement import measure_coverage, measure_scan_coverage
from nbv.plan.planning import plan_views
from nbv.scanning.beam import Intensity
from nbv.scanning.effects import Effects, PointingNoise, named_effects
from nbv.scanning.noise_models import ConstantNoise, TerrestrialNoise
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, SphericalSensor, View
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.requirement import Precision, Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from scenes.world.scene import Scene

NARROW = PinholeSensor(fov_deg=3, width=50, height=50, min_range_m=0.1, max_range_m=50, name="narrow")
TURNING = SphericalSensor(
    azimuth_span_deg=3, elevation_min_deg=-1.5, elevation_max_deg=1.5, width=50, height=50, name="turning"
)
EFFECTS = {
    "constant": named_effects("gaussian-3mm"),
    "range and steps": named_effects("khoshelham2012"),
    "axial and lateral": named_effects("nguyen2012"),
    "light": Effects(
        noise=TerrestrialNoise(constant_m=0.001, signal_per_m=1e-4), intensity=Intensity(reflectivity=0.6)
    ),
    "encoders": Effects(noise=ConstantNoise(constant_m=0.001), pointing=PointingNoise(sd_deg=0.05)),
}


def ground(half: float = 3.0) -> Scene:
    vertices = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    mesh = LabelledMesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    return Scene(mesh, (None,), ("ground",), "ground", "object")


def measured(pose: Pose, sensor: PinholeSensor | SphericalSensor, **options) -> np.ndarray:
    """Return the points (n, 3) of one scan of the ground."""
    scan = scan_scene(ground(), pose, sensor, **options)
    return scan.points()[scan.valid]


def over(distance: float, incidence_deg: float) -> Pose:
    """Return the pose that looks at the origin from a distance, at an incidence."""
    angle = np.radians(incidence_deg)
    return Pose.looking_at((distance * np.sin(angle), 0, distance * np.cos(angle)), (0, 0, 0))


@pytest.mark.parametrize("sensor", [NARROW, TURNING], ids=lambda s: s.name)
@pytest.mark.parametrize("incidence_deg", [0, 50, 70])
def test_predicted_density_is_that_of_a_scan(sensor, incidence_deg):
    points = measured(over(2.0, incidence_deg), sensor)
    inside = np.linalg.norm(points, axis=1) < 0.03
    precision = Precision(sensor.projection.pixel_angle, sensor.effects)
    predicted = precision.density_per_m2(np.array([2.0]), np.cos(np.radians([incidence_deg])))
    assert inside.sum() / (np.pi * 0.03**2) == pytest.approx(predicted[0], rel=0.06)


@pytest.mark.parametrize("name", EFFECTS)
@pytest.mark.parametrize(("distance", "incidence_deg"), [(1.0, 0), (2.5, 55), (2.5, 75)])
def test_predicted_deviation_of_single_points_is_that_of_scans(name, distance, incidence_deg):
    phases = np.linspace(-0.3, 0.3, 5)  # steps of a few mm are met at all their phases
    poses = [over(distance, incidence_deg + turn) for turn in phases]
    heights = [measured(pose, NARROW, effects=EFFECTS[name], rng=k)[:, 2] for k, pose in enumerate(poses)]
    precision = Precision(NARROW.projection.pixel_angle, EFFECTS[name])
    predicted = precision.sd_m(np.array([distance]), np.cos(np.radians([incidence_deg])))
    assert np.sqrt(np.mean(np.square(np.concatenate(heights)))) == pytest.approx(predicted[0], rel=0.1)


@pytest.mark.long
def test_averaging_and_registration_are_reckoned_with():
    effects, rng = EFFECTS["encoders"], np.random.default_rng(3)
    radius, registration = 0.02, 0.0002
    found = []
    for k in range(400):
        points = measured(over(2.0, 60), NARROW, effects=effects, rng=k)
        inside = np.linalg.norm(points[:, :2], axis=1) < radius
        found.append(points[inside, 2].mean() + rng.normal(0, registration))
    precision = Precision(NARROW.projection.pixel_angle, effects, registration, radius)
    predicted = precision.sd_m(np.array([2.0]), np.array([0.5]))[0]
    assert np.std(found) == pytest.approx(predicted, rel=0.1)  # 1 / sqrt(2 * 400) is 3.5 %
    alone = Precision(NARROW.projection.pixel_angle, effects).sd_m(np.array([2.0]), np.array([0.5]))[0]
    assert predicted < alone / 3
    assert predicted > registration


@pytest.mark.parametrize(
    ("limits", "reason"),
    [
        ({"min_density_per_m2": 4000.0}, "too_sparse"),
        ({"max_sd_m": 0.003}, "too_uncertain"),
        ({"max_range_m": 1.2}, "out_of_range"),
        ({"max_incidence_deg": 30.0}, "grazing"),
        ({"k": 2}, "too_few_views"),
    ],
)
def test_each_limit_has_its_closed_form_and_its_reason(limits, reason):
    """From 1 m above the ground every limit is a disc, within the 75 deg disc that all of it leaves."""
    sensor = PinholeSensor(
        fov_deg=160,
        width=640,
        height=640,
        effects=named_effects("khoshelham2012"),
        max_range_m=20,
        name="wide",
    )
    scene, samples = ground(), sample_surface(ground().mesh, 0.03)
    candidates = Candidates(np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, -1.0]]))
    view = View(Pose.looking_at((0, 0, 1.0), (0, 0, 0)), sensor)
    requirement = Requirement(**{"max_incidence_deg": 65.0, **limits})
    coverage = measure_coverage(scene, [view], requirement, samples=samples, candidates=candidates)
    radius = np.linalg.norm(samples.points[:, :2], axis=1)
    reach = np.hypot(radius, 1.0)
    precision = Precision(sensor.projection.pixel_angle, sensor.effects)
    met = (1 / reach >= requirement.min_cosine) & (reach <= (requirement.max_range_m or 20))
    met &= precision.density_per_m2(reach, 1 / reach) >= limits.get("min_density_per_m2", 0)
    met &= precision.sd_m(reach, 1 / reach) <= limits.get("max_sd_m", 1.0)
    met &= requirement.k == 1
    assert coverage.met == pytest.approx(met.mean(), abs=1e-6)
    assert coverage.reasons()[reason] > 0.01
    assert coverage.met < np.pi * np.tan(np.radians(65)) ** 2 / 36 - 0.01


def test_two_views_meet_what_asks_for_two():
    scene = ground(0.2)
    view = over(1.0, 0)
    wide = PinholeSensor(fov_deg=60)
    views = [View(view, wide), View(over(1.1, 5), wide)]
    candidates = Candidates(np.array([[0, 0, 1.0], [0.1, 0, 1.0]]), np.array([[0.0, 0, -1]]))
    requirement = Requirement(k=2)
    met = [
        measure_coverage(scene, views[:n], requirement, candidates=candidates, sensor=wide).met
        for n in range(3)
    ]
    assert met == [0.0, 0.0, 1.0]
    assert measure_coverage(scene, views, Requirement(k=3), candidates=candidates).reachable == 0.0
    scans = [scan_scene(scene, view, noise="gaussian-1mm", rng=0) for view in views]
    sharp = Requirement(k=2, max_sd_m=0.0005)
    assert measure_scan_coverage(scene, scans, requirement, candidates=candidates).met > 0.95
    with pytest.raises(InputError, match="whose errors are known"):
        measure_scan_coverage(scene, scans, sharp, candidates=candidates)  # of generic60 nothing is known
    noisy = PinholeSensor(effects=named_effects("gaussian-1mm"))
    assert measure_scan_coverage(scene, scans, sharp, candidates=candidates, sensor=noisy).met == 0.0


@pytest.mark.long
def test_offline_plans_meet_repeated_and_exact_measurement():
    room = builtin_scene("two_occluders")
    sensor = PinholeSensor(fov_deg=90, width=400, height=400, name="wide")
    samples = sample_surface(room.mesh, 0.3)
    rng = np.random.default_rng(0)
    candidates = Candidates(
        rng.uniform([0.4, 0.4, 0.4], [5.6, 4.6, 2.3], (40, 3)), np.vstack([np.eye(3), -np.eye(3)])
    )
    budgets = CoverOptions(polish_steps=1000)

    def plan(noise="none", **limits):
        required = Requirement(**limits)
        return plan_views(
            room, sensor, method="cover", candidates=candidates, samples=samples, requirement=required,
            target=0.98, budgets=budgets, noise=noise, rng=0,
        )  # fmt: skip

    once, twice, exact = plan(), plan(k=2), plan(max_sd_m=0.002, noise="khoshelham2012")
    for some in (once, twice, exact):
        assert some.coverage.met_of_reachable >= 0.98
        assert some.lower_bound.views <= len(some.views)
    assert twice.lower_bound.views > len(once.views)
    assert exact.coverage.reachable < once.coverage.reachable
    assert exact.sensor.effects.noise is not None
    with pytest.raises(InputError, match="whose errors are known"):
        plan(max_sd_m=0.001)


def test_a_plan_says_what_the_second_device_of_a_sensor_does_not_see():
    room, rng = builtin_scene("two_occluders"), np.random.default_rng(0)
    positions = rng.uniform([0.4, 0.4, 1.2], [5.6, 4.6, 2.2], (20, 3))
    plan = plan_views(
        room,
        load_sensor("realsense_d435"),
        method="cover",
        candidates=Candidates(positions, np.vstack([np.eye(3), -np.eye(3)])),
        samples=sample_surface(room.mesh, 0.3),
        target=1.0,
        budgets=CoverOptions(polish_steps=100),
        rng=0,
    )
    assert 0.9 < plan.coverage.met_of_reachable < 1
    assert "second device" in plan.stopped_because


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"max_range_m": 0.0}, "max_range_m must be positive"),
        ({"min_density_per_m2": -1.0}, "min_density_per_m2 must be positive"),
        ({"max_sd_m": 0.0}, "max_sd_m must be positive"),
        ({"registration_sd_m": -1.0}, "registration_sd_m must not be negative"),
        ({"averaging_radius_m": np.inf}, "averaging_radius_m must not be negative"),
        ({"k": 0}, "at least 1 view"),
    ],
)
def test_unusable_requirements_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        Requirement(**options)
