# SPDX-License-Identifier: MIT
"""Samples of exposed surface: how much of a design is exposed, and what scans say of each sample."""

import numpy as np
import pytest

from completion.asbuilt.beams import Surfaces
from completion.asbuilt.faces import find_faces
from completion.asbuilt.findings import SAMPLE_REASONS, SAMPLE_STATES
from completion.asbuilt.pipeline import CheckOptions, check_against_design
from completion.asbuilt.samples import exposed_share, sample_design
from scenes.mesh.winding import turn_outside_out
from scenes.rays.raycast import RayCaster
from tests.completion.asbuilt.designs import boxes, scanned
from tests.completion.asbuilt.test_beams import EYE, ROOM

EACH_M2 = 0.01


def sampled(design):
    turned = turn_outside_out(design.mesh, design.mesh.face_surface)
    faces = find_faces(turned.mesh, 1.0)
    surfaces = Surfaces.of(turned.mesh, faces, turned.is_closed)
    samples = sample_design(turned.mesh, surfaces, RayCaster(turned.mesh.vertices, turned.mesh.faces, 1), 1.0)
    return samples, faces, exposed_share(samples, surfaces, faces.area)


def test_a_box_on_a_floor_covers_its_own_bottom_and_the_floor_below() -> None:
    design = boxes({"floor": ((0, 0, -0.2), (5, 4, 0)), "box": ((1, 1, 0), (3, 2, 1.5))})
    samples, faces, share = sampled(design)
    top, bottom = faces.normal[:, 2] > 0.9, faces.normal[:, 2] < -0.9
    assert share[(faces.element == 1) & bottom].tolist() == [0.0]
    assert share[(faces.element == 0) & top] == pytest.approx([18 / 20], abs=0.01)
    rest = ~((faces.element == 1) & bottom | (faces.element == 0) & top)
    assert share[rest] == pytest.approx(1.0, abs=0.04)
    assert samples.area_m2.sum() == pytest.approx(18 + 20 + 2 * 0.2 * 9 + 2 + 1.5 * 6, rel=0.01)
    inside = (np.abs(samples.points - [2, 1.5, 0.75]) < [0.99, 0.49, 0.74]).all(axis=1)
    assert not inside.any()


def test_samples_are_even_and_on_their_triangles() -> None:
    samples, _, _ = sampled(boxes({"slab": ((0, 0, 0), (4, 3, 0.1))}))
    top = samples.normals[:, 2] > 0.9
    cell = np.floor(samples.points[top, :2]).astype(int)
    count = np.bincount(cell[:, 0] * 3 + cell[:, 1], minlength=12)
    assert count == pytest.approx(100, abs=12)
    assert samples.points[top, 2] == pytest.approx(0.1)


def test_glass_has_no_sample() -> None:
    samples, _, _ = sampled(
        boxes({"wall": ((0, 0, 0), (2, 0.1, 2)), "pane": ((3, 0, 0), (4, 0.1, 2))}, ("pane",))
    )
    assert set(samples.element.tolist()) == {0}


@pytest.fixture(scope="module")
def behind_a_crate():
    """A room with a crate that is no part of its design, before the east wall."""
    design = boxes(ROOM)
    crate = ((3.0, 1.5, 0.0), (3.6, 3.5, 1.8))
    scan = scanned(design, EYE, sigma_m=0.001, rng=1, extras=[crate])
    return check_against_design(design, [scan], CheckOptions(registration=(0.001, 0.003)), n_threads=1)


def test_what_a_crate_hides_names_it(behind_a_crate) -> None:
    held = behind_a_crate.samples
    (crate,) = behind_a_crate.extra
    east = next(one for one in behind_a_crate.elements if one.element.name == "east")
    assert [(one.by, one.stations) for one in east.hidden] == [(crate.name, ("s1",))]
    assert "east" in crate.hides
    mine = (held.element == east.surface) & (held.normals[:, 0] < -0.9)
    # the crate's front is 1.5 m from the scanner, the wall 2.5 m: a shadow 5/3 as wide
    y = 2.5 + (np.array([1.5, 3.5]) - 2.5) * 2.5 / 1.5
    z = min(1.2 + (1.8 - 1.2) * 2.5 / 1.5, 2.5)
    shadow = mine & (held.points[:, 1] > y[0]) & (held.points[:, 1] < y[1]) & (held.points[:, 2] < z)
    hidden = held.reason == SAMPLE_REASONS.index("hidden")
    assert (hidden == shadow)[mine].mean() > 0.97
    assert (held.blocker[mine & hidden] == -2).mean() > 0.97
    assert east.hidden[0].area_m2 == pytest.approx(EACH_M2 * (mine & hidden).sum())


def test_states_and_reasons_agree_and_shares_sum_to_one(behind_a_crate) -> None:
    held = behind_a_crate.samples
    assert ((held.state == SAMPLE_STATES.index("measured")) == (held.reason == 0)).all()
    way = held.points - EYE
    elevation = np.degrees(np.arcsin(way[:, 2] / np.linalg.norm(way, axis=1)))
    faces_it = np.einsum("ij,ij->i", way, held.normals) < -1e-3
    out = held.reason == SAMPLE_REASONS.index("out of view")
    near = np.abs(elevation + 60.0) < 1.0  # the edge of the image
    assert (out == ~(faces_it & (elevation > -60) & (elevation < 85.5)))[~near].mean() > 0.999
    for one in behind_a_crate.elements:
        assert one.share.measured + one.share.inferred + one.share.unknown == pytest.approx(1.0)
        assert one.share.measured + sum(one.not_seen.values()) == pytest.approx(1.0)
