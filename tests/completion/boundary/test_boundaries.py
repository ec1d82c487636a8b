# SPDX-License-Identifier: MIT
"""Edges, their continuation, the pieces they make, and which of those are surface, against closed forms."""

import numpy as np
import pytest

from completion.boundary.boundary_pixels import BoundaryKind, BoundaryPixels
from completion.boundary.continuation import ALL_CUES, Cue, continue_edges
from completion.boundary.edges import BoundaryEdge, ChartLine, Circle, find_edges, meeting_line
from completion.boundary.hidden_regions import divide_hidden, label_regions
from completion.evidence.chart_grid import ChartGrid
from completion.extension.confidence import Onward, Prospects, distance_to
from scenes.surfaces.catalogue import Cylinder, Plane

STEP = 0.01
WALL = Plane((0, 0, 0), (0, 0, 1), (1, 0, 0))
GRID = ChartGrid.over(WALL, np.array([0.0, 0.0]), np.array([1.0, 1.0]), 0.01, full_turn=False)


def _rim(uv, step):
    return BoundaryPixels(
        uv, np.broadcast_to(step, uv.shape).copy(), np.full(len(uv), BoundaryKind.OWN_EDGE, np.int8)
    )


def _stairs(angle, n=60):
    """Places half way between pixels on either side of a line, as a grid of pixels sees it."""
    along = np.arange(n) * STEP
    height = np.tan(angle) * along + 0.3
    return np.column_stack([along, (np.floor(height / STEP) + 0.5) * STEP]), height


@pytest.mark.parametrize("angle_deg", [0.0, 3.0, 17.0, -31.0])
def test_a_line_is_found_to_a_fraction_of_a_pixel(angle_deg):
    uv, _ = _stairs(np.radians(angle_deg))
    best = find_edges(_rim(uv, (0.0, STEP)))[0]
    assert isinstance(best.curve, ChartLine)
    turn = np.degrees(np.arctan2(best.curve.direction[1], best.curve.direction[0]))
    assert (turn - angle_deg + 90) % 180 - 90 == pytest.approx(0.0, abs=0.6)
    middle = np.array([[0.3, np.tan(np.radians(angle_deg)) * 0.3 + 0.3]])
    assert abs(best.curve.across(middle)[0]) < 0.51 * STEP


def test_stretches_on_one_line_are_one_edge_with_two_runs():
    uv, _ = _stairs(0.0)
    apart = uv[(uv[:, 0] < 0.2) | (uv[:, 0] > 0.4)]
    (edge,) = find_edges(_rim(apart, (0.0, STEP)))
    assert edge.runs.shape == (2, 2)


def test_a_circle_is_a_circle_and_not_a_chain_of_chords():
    angle = np.linspace(0.2, 2.4, 80)
    uv = np.column_stack([np.cos(angle), np.sin(angle)]) * 0.3
    (edge,) = find_edges(_rim(uv, uv / 0.3 * STEP))
    assert isinstance(edge.curve, Circle)
    assert edge.curve.radius == pytest.approx(0.3, abs=1e-6)
    assert np.ptp(edge.runs[0]) == pytest.approx(0.3 * 2.2, abs=1e-6)


def test_scattered_points_are_no_edge():
    uv = np.random.default_rng(0).uniform(0, 1, (6, 2))
    assert find_edges(_rim(uv, (STEP, 0.0))) == []


def _corner():
    """A surface in the lower left, two own edges at u = 0.6 and v = 0.6, their corner hidden by a square."""
    row, column = np.mgrid[:100, :100]
    hidden = (row >= 40) & (row < 80) & (column >= 40) & (column < 80)
    measured = (row < 60) & (column < 60) & ~hidden
    open_ = ~measured & ~hidden
    edges = [
        BoundaryEdge(
            ChartLine(np.array([0.6, 0.0]), np.array([0.0, 1.0])),
            np.array([[0.0, 0.4]]),
            np.array([1.0]),
            1e-4,
        ),
        BoundaryEdge(
            ChartLine(np.array([0.0, 0.6]), np.array([1.0, 0.0])),
            np.array([[0.0, 0.4]]),
            np.array([-1.0]),
            1e-4,
        ),
    ]
    return hidden, measured, open_, edges


