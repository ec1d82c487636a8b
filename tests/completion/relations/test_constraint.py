# SPDX-License-Identifier: MIT
"""Equations of relations: derivatives, values, and what surfaces cannot have."""

from __future__ import annotations

import numpy as np
import pytest

from completion.relations.constraint import constrain
from completion.relations.equations import RelationFrame, move_surface, place
from completion.relations.relation import Relation
from scenes.checks import InputError
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Plane, Sphere, Torus

RNG = np.random.default_rng(7)


def unit(*vector: float):
    return np.array(vector) / np.linalg.norm(vector)


PLANE = Plane((0.3, -0.2, 0.1), unit(0.2, 0.1, 1), unit(1, 0, -0.2))
OTHER = Plane((0.1, 0.4, 2.0), unit(-0.2, -0.13, -1), unit(1, 0, -0.2))
THIRD = Plane((0.1, 0.4, 3.5), unit(0.2, 0.12, 1.02), unit(1, 0, -0.2))
UPRIGHT = Plane((2.0, 0.4, 0.0), unit(1, 0.1, 0.05), unit(0, 0.5, -1))
PIPE = Cylinder((0.5, 0.1, 0.2), unit(0.2, 0.1, 1.1), 0.3)
TUBE = Cylinder((0.9, 0.4, 0.4), unit(0.2, 0.12, 1), 0.2)
LYING = Cylinder((0.2, 0.2, 0.15), unit(1, 0.1, -0.1), 0.1)
CONE = Cone((0.5, 0.12, 0.9), unit(0.2, 0.1, 1), 0.3, 0.4)
BALL = Sphere((0.1, 0.2, 0.3), 0.25)
RING = Torus((0.45, 0.1, 0.3), unit(0.21, 0.1, 1), 0.4, 0.3)
HOOP = Torus((0.1, 0.5, 0.3), unit(-0.1, 0.1, 1), 0.5, 0.2)
LEFT = Plane((-1.0, 0.2, 0.1), unit(-1, 0.5, 0.1), unit(0, 0.1, -0.5))
RIGHT = Plane((1.1, 0.1, 0.2), unit(-1.02, -0.5, -0.1), unit(0, 0.1, -0.5))
PEG = Cylinder((-0.6, 0.4, 0.1), unit(0.05, 0.02, 1), 0.2)
PIN = Cylinder((0.7, 0.42, 0.3), unit(0.03, -0.02, -1), 0.21)
BEAD = Sphere((-0.15, 0.25, 0.32), 0.2)
STRUT = Cylinder((-0.6, 0.4, 0.1), unit(0.5, 0.02, 1), 0.2)
BRACE = Cylinder((0.7, 0.42, 0.15), unit(-0.52, 0.04, 1), 0.21)
FLOOR = Plane((0.1, 0.4, -1.0), unit(0.01, -0.03, 1), unit(1, 0, 0))
CEILING = Plane((-0.1, 0.3, -1.02), unit(0.03, 0.02, -1), unit(1, 0, 0))
UP = unit(0.05, 0.02, 1)

