# SPDX-License-Identifier: MIT
"""Texels: colours of several images, of faces without one and of nothing, against a slow reference."""

import numpy as np
import pytest

from scenes.mesh.labelled_mesh import Appearance

WHITE = np.ones((1, 3, 3), np.float32)
CORNERS = np.array([[[0, 0], [1, 0], [0, 1]]], np.float32)  # u, v of a face that covers the lower left half


def look(image, uv=CORNERS, colour=WHITE):
    images = (np.asarray(image, np.uint8),)
    return Appearance(colour, images, np.zeros(len(uv), np.int32), np.asarray(uv, np.float32))


def checker(height=2, width=4):
    return np.arange(height * width * 3).reshape(height, width, 3)


def test_corner_colours_multiply_the_texture_and_stand_alone_without_one():
    tint = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], np.float32)
    weights = np.array([[0.5, 0.3, 0.2]])
    grey = np.full((3, 3, 3), 102)
    assert look(grey, colour=tint).colour(np.zeros(1, np.int32), weights)[0] == pytest.approx(
        [0.2, 0.12, 0.08]
    )
    assert Appearance(tint).colour(np.zeros(1, np.int32), weights)[0] == pytest.approx([0.5, 0.3, 0.2])
    mixed = Appearance(
        np.repeat(tint, 2, axis=0),
        (np.full((1, 1, 3), 51, np.uint8),),
        np.array([0, -1]),
        np.repeat(CORNERS, 2, 0),
    )
    both = mixed.colour(np.array([0, 1], np.int32), np.repeat(weights, 2, axis=0))
    assert both[0] == pytest.approx(both[1] * 0.2)


def test_where_nothing_was_met_there_is_the_colour_of_nothing():
    faces = np.array([-1, 0], np.int32)
    found = look(checker()).colour(faces, np.array([[0, 0, 0], [1, 0, 0.0]]), nothing=0.25)
    assert found[0].tolist() == [0.25] * 3
    assert found.dtype == np.float32
    assert look(checker()).colour(np.zeros(0, np.int32), np.zeros((0, 3))).shape == (0, 3)


def test_several_images_against_a_slow_reference():
    rng = np.random.default_rng(0)
    images = tuple(rng.integers(0, 256, (h, w, 3)).astype(np.uint8) for h, w in ((5, 7), (3, 2)))
    uv = rng.uniform(-2, 2, (40, 3, 2)).astype(np.float32)
    tint = rng.random((40, 3, 3)).astype(np.float32)
    image_of = rng.integers(-1, 2, 40).astype(np.int32)
    faces, weights = rng.integers(0, 40, 500).astype(np.int32), rng.dirichlet([1, 1, 1], 500)
    found = Appearance(tint, images, image_of, uv).colour(faces, weights)
    expected = np.einsum("nc,nck->nk", weights, tint[faces])
    for i, face in enumerate(faces):
        if image_of[face] < 0:
            continue
        image = images[image_of[face]].astype(float)
        height, width = image.shape[:2]
        u, v = weights[i] @ uv[face].astype(float)
        x, y = u * width - 0.5, (1 - v) * height - 0.5
        c, r = int(np.floor(x)), int(np.floor(y))
        sample = sum(
            image[(r + dr) % height, (c + dc) % width] * (1 - abs(x - c - dc)) * (1 - abs(y - r - dr))
            for dr in (0, 1)
            for dc in (0, 1)
        )
        expected[i] *= sample / 255
    np.testing.assert_allclose(found, expected, atol=1e-5)
