# SPDX-License-Identifier: MIT
import numpy as np
import pytest

from completion.fitting.pipeline import fit
from completion.fitting.result import FitError
from scenes.checks import InputError
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere, surfaces_close
from scenes.surfaces.cone import Cone

TRUE = Cylinder((0, 0, 0), (0, 0, 1), 60.0)
LOOK = np.array([-1.0, 0.0, 0.0])


def scanned(arc_deg: float, sigma: float, n: int, rng: np.random.Generator):
    """Points of a cylinder seen from afar, from the middle of the arc, with noise along the rays."""
    half = np.radians(arc_deg) / 2 * TRUE.radius
    points = TRUE.from_uv(np.column_stack([rng.uniform(-half, half, n), rng.uniform(-50, 50, n)]))
    middle = TRUE.from_uv(np.zeros((1, 2)))[0] / TRUE.radius
    rays = np.broadcast_to(-middle, points.shape)
    return points + rng.normal(0, sigma, (n, 1)) * rays, rays


@pytest.mark.parametrize(
    "surface",
    [
        Plane((1, 2, 3), (0, 0.3, 1)),
        Sphere((1, 2, 3), 0.5),
        Cylinder((1, 2, 3), (0.2, 1, 0), 0.5),
        Cone((1, 2, 3), (0, 1, 0.2), 0.5, 0.3),
    ],
    ids=lambda surface: surface.kind,
)
def test_exact_points_are_fitted_exactly(surface):
    uv = np.random.default_rng(0).uniform(-0.2, 0.2, (300, 2))
    points = surface.from_uv(uv)
    ray = surface.normal(points).mean(axis=0) + [0.1, 0.1, 0.2]
    estimate = fit(points, surface.kind, rays=np.broadcast_to(ray, points.shape))
    assert estimate.rms < 1e-10
    assert np.abs(estimate.surface.distance(points)).max() < 1e-9


@pytest.mark.long
@pytest.mark.parametrize(
    ("arc_deg", "sigma"), [(90, 0.5), pytest.param(60, 0.5, marks=pytest.mark.long), (30, 0.1)]
)
def test_range_noise_leaves_no_bias_and_the_predicted_spread(arc_deg, sigma):
    """40 trials: the mean within 4 standard errors, the spread within 4 of its own."""
    rng = np.random.default_rng(1)
    n_trials = 40
    fits = []
    for _ in range(n_trials):
        points, rays = scanned(arc_deg, sigma, 3000, rng)
        fits.append(fit(points, "cylinder", rays=rays))
    radii = np.array([estimate.surface.radius for estimate in fits])
    u = np.mean([estimate.parameter_deviations()["radius"] for estimate in fits])
    assert abs(radii.mean() - TRUE.radius) < 4 * u / np.sqrt(n_trials)
    assert radii.std(ddof=1) / u == pytest.approx(1, abs=4 / np.sqrt(2 * n_trials))


@pytest.mark.long
def test_robust_fits_along_rays_leave_outliers_out_and_predict_their_spread():
    rng = np.random.default_rng(7)
    n_trials, fits = 30, []
    for _ in range(n_trials):
        points, rays = scanned(90, 0.3, 2000, rng)
        points = np.where(
            rng.random((2000, 1)) < 0.2, points + rng.uniform(-20, 20, (2000, 1)) * rays, points
        )
        fits.append(fit(points, "cylinder", rays=rays, robust=True))
    radii = np.array([estimate.surface.radius for estimate in fits])
    u = np.mean([estimate.parameter_deviations()["radius"] for estimate in fits])
    assert abs(radii.mean() - TRUE.radius) < 4 * u / np.sqrt(n_trials)
    assert radii.std(ddof=1) / u == pytest.approx(1, abs=4 / np.sqrt(2 * n_trials))
    assert all(estimate.inliers.sum() == estimate.n for estimate in fits)
    assert 0.75 < np.mean([estimate.n for estimate in fits]) / 2000 < 0.85


def test_the_direction_of_the_rays_does_not_matter_and_their_length_neither():
    points, rays = scanned(90, 0.3, 1000, np.random.default_rng(2))
    along, against = fit(points, "cylinder", rays=rays), fit(points, "cylinder", rays=-3.0 * rays)
    assert surfaces_close(along.surface, against.surface, angle=1e-9, length=1e-7)


def test_grazing_rays_are_left_out():
    points, rays = scanned(180, 0.3, 2000, np.random.default_rng(3))
    assert fit(points, "cylinder", rays=rays).n < len(points)


def test_steps_that_do_not_settle_are_said(monkeypatch):
    points, rays = scanned(90, 0.3, 200, np.random.default_rng(5))
    monkeypatch.setattr("completion.fitting.pipeline._N_STEPS", 1)
    with pytest.raises(FitError, match="no convergence along the rays: 200 points determine no cylinder"):
        fit(points, "cylinder", rays=rays)


def test_rays_are_checked():
    points, rays = scanned(90, 0.1, 100, np.random.default_rng(4))
    with pytest.raises(InputError, match="99 rays for 100 points"):
        fit(points, "cylinder", rays=rays[1:])
    with pytest.raises(InputError, match="robust fits and errors along rays are Euclidean; drop"):
        fit(points, "cylinder", rays=rays, metric="taubin")
    with pytest.raises(InputError, match=r"1 of 100 rays have no length; is a point at the scanner\?"):
        fit(points, "cylinder", rays=np.where(np.arange(100)[:, None] == 7, 0.0, rays))
    with pytest.raises(FitError, match="of 100 rays meet it"):
        fit(points, "cylinder", rays=np.broadcast_to([0.0, 0, 1], points.shape))
    with pytest.raises(InputError, match="1 of 100 rays are not finite"):
        fit(points, "cylinder", rays=np.where(np.arange(100)[:, None] == 7, np.nan, rays))
