# SPDX-License-Identifier: MIT
"""Parts put together from known surfaces are divided into these, with noise, in any order and place."""

import numpy as np
import pytest

from benchmarks.suites.parts import evaluate, overlaps, parts, read_part
from completion.parts.division.pipeline import segment_part
from scenes.checks import InputError
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Torus
from tests.helpers.generated_parts import PARTS, UP, ring, sampled, turn_of
from tests.helpers.long_cases import first_in_gate

_TELLING = 150  # points: of a chamfer three rows wide noise hides the kind
SPACING = 2.2e-3  # m; parts are about 100 mm large


def scores(labels, true):
    sets = [np.stack([one == k for k in range(1, one.max() + 1)]) for one in (true, labels)]
    return overlaps(*sets)


@pytest.mark.parametrize("sigma", first_in_gate(1, [1e-4, 0.0]))
@pytest.mark.parametrize("name", first_in_gate(1, PARTS))
def test_every_face_of_a_part_is_found_and_of_its_kind(name, sigma):
    points, true, surfaces = sampled(PARTS[name](), SPACING, sigma, 1)
    found = segment_part(points)
    overlap = scores(found.labels, true)
    assert overlap.max(axis=1).min() > 0.7  # where a fillet goes over into a plane, noise hides the border
    for number, place in enumerate(overlap.argmax(axis=1)):
        fit, surface = found.fits[place], surfaces[number]
        own = points[true == number + 1]
        if len(own) < _TELLING:
            continue
        assert fit.surface.kind == surface.kind
        off = np.abs(fit.surface.distance(own) - np.mean(fit.surface.distance(own)))
        assert np.sqrt(np.mean(off**2)) < max(1.3 * sigma, 0.02 * SPACING)
    assert found.noise_m == pytest.approx(sigma, rel=0.25, abs=0.01 * SPACING)
    assert len(found.fits) == len(found.groups) <= len(surfaces) + 1


@pytest.mark.long
def test_covariances_say_how_far_fits_are_off():
    """Errors at points of the true surface, in predicted deviations; neighbours' cuts widen them a little."""
    z = []
    for name in PARTS:
        points, true, surfaces = sampled(PARTS[name](), SPACING, 1e-4, 2)
        found = segment_part(points)
        overlap = scores(found.labels, true)
        for number, place in enumerate(overlap.argmax(axis=1)):
            if overlap[number].max() > 0.8 and (true == number + 1).sum() > 60:
                fit, surface = found.fits[place], surfaces[number]
                own = points[true == number + 1]
                feet = own - surface.distance(own)[:, None] * surface.normal(own)
                z.append(np.sqrt(np.mean((fit.surface.distance(feet) / fit.standard_deviation(feet)) ** 2)))
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.6


ALONE = {
    "plane": (Plane((0, 0, 0), UP), (-0.05, 0.05, -0.03, 0.03)),
    "sphere": (Sphere((0, 0, 0), 0.04), (-0.06, 0.06, -0.03, 0.04)),
    "cylinder": (Cylinder((0, 0, 0), UP, 0.03), (*turn_of(0.03), -0.05, 0.05)),
    "cone": (Cone((0, 0, 0), UP, 0.04, 0.4), (-0.04, 0.04, -0.03, 0.03)),
    "torus": (Torus((0, 0, 0), UP, 0.05, 0.02), (*turn_of(0.05), -0.05, 0.03)),
}


@pytest.mark.parametrize("sigma", [0.0, 2e-4])
@pytest.mark.parametrize("kind", first_in_gate(3, ALONE))
def test_one_surface_alone_is_one_face(kind, sigma):
    surface, bounds = ALONE[kind]
    points, _, _ = sampled([(surface, bounds, None)], SPACING, sigma, 3)
    found = segment_part(points)
    assert [fit.surface.kind for fit in found.fits] == [kind]
    assert np.mean(found.labels == 1) > 0.99


@pytest.mark.long
def test_order_place_and_scale_change_no_face():
    points, _, _ = sampled(PARTS["plate"](), SPACING, 1e-4, 4)
    found = segment_part(points)
    order = np.random.default_rng(0).permutation(len(points))
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    for changed, back in ((points[order], order), (1000 * points @ turn.T + 5.0, np.arange(len(points)))):
        other = segment_part(changed)
        overlap = scores(other.labels, found.labels[back].astype(np.int64))
        assert overlap.max(axis=1).min() > 0.97


