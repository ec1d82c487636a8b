# SPDX-License-Identifier: MIT
"""Measured points in parts are measured points as a whole, and coarser ones lie where they lie."""

import numpy as np
import pytest

from completion.observe.observation import observe
from completion.result import labelled_points as observed_points
from completion.result.labelled_points import mesh_area, observed_mesh, observed_parts, remainder
from scenes.pose import Pose
from tests.helpers.completion_examples import example


@pytest.fixture(scope="module")
def seen():
    return observe(example("chair_before_wall", pixels=90), Pose.identity())


@pytest.fixture(scope="module")
def owner(seen):
    return (np.indices(seen.scan.shape).sum(axis=0) // 20 % 3).astype(np.int32)


def triangles(mesh):
    """The corners of all triangles, in an order that does not depend on that of the mesh."""
    corners = mesh.vertices[mesh.faces].reshape(-1, 9)
    return corners[np.lexsort(corners.T)]


@pytest.mark.parametrize("band", [1, 100, 90 * 7, 90 * 89])
def test_rows_at_a_time_make_the_same_mesh(seen, owner, band, monkeypatch):
    whole = observed_mesh([seen, seen], [owner, owner])
    monkeypatch.setattr(observed_points, "_BAND", band)
    parts = observed_mesh([seen, seen], [owner, owner])
    for name in whole.of_vertices:
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    np.testing.assert_array_equal(triangles(parts), triangles(whole))


def test_a_part_holds_no_more_than_its_rows(seen, owner, monkeypatch):
    monkeypatch.setattr(observed_points, "_BAND", 90 * 10)
    parts = list(observed_parts([seen], [owner]))
    assert len(parts) == 9
    assert max(len(part.vertices) for part in parts) <= 900
    assert sum(len(part.vertices) for part in parts) == np.count_nonzero(seen.valid)


@pytest.mark.parametrize("band", [90 * 7, 1 << 18])
def test_the_remainder_is_what_touches_points_of_no_surface(seen, owner, band, monkeypatch):
    whole = observed_mesh([seen], [owner])
    expected = whole.part((whole.surface == 0)[whole.faces].any(axis=1))
    monkeypatch.setattr(observed_points, "_BAND", band)
    rest = remainder([seen], [owner])
    assert rest.step == 1
    np.testing.assert_array_equal(triangles(rest.points), triangles(expected))
    footprint = (
        np.linalg.norm(rest.points.vertices - seen.scan.origin, axis=1) * seen.scan.projection.pixel_angle
    )
    np.testing.assert_allclose(rest.error_m, np.maximum(2 * rest.points.sd, footprint / 2))


def test_a_large_remainder_is_coarser_and_covers_the_same(seen, monkeypatch):
    nobody = [np.zeros(seen.scan.shape, np.int32)]
    fine = remainder([seen], nobody).points
    monkeypatch.setattr(observed_points, "_MOST_FACES", 4_000)
    found = remainder([seen], nobody)
    coarse = found.points
    assert found.step == 2
    assert len(coarse.faces) <= 4_000
    assert mesh_area(coarse.vertices, coarse.faces) == pytest.approx(
        mesh_area(fine.vertices, fine.faces), rel=0.2
    )
    measured = seen.points_at(np.flatnonzero(seen.valid))
    assert set(map(tuple, coarse.vertices)) <= set(map(tuple, measured))