def test_two_edges_that_vanish_behind_an_occluder_meet_in_the_hidden_corner():
    hidden, measured, open_, edges = _corner()
    continued = continue_edges(edges, GRID, hidden)
    assert [edge.provenance for edge in continued] == ["convergent", "convergent"]
    regions = divide_hidden(GRID, hidden, measured, open_, continued)
    assert regions.n_regions == 4
    labelling = label_regions(regions)
    is_surface = np.zeros_like(hidden)
    is_surface[hidden] = labelling.is_surface[regions.region[hidden]]
    row, column = np.mgrid[:100, :100]
    assert np.array_equal(is_surface, hidden & (row < 60) & (column < 60))


def test_without_edges_a_hole_with_measured_rim_is_surface_and_one_with_open_rim_is_not():
    row, column = np.mgrid[:100, :100]
    hidden = (row >= 40) & (row < 60) & (column >= 40) & (column < 60)
    nothing = np.zeros_like(hidden)
    inside = label_regions(divide_hidden(GRID, hidden, ~hidden, nothing, []))
    outside = label_regions(divide_hidden(GRID, hidden, nothing, ~hidden, []))
    assert inside.is_surface.tolist() == [True]
    assert inside.margin[0] == pytest.approx(1.0)
    assert outside.is_surface.tolist() == [False]
    assert outside.margin[0] == pytest.approx(-1.0)


def test_what_touches_nothing_known_is_no_surface():
    hidden = np.ones((100, 100), dtype=np.bool_)
    nothing = np.zeros_like(hidden)
    labelling = label_regions(divide_hidden(GRID, hidden, nothing, nothing, []))
    assert labelling.is_surface.tolist() == [False]
    assert label_regions(divide_hidden(GRID, nothing, nothing, nothing, [])).is_surface.shape == (0,)


def test_an_edge_seen_on_both_sides_is_one_stretch():
    row, column = np.mgrid[:100, :100]
    hidden = (column >= 40) & (column < 60) & (row > 20) & (row < 80)
    line = ChartLine(np.array([0.0, 0.5]), np.array([1.0, 0.0]))
    (both,) = continue_edges(
        [BoundaryEdge(line, np.array([[0.0, 0.4], [0.6, 1.0]]), np.ones(2), 1e-4)], GRID, hidden
    )
    (once,) = continue_edges([BoundaryEdge(line, np.array([[0.0, 0.4]]), np.ones(1), 1e-4)], GRID, hidden)
    assert both.provenance == "collinear"
    assert once.provenance == "convergent"


def test_surfaces_meet_where_geometry_says():
    floor = Plane((0, 0, 0.25), (0, 0, 1))
    side = Plane((0, 0.5, 0), (0, -1, 0))
    line = meeting_line(side, floor)
    assert line is not None
    points = side.from_uv(line.at(np.linspace(-1, 1, 5)))
    np.testing.assert_allclose(floor.distance(points), 0, atol=1e-12)
    pipe = Cylinder((0.2, 0.1, 0), (0, 0, 1), 0.1)
    ring = meeting_line(pipe, floor)
    assert ring is not None
    np.testing.assert_allclose(
        floor.distance(pipe.from_uv(ring.at(np.linspace(-0.2, 0.2, 5)))), 0, atol=1e-12
    )
    assert meeting_line(floor, Plane((0, 0, 0.3), (0.01, 0, 1))) is None


def test_rim_points_keep_their_place_in_another_chart():
    other = Plane((0.3, 0.2, 0), (0, 0, 1), (1, 1, 0))
    uv = np.random.default_rng(0).uniform(0, 1, (20, 2))
    boundary = _rim(uv, (0.01, 0.002))
    moved = boundary.in_chart(WALL, other)
    np.testing.assert_allclose(other.from_uv(moved.uv), WALL.from_uv(uv), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(moved.step, axis=1), np.hypot(0.01, 0.002), atol=1e-12)


