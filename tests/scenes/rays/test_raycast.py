# SPDX-License-Identifier: MIT
"""Embree's hits against closed forms and a brute force in numpy, and what must not matter."""

import numpy as np
import pytest
from hypothesis import given, settings

from scenes.checks import BoolArray, FloatArray, InputError, IntArray
from scenes.pose import Pose
from scenes.rays.raycast import Hits, RayCaster
from scenes.surfaces.catalogue import Cylinder
from scenes.world.builtin import builtin_scene
from tests.helpers.strategies import EPS, law, poses, seeds

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float), np.array([[0, 1, 2], [0, 2, 3]])
FLOAT32 = float(np.finfo(np.float32).eps)


def unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), np.float64)


def assert_same_hits(first: Hits, second: Hits) -> None:
    for name in ("ranges", "face", "barycentric", "incidence_cosine"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


def brute_force(
    vertices: FloatArray, faces: IntArray, origins: FloatArray, along: FloatArray
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Moller and Trumbore for all pairs: nearest face, its range, and which rays leave no doubt."""
    corner, second, third = np.moveaxis(vertices[faces], 1, 0)
    first_edge, second_edge = second - corner, third - corner
    across = np.cross(along[:, None], second_edge[None])
    determinant = np.einsum("rfi,fi->rf", across, first_edge)
    offset = origins[:, None] - corner[None]
    u = np.einsum("rfi,rfi->rf", offset, across) / determinant
    turned = np.cross(offset, np.broadcast_to(first_edge, offset.shape))
    v = np.einsum("ri,rfi->rf", along, turned) / determinant
    ranges = np.einsum("fi,rfi->rf", second_edge, turned) / determinant
    margin = np.minimum(np.minimum(u, v), 1 - u - v)
    hit = (margin >= 0) & (ranges > 0)
    near_an_edge = (np.abs(margin) < 1e-3) | (np.abs(ranges) < 1e-3) | (np.abs(determinant) < 1e-4)
    reached = np.where(hit, ranges, np.inf)
    nearest = reached.argmin(axis=1)
    best = reached.min(axis=1)
    gap = np.partition(reached, 1, axis=1)[:, 1] - np.where(np.isfinite(best), best, 0.0)
    return np.where(np.isfinite(best), nearest, -1), best, ~near_an_edge.any(axis=1) & (gap > 1e-4)


@settings(law, max_examples=25)
@given(seeds)
def test_first_hits_agree_with_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.uniform(-1, 1, (40, 3))
    faces = np.array([rng.choice(40, 3, replace=False) for _ in range(30)])
    origins, along = rng.uniform(-2, 2, (300, 3)), unit(rng.normal(size=(300, 3)))
    hits = RayCaster(vertices, faces).first_hit(origins, along * rng.uniform(0.1, 10, (300, 1)))
    face, ranges, clear = brute_force(vertices, faces, origins, along)
    assert clear.mean() > 0.5
    np.testing.assert_array_equal(hits.face[clear], face[clear])
    np.testing.assert_allclose(hits.ranges[clear], ranges[clear], atol=1e4 * 16 * EPS, rtol=0)
    np.testing.assert_array_equal(hits.hit, np.isfinite(hits.ranges))


@law
@given(seeds)
def test_weights_reproduce_the_hit_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, faces = rng.uniform(-1, 1, (30, 3)), rng.integers(0, 30, (20, 3))
    origins, along = rng.uniform(-2, 2, (500, 3)), unit(rng.normal(size=(500, 3)))
    hits = RayCaster(vertices, faces).first_hit(origins, along)
    hit = hits.hit
    assert (hits.barycentric[~hit] == 0).all()
    assert (hits.incidence_cosine[~hit] == 0).all()
    assert (hits.barycentric >= 0).all()
    np.testing.assert_allclose(hits.barycentric[hit].sum(axis=1), 1, atol=4 * EPS)
    corners = vertices[faces[hits.face[hit]]]
    by_weights = np.einsum("nc,nci->ni", hits.barycentric[hit], corners)
    by_range = origins[hit] + hits.ranges[hit, None] * along[hit]
    # Embree decides in float32: beside an edge the ray may miss the face by that much, stretched by slant.
    error = np.linalg.norm(by_weights - by_range, axis=1) * hits.incidence_cosine[hit]
    assert error.max(initial=0.0) < 16 * FLOAT32
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cosine = np.abs(np.einsum("ni,ni->n", unit(normals), along[hit]))
    np.testing.assert_allclose(hits.incidence_cosine[hit], cosine, atol=1e-12, rtol=0)


@settings(law, max_examples=20)
@given(seeds)
def test_grazing_rays_stay_within_the_face_they_hit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, faces = rng.normal(size=(30, 3)), rng.integers(0, 30, (50, 3))
    corners = vertices[faces[rng.integers(0, 50, 5000)]]
    targets = np.einsum("nc,nci->ni", rng.dirichlet([1, 1, 1], 5000), corners)
    weights = rng.normal(size=(5000, 2, 1)) * 3
    in_plane = weights[:, 0] * (corners[:, 1] - corners[:, 0]) + weights[:, 1] * (
        corners[:, 2] - corners[:, 0]
    )
    moving = np.linalg.norm(in_plane, axis=1) > 0
    origins, along = (targets + in_plane)[moving], -in_plane[moving]
    hits = RayCaster(vertices, faces).first_hit(origins, along)
    hit = hits.hit
    assert hit.any()
    depths = np.einsum("nci,ni->nc", vertices[faces[hits.face[hit]]] - origins[hit, None], unit(along[hit]))
    assert (hits.ranges[hit] >= np.maximum(depths.min(axis=1), 0) - 1e-12).all()
    assert (hits.ranges[hit] <= np.maximum(depths.max(axis=1), 0) + 1e-12).all()
    assert np.isfinite(hits.barycentric).all()


def test_a_square_from_above_below_and_beside() -> None:
    square = RayCaster(*SQUARE)
    assert square.n_faces == 2
    origins = [[0.7, 0.2, 2], [0.2, 0.7, 2], [0.7, 0.2, -3], [1.01, 0.5, 2], [0.5, 0.25, 2], [-1, 0.5, 1e-3]]
    along = [[0, 0, -1], [0, 0, -5], [0, 0, 1], [0, 0, -1], [0, 0, 1], [1, 0, 0]]
    hits = square.first_hit(origins, along)
    assert hits.ranges.tolist() == [2, 2, 3, np.inf, np.inf, np.inf]
    assert hits.face.tolist() == [0, 1, 0, -1, -1, -1]
    assert hits.hit.tolist() == [True, True, True, False, False, False]
    assert hits.incidence_cosine.tolist() == [1, 1, 1, 0, 0, 0]
    np.testing.assert_allclose(hits.barycentric[0], [0.3, 0.5, 0.2], atol=4 * EPS)
    assert hits.n_not_finite == 0


def test_a_slanted_ray_has_its_cosine() -> None:
    hits = RayCaster(*SQUARE).first_hit([[-2.5, 0.25, 4.0]], [[3, 0, -4]])
    np.testing.assert_allclose([hits.ranges[0], hits.incidence_cosine[0]], [5, 0.8], atol=8 * EPS)


def box(low: FloatArray, high: FloatArray) -> tuple[FloatArray, IntArray]:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return corners, np.array([face for a, b, c, d in quads for face in ([a, b, c], [a, c, d])])


def range_within_box(low: FloatArray, high: FloatArray, origins: FloatArray, along: FloatArray) -> FloatArray:
    with np.errstate(divide="ignore"):
        walls = np.maximum((low - origins) / along, (high - origins) / along)
    return np.asarray(walls.min(axis=1), np.float64)


@pytest.mark.parametrize("centre", [(0, 0, 0), (5e5, 5e6, 100)])
def test_within_a_box_every_ray_meets_the_wall(centre: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(1)
    low, high = np.array(centre) - [3, 2.5, 1.3], np.array(centre) + [3, 2.5, 1.3]
    origins, along = rng.uniform(low + 0.1, high - 0.1, (20_000, 3)), unit(rng.normal(size=(20_000, 3)))
    hits = RayCaster(*box(low, high)).first_hit(origins, along)
    expected = range_within_box(low, high, origins, along)
    # At an edge float32 may name either wall: there an error of 1e-6 m may show; elsewhere float64 rules.
    error = np.abs(hits.ranges - expected)
    assert error.max() < 1e-5
    assert np.mean(error < 1e-8) > 0.999


def test_a_tessellated_cylinder_lies_within_its_sagitta() -> None:
    n, radius = 64, 0.35
    post = Cylinder((1, 2, 0), (0, 0, 1), radius)
    arc = np.linspace(0, 2 * np.pi * radius, n + 1)
    ring = [post.from_uv(np.column_stack([arc, np.full(n + 1, height)])) for height in (0.0, 2.0)]
    i = np.arange(n)
    lower = np.column_stack([i, i + 1, i + n + 2])
    upper = np.column_stack([i, i + n + 2, i + n + 1])
    caster = RayCaster(np.concatenate(ring), np.concatenate([lower, upper]))
    rng = np.random.default_rng(2)
    angle, height = rng.uniform(-np.pi, np.pi, 5000), rng.uniform(0.1, 1.9, 5000)
    outward = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(5000)])
    origins = np.array([1.0, 2, 0]) + 3 * outward + height[:, None] * [0, 0, 1]
    excess = caster.first_hit(origins, -outward).ranges - post.ray_ranges(origins, -outward)
    assert excess.min() > -16 * EPS
    assert excess.max() < radius * (1 - np.cos(np.pi / n)) + 16 * EPS
    assert excess.max() > 0.9 * radius * (1 - np.cos(np.pi / n))


ROOM = builtin_scene("two_occluders").mesh
RNG = np.random.default_rng(3)
INSIDE = RNG.uniform([0.2, 0.2, 1.85], [5.8, 4.8, 2.6], (2000, 3))
ALONG = unit(RNG.normal(size=(2000, 3)))
HITS = RayCaster(ROOM.vertices, ROOM.faces).first_hit(INSIDE, ALONG)


@settings(law, max_examples=30)
@given(poses())
def test_moving_the_world_changes_no_range(pose: Pose) -> None:
    moved = RayCaster(pose.apply(ROOM.vertices), ROOM.faces)
    hits = moved.first_hit(pose.apply(INSIDE), pose.rotate(ALONG))
    np.testing.assert_allclose(hits.ranges, HITS.ranges, atol=1e-9, rtol=0)
    np.testing.assert_allclose(hits.incidence_cosine, HITS.incidence_cosine, atol=1e-12, rtol=0)


@pytest.mark.parametrize("shift", [(5e5, 5e6, 100), (-4e6, 3e5, -20)])
def test_a_world_in_national_coordinates_is_cast_as_at_home(shift: tuple[float, float, float]) -> None:
    moved = RayCaster(ROOM.vertices + shift, ROOM.faces).first_hit(INSIDE + shift, ALONG)
    # Adding 5e6 rounds each coordinate by 5e-10 m; a slant multiplies that.
    error = np.abs(moved.ranges - HITS.ranges) * np.minimum(HITS.incidence_cosine, moved.incidence_cosine)
    assert error.max() < 1e-8


def test_what_no_face_uses_does_not_matter() -> None:
    stray = np.concatenate([ROOM.vertices, [[1e9, -3e9, 1e200]]])
    assert_same_hits(RayCaster(stray, ROOM.faces).first_hit(INSIDE, ALONG), HITS)


def test_faces_without_area_are_not_hit() -> None:
    n = len(ROOM.vertices)
    points = np.concatenate([ROOM.vertices, [[3, 2, 2], [3, 4, 2], [3, 3, 2]]])
    flat = np.array([[n, n, n], [n, n + 1, n], [n, n + 1, n + 2]])
    hits = RayCaster(points, np.concatenate([ROOM.faces, flat])).first_hit(INSIDE, ALONG)
    assert_same_hits(hits, HITS)
    aimed = RayCaster(points, flat).first_hit(
        [[3, 0, 2], [3, 3, 0], [3, 0, 2]], [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    )
    assert np.isfinite(aimed.barycentric).all()
    assert (aimed.ranges[aimed.hit] >= 0).all()


def test_rays_that_are_not_finite_are_counted_misses() -> None:
    origins, along = INSIDE[:9].copy(), ALONG[:9].copy()
    origins[0, 1], origins[1, 2], origins[2, 0] = np.nan, np.inf, -np.inf
    along[3, 0], along[4, 1], along[5] = np.nan, np.inf, 0
    origins[6, 0], along[7, 2] = 1e200, -1e200  # finite, but not in float32
    hits = RayCaster(ROOM.vertices, ROOM.faces).first_hit(origins, along)
    assert hits.n_not_finite == 8
    assert hits.hit.tolist() == [False] * 8 + [True]
    assert hits.ranges[:8].tolist() == [np.inf] * 8
    assert hits.ranges[8] == HITS.ranges[8]


def test_rays_that_are_not_finite_are_counted_and_not_cast() -> None:
    rng = np.random.default_rng(4)
    vertices = rng.normal(size=(9000, 3))
    caster = RayCaster(vertices, np.arange(9000).reshape(-1, 3), n_threads=1)
    nowhere = np.full((200_000, 3), np.nan)  # Embree would visit every face of each: minutes
    hits = caster.first_hit(nowhere, nowhere)
    assert hits.n_not_finite == 200_000


@pytest.mark.parametrize("n_threads", [1, 2, 3, None])
def test_the_number_of_threads_changes_no_byte(n_threads: int | None) -> None:
    rng = np.random.default_rng(5)
    along = rng.normal(size=(150_000, 3))  # several chunks of 32,768
    along[::1000] = np.nan
    one = RayCaster(ROOM.vertices, ROOM.faces, n_threads=1)
    several = RayCaster(ROOM.vertices, ROOM.faces, n_threads=n_threads)
    assert_same_hits(one.first_hit([[3, 2, 2]], along), several.first_hit([[3, 2, 2]], along))
    targets = rng.uniform(0, 5, along.shape)
    assert (one.are_blocked([[3, 2, 2]], targets) == several.are_blocked([[3, 2, 2]], targets)).all()


def test_rays_of_one_batch_do_not_know_of_each_other() -> None:
    caster = RayCaster(ROOM.vertices, ROOM.faces)
    order = np.random.default_rng(6).permutation(len(INSIDE))
    shuffled = caster.first_hit(INSIDE[order], ALONG[order])
    assert (shuffled.ranges == HITS.ranges[order]).all()
    alone = [caster.first_hit(INSIDE[[i]], ALONG[[i]]).ranges[0] for i in range(20)]
    assert alone == HITS.ranges[:20].tolist()


def test_one_origin_serves_many_rays() -> None:
    caster = RayCaster(ROOM.vertices, ROOM.faces)
    many = caster.first_hit(np.tile(INSIDE[:1], (2000, 1)), ALONG)
    assert_same_hits(caster.first_hit(INSIDE[:1], ALONG), many)
    ends = INSIDE[:1] + ALONG * 2
    assert (caster.are_blocked(INSIDE[:1], ends) == (many.ranges < 2)).all()


def test_no_rays_have_no_hits() -> None:
    caster, none = RayCaster(*SQUARE), np.zeros((0, 3))
    for origins in (none, np.zeros((1, 3))):
        assert caster.first_hit(origins, none).ranges.shape == (0,)
        assert caster.first_hit(origins, none).barycentric.shape == (0, 3)
        assert caster.are_blocked(origins, none).shape == (0,)


@pytest.mark.parametrize("n_vertices", [0, 5])
def test_a_mesh_without_faces_is_never_hit(n_vertices: int) -> None:
    empty = RayCaster(np.zeros((n_vertices, 3)), np.zeros((0, 3), int))
    assert empty.n_faces == 0
    assert not empty.first_hit(INSIDE, ALONG).hit.any()
    assert not empty.are_blocked(INSIDE, INSIDE + ALONG).any()


def test_a_segment_is_blocked_by_what_stands_before_its_target() -> None:
    square = RayCaster(*SQUARE)
    origins = np.tile([0.7, 0.2, 2.0], (5, 1))
    targets = np.array([[0.7, 0.2, z] for z in (1.0, 1e-3, -1e-3, -5.0, 3.0)])
    assert square.are_blocked(origins, targets).tolist() == [False, False, True, True, False]
    assert square.are_blocked(targets, origins).tolist() == [False, False, True, True, False]
    beside = square.are_blocked([[2.0, 2, 2]], [[2, 2, -2], [0.5, 0.5, -1e-3]])
    assert beside.tolist() == [False, True]


def test_segments_that_are_not_finite_are_blocked_and_those_without_length_free() -> None:
    origins = np.tile([0.7, 0.2, 2.0], (6, 1))
    targets = np.tile([0.7, 0.2, 1.0], (6, 1))
    origins[0, 0], targets[1, 2], targets[2, 0] = np.nan, -np.inf, 1e200
    origins[3], targets[3] = np.inf, np.inf
    targets[4] = origins[4]
    assert RayCaster(*SQUARE).are_blocked(origins, targets).tolist() == [True, True, True, True, False, False]


@settings(law, max_examples=20)
@given(seeds)
def test_blocked_agrees_with_first_hit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, faces = rng.uniform(-1, 1, (40, 3)), rng.integers(0, 40, (30, 3))
    begin, end = rng.uniform(-2, 2, (2, 1000, 3))
    caster = RayCaster(vertices, faces)
    length = np.linalg.norm(end - begin, axis=1)
    ranges = caster.first_hit(begin, end - begin).ranges
    clear = ~(np.abs(ranges - length) < 1e-5)
    assert (caster.are_blocked(begin, end) == (ranges < length))[clear].all()


def test_wrong_arguments_are_refused() -> None:
    vertices, faces = SQUARE
    square = RayCaster(vertices, faces)
    with pytest.raises(InputError, match=r"expected origins with shape \(n, 3\), got \(3,\)"):
        square.first_hit([0, 0, 1], [[0, 0, -1]])
    with pytest.raises(InputError, match=r"expected directions with shape \(n, 3\), got \(1, 2\)"):
        square.first_hit([[0, 0, 1]], [[0, 0]])
    with pytest.raises(InputError, match="2 origins for 3 directions; give as many of both, or one origin"):
        square.first_hit(np.zeros((2, 3)), np.ones((3, 3)))
    with pytest.raises(InputError, match="2 origins for 3 targets; give as many of both, or one origin"):
        square.are_blocked(np.zeros((2, 3)), np.ones((3, 3)))
    with pytest.raises(InputError, match=r"expected targets with shape \(n, 3\), got \(3,\)"):
        square.are_blocked(np.zeros((2, 3)), np.ones(3))
    with pytest.raises(InputError, match="n_threads must be at least 1, got 0"):
        RayCaster(vertices, faces, n_threads=0)
    with pytest.raises(InputError, match=r"1 of 4 vertices are not finite \(first at row 2\)"):
        RayCaster(np.where(np.arange(4)[:, None] == 2, np.nan, vertices), faces)
    with pytest.raises(InputError, match=r"face 1 is \[0, 2, 4\], but there are 4 vertices"):
        RayCaster(vertices, [[0, 1, 2], [0, 2, 4]])