@pytest.mark.long
def test_the_same_points_give_the_same_bytes():
    points, _, _ = sampled(PARTS["knob"](), SPACING, 1e-4, 5)
    one, two = segment_part(points), segment_part(points)
    assert one.labels.tobytes() == two.labels.tobytes()
    assert one.fits[0].covariance.tobytes() == two.fits[0].covariance.tobytes()


@pytest.mark.long
def test_copies_of_points_get_their_labels_and_change_nothing():
    points, _, _ = sampled(PARTS["knob"](), SPACING, 0.0, 6)
    one, two = segment_part(points), segment_part(np.concatenate([points, points[::-1]]))
    assert (two.labels[: len(points)] == one.labels).mean() > 0.99
    assert (two.labels[len(points) :] == one.labels[::-1]).mean() > 0.99


def test_faces_on_one_surface_are_told_and_stay_faces():
    pads = [(Plane((x, 0, 0), UP, (1, 0, 0)), (-0.02, 0.02, -0.02, 0.02), None) for x in (-0.04, 0.04)] + [
        (Plane((0, 0, -0.01), UP, (1, 0, 0)), (-0.06, 0.06, -0.02, 0.02), None)
    ]
    points, true, _ = sampled(pads, SPACING, 1e-4, 7)
    found = segment_part(points)
    assert len(found.fits) == 3
    assert len(set(found.groups)) == 2
    assert len(np.unique(found.by_surface())) == 2
    assert scores(found.labels, true).max(axis=1).min() > 0.95


@pytest.mark.long
def test_given_normals_and_noise_are_used():
    points, true, surfaces = sampled(PARTS["plate"](), SPACING, 1e-4, 8)
    normals = np.empty_like(points)
    for number, surface in enumerate(surfaces, start=1):
        normals[true == number] = -7 * surface.normal(points[true == number])
    found = segment_part(points, normals, noise_m=1e-4)
    assert found.noise_m == 1e-4
    assert scores(found.labels, true).max(axis=1).min() > 0.8


@pytest.mark.parametrize("n", [0, 1, 3, 7])
def test_few_points_have_no_faces(n):
    found = segment_part(np.random.default_rng(0).normal(size=(n, 3)))
    assert (found.fits, found.groups, len(found.labels)) == ((), (), n)
    assert "nothing" in repr(found)


def test_places_that_determine_nothing_are_no_face():
    assert segment_part(np.zeros((100, 3))).fits == ()
    line = np.linspace(0, 1, 100)[:, None] * [1.0, 2, 3]
    assert segment_part(line).fits == ()


@pytest.mark.parametrize(
    ("arguments", "given", "message"),
    [
        ((np.zeros((5, 2)),), {}, r"expected points with shape \(n, 3\), got \(5, 2\)"),
        ((np.full((9, 3), np.nan),), {}, r"9 of 9 points are not finite"),
        ((np.ones((9, 3)), np.ones((8, 3))), {}, "8 normals for 9 points; give one a point"),
        ((np.ones((9, 3)), np.zeros((9, 3))), {}, "9 of 9 normals have no length"),
        ((np.ones((9, 3)),), {"noise_m": -1.0}, "noise_m must be a number of metres from 0, got -1"),
    ],
)
def test_bad_input_is_named(arguments, given, message):
    with pytest.raises(InputError, match=message):
        segment_part(*arguments, **given)


@pytest.mark.long
def test_more_points_than_surfaces_are_sought_in_all_find_their_face():
    disk = [
        (Plane((0, 0, 0), UP), (-0.05, 0.05, -0.05, 0.05), ring(0, 0.05)),
        (Cylinder((0, 0, 0), UP, 0.05), (*turn_of(0.05), 0, 0.03), None),
    ]
    points, true, _ = sampled(disk, 4e-4, 5e-5, 9)
    assert len(points) > 60_000
    found = segment_part(points)
    assert scores(found.labels, true).max(axis=1).min() > 0.97
    assert found.fits[0].n > 15_000


@pytest.mark.long
@pytest.mark.skipif(not parts(), reason="no parts in UNSEEN_DATA/parts")
@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_of_real_parts_nearly_all_primitives_are_found(noise):
    found = total = 0.0
    for seed, path in enumerate(parts("held-out")):
        counts = evaluate(read_part(path), noise, seed).counts
        found, total = found + counts[1], total + counts[0]
    assert found >= 0.85 * total
