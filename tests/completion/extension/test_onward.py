# SPDX-License-Identifier: MIT
"""How a plane goes on to hidden places: the compiled loop against the plain formula."""

import numpy as np
import pytest

from completion.evidence.evidence import Evidence, Label
from completion.extension.confidence import Onward, is_fragment, onward_on_plane


@pytest.mark.parametrize("encloses", [False, True])
def test_places_are_within_the_measured_rectangle_or_beyond_its_sides(encloses):
    rng = np.random.default_rng(0)
    uv, near = rng.uniform(-2, 3, (500, 2)), rng.uniform(0, 1, 500)
    own = np.array([[0.0, -0.5], [1.5, 1.0]])
    ends = np.array([[0.0, 1.0], [0.25, 0.0]])
    past = np.stack([own[0] - uv, uv - own[1]])  # side, place, axis
    is_out = (past > 0).any(axis=(0, 2))
    beyond = (np.maximum(past, 0.0) / (own[1] - own[0])).max(axis=(0, 2))
    certain = np.where(past > 0, ends[:, None, :], 1.0).min(axis=(0, 2))
    to_end = is_out & (certain > 0)
    if encloses:
        kind = np.select([to_end, is_out], [Onward.WALL_TO_END, Onward.WALL_BEYOND], Onward.WALL_WITHIN)
        distance, probability = np.where(is_out & ~to_end, beyond, near), np.zeros(500)
    else:
        kind = np.where(is_out, Onward.OBJECT_BEYOND, Onward.OBJECT_WITHIN)
        distance, probability = np.where(is_out, beyond, near), np.where(is_out, certain, 0.0)
    found = onward_on_plane(uv, near, own, ends, encloses)
    for one, expected in zip(found, (kind, distance, probability), strict=True):
        np.testing.assert_array_equal(one, expected)
    assert len(np.unique(kind)) == (3 if encloses else 2)


@pytest.mark.parametrize(("n_open", "is_piece"), [(0, True), (3, True), (4, False), (10, False)])
def test_a_plane_that_was_hardly_seen_to_end_is_a_fragment(n_open, is_piece):
    observed = np.zeros((12, 12), dtype=np.bool_)
    observed[2:10, 2:10] = True  # 36 cells lie around it
    labels = np.full((12, 12), Label.OCCLUDED, np.int8)
    labels[1, 1 : 1 + n_open] = Label.FREE
    nothing, none = np.zeros((12, 12), np.int32), np.zeros((12, 12), dtype=np.bool_)
    evidence = Evidence(labels, observed, observed, nothing, nothing, nothing, none, none)
    assert is_fragment(evidence) is is_piece