CASES = [
    (Relation(kind="parallel", surfaces=(0, 1)), [PLANE, OTHER]),
    (Relation(kind="parallel", surfaces=(0, 1)), [PLANE, PIPE]),
    (Relation(kind="perpendicular", surfaces=(0, 1)), [PLANE, UPRIGHT]),
    (Relation(kind="perpendicular", surfaces=(0, 1)), [CONE, LYING]),
    (Relation(kind="angle", surfaces=(0, 1), value=1.4), [PLANE, UPRIGHT]),
    (Relation(kind="coplanar", surfaces=(0, 1)), [PLANE, OTHER]),
    (Relation(kind="coaxial", surfaces=(0, 1)), [PIPE, CONE]),
    (Relation(kind="distance", surfaces=(0, 1), value=1.8), [PLANE, OTHER]),
    (Relation(kind="distance", surfaces=(0, 1), value=0.4), [PIPE, TUBE]),
    (Relation(kind="distance", surfaces=(0, 1), value=0.2), [LYING, PLANE]),
    (Relation(kind="equal_distance", surfaces=(0, 1, 1, 2)), [PLANE, OTHER, THIRD]),
    (Relation(kind="radius", surfaces=(0,), value=0.31), [PIPE]),
    (Relation(kind="radius", surfaces=(0,), value=0.31), [BALL]),
    (Relation(kind="equal_radius", surfaces=(0, 1)), [PIPE, TUBE]),
    (Relation(kind="half_angle", surfaces=(0,), value=0.5), [CONE]),
    (Relation(kind="coaxial", surfaces=(0, 1)), [PIPE, RING]),
    (Relation(kind="parallel", surfaces=(0, 1)), [PLANE, RING]),
    (Relation(kind="radius", surfaces=(0,), value=0.31), [RING]),
    (Relation(kind="equal_radius", surfaces=(0, 1)), [PIPE, RING]),
    (Relation(kind="equal_ring_radius", surfaces=(0, 1)), [RING, HOOP]),
    (Relation(kind="axis_in_plane", surfaces=(0, 1)), [UPRIGHT, RING]),
    (Relation(kind="distance", surfaces=(0, 1), value=0.4), [PIPE, RING]),
    (Relation(kind="axis_in_plane", surfaces=(0, 1)), [PLANE, LYING]),
    (Relation(kind="tangent", surfaces=(0, 1)), [PLANE, LYING]),
    (Relation(kind="tangent", surfaces=(0, 1)), [PIPE, TUBE]),
    (Relation(kind="tangent", surfaces=(1, 0)), [PEG, PIN]),
    (Relation(kind="vertical", surfaces=(0,)), [UPRIGHT]),
    (Relation(kind="vertical", surfaces=(0,)), [PIPE]),
    (Relation(kind="horizontal", surfaces=(0,)), [OTHER]),
    (Relation(kind="horizontal", surfaces=(0,)), [LYING]),
    (Relation(kind="regular", surfaces=(0, 1, 2)), [PLANE, OTHER, THIRD]),
    (Relation(kind="regular", surfaces=(2, 0, 3, 1)), [PIPE, TUBE, CONE, RING]),
    (Relation(kind="symmetric", surfaces=(0, 1, 2, 3)), [LEFT, RIGHT, PLANE, OTHER]),
    (Relation(kind="symmetric", surfaces=(0, 1, 2, 3, 4, 5)), [LEFT, RIGHT, PEG, PIN, BALL, BEAD]),
    (Relation(kind="symmetric", surfaces=(0, 1, 2, 3)), [BALL, BEAD, PIPE, TUBE]),
    (Relation(kind="symmetric", surfaces=(0, 1, 2, 3)), [STRUT, BRACE, FLOOR, CEILING]),
]


def size(surface) -> int:
    return {Plane: 3, Sphere: 4, Cylinder: 5, Cone: 6, Torus: 7}[type(surface)]


def placed(surfaces, changes):
    return {n: place(surface, changes[n]) for n, surface in enumerate(surfaces)}


@pytest.mark.parametrize(
    ("relation", "surfaces"), CASES, ids=[f"{n}-{c[0].kind}" for n, c in enumerate(CASES)]
)
def test_derivatives_are_those_of_finite_differences(relation, surfaces):
    changes = [1e-2 * RNG.normal(size=size(surface)) for surface in surfaces]
    frame = RelationFrame(
        {k: place(surface, np.zeros(size(surface))) for k, surface in enumerate(surfaces)}, UP
    )
    found = constrain(relation, placed(surfaces, changes), frame)
    for number, surface in enumerate(surfaces):
        for k in range(size(surface)):
            step = 1e-6 * np.eye(size(surface))[k]
            values = []
            for sign in (1, -1):
                some = [*changes]
                some[number] = changes[number] + sign * step
                values.append(constrain(relation, placed(surfaces, some), frame).value)
            np.testing.assert_allclose(found.blocks[number][:, k], (values[0] - values[1]) / 2e-6, atol=1e-8)
    assert found.value.shape == (len(found.rows),)


