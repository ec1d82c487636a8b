# SPDX-License-Identifier: MIT
"""Surface samples: areas, evenness, interiors."""

import numpy as np
import pytest

from nbv.visibility.samples import SurfaceSamples, default_spacing, sample_surface
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.morton import morton_order

TRIANGLES = LabelledMesh(
    np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [0, 0, 0.01], [1e-3, 0, 0.01]], dtype=float),
    np.array([[0, 1, 2], [0, 2, 3], [0, 5, 4], [0, 0, 1]]),
    np.array([0, 0, 1, 1]),
)


@pytest.mark.parametrize("every_face", [True, False])
def test_areas_add_up_to_the_mesh(every_face):
    samples = sample_surface(TRIANGLES, 0.05, every_face=every_face)
    assert samples.total_m2 == pytest.approx(TRIANGLES.face_areas().sum())
    assert (2 in samples.face) == every_face
    assert 3 not in samples.face
    assert (samples.surface == TRIANGLES.face_surface[samples.face]).all()


def test_samples_lie_strictly_inside_their_faces():
    samples = sample_surface(TRIANGLES, 0.03)
    a, b, c = np.moveaxis(TRIANGLES.corners[samples.face], 1, 0)
    whole = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    for p, q in ((a, b), (b, c), (c, a)):
        share = np.linalg.norm(np.cross(p - samples.points, q - samples.points), axis=1) / whole
        assert share.min() > 1e-5


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
