# SPDX-License-Identifier: MIT
"""What is known of tiles holds for each of their pixels; what is left out changes nothing."""

from functools import cache

import numpy as np
import pytest

from completion.evidence import weighing as module
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Scans
from completion.evidence.form import form_of
from completion.evidence.free_space import Rectangle, crossing_tiles, free_cells
from completion.evidence.reach import TILE, farthest_along, is_beyond, progress_of, reach_of
from completion.evidence.sight import look, pixel_of, sight_of, window_of
from completion.evidence.weighing import weigh
from completion.extension.grid import farthest_hidden
from completion.observe.observation import observe
from completion.observe.rays import deviation_at, triple
from scenes.io.scan_files import read_scan
from scenes.pose import Pose
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane
from tests.completion.evidence.scans_that_stray import (
    KINDS,
    TOLERANCE,
    draw_scan,
    draw_scans,
    without_reach,
)
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.long_cases import first_in_gate

POST = Cylinder((0.9, 0.4, 0.0), (0.1, 0.2, 1.0), 0.25)
TUNNEL = Cylinder((0.0, 0.1, 0.0), (1.0, 0.1, 0.0), 1.9, concave=True)
SURFACES = {
    "wall": (Plane((0.0, 2.0, 0.0), (0.0, -1.0, 0.0)), 4.0),
    "wall behind": (Plane((0.0, 2.12, 0.0), (0.0, 1.0, 0.0)), 9.0),
    "table": (Plane((0.5, 0.2, -0.4), (0.02, 0.01, 1.0)), 0.7),
    "slanted": (Plane((0.5, 0.2, 0.1), (0.2, 1.0, 0.3)), 9.0),
    "post": (POST, 1.5),
    "part of a post": (POST, 0.2),
    "tunnel": (TUNNEL, 4.0),
}


def grid_of(name):
    surface, half = SURFACES[name]
    full_turn = name == "post"
    return ChartGrid.over(surface, np.full(2, -half), np.full(2, half), half / 50, full_turn=full_turn)


@cache
def seen_of(kind, seed):
    """A drawn scan as it was observed, at the origin."""
    return observe(draw_scan(kind, seed), Pose.identity(), 0.003)


@cache
def known_of(kind, seed):
    """The same with what beams and tiles of it tell."""
    return seen_of(kind, seed), sight_of(seen_of(kind, seed), TOLERANCE), reach_of(seen_of(kind, seed))


def places_on(plane, middle, radius, rng, n=150):
    turn = rng.uniform(0, 2 * np.pi, n)
    at = plane.to_uv(middle[None]) + (radius * np.sqrt(rng.random(n)) * [np.cos(turn), np.sin(turn)]).T
    return plane.from_uv(at)


@pytest.mark.parametrize("kind", first_in_gate(4, KINDS))
def test_boxes_and_parts_bound_all_points_of_their_tile(kind):
    seen, rng = seen_of(kind, 3), np.random.default_rng(0)
    reach, (rows, columns) = reach_of(seen), seen.valid.shape
    points = seen.points_at(np.arange(rows * columns)).reshape(rows, columns, 3) - seen.scan.origin
    directions = rng.normal(size=(20, 3))
    for i, j in np.ndindex(reach.far.shape):
        here = (slice(i * TILE, (i + 1) * TILE), slice(j * TILE, (j + 1) * TILE))
        held = points[here][seen.valid[here]]
        assert (len(held) == 0) == (reach.far[i, j] < 0)
        if len(held):
            assert np.linalg.norm(held, axis=1).max() <= reach.far[i, j] * (1 + 1e-12)
            for direction in directions:
                bound, most = farthest_along(reach.boxes, i, j, triple(direction)), (held @ direction).max()
                assert most <= bound + 1e-6
    whole = np.full((reach.part.shape[0] * 4, reach.part.shape[1] * 4), -np.inf)
    whole[:rows, :columns] = np.where(seen.valid, seen.scan.ranges, -np.inf)
    assert (whole <= np.kron(reach.part, np.ones((4, 4)))).all()


def test_reach_takes_half_a_byte_a_pixel():
    camera = SphericalProjection.regular(320, 160, 360.0, (-45.0, 60.0))
    seen = observe(RangeImage(np.full(camera.shape, 2.0), camera, Pose.identity()), Pose.identity(), 0.001)
    assert sum(array.nbytes for array in reach_of(seen)) <= 0.5 * seen.valid.size


@pytest.mark.parametrize("kind", KINDS)
def test_windows_hold_the_pixels_of_all_places_in_a_sphere(kind):
    rng, n_empty, n_small = np.random.default_rng(2), 0, 0
    for trial in range(80):
        sight = known_of(kind, trial % 5)[1]
        middle = np.array(sight.eye.origin) + rng.normal(size=3) * rng.choice([0.3, 1.0, 5.0])
        radius = float(rng.choice([0.01, 0.2, 1.0]))
        top, bottom, left, right = window_of(sight.eye, sight.angles, triple(middle), radius)
        offsets = rng.normal(size=(100, 3))
        offsets *= radius * rng.random((100, 1)) ** 0.2 / np.linalg.norm(offsets, axis=1, keepdims=True)
        pixels = np.array([pixel_of(sight.eye, sight.angles, triple(place)) for place in middle + offsets])
        row, column = np.divmod(pixels[pixels >= 0], sight.eye.shape[1])
        assert ((row >= top) & (row <= bottom) & (column >= left) & (column <= right)).all()
        n_empty += bottom < 0 or right < 0
        n_small += 0 <= right - left < sight.eye.shape[1] // 2
    assert n_small > 5
    assert n_empty > 5 or kind.startswith("turning")


