# SPDX-License-Identifier: MIT
"""Sides at which a surface was seen to end: most of a straight side, beside open space or no echo."""

import numpy as np
import pytest

from completion.boundary.boundary_pixels import BoundaryKind, BoundaryPixels, ended_sides, seen_ends
from scenes.surfaces.catalogue import Plane
from tests.completion.extension.test_enclosure import WALL, completed, patch_on, scan_of, within

STEP = 0.01
LOW, HIGH = np.array([0.0, 0.0]), np.array([2.0, 1.0])


def left_side(kinds) -> BoundaryPixels:
    """Rim points at u = 0 of the rectangle, evenly along v."""
    v = (np.arange(len(kinds)) + 0.5) / len(kinds)
    uv = np.column_stack([np.full(len(v), -STEP / 2), v])
    return BoundaryPixels(uv, np.tile([-STEP, 0.0], (len(v), 1)), np.array(kinds, np.int8))


@pytest.mark.parametrize("kind", [BoundaryKind.OWN_EDGE, BoundaryKind.NO_RETURN])
def test_a_side_beside_open_space_or_no_echo_ends_half_a_pixel_on(kind):
    sides = ended_sides(left_side([kind] * 100), LOW, HIGH)
    assert sides[0, 0] == pytest.approx(-STEP / 2)
    assert np.isnan(sides).sum() == 3


@pytest.mark.parametrize(
    "kind", [BoundaryKind.OCCLUDED, BoundaryKind.FRAME, BoundaryKind.CONTIGUOUS, BoundaryKind.LIMB]
)
def test_a_side_that_is_hidden_or_cut_by_the_frame_or_another_surface_does_not(kind):
    assert np.isnan(ended_sides(left_side([kind] * 100), LOW, HIGH)).all()


@pytest.mark.parametrize(("n_seen", "is_end"), [(40, False), (60, True)])
def test_most_of_the_side_must_be_seen_to_end(n_seen, is_end):
    kinds = [BoundaryKind.OWN_EDGE] * n_seen + [BoundaryKind.OCCLUDED] * (100 - n_seen)
    assert np.isfinite(ended_sides(left_side(kinds), LOW, HIGH)[0, 0]) == is_end


def test_an_edge_inside_the_rectangle_ends_no_side():
    boundary = left_side([BoundaryKind.OWN_EDGE] * 100)
    inner = BoundaryPixels(boundary.uv + [0.5, 0.0], boundary.step, boundary.kind)
    assert np.isnan(ended_sides(inner, LOW, HIGH)).all()


@pytest.mark.parametrize(
    ("kinds", "share"),
    [
        ([BoundaryKind.CONTIGUOUS, BoundaryKind.OWN_EDGE], 1),
        ([BoundaryKind.OCCLUDED, BoundaryKind.NO_RETURN], 0),
        (
            [BoundaryKind.CONTIGUOUS, BoundaryKind.OCCLUDED, BoundaryKind.OCCLUDED, BoundaryKind.OCCLUDED],
            0.25,
        ),
        ([BoundaryKind.FRAME], 0),
    ],
)
def test_an_end_is_seen_where_beams_went_past_it_or_lie_on_it_still(kinds, share):
    """The low end of a length of 1 m; its long sides and a gap in its middle are no ends."""
    n = 20
    kind = np.resize(np.array(kinds, np.int8), n)
    uv = np.column_stack([np.linspace(0, 0.1, n), np.full(n, -STEP / 2)])
    step = np.tile([0.0, 0.0 if kinds == [BoundaryKind.FRAME] else -STEP], (n, 1))
    long_side = BoundaryPixels(np.zeros((n, 2)), np.tile([STEP, 0.0], (n, 1)), np.full(n, 1, np.int8))
    gap = BoundaryPixels(np.tile([0.05, 0.5], (n, 1)), np.tile([0.0, STEP], (n, 1)), np.full(n, 1, np.int8))
    parts = [BoundaryPixels(uv, step, kind), long_side, gap]
    every = BoundaryPixels(
        np.concatenate([one.uv for one in parts]),
        np.concatenate([one.step for one in parts]),
        np.concatenate([one.kind for one in parts]),
    )
    np.testing.assert_allclose(seen_ends(every, 0.0, 1.0), [share, 0])


def test_a_wall_before_nothing_ends_behind_a_pipe_where_it_ends_beside_it():
    """A wall from x = -0.7 to 3, nothing beside it, and a beam before it that reaches past its edge."""
    wall = within(WALL, np.array([-0.7, -1.0]), np.array([3.0, 2.6]))
    board = Plane((0, 2.6, 0), (0, -1, 0))
    before = within(board, np.array([-2.0, 1.2]), np.array([0.6, 1.5]))
    found = completed(scan_of(wall, before))
    patch = patch_on(found, WALL)
    at = found.world_from_reference.apply(patch.grid.centres()[patch.hypothesised.ravel()])
    pixel = 3.0 / 110.0
    assert patch.hypothesised_m2 > 0.2
    assert at[:, 0].min() == pytest.approx(-0.7, abs=1.5 * pixel)
