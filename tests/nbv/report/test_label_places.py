# SPDX-License-Identifier: MIT
"""Texts beside points: they cover neither each other nor the points while there is room."""

import numpy as np

from nbv.report.figures.floor_plan import around, beside, boxes


def covered(rectangles):
    """Area (n, n) that each two rectangles have in common, 0 with itself."""
    low = np.maximum(rectangles[:, None, 0], rectangles[None, :, 0])
    high = np.minimum(rectangles[:, None, 1], rectangles[None, :, 1])
    area = np.maximum(high - low, 0.0).prod(axis=2)
    np.fill_diagonal(area, 0.0)
    return area


def test_numbers_of_near_points_do_not_run_together():
    points = np.array([[0.0, 0.0], [6.0, 0.0], [0.0, 7.0], [6.0, 7.0]])
    sizes, dots = np.full((4, 2), [10.0, 9.0]), boxes(points, np.full((4, 2), 4.0))
    placed = beside(points, sizes, 2.0, dots)
    assert covered(np.concatenate([dots[:0], boxes(placed, sizes)])).max() == 0
    assert (np.abs(placed - points) <= sizes).all()
    alone = beside(points[:1], sizes[:1], 2.0, dots[:1])
    assert (alone[0] > points[0]).all()  # above on the right, where nothing is in the way


def test_a_name_gives_way_to_a_point_and_else_stays():
    places, sizes = np.array([[0.0, 0.0], [100.0, 0.0]]), np.full((2, 2), [30.0, 14.0])
    dot = boxes(np.array([[2.0, 1.0]]), np.full((1, 2), 4.0))
    moved, stayed = around(places, sizes, dot)
    assert (stayed == places[1]).all()
    assert covered(np.concatenate([dot, boxes(moved[None], sizes[:1])])).max() == 0


def test_nothing_to_place():
    assert beside(np.zeros((0, 2)), np.zeros((0, 2)), 1.0, np.zeros((0, 2, 2))).shape == (0, 2)