@pytest.mark.parametrize("surface", [PLANE, PIPE, CONE, BALL, RING])
def test_a_moved_surface_is_where_it_was_placed(surface):
    change = 1e-2 * RNG.normal(size=size(surface))
    there, again = place(surface, change), place(move_surface(surface, change), np.zeros(size(surface)))
    np.testing.assert_allclose(there.direction, again.direction, atol=1e-14)
    np.testing.assert_allclose(there.point, again.point, atol=1e-14)
    sizes = [(one.radius, one.half_angle, one.ring_radius) for one in (there, again)]
    assert sizes[0] == pytest.approx(sizes[1], abs=1e-14)
    assert move_surface(surface, 0 * change) is surface


def test_what_holds_is_zero():
    flat, above = Plane((0, 0, 1), (0, 0, 1), (1, 0, 0)), Plane((5, 2, 3), (0, 0, -1), (0, 1, 0))
    pipe, cone = Cylinder((1, 2, 9), (0, 0, 1), 0.5), Cone((1, 2, 1), (0, 0, -1), 0.5, 0.3)
    lying, ball = Cylinder((0, 0, 1), (1, 0, 0), 0.5), Sphere((0, 0, 0), 0.5)
    ring, hoop = Torus((1, 2, 4), (0, 0, -1), 0.8, 0.5), Torus((0, 0, 0), (1, 0, 0), 0.8, 0.1)
    third, fourth = Plane((1, 0, 5), (0, 0, 1), (1, 0, 0)), Plane((-3, 0, 7), (0, 0, -1), (1, 0, 0))
    row = [Cylinder((k - 4.0, 2 + 0.5 * k, -k), (0, 0, (-1.0) ** k), 0.3) for k in range(4)]
    slopes = [Plane((3 * side, 0, 1), unit(side, 0.2, 0.4), (0, 2, -1)) for side in (-1, 1)]
    legs = [Cylinder((side, 0.5, 1), unit(0.3 * side, 0.2, side), 0.2) for side in (-1, 1)]
    balls = [Sphere((side, 0.3, 1), 0.2) for side in (-1, 1)]
    legs[0] = Cylinder((-1, 0.5, 1), unit(0.3, -0.2, -1), 0.2)
    surfaces = [flat, above, pipe, cone, lying, ball, ring, hoop, third, fourth, *row]
    surfaces += [*slopes, *legs, *balls, Plane((9, -0.5, 4), (0, 1, 0))]
    surfaces += [Cylinder((x, 0, x), (0, 0, 1), r) for x, r in ((0.0, 0.5), (0.8, 0.3), (0.7, 0.4))]
    at = placed(surfaces, [np.zeros(size(surface)) for surface in surfaces])
    frame = RelationFrame(at, np.array([0, 0, 1.0]))
    for kind, numbers, value in [
        ("parallel", (0, 1), None),
        ("parallel", (0, 2), None),
        ("perpendicular", (0, 4), None),
        ("angle", (2, 4), np.pi / 2),
        ("coaxial", (2, 3), None),
        ("distance", (0, 1), 2.0),
        ("distance", (1, 4), 2.0),
        ("equal_radius", (2, 4), None),
        ("equal_radius", (4, 5), None),
        ("radius", (5,), 0.5),
        ("half_angle", (3,), 0.3),
        ("axis_in_plane", (0, 4), None),
        ("coaxial", (2, 6), None),
        ("perpendicular", (6, 7), None),
        ("equal_radius", (2, 6), None),
        ("radius", (6,), 0.5),
        ("equal_ring_radius", (6, 7), None),
        ("tangent", (20, 21), None),
        ("tangent", (21, 22), None),
        ("tangent", (22, 23), None),
        ("horizontal", (1,), None),
        ("vertical", (3,), None),
        ("horizontal", (4,), None),
        ("regular", (0, 1, 8, 9), None),
        ("regular", (8, 1, 0), None),
        ("regular", (10, 11, 12, 13), None),
        ("symmetric", (14, 15, 16, 17, 18, 19), None),
        ("symmetric", (17, 16, 15, 14), None),
        ("symmetric", (19, 18, 16, 17), None),
        ("symmetric", (0, 9, 1, 8), None),
        ("symmetric", (9, 0, 8, 1), None),
        ("symmetric", (10, 13, 11, 12), None),
    ]:
        found = constrain(Relation(kind=kind, surfaces=numbers, value=value), at, frame)
        np.testing.assert_allclose(found.value, 0, atol=4e-15, err_msg=f"{kind} {numbers}")


