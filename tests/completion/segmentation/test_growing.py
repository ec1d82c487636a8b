"""Truth tables of growing: tiles on known planes in, the tiles that one plane explains out."""

import cv2
import numpy as np
import pytest

from completion.observe.packed_surfaces import pack_plane
from completion.observe.rays import Noise, rays_of
from completion.observe.tiles import cut_tiles
from completion.segmentation.growing import (
    depths_within,
    deviations,
    find_seeds,
    flood,
    grow_plane,
    next_seed,
    tile_cut,
    with_smooth_ring,
)
from completion.segmentation.regions import SegmentationOptions
from scenes import PinholeProjection, Pose, RangeImage

SIDE, COLUMNS, SIGMA = 4, 8, 0.001
OPTIONS = SegmentationOptions()
CUT, ANGLE = tile_cut(OPTIONS), np.radians(OPTIONS.max_angle_deg)
MIDDLE = 2.0 * (COLUMNS // 2 - COLUMNS / 2) * SIDE / 100  # x where the wall's fourth tile ends


def leaning(degrees):
    """The w of a plane w . x = 1 that leaves the wall z = 2 by an angle, at the end of the fourth tile."""
    slope = np.tan(np.radians(degrees))
    return np.array([-slope, 0.0, 1.0]) / (2.0 - slope * MIDDLE)


PLANES = {
    "w": np.array([0, 0, 1 / 2.0]),  # a wall 2 m away
    "s": np.array([0, 0, 1 / 2.2]),  # another, 20 cm behind it
    "t": np.array([0, 0, 1 / 2.001]),  # another, one standard deviation behind it
    "c": leaning(60.0),  # meets the wall in a crease
    "b": leaning(10.0),  # bends away from it by less than the largest angle
}


def tiles_of(picture):
    """Tiles of a pinhole image, each on the plane that its letter names; a dot is a tile without returns."""
    letters = np.repeat(np.repeat(np.array([list(row) for row in picture]), SIDE, axis=0), SIDE, axis=1)
    height, width = letters.shape
    camera = PinholeProjection(width, height, 100.0, 100.0, (width - 1) / 2, (height - 1) / 2)
    rays, ranges = camera.directions(), np.full(letters.shape, np.inf)
    for letter, w in PLANES.items():
        ranges = np.where(letters == letter, 1 / (rays @ w), ranges)
    of_image = rays_of(RangeImage(ranges, camera, Pose.identity()))
    return cut_tiles(ranges, of_image, Noise(SIGMA, 0.0, 0.0), 0.0, SIDE), ranges, rays


def drawn(members):
    return ["".join("x" if taken else "-" for taken in row) for row in members]


def free_of(picture):
    return np.array([[letter not in ".#" for letter in row] for row in picture])


TABLE = {
    "a wall whole": (["wwwwwwww"] * 3, (1, 1), ["xxxxxxxx"] * 3),
    "up to a step": (["wwwwssss"] * 3, (1, 1), ["xxxx----"] * 3),
    "from behind the step": (["wwwwssss"] * 3, (1, 6), ["----xxxx"] * 3),
    "up to a crease": (["wwwwcccc"] * 3, (1, 1), ["xxxx----"] * 3),
    "up to a bend within the angle": (["wwwwbbbb"] * 3, (1, 1), ["xxxx----"] * 3),
    "around a thing before it": (
        ["wwwwwwww", "wwssswww", "wwwwwwww"],
        (0, 0),
        ["xxxxxxxx", "xx---xxx", "xxxxxxxx"],
    ),
    "not to an island": (["ww.wwwww", "ww.wwwww", "ww.wwwww"], (1, 0), ["xx------"] * 3),
    "not across a corner": (
        ["www.wwww", "www.wwww", "....wwww"],
        (0, 0),
        ["xxx-----", "xxx-----", "--------"],
    ),
    "through a door": (["www.wwww", "wwwwwwww", "www.wwww"], (0, 0), ["xxx-xxxx", "xxxxxxxx", "xxx-xxxx"]),
}


@pytest.mark.parametrize("name", TABLE)
def test_a_plane_takes_its_own_connected_tiles(name):
    picture, seed, expected = TABLE[name]
    tiles, ranges, _ = tiles_of(picture)
    cluster = grow_plane(seed, free_of(picture), tiles, CUT, ANGLE)
    assert drawn(cluster.tiles) == expected
    assert cluster.n_pixels == SIDE**2 * cluster.tiles.sum()
    np.testing.assert_allclose(cluster.model, pack_plane(PLANES[picture[seed[0]][seed[1]]]), atol=1e-9)
    assert np.isfinite(ranges).sum() == tiles.count.sum()


def test_tiles_that_are_taken_already_stop_it():
    picture = ["wwww#www", "wwww#www", "wwww#www"]
    tiles, *_ = tiles_of([row.replace("#", "w") for row in picture])
    assert drawn(grow_plane((1, 1), free_of(picture), tiles, CUT, ANGLE).tiles) == ["xxxx----"] * 3


def test_a_seed_that_is_taken_grows_to_nothing():
    tiles, *_ = tiles_of(["wwwwwwww"] * 3)
    assert grow_plane((1, 1), np.zeros((3, 8), dtype=bool), tiles, CUT, ANGLE) is None


def test_a_surface_within_the_noise_is_the_same_one():
    tiles, *_ = tiles_of(["wwwwtttt"] * 3)
    assert grow_plane((1, 1), np.ones((3, 8), dtype=bool), tiles, CUT, ANGLE).tiles.all()


@pytest.mark.parametrize(("plane", "taken"), [("w", 12), ("s", 0)])
def test_a_flood_takes_what_lies_on_the_given_plane(plane, taken):
    tiles, *_ = tiles_of(["wwwwssss"] * 3)
    free = np.ones((3, 8), dtype=bool)
    found, *_, n = flood(pack_plane(PLANES[plane]), (1, 1), free, tiles, CUT, max_angle=ANGLE)
    assert found.sum() == n == taken


@pytest.mark.parametrize(("beyond", "ring"), [("b", "-xxxx---"), ("c", "-xxx----"), ("s", "-xxx----")])
def test_a_ring_goes_on_over_bends_but_not_over_creases_or_steps(beyond, ring):
    picture = ["wwww" + 4 * beyond] * 3
    tiles, *_ = tiles_of(picture)
    members = np.zeros((3, 8), dtype=bool)
    members[:, 2:4] = True
    assert drawn(with_smooth_ring(members, np.ones((3, 8), dtype=bool), tiles, ANGLE)) == [ring] * 3


def test_deviations_are_squared_inverse_ranges_over_their_errors():
    tiles, ranges, rays = tiles_of(["wwwwwwww"] * 3)
    every = np.argwhere(np.ones((3, 8)))
    found = deviations(pack_plane(PLANES["s"]), every, tiles.matrix, tiles.plane, tiles.centre)
    off = ranges**2 / SIGMA * (rays @ (PLANES["s"] - PLANES["w"]))
    each = np.square(off).reshape(3, SIDE, 8, SIDE).sum(axis=(1, 3)).ravel()
    np.testing.assert_allclose(found, each, rtol=1e-6)


def test_seeds_lie_on_flat_tiles_and_first_in_the_middle_of_the_largest_area():
    picture = ["wwwwwscs", "wwwwwcsc", "wwwwwscs", "wwwwwcsc", "wwwww..."]
    seeds = find_seeds(tiles_of(picture)[0])
    assert drawn(seeds.flat) == ["xxxxxxxx"] * 4 + ["xxxxx---"]
    assert seeds.coherent[2, 2]
    assert not seeds.coherent[1:3, 6].any()
    area = np.zeros((7, 9), dtype=bool)
    area[1:6, 2:7] = area[0, 0] = True
    assert next_seed(area, depths_within(area)) == (3, 4)
    assert next_seed(area & ~area, depths_within(area)) is None


def test_seeds_of_an_area_that_shrinks_are_the_deepest_by_a_transform_of_each_of_its_states():
    rng = np.random.default_rng(0)
    area = rng.random((40, 60)) < 0.97
    depths, n_steps = depths_within(area), 0
    while (seed := next_seed(area, depths)) is not None:
        whole = cv2.distanceTransform(np.pad(area, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
        first = np.argmax(whole > whole.max() - 1e-5)  # what is equally deep differs by rounding there
        assert seed == np.unravel_index(first, whole.shape)
        reach = int(rng.integers(4))
        area[max(seed[0] - reach, 0) : seed[0] + 2, max(seed[1] - reach, 0) : seed[1] + reach + 1] = False
        n_steps += 1
    assert n_steps > 100
    assert not area.any()
