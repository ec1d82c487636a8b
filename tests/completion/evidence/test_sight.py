# SPDX-License-Identifier: MIT
"""The compiled loops of evidence against the plain formulas, place by place and beam by beam."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.form import chart_of, form_of, place_of, reach_of, slope_at
from completion.evidence.free_space import free_cells
from completion.evidence.reach import reach_of as tiles_of
from completion.evidence.sight import look, pixel_of, sight_of
from completion.observe.observation import observe
from completion.observe.tolerance import EvidenceOptions
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere

TOLERANCE = EvidenceOptions(registration_m=0.001).tolerance()
POSE = Pose.looking_at((0.4, -0.3, 0.2), (3.0, 1.0, 0.5))
UNEVEN = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.05, 40)) - 0.6
CAMERAS = {
    "camera": PinholeProjection.from_fov(60, 40, 70),
    "upside down": PinholeProjection(60, 40, 40.0, -45.0, 31.0, 18.0),
    "panorama": SphericalProjection.regular(90, 40, 360.0, (-45.0, 60.0)),
    "uneven": SphericalProjection(-np.concatenate([UNEVEN, UNEVEN + 1.5]), UNEVEN),
    "one row": SphericalProjection(np.linspace(-1, 1, 70), np.array([0.1])),
}
SURFACES = {
    "plane": Plane((3, 1, 0), (-1, 0.2, 0.1), (0, 0, 1)),
    "turned away": Plane((3, 1, 0), (1, 0.2, 0.1), (0, 0, 1)),
    "column": Cylinder((3, 1, 0), (0.1, 0.2, 1), 0.6),
    "vault": Cylinder((1, 0, 0), (1.0, 0.1, 0), 2.0, (0, 0, 1), concave=True),
}
each_camera = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
each_surface = pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES)


def observed(camera, noise_sigma_m=0.004, seed=0):
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(1.0, 6.0, camera.shape)
    ranges[rng.random(camera.shape) < 0.1] = np.inf
    return observe(RangeImage(ranges, camera, POSE, sigma_m=noise_sigma_m), Pose.identity())


@each_camera
def test_places_are_seen_by_the_pixels_that_the_projection_says(camera):
    sight = sight_of(observed(camera), TOLERANCE)
    places = np.random.default_rng(2).normal(0, 3, (2000, 3))
    row, column = np.rint(observed(camera).scan.pixels(places)).T
    expected = np.where(np.isfinite(row + column), row * camera.shape[1] + column, -1)
    assert [pixel_of(sight.eye, sight.angles, tuple(place)) for place in places.tolist()] == expected.tolist()
    assert (expected >= 0).any()
    assert (expected < 0).any()


@each_surface
def test_forms_have_the_charts_rays_and_normals_of_their_surfaces(surface):
    form, rng = form_of(surface), np.random.default_rng(3)
    rays = rng.normal(size=(300, 3))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    origin = np.array([0.4, -0.3, 0.2])
    for from_within in (False, True):
        face = surface
        if isinstance(surface, Plane) and from_within:
            face = surface.flip()
        if isinstance(surface, Cylinder):
            concave = from_within
            face = Cylinder(surface.point, surface.direction, surface.radius, surface.zero_direction, concave)
        found = [reach_of(form, tuple(origin), tuple(ray), from_within) for ray in rays.tolist()]
        np.testing.assert_allclose(found, face.ray_ranges(origin, rays), rtol=1e-10)
    uv = rng.uniform(-1, 1, (100, 2))
    places = surface.from_uv(uv)
    np.testing.assert_allclose([place_of(form, *pair) for pair in uv.tolist()], places, atol=1e-12)
    np.testing.assert_allclose([chart_of(form, tuple(one)) for one in places.tolist()], uv, atol=1e-12)
    slope = [slope_at(form, tuple(one), tuple(ray)) for one, ray in zip(places, rays, strict=False)]
    expected = np.einsum("ij,ij->i", surface.normal(places), rays[:100])
    np.testing.assert_allclose(slope, expected, atol=1e-12)


@each_camera
@each_surface
def test_a_look_compares_ranges_by_the_tolerance_along_the_ray(surface, camera):
    seen = observed(camera)
    sight, form = sight_of(seen, TOLERANCE), form_of(surface)
    places = surface.from_uv(np.random.default_rng(4).uniform(-2, 2, (200, 2)))
    pixel = np.array([pixel_of(sight.eye, sight.angles, tuple(place)) for place in places.tolist()])
    places, pixel = places[pixel >= 0], pixel[pixel >= 0]
    beams = np.stack([sight.ranges[pixel], seen.sigma_at(pixel)], axis=1).tolist()
    found = [
        look(sight.eye, form, tuple(place), 0.002, tuple(beam))
        for place, beam in zip(places.tolist(), beams, strict=True)
    ]
    ray = places - seen.scan.origin
    distance = np.linalg.norm(ray, axis=1)
    cosine = np.abs(np.einsum("ij,ij->i", ray, surface.normal(places))) / distance
    safe = np.maximum(cosine, 1e-3)
    oblique = distance * camera.pixel_angle * np.sqrt(1 - safe**2) / safe / 2
    sigma = seen.sigma_at(pixel)
    allowed = TOLERANCE.along_ray(sigma, np.full(len(pixel), 0.002), cosine) + oblique
    np.testing.assert_allclose([one.distance for one in found], distance, rtol=1e-12)
    np.testing.assert_allclose([one.cosine for one in found], cosine, atol=1e-12)
    behind = distance - seen.scan.ranges.ravel()[pixel]
    np.testing.assert_allclose([one.behind for one in found], behind, atol=1e-12)
    np.testing.assert_allclose([one.allowed for one in found], allowed, rtol=1e-6)


@pytest.mark.parametrize("noise_sigma_m", [0.0, 0.004])
@each_surface
def test_cells_are_vetoed_by_the_beams_that_meet_them_before_they_end(surface, noise_sigma_m):
    full_turn = isinstance(surface, Cylinder)
    grid = ChartGrid.over(surface, (-1.5, -1.5), (1.5, 1.5), 0.12, full_turn=full_turn)
    scans = [observed(CAMERAS[name], noise_sigma_m, seed=k) for k, name in enumerate(("camera", "panorama"))]
    sd = np.full(grid.shape[0] * grid.shape[1], 0.002)
    count = np.zeros(grid.shape)
    for seen in scans:
        rays, measured = seen.scan.rays()[seen.valid], seen.scan.ranges[seen.valid]
        sigma, origin = seen.noise.deviation(measured), seen.scan.origin
        faces = [surface, surface.flip()] if isinstance(surface, Plane) else [
            Cylinder(surface.point, surface.direction, surface.radius, surface.zero_direction, concave)
            for concave in (False, True)
        ]  # fmt: skip
        for face in faces:
            reach = face.ray_ranges(origin, rays)
            through = np.flatnonzero(reach < measured)
            index, cell = grid.cells_of(origin + reach[through, None] * rays[through])
            hit = through[index]
            at = origin + reach[hit, None] * rays[hit]
            cosine = np.abs(np.einsum("ij,ij->i", rays[hit], face.normal(at)))
            allowed = TOLERANCE.along_ray(sigma[hit], sd[cell], cosine)
            beyond = (measured[hit] - reach[hit] > allowed) & (allowed <= TOLERANCE.max_m)
            count += np.bincount(cell[beyond], minlength=count.size).reshape(grid.shape)

    def around(values):
        padded = np.pad(values, ((1, 1), (0, 0)))
        padded = np.pad(padded, ((0, 0), (1, 1)), mode="wrap" if grid.wraps else "constant")
        return np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).sum(axis=(2, 3))

    expected = count > 0
    if noise_sigma_m:
        expected &= around(count) >= 2
    if full_turn:
        expected = around(expected) > 0
    sights = [sight_of(seen, TOLERANCE) for seen in scans]
    found = free_cells(grid, sd, sights, list(map(tiles_of, scans)))
    assert expected.any()
    np.testing.assert_array_equal(found.reshape(grid.shape), expected)


def test_what_no_loop_knows_is_refused():
    with pytest.raises(TypeError, match="no scan can be held against a Sphere"):
        form_of(Sphere((0, 0, 0), 1.0))
    seen = observed(CAMERAS["camera"])
    strange = SimpleNamespace(projection=object(), world_from_sensor=POSE)
    with pytest.raises(TypeError, match="points cannot be projected into a object"):
        sight_of(replace(seen, scan=strange), TOLERANCE)
    unknown = SimpleNamespace(projection=object(), ranges=seen.scan.ranges)
    with pytest.raises(TypeError, match="points cannot be projected into a object"):
        tiles_of(replace(seen, scan=unknown))
