# SPDX-License-Identifier: MIT
"""Unseen sides of parts: a box from its corner, a rod from one side; what is refuted, and refusals."""

import numpy as np
import pytest

from completion.parts.backs.assertion import mirrored_surface
from completion.parts.backs.hypothesis import Hypothesis, reflection
from completion.parts.backs.pipeline import find_back
from completion.parts.step_export import step_model
from scenes.checks import InputError
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Torus
from tests.completion.parts.backs.shapes import (
    BOX,
    EYE,
    STEP,
    box_corner,
    divided,
    rod,
    rounded,
    rounded_end,
    stepped,
)


def seen(part, **options):
    return find_back(part, origins=np.broadcast_to(EYE, part.points.shape), **options)


@pytest.fixture(scope="module")
def box():
    part = divided(box_corner())
    return part, seen(part)


def off_box(points):
    """Distance (n,) from the planes of the box."""
    return np.minimum(np.abs(points), np.abs(points - BOX)).min(axis=1)


def test_a_box_seen_from_its_corner_has_three_mirrors_and_six_faces(box):
    part, back = box
    assert [one.kind for one in back.chosen] == ["mirror"] * 3
    assert sorted(int(np.abs(one.direction).argmax()) for one in back.chosen) == [0, 1, 2]
    for one in back.chosen:
        assert one.point @ one.direction == pytest.approx(BOX / 2 @ one.direction, abs=STEP)
        assert one.relation == "symmetric"
    assert [face.is_new for face in back.faces] == [True] * 3
    assert {face.provenance for face in back.faces} == {"symmetry"}
    assert off_box(back.places.points).max() < STEP
    assert back.area_m2 == pytest.approx(BOX[0] * BOX[1] + BOX[0] * BOX[2] + BOX[1] * BOX[2], rel=0.1)
    assert set(back.places.label).isdisjoint(part.labels)
    assert not back.places.origin[back.places.origin != 1].size


def test_nothing_inferred_lies_before_what_was_measured(box):
    _, back = box
    inside = (back.places.points < BOX - STEP).any(axis=1)
    assert inside.all()


def test_the_same_without_the_scanners_place_but_with_sides():
    part = divided(box_corner())
    back = find_back(part, normals=EYE - part.points)
    assert len(back.chosen) == 3
    assert not back.is_told
    assert back.told.endswith("sides that see all were tried")
    assert off_box(back.places.points).max() < STEP


def test_the_box_closes_as_a_solid_whose_inferred_faces_say_so(box):
    pytest.importorskip("OCP")
    part, back = box
    model = step_model(part, back=back)
    assert model.is_solid
    assert model.volume_m3 == pytest.approx(float(np.prod(BOX)), rel=0.02)
    shares = {face.number: (face.measured_share > 0.9, face.inferred) for face in model.faces}
    assert all(shares[label] == (True, "") for label in part.labels)
    for face in back.faces:
        assert shares[face.label] == (False, f"inferred by symmetry, p {face.probability:.2f}")
    assert model.record()["inferred_faces"] == sorted(face.label for face in back.faces)
    assert b"PARTLY-INFERRED" in model.data


def test_a_step_refutes_the_mirror_along_it_and_keeps_the_one_across():
    back = seen(divided(stepped()))
    asserted = [int(np.abs(one.direction).argmax()) for one in back.chosen if one.kind == "mirror"]
    assert 0 not in asserted
    assert 2 not in asserted


def test_a_rod_seen_from_one_side_goes_all_round():
    part = divided(rod())
    back = seen(part)
    (axis,) = [one for one in back.chosen if one.kind == "axis"]
    assert axis.relation == "coaxial"
    turned = back.places.origin == 2
    assert np.hypot(*back.places.points[turned][:, 1:].T) == pytest.approx(0.01, abs=3e-4)
    angle = np.degrees(np.arctan2(*back.places.points[turned][:, [2, 1]].T))
    assert len(np.unique(np.floor(angle / 15))) >= 11  # of 24 sectors, twelve were measured
    (face,) = [one for one in back.faces if one.provenance == "turn"]
    assert not face.is_new
    assert back.places.points[:, 0].max() < 0.05 + STEP


