# SPDX-License-Identifier: MIT
"""Slim faces: the side of a board a few pixels wide is found at the edge beside it, with its angle."""

from types import SimpleNamespace

import numpy as np
import pytest

from completion.boundary.edges import BoundaryEdge, ChartLine
from completion.export.panels.pipeline import NO_SURFACE, slim_folds
from scenes.surfaces.catalogue import Plane

CELL = 0.01
BOARD = Plane((0, 0, 0), (0, 0, 1), (1, 0, 0))  # covers y < 0; its edge runs along x
RUN = np.array([[-0.5, 0.5]])


def board(deviation=0.001):
    """A sheet with one straight edge, as far as slim faces look at it."""
    line = ChartLine(np.zeros(2), np.array([1.0, 0.0]))
    edge = BoundaryEdge(line, RUN, np.array([-1.0]), deviation)
    fit = SimpleNamespace(rms=0.0005, standard_deviation=lambda points: np.full(len(points), 0.001))
    patch = SimpleNamespace(
        edges=(edge,), source=SimpleNamespace(fit=fit), stated=fit, grid=SimpleNamespace(surface=BOARD)
    )
    return SimpleNamespace(number=1, surface=BOARD, patch=patch, cell_m=CELL)


def strip(degrees, width_m=0.03, noise_m=0.0003, n=120):
    """Points on a face that leaves the board's edge at an angle, from outward to its normal."""
    rng = np.random.default_rng(0)
    along, across = rng.uniform(-0.4, 0.3, n), rng.uniform(0, width_m, n)
    direction = np.array([0, np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    points = along[:, None] * [1.0, 0, 0] + across[:, None] * direction
    return points + rng.normal(0, noise_m, (n, 3))


@pytest.mark.parametrize("degrees", [-135.0, -90.0, -60.0, 60.0, 90.0])
def test_its_angle_and_extent_are_found(degrees):
    (fold,) = slim_folds([board()], strip(degrees), [])
    assert fold.surfaces == (1, NO_SURFACE)
    assert fold.dihedral_deg == pytest.approx(180 - degrees, abs=3 * fold.dihedral_sd_deg + 0.5)
    assert np.sort(fold.points[:, 0]) == pytest.approx([-0.4, 0.3], abs=2 * CELL)
    assert np.abs(fold.points[:, 1:]).max() < 0.002
    assert np.linalg.norm(fold.normals, axis=1) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        strip(-90, n=5),
        strip(-10.0),  # flatter than 20 degrees
        np.random.default_rng(1).uniform([-0.4, -0.05, -0.05], [0.4, 0.05, 0.05], (300, 3)),  # a bush
        strip(-90.0) + [0, 0, 0.3],  # elsewhere
    ],
)
def test_what_is_no_face_is_none(points):
    assert slim_folds([board()], points, []) == []


def test_folds_that_are_known_are_not_found_again():
    (fold,) = slim_folds([board()], strip(-90.0), [])
    assert slim_folds([board()], strip(-90.0), [fold]) == []
