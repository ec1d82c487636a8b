# SPDX-License-Identifier: MIT
"""Open doors: the leaf is found where it turned to, and what is near is not taken for it."""

import numpy as np
import pytest

from completion.asbuilt.doors import leaf_of
from completion.asbuilt.faces import find_faces
from completion.asbuilt.findings import Extra
from tests.completion.asbuilt.designs import boxes

WIDE_M, HIGH_M = 0.9, 2.05
DOOR = find_faces(boxes({"door": ((1, 0, 0), (1 + WIDE_M, 0.04, HIGH_M))}).mesh, 1.0)


def extra_of(points, name="extra-1") -> Extra:
    return Extra(name, np.array([points.min(axis=0), points.max(axis=0)]), 1.8, points)


def leaf(angle_deg, hinge=0.0, way=1.0) -> np.ndarray:
    """Cells of 5 cm of the leaf, turned about the edge x = 1 or that at the other side, towards +y or -y."""
    s, z = (
        grid.ravel() for grid in np.meshgrid(np.arange(0.025, WIDE_M, 0.05), np.arange(0.025, HIGH_M, 0.05))
    )
    turn, edge = np.radians(angle_deg), -1.0 if hinge else 1.0
    x = 1 + hinge + edge * s * np.cos(turn)
    return np.column_stack([x, way * s * np.sin(turn), z])


@pytest.mark.parametrize("angle_deg", [30, 60, 90, 115])
@pytest.mark.parametrize("hinge", [0.0, WIDE_M])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_leaf_is_found_with_its_angle(angle_deg, hinge, way) -> None:
    found = leaf_of(DOOR, 0, [extra_of(leaf(angle_deg, hinge, way))], 1.0)
    assert found is not None
    assert found[0] == "extra-1"
    assert np.degrees(found[1]) == pytest.approx(angle_deg, abs=4)


def test_the_leaf_is_told_from_other_extras() -> None:
    crate = np.random.default_rng(1).uniform((1.2, -1.5, 0), (1.8, -0.9, 0.6), (500, 3))
    found = leaf_of(DOOR, 0, [extra_of(crate, "extra-1"), extra_of(leaf(60), "extra-2")], 1.0)
    assert found is not None
    assert found[0] == "extra-2"
    assert np.degrees(found[1]) == pytest.approx(60, abs=4)


@pytest.mark.parametrize("points", [
    leaf(60) + [0.3, 0.4, 0],  # a board that stands a step away
    leaf(60)[leaf(60)[:, 2] < 0.9],  # a low cupboard
    leaf(60) + [6.0, 0, 0],  # far away
    np.random.default_rng(1).uniform((1.2, 0.3, 0), (1.8, 0.9, 0.6), (500, 3)),
])  # fmt: skip
def test_what_is_near_is_no_leaf(points) -> None:
    assert leaf_of(DOOR, 0, [extra_of(points)], 1.0) is None


def test_a_wall_along_the_opening_is_no_leaf() -> None:
    """A screen 0.5 m behind the door, parallel to it."""
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(0, 3, 0.05), np.arange(0, 2.5, 0.05)))
    screen = np.column_stack([x, np.full(len(x), 0.5), z])
    assert leaf_of(DOOR, 0, [extra_of(screen)], 1.0) is None
    assert leaf_of(DOOR, 0, [], 1.0) is None
    assert leaf_of(DOOR, 1, [extra_of(leaf(60))], 1.0) is None