def test_a_fillet_is_not_turned_round():
    part = divided(rounded())
    back = seen(part)
    bends = [
        label for label, fit in zip(part.labels, part.fits, strict=True) if fit.surface.kind == "cylinder"
    ]
    assert len(bends) == 1
    assert [one for one in back.chosen if one.kind == "axis"] == []


def test_the_round_end_of_a_bar_is_not_turned_into_the_bar():
    part = divided(rounded_end())
    back = seen(part)
    assert [fit.surface.kind for fit in part.fits].count("cylinder") == 1
    (axis,) = [one for one in back.hypotheses if one.kind == "axis"]
    assert axis.evidence["lost"] > 0.1  # its rim would end within the measured top
    assert axis not in back.chosen


def test_a_higher_least_asserts_no_more(box):
    part, back = box
    strict = seen(part, least=0.999)
    assert strict.chosen == ()
    assert strict.places is None
    best = back.hypotheses[0].probability
    assert f"has probability {best:.2f} of 0.999 needed" in strict.told


def test_the_same_input_gives_the_same_places(box):
    part, back = box
    again = seen(part)
    assert np.array_equal(again.places.points, back.places.points)


def test_without_a_scanners_place_or_sides_it_refuses():
    part = divided(box_corner())
    back = find_back(part)
    assert back.places is None
    assert back.told == (
        "no unseen side is inferred: the file tells neither where the scanner stood nor which side of the "
        "surface it saw"
    )


def test_surface_of_several_sides_without_the_scanners_places_is_refused():
    points = box_corner()
    both = np.concatenate([points, BOX - points])
    part = divided(both)
    back = find_back(part, normals=both - BOX / 2)
    assert back.places is None
    assert "no side shows all of its surface (at most 50 % face one way)" in back.told


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"least": 0.4}, "least must lie between 0.5 and 1, got 0.4"),
        ({"origins": np.zeros((3, 3))}, "3 origins for 15050 points; give one a point"),
        ({"normals": np.zeros((2, 2))}, r"expected normals with shape \(n, 3\), got \(2, 2\)"),
    ],
)
def test_what_cannot_be_is_refused(box, options, text):
    with pytest.raises(InputError, match=text):
        find_back(box[0], **options)


@pytest.mark.parametrize(
    "surface",
    [
        Plane([1, 2, 3], [0.6, 0, 0.8]),
        Cylinder([1, 2, 3], [0.6, 0, 0.8], 0.5),
        Cone([1, 2, 3], [0.6, 0, 0.8], 0.5, 0.3),
        Sphere([1, 2, 3], 0.5),
        Torus([1, 2, 3], [0.6, 0, 0.8], 2.0, 0.5),
    ],
    ids=lambda surface: surface.kind,
)
def test_a_mirrored_surface_is_as_far_from_mirrored_points(surface):
    points = np.random.default_rng(0).normal(size=(50, 3)) + [1, 2, 3]
    isometry = reflection(np.array([0.3, 0.1, 0.2]), np.array([2, 3, 6]) / 7)
    moved = points @ isometry[:, :3].T + isometry[:, 3]
    mirrored = mirrored_surface(surface, isometry)
    assert np.abs(mirrored.distance(moved)) == pytest.approx(np.abs(surface.distance(points)))


def test_the_spread_of_mirrored_points_follows_the_mirror():
    normal, point = np.array([1.0, 0.0, 0.0]), np.zeros(3)
    place, facing = np.array([[0.1, 0.2, 0.3]]), np.array([[1.0, 0.0, 0.0]])
    mirror = Hypothesis("mirror", point, normal, np.diag([0, 0, 1e-6]), {})
    assert mirror.spread(place, facing) == pytest.approx(2e-3)  # a shift moves the image twice as far
    tilted = Hypothesis("mirror", point, normal, np.diag([1e-6, 1e-6, 0]), {})
    assert tilted.spread(place, facing) == pytest.approx(2e-3 * np.hypot(0.2, 0.3), rel=1e-6)
