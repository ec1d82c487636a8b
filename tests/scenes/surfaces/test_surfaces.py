# SPDX-License-Identifier: MIT
"""One battery of laws for every surface, closed forms for each, and what is refused."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenes.checks import FloatArray, InputError
from scenes.pose import Pose
from scenes.surfaces.catalogue import (
    Cone,
    Cylinder,
    EllipticCylinder,
    Plane,
    Sphere,
    Surface,
    Torus,
    surfaces_close,
)
from scenes.surfaces.surface import perpendicular
from tests.helpers.strategies import EPS, ROUNDING_M, SURFACES, directions, law, poses, seeds, surfaces

POST = Cylinder(point=(0, 0, 0), direction=(0, 0, 1), radius=0.5)
PIPE = Cylinder(point=(0, 0, 0), direction=(0, 0, 1), radius=0.5, concave=True)
FLOOR = Plane(point=(0, 0, 0), normal=(0, 0, 1))


def draw_uv(surface: Surface, seed: int, n: int = 20) -> FloatArray:
    """Chart coordinates within 10 m, within half a period where there is one."""
    uv = np.random.default_rng(seed).uniform(-10, 10, (n, 2))
    if np.isfinite(surface.period):
        uv[:, 0] *= surface.period / 2 / 10
    if isinstance(surface, Sphere):  # to 85 degrees of latitude: longitude fails at the poles
        uv[:, 1] *= 0.47 * np.pi * surface.radius / 10
    if isinstance(surface, Torus):  # the innermost circle is a seam
        uv[:, 1] *= 0.98 * surface.tube_period / 2 / 10
    if isinstance(surface, Cone):  # inside the unrolled sector, from a tenth of the way up to 10 m
        slant = surface.radius / np.sin(surface.half_angle)
        turn = uv[:, 0] / 10 * 0.99 * np.pi * np.sin(surface.half_angle)
        from_apex = 0.1 * slant + (uv[:, 1] + 10) / 2
        uv = np.stack([from_apex * np.sin(turn), from_apex * np.cos(turn) - slant], axis=1)
    return uv


def least_radius(surface: Surface) -> float:
    """Least radius of curvature where the tests draw points."""
    if isinstance(surface, EllipticCylinder):
        return surface.radii[1] ** 2 / surface.radii[0]
    if isinstance(surface, Cone):
        return 0.1 * surface.radius / float(np.cos(surface.half_angle))
    if isinstance(surface, Torus):
        return min(surface.tube_radius, surface.radius - surface.tube_radius)
    return float(getattr(surface, "radius", np.inf))


def draw_heights(surface: Surface, seed: int, n: int = 20) -> FloatArray:
    """Signed distances within 10 m that do not reach the axis (where feet are not unique)."""
    heights = np.random.default_rng(seed + 1).uniform(-10, 10, n)
    if isinstance(surface, Cylinder):
        limit = 0.9 * surface.radius
        return np.minimum(heights, limit) if surface.concave else np.maximum(heights, -limit)
    limits: object = None
    if isinstance(surface, Sphere):
        limits = 0.9 * surface.radius
    if isinstance(surface, EllipticCylinder):  # the least radius of curvature
        limits = 0.9 * surface.radii[1] ** 2 / surface.radii[0]
    if isinstance(surface, Torus):  # inside to the tube's middle, outside to the axis
        limits = 0.9 * surface.tube_radius
        feet = surface.from_uv(draw_uv(surface, seed, n))
        offset = feet - surface.centre
        along = offset @ surface.direction
        reach = np.linalg.norm(offset - along[:, None] * surface.direction, axis=1)
        outward = surface.normal(feet) * (-1 if surface.concave else 1)
        level = (offset - along[:, None] * surface.direction) / reach[:, None]
        inward = np.maximum(-np.einsum("ij,ij->i", outward, level), 1e-9)
        heights = np.where(surface.concave, -1, 1) * np.minimum(np.abs(heights), 0.9 * reach / inward)
    if isinstance(surface, Cone):
        feet = surface.from_uv(draw_uv(surface, seed, n))
        limits = 0.9 * surface.radius_at(feet) / np.cos(surface.half_angle)
    if limits is not None:
        concave = bool(getattr(surface, "concave", False))
        heights = np.minimum(heights, limits) if concave else np.maximum(heights, -np.asarray(limits))
    return heights


@law
@given(surfaces, seeds)
def test_distance_foot_and_normal_belong_together(surface: Surface, seed: int) -> None:
    uv, heights = draw_uv(surface, seed), draw_heights(surface, seed)
    feet = surface.from_uv(uv)
    np.testing.assert_allclose(surface.distance(feet), 0, atol=ROUNDING_M, rtol=0)
    normals = surface.normal(feet)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=16 * EPS, rtol=0)
    points = feet + heights[:, None] * normals
    np.testing.assert_allclose(surface.distance(points), heights, atol=ROUNDING_M, rtol=0)
    amplified = 200 * ROUNDING_M  # a foot is 1 / 0.1 radii farther out; normals turn by rounding / 5 mm
    np.testing.assert_allclose(surface.normal(points), normals, atol=amplified, rtol=0)
    np.testing.assert_allclose(surface.from_uv(surface.to_uv(points)), feet, atol=amplified, rtol=0)


@law
@given(surfaces, seeds)
def test_a_chart_is_the_inverse_of_its_placement(surface: Surface, seed: int) -> None:
    uv = draw_uv(surface, seed)
    turn = np.zeros_like(uv)
    turn[:, 0] = surface.to_uv(surface.from_uv(uv))[:, 0] - uv[:, 0]
    np.testing.assert_allclose(surface.to_uv(surface.from_uv(uv)) - turn, uv, atol=100 * ROUNDING_M, rtol=0)
    if np.isfinite(surface.period):  # a point on the seam may come back one turn on
        turn[:, 0] -= surface.period * np.round(turn[:, 0] / surface.period)
    np.testing.assert_allclose(turn, 0, atol=100 * ROUNDING_M, rtol=0)


@law
@given(surfaces, seeds)
def test_a_chart_is_isometric(surface: Surface, seed: int) -> None:
    if isinstance(surface, Sphere | Torus):  # no chart of either is
        return
    uv, step = draw_uv(surface, seed), 1e-4 * min(1.0, 6 * least_radius(surface))
    ahead = [surface.from_uv(uv + step * axis) - surface.from_uv(uv - step * axis) for axis in np.eye(2)]
    jacobian = np.stack(ahead, axis=-1) / (2 * step)
    metric = np.einsum("nij,nik->njk", jacobian, jacobian)
    # A chord is shorter than its arc by (step / radius)^2 / 6; differences lose ROUNDING_M / step.
    tolerance = 1e-6 + 4 * ROUNDING_M / step
    np.testing.assert_allclose(metric, np.broadcast_to(np.eye(2), metric.shape), atol=tolerance, rtol=0)


@law
@given(surfaces, seeds)
def test_the_first_chart_coordinate_returns_after_a_period(surface: Surface, seed: int) -> None:
    if isinstance(surface, Plane | Cone):
        assert surface.period == np.inf
        return
    uv = draw_uv(surface, seed)
    around = surface.from_uv(uv + [surface.period, 0.0])
    np.testing.assert_allclose(around, surface.from_uv(uv), atol=ROUNDING_M, rtol=0)
    halfway = surface.from_uv(uv + [surface.period / 2, 0.0])
    assert np.linalg.norm(halfway - around, axis=1).min() > 0.005


@law
@given(surfaces, seeds)
def test_rays_land_on_the_side_that_the_normal_points_to(surface: Surface, seed: int) -> None:
    rng = np.random.default_rng(seed)
    origins, along = rng.uniform(-10, 10, (200, 3)), rng.normal(size=(200, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    ranges = surface.ray_ranges(origins, along)
    hit = np.isfinite(ranges)
    assert (ranges > 0).all()
    landed = origins[hit] + np.minimum(ranges[hit], 1e9)[:, None] * along[hit]
    slack = ROUNDING_M + 64 * EPS * ranges[hit]
    slack *= 10 / np.abs(np.einsum("ij,ij->i", along[hit], surface.normal(landed)))
    assert (np.abs(surface.distance(landed)) < slack).all()
    assert (np.einsum("ij,ij->i", along[hit], surface.normal(landed)) <= slack).all()


@law
@given(surfaces, seeds)
def test_a_ray_meets_the_point_it_is_sent_to_when_that_faces_it(surface: Surface, seed: int) -> None:
    targets = surface.from_uv(draw_uv(surface, seed, 100))
    origins = np.random.default_rng(seed + 2).uniform(-10, 10, (100, 3))
    distance = np.linalg.norm(targets - origins, axis=1)
    along = (targets - origins) / distance[:, None]
    cosine = -np.einsum("ij,ij->i", along, surface.normal(targets))
    ranges = surface.ray_ranges(origins, along)
    faces = cosine > 0.05
    if isinstance(surface, Torus):  # it may stand before itself; where the ray lands then is a law above
        assert (ranges[faces] <= distance[faces] + 100 * ROUNDING_M).all()
        faces &= ranges > distance - 1e-4
    # Across a cylinder an error e of the direction at distance d moves the hit by e d / cosine; the roots of
    # a torus' quartic lose another digit.
    slack = (1000 if isinstance(surface, Torus) else 100) * ROUNDING_M
    np.testing.assert_allclose(ranges[faces], distance[faces], atol=slack, rtol=0)
    turned_away = cosine < -0.05
    assert (np.abs(ranges[turned_away] - distance[turned_away]) > 1e-4).all()


@law
@given(surfaces, poses(), seeds)
def test_moving_everything_changes_nothing(surface: Surface, pose: Pose, seed: int) -> None:
    moved = surface.transform(pose)
    assert type(moved) is type(surface)
    uv, heights = draw_uv(surface, seed), draw_heights(surface, seed)
    points = surface.from_uv(uv) + heights[:, None] * surface.normal(surface.from_uv(uv))
    atol = 400 * ROUNDING_M
    np.testing.assert_allclose(moved.distance(pose.apply(points)), heights, atol=atol, rtol=0)
    np.testing.assert_allclose(moved.from_uv(uv), pose.apply(surface.from_uv(uv)), atol=atol, rtol=0)
    np.testing.assert_allclose(
        moved.normal(pose.apply(points)), pose.rotate(surface.normal(points)), atol=atol, rtol=0
    )
    inner = np.abs(uv[:, 0]) < 0.49 * surface.period
    moved_uv = moved.to_uv(pose.apply(points))
    np.testing.assert_allclose(moved_uv[inner], surface.to_uv(points)[inner], atol=atol, rtol=0)
    along = np.roll(points, 1, axis=0) - points
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    ranges = surface.ray_ranges(points, along)
    landed = points + np.where(np.isfinite(ranges), ranges, 0.0)[:, None] * along
    clear = np.abs(np.einsum("ij,ij->i", along, surface.normal(landed))) > 0.05
    moved_ranges = moved.ray_ranges(pose.apply(points), pose.rotate(along))
    clear &= np.isfinite(ranges)
    np.testing.assert_allclose(moved_ranges[clear], ranges[clear], atol=atol, rtol=0)


@pytest.mark.parametrize("kind", SURFACES)
@given(data=st.data())
@law
def test_every_surface_offers_the_protocol(kind: str, data: st.DataObject) -> None:
    surface = data.draw(SURFACES[kind])
    assert isinstance(surface, Surface)
    assert surface.kind == kind.split()[-1]
    with pytest.raises(FrozenInstanceError):
        setattr(surface, "centre" if isinstance(surface, Sphere | Torus) else "point", np.zeros(3))
    place = surface.centre if isinstance(surface, Sphere | Torus) else surface.point  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match="read-only"):
        place[0] = 1.0


@law
@given(directions)
def test_perpendicular_is_a_fixed_unit_vector_at_right_angles(direction: FloatArray) -> None:
    unit = direction / np.linalg.norm(direction)
    across = perpendicular(unit)
    assert abs(across @ unit) < 4 * EPS
    assert abs(np.linalg.norm(across) - 1) < 4 * EPS
    assert (perpendicular(unit) == across).all()


def test_the_chart_of_a_plane_is_right_handed() -> None:
    plane = Plane((1, 2, 3), (0, -1, 0), (5, 2, 0))
    np.testing.assert_allclose(plane.u_direction, [1, 0, 0], atol=EPS)
    np.testing.assert_allclose(plane.v_direction, [0, 0, 1], atol=EPS)
    np.testing.assert_allclose(plane.from_uv(np.array([[2.0, 4.0]])), [[3, 2, 7]], atol=4 * EPS)


def test_a_flipped_plane_is_seen_from_its_other_side() -> None:
    points = np.array([[3.0, 2.0, 5.0]])
    assert FLOOR.flip().distance(points).tolist() == [-5.0]
    assert FLOOR.flip().ray_ranges(points, np.array([[0.0, 0, -1]])).tolist() == [np.inf]
    assert FLOOR.flip().ray_ranges(-points, np.array([[0.0, 0, 1]])).tolist() == [5.0]


@pytest.mark.parametrize(
    ("origin", "direction", "expected"),
    [
        ((1, 2, 3), (0, 0, -1), 3.0),
        ((1, 2, 3), (0.6, 0, -0.8), 3 / 0.8),
        ((1, 2, 0), (0, 0, -1), 0.0),  # starts on it
        ((1, 2, 3), (0, 0, 1), np.inf),  # leaves
        ((1, 2, 3), (1, 0, 0), np.inf),  # parallel
        ((1, 2, 0), (1, 0, 0), np.inf),  # within it
        ((1, 2, -3), (0, 0, 1), np.inf),  # from behind
        ((1, 2, -3), (0, 0, -1), np.inf),
    ],
)
def test_ranges_to_a_plane(origin: FloatArray, direction: FloatArray, expected: float) -> None:
    ranges = FLOOR.ray_ranges(np.array([origin], float), np.array([direction], float))
    np.testing.assert_allclose(ranges, expected, atol=8 * EPS)


@pytest.mark.parametrize(
    ("origin", "direction", "convex", "concave"),
    [
        ((-2, 0, 1), (1, 0, 0), 1.5, 2.5),  # through the axis: near wall, far wall
        ((-2, 0.3, 1), (1, 0, 0), 1.6, 2.4),  # 3-4-5
        ((-2, 0, 1), (0.6, 0, 0.8), 2.5, 2.5 / 0.6),  # slanted: ranges grow by 1 / sin
        ((-2, 0.5, 1), (1, 0, 0), 2.0, 2.0),  # tangent
        ((-2, 0.6, 1), (1, 0, 0), np.inf, np.inf),  # misses
        ((-2, 0, 1), (-1, 0, 0), np.inf, np.inf),  # leaves
        ((0, 0, 1), (0, 1, 0), np.inf, 0.5),  # from the axis
        ((0.2, 0, 1), (1, 0, 0), np.inf, 0.3),  # from inside
        ((0.2, 0, 1), (-1, 0, 0), np.inf, 0.7),
        ((0.2, 0, 1), (0, 0, 1), np.inf, np.inf),  # along the axis, inside
        ((2.0, 0, 1), (0, 0, -1), np.inf, np.inf),  # along the axis, outside
    ],
)
def test_ranges_to_a_cylinder(
    origin: FloatArray, direction: FloatArray, convex: float, concave: float
) -> None:
    ray = np.array([origin], float), np.array([direction], float)
    np.testing.assert_allclose(POST.ray_ranges(*ray), convex, atol=32 * EPS)
    np.testing.assert_allclose(PIPE.ray_ranges(*ray), concave, atol=32 * EPS)


def test_a_thin_post_is_met_exactly_from_a_kilometre() -> None:
    post = Cylinder((0, 0, 0), (0, 0, 1), 0.05)
    offset = np.array([0.0, 0.03, -0.04])
    origins = np.stack([np.full(3, -1000.0), offset, np.zeros(3)], axis=1)
    ranges = post.ray_ranges(origins, np.tile([1.0, 0, 0], (3, 1)))
    # b^2 - a c would lose eps * 1e6 m^2 / 0.05 m = 4e-9 m here
    np.testing.assert_allclose(ranges, 1000 - np.sqrt(0.05**2 - offset**2), atol=1000 * EPS, rtol=0)


def test_the_chart_of_a_cylinder_counts_arc_length_from_its_zero_direction() -> None:
    post = Cylinder((0, 0, 1), (0, 0, 2), 0.5, zero_direction=(3, 0, 1))
    points = np.array([[2, 0, 1], [0, 2, 3], [-2, 0, 0], [0, -0.1, 1]], float)
    quarter = 0.5 * np.pi / 2
    expected = [[0, 0], [quarter, 2], [2 * quarter, -1], [-quarter, 0]]
    np.testing.assert_allclose(post.to_uv(points), expected, atol=4 * EPS)
    assert post.period == np.pi


def test_the_chart_of_a_convex_cylinder_is_right_handed() -> None:
    foot, along_s, along_h = POST.from_uv(np.array([[0.3, 1], [0.3001, 1], [0.3, 1.0001]]))
    assert np.cross(along_s - foot, along_h - foot) @ POST.normal(foot) > 0


def test_concave_turns_sign_and_normal_alone() -> None:
    points = np.array([[2.0, 1, 5], [0.1, 0, 0]])
    assert (PIPE.distance(points) == -POST.distance(points)).all()
    assert (PIPE.normal(points) == -POST.normal(points)).all()
    assert (PIPE.to_uv(points) == POST.to_uv(points)).all()


def test_points_on_the_axis_have_the_zero_directions_normal() -> None:
    on_axis = np.array([[0.0, 0, 3]])
    assert POST.normal(on_axis).tolist() == [POST.zero_direction.tolist()]
    assert POST.distance(on_axis).tolist() == [-0.5]


@pytest.mark.parametrize("angle", [1e-3, 1e-6, 3e-9])
def test_a_reference_nearly_along_the_normal_still_gives_a_square_chart(angle: float) -> None:
    normal, across = np.array([1.0, 2.0, 3.0]) / np.sqrt(14), np.array([3.0, 0.0, -1.0]) / np.sqrt(10)
    plane = Plane((0, 0, 0), normal, normal + angle * across)
    assert abs(plane.u_direction @ plane.normal_direction) < 4 * EPS
    np.testing.assert_allclose(plane.u_direction, across, atol=4 * EPS / angle)


def test_the_length_of_a_reference_does_not_count() -> None:
    tiny = Plane((0, 0, 0), (0, 0, 1), (1e-30, 0, 0))
    assert tiny.u_direction.tolist() == [1, 0, 0]


@pytest.mark.parametrize("radius", [0.0, -1.0, np.nan, np.inf])
def test_a_radius_is_a_positive_number(radius: float) -> None:
    with pytest.raises(InputError, match=f"radius must be a positive number of metres, got {radius}"):
        Cylinder((0, 0, 0), (0, 0, 1), radius)


def test_degenerate_surfaces_are_refused() -> None:
    with pytest.raises(InputError, match=r"normal has length 0\.0"):
        Plane((0, 0, 0), (0, 0, 0))
    with pytest.raises(InputError, match="direction has length nan"):
        Cylinder((0, 0, 0), (0, np.nan, 1), 1.0)
    with pytest.raises(InputError, match=r"expected point with shape \(3,\), got \(2,\)"):
        Plane((0, 0), (0, 0, 1))
    with pytest.raises(InputError, match=r"point is \[0\.0, 0\.0, inf\]; give finite"):
        Cylinder((0, 0, np.inf), (0, 0, 1), 1.0)
    with pytest.raises(InputError, match="reference direction is parallel to the normal or axis"):
        Plane((0, 0, 0), (1, 2, 3), (-2, -4, -6))
    with pytest.raises(InputError, match="reference direction is parallel"):
        Cylinder((0, 0, 0), (0, 0, 1), 1.0, zero_direction=(0, 0, 5))
    with pytest.raises(InputError, match="reference direction has length nan"):
        Plane((0, 0, 0), (1, 2, 3), (np.nan, 0, 0))


@pytest.mark.parametrize(
    ("other", "close"),
    [
        (Plane((7, 8, 0), (0, 0, 2)), True),  # the same plane, named by another point
        (FLOOR.flip(), True),
        (Plane((0, 0, 0.009), (0, 0, 1)), True),
        (Plane((0, 0, 0.011), (0, 0, 1)), False),
        (Plane((0, 0, 0), (np.sin(0.019), 0, np.cos(0.019))), True),
        (Plane((0, 0, 0), (np.sin(0.021), 0, np.cos(0.021))), False),
        (POST, False),
    ],
)
def test_planes_are_close_within_angle_and_length(other: Surface, close: bool) -> None:
    assert surfaces_close(FLOOR, other, angle=0.02, length=0.01) is close
    assert surfaces_close(other, FLOOR, angle=0.02, length=0.01) is close


@pytest.mark.parametrize(
    ("other", "close"),
    [
        (Cylinder((0, 0, 9), (0, 0, -3), 0.5), True),  # the same axis, the other way
        (PIPE, True),
        (Cylinder((0, 0.009, 9), (0, 0, 1), 0.5), True),
        (Cylinder((0, 0.011, 9), (0, 0, 1), 0.5), False),
        (Cylinder((0, 0, 0), (0, 0, 1), 0.509), True),
        (Cylinder((0, 0, 0), (0, 0, 1), 0.511), False),
        (Cylinder((0, 0, 0), (np.sin(0.019), 0, np.cos(0.019)), 0.5), True),
        (Cylinder((0, 0, 0), (np.sin(0.021), 0, np.cos(0.021)), 0.5), False),
        (FLOOR, False),
    ],
)
def test_cylinders_are_close_within_angle_and_length(other: Surface, close: bool) -> None:
    assert surfaces_close(POST, other, angle=0.02, length=0.01) is close


BALL = Sphere(centre=(0, 0, 0), radius=0.5)
HAT = Cone(point=(0, 0, 1), direction=(0, 0, 1), radius=1.0, half_angle=np.pi / 4)
RING = Torus(centre=(0, 0, 0), direction=(0, 0, 1), radius=2.0, tube_radius=0.5)
BORE = Torus(centre=(0, 0, 0), direction=(0, 0, 1), radius=2.0, tube_radius=0.5, concave=True)
DUCT = EllipticCylinder(point=(0, 0, 0), direction=(0, 0, 1), radii=(2.0, 1.0), zero_direction=(1, 0, 0))


@pytest.mark.parametrize(
    ("surface", "origin", "direction", "expected"),
    [
        (BALL, (-2, 0.3, 0), (1, 0, 0), 1.6),  # 3-4-5
        (BALL, (0, 0, 0), (1, 0, 0), np.inf),  # from within
        (BALL, (-2, 0.6, 0), (1, 0, 0), np.inf),
        (HAT, (-5, 0, 2), (1, 0, 0), 3.0),
        (HAT, (-5, 0, -2), (1, 0, 0), np.inf),  # the other nappe is none of it
        (HAT, (0, 0, 5), (0, 0, -1), np.inf),  # through the apex, from within
        (HAT, (3, 0, 1), (0, 0, 1), 2.0),
        (RING, (-5, 0, 0), (1, 0, 0), 2.5),
        (RING, (0, 0, 0), (1, 0, 0), 1.5),  # from the hole
        (RING, (0, 0, -5), (0, 0, 1), np.inf),  # through the hole
        (RING, (2, 0, 0), (-1, 0, 0), 3.5),  # out of the tube, across the hole
        (RING, (-5, 1.5, 0), (1, 0, 0), 3.0),  # 3-4-5 about the axis
        (RING, (2.3, 0, 5), (0, 0, -1), 4.6),  # 3-4-5 in the tube
        (RING, (-5, 0, 0.6), (1, 0, 0), np.inf),  # over it
        (RING, (-1e6, 0, 0.3), (1, 0, 0), 1e6 - 2.4),
        (BORE, (2, 0, 0), (0, 0, 1), 0.5),
        (BORE, (-5, 0, 0), (1, 0, 0), 3.5),
        (DUCT, (-5, 0, 0), (1, 0, 0), 3.0),
        (DUCT, (0, -5, 0), (0, 1, 0), 4.0),
        (DUCT, (-5, 0.6, 0), (1, 0, 0), 3.4),  # 2 * 0.8 from the axis
    ],
)
def test_ranges_to_sphere_cone_and_elliptic_cylinder(
    surface: Surface, origin: FloatArray, direction: FloatArray, expected: float
) -> None:
    ranges = surface.ray_ranges(np.array([origin], float), np.array([direction], float))
    np.testing.assert_allclose(ranges, expected, atol=64 * EPS, rtol=2 * EPS)


def test_behind_the_apex_distances_are_to_the_apex() -> None:
    assert HAT.distance(np.array([[0.0, 0, -2], [0.3, 0, -0.4]])) == pytest.approx([2.0, 0.5])


def test_the_foot_on_an_ellipse_is_the_nearest_of_many() -> None:
    """Against a slow reference: 10 000 points of the ellipse, at most 1.26 mm apart."""
    points = np.random.default_rng(0).uniform(-3, 3, (200, 3))
    points[:4, :2] = [[0, 0], [0.5, 0], [0, 0.5], [1.9, 0]]  # on the axes, where feet are two or meet
    around = np.linspace(0, 2 * np.pi, 10_000)
    ellipse = np.column_stack([2 * np.cos(around), np.sin(around)])
    nearest = np.linalg.norm(points[:, None, :2] - ellipse[None], axis=2).min(axis=1)
    np.testing.assert_allclose(np.abs(DUCT.distance(points)), nearest, atol=7e-4)


def test_a_circle_is_an_ellipse() -> None:
    duct = EllipticCylinder((0, 0, 0), (0, 0, 1), (0.5, 0.5))
    points = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_allclose(duct.distance(points), POST.distance(points), atol=16 * EPS)
    np.testing.assert_allclose(duct.to_uv(points), POST.to_uv(points), atol=64 * EPS)


def test_the_apex_of_a_cone() -> None:
    assert HAT.apex == pytest.approx(np.zeros(3), abs=4 * EPS)
    assert HAT.radius_at(np.array([[7.0, 0, 3], [0, 0, -1]])) == pytest.approx([3.0, -1.0])


@pytest.mark.parametrize(
    ("other", "close"),
    [
        (Cone((0, 0, 3), (0, 0, 1), 3.0, np.pi / 4), True),  # named by another point
        (Cone((0, 0, 1), (0, 0, -1), 1.0, np.pi / 4), False),  # opens the other way
        (Cone((0, 0, 1), (0, 0, 1), 1.0, np.pi / 4 + 0.03), False),
        (BALL, False),
    ],
)
def test_cones_are_close_within_angle_and_length(other: Surface, close: bool) -> None:
    assert surfaces_close(HAT, other, angle=0.02, length=0.01) is close


def test_spheres_and_elliptic_cylinders_are_close_within_angle_and_length() -> None:
    assert surfaces_close(BALL, Sphere((0.006, 0, 0.006), 0.495), angle=0.02, length=0.01)
    assert not surfaces_close(BALL, Sphere((0.009, 0, 0.009), 0.5), angle=0.02, length=0.01)
    turned = EllipticCylinder((0, 0, 5), (0, 0, -1), (2, 1), (1, 0.009, 0))
    assert surfaces_close(DUCT, turned, angle=0.02, length=0.01)
    quarter = EllipticCylinder((0, 0, 5), (0, 0, -1), (2, 1), (0, 1, 0))
    assert not surfaces_close(DUCT, quarter, angle=0.02, length=0.01)


def test_tori_are_close_within_angle_and_length() -> None:
    near = Torus((0.006, 0, 0.006), (0.01, 0, -1), 2.008, 0.495)
    assert surfaces_close(RING, near, angle=0.02, length=0.01)
    for other in (Torus((0, 0, 0.02), (0, 0, 1), 2, 0.5), Torus((0, 0, 0), (0, 0, 1), 2, 0.52), BALL):
        assert not surfaces_close(RING, other, angle=0.02, length=0.01)


def test_the_chart_of_a_torus_counts_from_its_outermost_circle() -> None:
    points = np.array([[3.0, 0, 0], [0, 2, 0.5], [0, 2, -7], [-2.5, 0, 0]])
    expected = [[0, 0], [np.pi, np.pi / 4], [np.pi, -np.pi / 4], [2 * np.pi, 0]]
    ring = Torus((0, 0, 0), (0, 0, 1), 2.0, 0.5, zero_direction=(1, 0, 0))
    np.testing.assert_allclose(ring.to_uv(points), expected, atol=16 * EPS)
    assert ring.tube_period == np.pi


def test_many_rays_come_in_the_shape_they_were_given() -> None:
    origins = np.zeros((3, 4, 3)) + [-5.0, 0, 0]
    ranges = RING.ray_ranges(origins, np.broadcast_to([1.0, 0, 0], origins.shape))
    np.testing.assert_allclose(ranges, np.full((3, 4), 2.5), atol=16 * EPS)


def test_degenerate_round_surfaces_are_refused() -> None:
    with pytest.raises(InputError, match=r"tube of radius 2 m about a circle of 1 m reaches its axis"):
        Torus((0, 0, 0), (0, 0, 1), 1.0, 2.0)
    with pytest.raises(InputError, match=r"tube_radius must be a positive number of metres, got nan"):
        Torus((0, 0, 0), (0, 0, 1), 1.0, np.nan)
    with pytest.raises(InputError, match=r"radius must be a positive number of metres, got -1\.0"):
        Sphere((0, 0, 0), -1.0)
    with pytest.raises(InputError, match=r"radius must be a positive number of metres, got 0"):
        Cone((0, 0, 0), (0, 0, 1), 0, 0.5)
    with pytest.raises(InputError, match=r"half_angle must lie between 0 and pi / 2, got 1\.6"):
        Cone((0, 0, 0), (0, 0, 1), 1.0, 1.6)
    with pytest.raises(InputError, match=r"the greater first, got \(1\.0, 2\.0\)"):
        EllipticCylinder((0, 0, 0), (0, 0, 1), (1.0, 2.0))