def test_confidence_falls_with_distance():
    away, none = np.array([0.0, 0.5, 1.0]), np.zeros(3, dtype=np.bool_)
    for onward in (Onward.WALL_WITHIN, Onward.OBJECT_WITHIN, Onward.CYLINDER):
        kind = np.full(3, onward, np.int8)
        found = Prospects(
            np.ones(3),
            kind,
            away,
            np.zeros(3),
            np.zeros((3, 11)),
            end_features=np.zeros((3, 4)),
            is_said=none,
        )
        assert (np.diff(found.probability()) < 0).all()
    cells = np.zeros(GRID.shape, dtype=np.bool_)
    assert (distance_to(cells, GRID)[0] > 1e5).all()
    cells[10:20, 10:30] = True
    distance, longer = distance_to(cells, GRID)
    assert distance[15, 39] == pytest.approx(0.1)
    assert longer[50, 50] == pytest.approx(0.2)


def test_an_edge_parts_surface_from_opening_only_on_the_side_it_was_seen_on():
    """Open cells left, measured ones right of a strip with one edge down its middle."""
    row, column = np.mgrid[:100, :100]
    hidden = (column >= 40) & (column < 60) & (row < 50)
    measured, open_ = (column >= 60) & (row < 50), (column < 40) & (row < 50)
    line = ChartLine(np.array([0.5, 0.0]), np.array([0.0, 1.0]))
    pieces = {}
    for side in (-1.0, 1.0):  # `across` grows to the left
        edge = BoundaryEdge(line, np.array([[0.5, 0.9]]), np.array([side]), 1e-4)
        regions = divide_hidden(GRID, hidden, measured, open_, continue_edges([edge], GRID, hidden))
        assert regions.n_regions == 2
        pieces[side] = label_regions(regions).margin[regions.region[25, [41, 58]]]
    assert pieces[-1.0][0] < pieces[1.0][0]
    assert pieces[-1.0][1] > pieces[1.0][1]


def test_runs_on_one_line_with_the_surface_on_different_sides_stay_apart():
    uv, _ = _stairs(0.0)
    below, above = _rim(uv[:25], (0.0, STEP)), _rim(uv[30:], (0.0, -STEP))
    boundary = BoundaryPixels(
        np.concatenate([below.uv, above.uv]),
        np.concatenate([below.step, above.step]),
        np.concatenate([below.kind, above.kind]),
    )
    (edge,) = find_edges(boundary)
    normal_up = edge.curve.normal[1] > 0
    assert sorted(edge.sides) == [-1.0, 1.0]
    first = edge.sides[np.argmin(np.abs(edge.curve.at(edge.runs.mean(axis=1))[:, 0] - 0.12))]
    assert (first < 0) == normal_up  # the surface lies below where steps lead up


@pytest.mark.parametrize("cue", [Cue.COLLINEAR, Cue.CONVERGENT, Cue.CLOSURE])
def test_a_cue_that_is_left_out_continues_no_edge(cue):
    row, column = np.mgrid[:100, :100]
    hidden = (column >= 40) & (column < 60) & (row > 20) & (row < 80)
    line = ChartLine(np.array([0.0, 0.5]), np.array([1.0, 0.0]))
    runs = {
        Cue.COLLINEAR: [[0.0, 0.4], [0.6, 1.0]], Cue.CONVERGENT: [[0.0, 0.4]], Cue.CLOSURE: [[0.7, 0.9]],
    }[cue]  # fmt: skip
    if cue == Cue.CLOSURE:
        line, hidden = ChartLine(np.array([0.39, 0.0]), np.array([0.0, 1.0])), hidden & (row > 40)
    edge = BoundaryEdge(line, np.array(runs), np.ones(len(runs)), 1e-4)
    others = tuple(other for other in ALL_CUES if other != cue)
    assert {edge.provenance for edge in continue_edges([edge], GRID, hidden)} == {cue}
    assert continue_edges([edge], GRID, hidden, others) == []