@pytest.mark.parametrize("kind", first_in_gate(4, KINDS))
def test_beyond_means_hidden_at_every_place(kind):
    rng, n_beyond, n_before = np.random.default_rng(5), 0, 0
    behind = SURFACES["wall behind"][0].flip()
    walls = [SURFACES["wall"][0], Plane(behind.point + 0.2, behind.normal_direction), behind]
    for trial in range(200):
        seen, sight, reach = known_of(kind, trial % 20)
        plane, radius = walls[trial % 3], float(rng.choice([0.02, 0.1, 0.5]))
        rays = seen.rays_at(rng.integers(0, seen.valid.size, 50))
        reached = plane.ray_ranges(seen.scan.origin, rays)
        meets = np.flatnonzero((reached > 0.3) & (reached < 9))
        if not len(meets):
            continue
        middle = seen.scan.origin + reached[meets[0]] * rays[meets[0]]
        height, sd = float(plane.distance(seen.scan.origin[None])[0]), float(rng.uniform(0, 0.004))
        window = window_of(sight.eye, sight.angles, triple(middle), radius)
        if window[1] < 0 or window[3] < 0:
            continue
        progress = progress_of(reach, triple(-np.sign(height) * plane.normal_direction))
        distance = float(np.linalg.norm(middle - seen.scan.origin))
        said = [
            is_beyond(sight, reach, told, window, distance, radius, height, sd)
            for told in (progress, np.full_like(progress, 1e9))
        ]
        n_before += said[0] > said[1]  # by how far the tiles got towards the plane alone
        if not said[0]:
            continue
        n_beyond += 1
        for place in places_on(plane, middle, radius, rng):
            pixel = pixel_of(sight.eye, sight.angles, triple(place))
            if pixel >= 0 and np.isfinite(sight.ranges[pixel]):
                beam = sight.ranges[pixel], deviation_at(sight.noise, sight.ranges[pixel])
                found = look(sight.eye, form_of(plane), triple(place), sd, beam)
                assert found.behind > found.allowed
    assert n_beyond > 8
    assert n_before > 0 or kind == "turning" or kind.endswith("off the grid")  # too coarse, too far off


@pytest.mark.parametrize("name", SURFACES)
def test_tiles_that_cross_nothing_hold_no_beam_that_counts(name):
    grid, n_left_out = grid_of(name), 0
    sd = np.full(grid.shape[0] * grid.shape[1], 0.001)
    part = Rectangle(*(float(x) for pair in zip(grid.corner, grid.corner + grid.cell * grid.shape[::-1],
                                                strict=True) for x in pair))  # fmt: skip
    for noise_m in (0.0, 0.003):
        scans = draw_scans(KINDS, noise_m)
        plain = without_reach(scans)
        for sight, reach, nothing in zip(scans.sights, scans.reach, plain.reach, strict=True):
            crossing = crossing_tiles(sight.eye, sight.noise, form_of(grid.surface), reach, part, 0.001)
            n_left_out += np.count_nonzero(~crossing & (reach.far > 0))
            found = free_cells(grid, sd, [sight], [reach])
            np.testing.assert_array_equal(found, free_cells(grid, sd, [sight], [nothing]))
    assert n_left_out > 20


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("noise_m", [0.0, 0.003])
def test_evidence_is_the_same_with_what_is_left_out_and_without(name, noise_m):
    scans, grid = draw_scans(KINDS * 2, noise_m), grid_of(name)
    sd = np.random.default_rng(4).uniform(0, 0.003, grid.shape[0] * grid.shape[1])
    found, plain = weigh(grid, sd, scans, 1), weigh(grid, sd, without_reach(scans), 1)
    for part in Evidence.__slots__:
        np.testing.assert_array_equal(getattr(found, part), getattr(plain, part), err_msg=part)
    assert min(grid.shape) > module._BLOCK
    assert len(np.unique(found.labels)) >= 3


@pytest.mark.parametrize("name", [name for name in SURFACES if isinstance(SURFACES[name][0], Plane)])
def test_the_farthest_hidden_places_are_the_same_with_what_is_left_out(name):
    scans, (chart, half) = draw_scans(KINDS * 2), SURFACES[name]
    for plane in (chart, chart.flip()):
        for low, high in ((-half, half), (-half, -half / 2), (0.1, half / 3)):
            corners = np.array([low, low / 2]), np.array([high, half])
            found, plain = (farthest_hidden(plane, *corners, held) for held in (scans, without_reach(scans)))
            np.testing.assert_array_equal(found, plain)


@requires_data
@pytest.mark.parametrize("name", ["range/pcl/office1.pcd", "range/e57/pumpA.e57"])
def test_evidence_of_real_scans_is_the_same_with_what_is_left_out(name):
    seen, rng = observe(read_scan(data_path(name)), Pose.identity(), 0.002), np.random.default_rng(1)
    points = seen.points_at(rng.choice(np.flatnonzero(seen.valid), 6))
    scans = Scans((seen,), (np.zeros(seen.valid.shape, np.int32),), TOLERANCE)
    plain = without_reach(scans)
    for number, point in enumerate(points):
        normal = rng.normal(size=3)
        surface = Plane(point, normal) if number % 2 else Cylinder(point, normal, float(rng.uniform(0.05, 1)))
        grid = ChartGrid.over(surface, np.full(2, -1.5), np.full(2, 1.5), 0.02, full_turn=False)
        sd = np.full(grid.shape[0] * grid.shape[1], 0.001)
        found, full = weigh(grid, sd, scans, 1), weigh(grid, sd, plain, 1)
        for part in Evidence.__slots__:
            np.testing.assert_array_equal(getattr(found, part), getattr(full, part), err_msg=part)