def test_what_surfaces_cannot_have_is_refused():
    surfaces = [PLANE, PIPE, BALL, CONE, *(Cylinder((0, 0, k), (0, 0, 1), 0.2) for k in range(4))]
    at = placed(surfaces, [np.zeros(size(surface)) for surface in surfaces])
    for kind, numbers, value, words in [
        ("parallel", (0, 2), None, "a sphere has no direction: it cannot be parallel"),
        ("vertical", (2,), None, "a sphere has no direction: it cannot be vertical"),
        ("half_angle", (1,), 0.3, "only a cone has a half angle"),
        ("radius", (0,), 0.3, "only spheres, cylinders and tubes of tori have one radius"),
        ("equal_radius", (1, 3), None, "only spheres, cylinders and tubes of tori have one radius"),
        ("equal_ring_radius", (1, 3), None, "only tori have a ring"),
        ("angle", (0, 1), 0.0, "an angle of 0 deg is the relation parallel"),
        ("coplanar", (0, 1), None, "coplanar relates two planes"),
        ("tangent", (0, 3), None, "tangent relates a plane and a cylinder, or two cylinders"),
        ("coaxial", (0, 1), None, "coaxial relates two axes"),
        ("axis_in_plane", (1, 0), None, "axis in plane relates a plane and then an axis"),
        ("regular", (0, 1, 3), None, "regular relates planes, or axes, not both"),
        ("regular", (0, 1, 2), None, "a sphere has no direction: it cannot be regular"),
        ("symmetric", (0, 1, 2, 3), None, "halves of one kind, got a plane and a cylinder"),
        ("symmetric", (3, 1, 2, 0), None, "symmetric relates pairs of planes, of cylinders or of spheres"),
        ("symmetric", (4, 5, 6, 7), None, "symmetric: no pair tells where the mirror is"),
    ]:
        with pytest.raises(InputError, match=words):
            constrain(Relation(kind=kind, surfaces=numbers, value=value), at, RelationFrame(at, UP))
    with pytest.raises(InputError, match="vertical needs to know which way is up"):
        constrain(Relation(kind="vertical", surfaces=(0,)), at, RelationFrame(at))
    elliptic = EllipticCylinder((0, 0, 0), (0, 0, 1), (0.5, 0.4))
    with pytest.raises(InputError, match="EllipticCylinder: relations are known of planes"):
        place(elliptic, np.zeros(7))
    with pytest.raises(InputError, match="EllipticCylinder: relations are known of planes"):
        move_surface(elliptic, np.ones(7))


@pytest.mark.parametrize(
    ("words", "given"),
    [
        ("a relation is one of parallel, .*; got 'near'", {"kind": "near", "surfaces": (0, 1)}),
        ("parallel is a relation of 2 surfaces, got 3", {"kind": "parallel", "surfaces": (0, 1, 2)}),
        ("parallel relates different surfaces", {"kind": "parallel", "surfaces": (1, 1)}),
        ("regular is a relation of 3 or more surfaces, got 2", {"kind": "regular", "surfaces": (0, 1)}),
        ("pairs of surfaces, two or more, got 2", {"kind": "symmetric", "surfaces": (0, 1)}),
        ("pairs of surfaces, two or more, got 5", {"kind": "symmetric", "surfaces": (0, 1, 2, 3, 4)}),
        ("regular relates different surfaces", {"kind": "regular", "surfaces": (0, 1, 0)}),
        ("equal_distance relates different", {"kind": "equal_distance", "surfaces": (0, 1, 1, 0)}),
        ("angle needs a value, got None", {"kind": "angle", "surfaces": (0, 1)}),
        ("parallel has no value, got 1", {"kind": "parallel", "surfaces": (0, 1), "value": 1.0}),
        ("must be a number from 0, got nan", {"kind": "radius", "surfaces": (0,), "value": float("nan")}),
        ("must be a number from 0, got -1", {"kind": "radius", "surfaces": (0,), "value": -1.0}),
    ],
)
def test_a_relation_that_is_none_is_refused(words, given):
    with pytest.raises(InputError, match=words):
        Relation(**given)
