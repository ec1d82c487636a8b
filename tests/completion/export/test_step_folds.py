# SPDX-License-Identifier: MIT
"""Curves that contacts of two surfaces speak for: each once, as far as its contacts, and none for noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from completion.export.step import limits
from completion.export.step.boundaries import OpenEnds
from completion.export.step.folds import ContactCurve, FoldFinder, tabulate
from completion.export.step.kernel import circle_through, kernel_surface, line_through
from completion.export.step.pieces import CurveCorner, LoopSide, RegionLoops, corners_of, pieces_of
from completion.export.step.tracing import trace_curve
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Surface
from tests.helpers.step_examples import needs_kernel

needs_kernel()

SPACING = 0.5


def curves(surface: Surface, two: Surface, contacts: np.ndarray, noise: float = 0.0) -> list[ContactCurve]:
    finder = FoldFinder([surface, two], [kernel_surface(surface), kernel_surface(two)], SPACING, noise)
    return finder.curves_between((0, 1), contacts)


def straight(low: float, high: float) -> ContactCurve:
    """A line along x."""
    geometry = line_through(np.array([[0.0, 0, 0], [1, 0, 0]]), 1e-9)
    line = tabulate((0, 1), geometry, (-50.0, 50.0), SPACING, is_closed=False, is_tangent=False)
    along = np.sign(line.at(np.ones(1))[0, 0] - line.at(np.zeros(1))[0, 0])
    shift = line.at(np.zeros(1))[0, 0]
    ends = sorted(along * (x - shift) for x in (low, high))
    return tabulate((0, 1), geometry, (ends[0], ends[1]), SPACING, is_closed=False, is_tangent=False)


def test_contacts_that_stray_from_a_crossing_do_not_repeat_it() -> None:
    rod, pipe = Cylinder((0, 0, 0), (0, 0, 1), 5.0), Cylinder((0, 0, 0), (1, 0, 0), 10.0)
    angle = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    x, y = 5 * np.cos(angle), 5 * np.sin(angle)
    fold = np.column_stack([x, y, np.sqrt(100 - y**2)])
    strays = fold[:40:10] + (0, 0, 1.8 * SPACING)
    found = curves(rod, pipe, np.concatenate([fold, strays]))
    assert len(found) == 1
    assert found[0].tree.query(fold)[0].max() < SPACING / 4


def test_cylinders_along_each_other_meet_once_in_an_arc_of_an_endless_circle() -> None:
    rod = Cylinder((-12.168, 16.742, 12.698), (-1.44e-4, -1.72e-5, 1.0), 14.812)
    drum = Cylinder((55.741, 176.752, 12.734), (0.00840652, -0.00325042, 0.99995938), 159.92)
    z = np.repeat(np.arange(0, 25.4, SPACING), 2)
    line = np.column_stack([np.full(len(z), -2.195), np.full(len(z), 27.695), z])
    found = curves(rod, drum, line + [[0.4, 0, 0], [-0.4, 0, 0]] * (len(z) // 2))
    assert len(found) == 1
    assert np.linalg.norm(np.diff(found[0].points, axis=0), axis=1).max() < SPACING
    assert found[0].tree.query(line)[0].max() < SPACING


@pytest.mark.parametrize(("degrees", "noise", "reach"), [(90, 0.0, 1.6), (90, 0.1, 2.0), (10, 0.1, 3.0)])
def test_flat_surfaces_are_confused_farther_from_their_fold(
    degrees: float, noise: float, reach: float
) -> None:
    turn = np.radians(degrees)
    floor, wall = Plane((0, 0, 0), (0, 0, 1)), Plane((0, 0, 0), (0, np.sin(turn), np.cos(turn)))
    line = np.column_stack([np.arange(20) * SPACING, np.zeros(20), np.zeros(20)])
    (curve,) = curves(floor, wall, line, noise)
    assert curve.reach == pytest.approx(reach)


def test_surfaces_touch_only_where_their_normals_agree() -> None:
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    ring = np.column_stack([20 * np.cos(angle), 20 * np.sin(angle), np.full(90, 0.8)])
    wide, narrow = (Cone((0, 0, 0), (0, 0, -1), 20.0, half) for half in (0.32, 0.24))
    assert trace_curve(wide, narrow, ring, SPACING, touching=True) is None
    rod, floor = Cylinder((0, 0, 5), (1, 0, 0), 5.0), Plane((0, 0, 0.02), (0, 0, 1))
    line = np.column_stack([np.arange(20) * SPACING, np.full(20, 0.3), np.zeros(20)])
    path = trace_curve(rod, floor, line, SPACING, touching=True)
    assert path is not None
    assert np.abs(path.points[:, 1]).max() < 1e-6


@pytest.mark.parametrize("reach", [limits.TOUCH_REACH, limits.CONTACT_REACH])
def test_a_piece_does_not_outrun_its_contacts_however_far_they_reach(reach: float) -> None:
    curve = replace(straight(-20, 20), reach=reach)
    contacts = np.column_stack([np.arange(-5, 5.1, SPACING), np.full(21, 0.1), np.zeros(21)])
    (piece,) = pieces_of([curve], [], contacts, np.tile([0, 1], (21, 1)), SPACING)
    ends = np.sort(curve.at(np.array([piece.low, piece.high]))[:, 0])
    assert ends == pytest.approx([-5, 5], abs=0.8 * SPACING)


def test_an_open_chain_without_width_bounds_nothing() -> None:
    floor = Plane((0, 0, 0), (0, 0, 1))
    line = straight(0, 10)
    corners = [CurveCorner(line.at(np.array([t]))[0], is_free=True) for t in (line.low, line.high)]
    (piece,) = pieces_of([line], [], line.points, np.tile([0, 1], (len(line.points), 1)), SPACING)
    points = np.stack(np.meshgrid(np.arange(0, 10, SPACING), np.arange(0, 6, SPACING)), -1).reshape(-1, 2)
    points = np.column_stack([points, np.zeros(len(points))])
    ends = OpenEnds([replace(piece, ends=(0, 1))], [line], corners, [floor, floor], SPACING)
    closed, at = ends.close_loops(0, RegionLoops([], [[LoopSide(0, True)]]), points)
    assert closed == RegionLoops([], [])
    assert at is None
    assert len(ends.pieces) == 1


@pytest.mark.parametrize(("missing", "is_closed"), [(0.2, True), (0.7, False)])
def test_a_traced_curve_closes_across_a_gap_if_most_of_it_has_contacts(
    missing: float, is_closed: bool
) -> None:
    rod, pipe = Cylinder((0, 0, 0), (0, 0, 1), 8.0), Cylinder((0, 0, 0), (1, 0, 0), 15.0)
    angle = np.linspace(0, 2 * np.pi * (1 - missing), 120)
    y = 8 * np.sin(angle)
    fold = np.column_stack([8 * np.cos(angle), y, np.sqrt(225 - y**2)])
    path = trace_curve(rod, pipe, fold, SPACING, touching=False)
    assert path is not None
    assert path.is_closed == is_closed
    beyond = cKDTree(fold).query(path.points)[0].max()
    assert is_closed or 3 * SPACING < beyond < 10 * SPACING


def test_edges_of_surfaces_that_touch_with_a_gap_meet_in_one_corner() -> None:
    gap, step, angle = 0.1, SPACING / 2, np.arange(40) * np.pi / 20
    rings = [
        np.column_stack([3 * np.cos(angle), sign * (3 + gap) + 3 * np.sin(angle), 0 * angle])
        for sign in (1, -1)
    ]
    edges = [
        tabulate((k, 2), circle_through(ring, 1e-6), (0, 2 * np.pi), step, is_closed=True, is_tangent=False)
        for k, ring in enumerate(rings)
    ]
    touch = tabulate(
        (0, 1), line_through(np.array([[0.0, 0, -1], [0, 0, 1]]), 1e-6), (-2, 2), step, is_closed=False,
        is_tangent=True,
    )  # fmt: skip
    (corner,) = corners_of([*edges, touch], step)
    assert set(corner.at) == {0, 1, 2}
    assert corner.off == pytest.approx(1.5 * gap, abs=0.6 * gap)
    assert np.linalg.norm(corner.point) < gap
