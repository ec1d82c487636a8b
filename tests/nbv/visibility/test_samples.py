# SPDX-License-Identifier: MIT
"""Surface samples: areas, evenness, interiors."""

import numpy as np
import pytest

from nbv.visibility.samples import SurfaceSamples, default_spacing, sample_surface
from scenes.checks import InputError
from scenes.mesh.blocks import morton_order
from scenes.mesh.labelled_mesh import LabelledMesh

TRIANGLES = LabelledMesh(
    np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [0, 0, 0.01], [1e-3, 0, 0.01]], dtype=float),
    np.array([[0, 1, 2], [0, 2, 3], [0, 5, 4], [0, 0, 1]]),
    np.array([0, 0, 1, 1]),
)


@pytest.mark.parametrize("spacing", [0.05, 2.0])
def test_areas_add_up_to_the_mesh(spacing):
    samples = sample_surface(TRIANGLES, spacing)
    assert samples.total_m2 == pytest.approx(TRIANGLES.face_areas().sum())
    assert 3 not in samples.face
    assert (samples.surface == TRIANGLES.face_surface[samples.face]).all()


def test_where_faces_are_few_each_has_a_sample():
    assert set(sample_surface(TRIANGLES, 0.05).face.tolist()) == {0, 1, 2}


def many_triangles(n: int) -> LabelledMesh:
    """Two surfaces of n small triangles each, the second much smaller."""
    corner = np.random.default_rng(0).random((2 * n, 1, 3)) * [1, 1, 0] + np.zeros((2 * n, 3, 3))
    shape = np.array([[0, 0, 0], [1e-3, 0, 0], [0, 1e-3, 0]])
    size = np.repeat([1.0, 0.1], n)[:, None, None]
    vertices = (corner + size * shape).reshape(-1, 3)
    return LabelledMesh(vertices, np.arange(6 * n).reshape(-1, 3), np.repeat([0, 1], n))


def test_however_many_the_faces_samples_are_bounded_and_areas_right():
    mesh = many_triangles(60_000)
    samples = sample_surface(mesh)
    assert len(samples) < 1.2 * 20_000
    areas = np.bincount(mesh.face_surface, mesh.face_areas())
    assert np.bincount(samples.surface, samples.areas) == pytest.approx(areas)
    coarse = sample_surface(mesh, 0.02)
    assert len(coarse) <= 3 * mesh.face_areas().sum() / 0.02**2
    assert set(coarse.surface.tolist()) == {0, 1}


def test_congruent_faces_do_not_share_their_samples():
    plates = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float) + np.arange(9).reshape(-1, 1, 1) * [0, 0, 1]
    mesh = LabelledMesh(plates.reshape(-1, 3), np.arange(27).reshape(-1, 3))
    samples = sample_surface(mesh, 0.2)
    first = [samples.points[samples.face == face][:, :2] for face in range(9)]
    assert len({len(points) for points in first}) == 1
    assert min(np.abs(a - b).max() for k, a in enumerate(first) for b in first[:k]) > 0.01


def test_pairs_are_neighbours_on_one_face():
    samples = sample_surface(TRIANGLES, 0.02)
    samples = samples.some(samples.face < 2)  # the third face is too small for a pair
    counts = np.bincount(samples.pair, minlength=1)
    counts = counts[counts > 0]
    assert set(counts.tolist()) <= {2, 3}
    for pair in np.unique(samples.pair)[::17]:
        points = samples.points[samples.pair == pair]
        assert np.ptp(points, axis=0).max() < 0.02 * 4


def test_samples_of_a_moved_mesh_are_the_moved_samples():
    samples, shift = sample_surface(TRIANGLES, 0.05), np.array([3.0, -2.0, 7.0])
    moved = LabelledMesh(TRIANGLES.vertices + shift, TRIANGLES.faces, TRIANGLES.face_surface)
    assert sample_surface(moved, 0.05).points == pytest.approx(samples.points + shift)


def test_samples_lie_strictly_inside_their_faces():
    samples = sample_surface(TRIANGLES, 0.03)
    a, b, c = np.moveaxis(TRIANGLES.corners[samples.face], 1, 0)
    whole = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    for p, q in ((a, b), (b, c), (c, a)):
        share = np.linalg.norm(np.cross(p - samples.points, q - samples.points), axis=1) / whole
        assert share.min() > 1e-6


def test_samples_are_spread_more_evenly_than_random_ones():
    points = sample_surface(TRIANGLES, 0.02).points
    counts = np.histogram2d(points[:, 0], points[:, 1], bins=(20, 10))[0]
    assert counts.std() < 0.5 * np.sqrt(counts.mean())  # random samples would have sqrt(mean)


def test_neighbours_follow_each_other():
    samples = sample_surface(TRIANGLES, 0.02)
    assert (morton_order(samples.points) == np.arange(len(samples))).all()


def test_default_spacing_gives_about_20000_samples():
    assert 19_000 < len(sample_surface(TRIANGLES)) < 21_000
    assert default_spacing(TRIANGLES) == pytest.approx(0.01, rel=0.01)


def test_unusable_input_is_refused():
    flat = LabelledMesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(InputError, match="no surface: 1 faces"):
        sample_surface(flat)
    with pytest.raises(InputError, match="spacing_m must be positive, got 0"):
        sample_surface(TRIANGLES, 0.0)
    with pytest.raises(InputError, match="2 samples, but normals"):
        SurfaceSamples(np.zeros((2, 3)), np.zeros((1, 3)), np.zeros(2), np.zeros(2), np.zeros(2))
