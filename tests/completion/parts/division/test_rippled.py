# SPDX-License-Identifier: MIT
"""Planes beneath ripple are whole, and what has no ripple is divided as ever."""

import numpy as np
import pytest

from completion.parts import pipeline
from completion.parts.division.faces import settle
from completion.parts.division.pipeline import fit_labelled, segment_part
from completion.parts.division.rippled import segment_rippled
from completion.parts.pipeline import divide_part
from tests.helpers.wall_examples import corner_mesh, panelled, wall_mesh


@pytest.mark.long
def test_a_wall_with_ripple_is_one_plane():
    vertices = wall_mesh(panelled(0))[0]
    found = segment_rippled(vertices)
    assert [fit.surface.kind for fit in found.fits] == ["plane"]
    assert (found.labels == 1).mean() > 0.9
    assert 0.001 < found.noise_m < 0.004
    assert "where ripple is noise" in found.warnings[0]


def test_points_beside_a_crease_go_to_their_own_wall():
    """Ripple of 2 mm makes a tolerance of a centimetre: three rows of the other wall are within it."""
    vertices, _, labels, fits = corner_mesh(5)
    taken = np.where((labels == 2) & (vertices[:, 2] < 0.031), 1, labels)
    found = settle(vertices, [fit.surface for fit in fits], taken)
    inner = np.abs(vertices[:, [0, 2]]).max(axis=1) > 0.009
    np.testing.assert_array_equal(found[inner], labels[inner])


def test_labels_are_kept_and_their_kind_is_sought_beneath_the_ripple():
    vertices, _, labels, _ = wall_mesh(panelled(0))
    found = segment_rippled(vertices, 7 * labels)
    assert found.names == (7,)
    assert [fit.surface.kind for fit in found.fits] == ["plane"]
    assert (found.labels == 1).all()


@pytest.mark.long
def test_without_ripple_it_is_the_same_division():
    rng = np.random.default_rng(0)
    flat = rng.uniform(0, 0.1, (3, 1500, 2))
    points = np.vstack([np.insert(flat[axis], axis, 0.0, axis=1) for axis in range(3)])
    points += rng.normal(0, 1e-4, points.shape)
    np.testing.assert_array_equal(segment_rippled(points).labels, segment_part(points).labels)


@pytest.mark.parametrize(("most", "n_faces"), [(12, 3), (13, 12)])
def test_where_ripple_looks_like_many_faces_it_is_sought_beneath(monkeypatch, most, n_faces):
    """Errors of a depth camera, alike over some points: a corner of a box has three faces."""
    rng = np.random.default_rng(3)
    flat = rng.uniform(0, 0.3, (3, 1000, 2))
    points = np.vstack([np.insert(flat[axis], axis, 0.0, axis=1) for axis in range(3)])
    quarter = (np.vstack(flat) > 0.15) @ [1, 2] + 4 * np.repeat(np.arange(3), 1000)
    waves, phase = rng.normal(size=(200, 3)) / 0.03, rng.uniform(0, 2 * np.pi, (200, 3))
    points += 0.004 * np.sqrt(2 / 200) * np.cos((points @ waves.T)[:, :, None] + phase).sum(axis=1)
    many = fit_labelled(points, quarter + 1, noise_m=0.004)
    monkeypatch.setattr(pipeline, "MANY_FACES", most)
    monkeypatch.setattr(pipeline, "segment_part", lambda *_, **__: many)
    found = divide_part(points)
    assert len(found.fits) == n_faces
    assert any("where ripple is noise" in text for text in found.warnings) == (n_faces == 3)
