# SPDX-License-Identifier: MIT
"""Texts beside points: they cover neither each other nor the points, and what has no room is left out."""

from itertools import combinations, pairwise

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from nbv.report.figures.floor_plan import FloorPlan, StoreyPlan
from nbv.report.figures.labels import Label, beside, boxes, place_texts


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


def test_nothing_to_place():
    assert beside(np.zeros((0, 2)), np.zeros((0, 2)), 1.0, np.zeros((0, 2, 2))).shape == (0, 2)
    assert place_texts(np.zeros((0, 2)), [], None, np.array([[0.0, 0.0], [9.0, 9.0]])).shape == (0, 2)


def numbers(n):
    return [Label(str(k), np.zeros(2), "k", 8.0, 4.0) for k in range(1, n + 1)]


def test_a_name_gives_way_to_a_point_and_else_stays():
    places, frame = (
        np.array([[50.0, 50.0], [150.0, 50.0], [52.0, 51.0]]),
        np.array([[0.0, 0.0], [200.0, 100.0]]),
    )
    labels = [Label("room", place, "k", 8.0) for place in places[:2]] + numbers(1)
    moved, stayed, number = place_texts(places, labels, None, frame)
    assert (stayed == places[1]).all()
    sizes = np.array([label.size_pt for label in labels])
    taken = np.concatenate(
        [boxes(np.stack([moved, number]), sizes[[0, 2]]), boxes(places[2:], np.full((1, 2), 4.0))]
    )
    assert covered(taken).max() == 0


def test_what_has_no_room_is_left_out_and_the_rest_stays_within():
    frame = np.array([[0.0, 0.0], [120.0, 90.0]])
    points = np.random.default_rng(0).uniform(frame[0], frame[1], (60, 2))
    placed = place_texts(points, numbers(60), None, frame)
    is_placed = ~np.isnan(placed[:, 0])
    assert 0 < is_placed.sum() < 60
    sizes = np.array([label.size_pt for label in numbers(60)])
    rectangles = boxes(placed, sizes)[is_placed]
    assert covered(rectangles).max() == 0
    assert (rectangles >= frame[0]).all()
    assert (rectangles <= frame[1]).all()


def dense_plan(n=70, extent=(16.0, 9.0)):
    """Many stations with directions and a few scans in rooms, some smaller than their names."""
    draws = np.random.default_rng(3)
    wide, deep = extent
    xs, ys = np.linspace(0, wide, 9), np.linspace(0, deep, 5)
    walls = [[[x, 0], [x, deep]] for x in xs] + [[[0, y], [wide, y]] for y in ys]
    middles = [np.array([(a + b) / 2, (c + d) / 2]) for a, b in pairwise(xs) for c, d in pairwise(ys)]
    places = draws.uniform([0.2, 0.2], [wide - 0.2, deep - 0.2], (n, 2))
    return StoreyPlan(
        storey=1,
        title="dense",
        outline=np.array(walls, dtype=np.float64),
        cut_m=1.5,
        rooms=[(f"room {k}\n{4 + k / 10:.1f} m\u00b2", place) for k, place in enumerate(middles, start=1)],
        stations=[(str(k), place, (45.0 * k,)) for k, place in enumerate(places, start=1)],
        given=[(name, place) for name, place in zip("ABC", draws.uniform(1, 8, (3, 2)), strict=True)],
        ways=[places],
    )


def test_texts_of_a_dense_plan_cover_neither_each_other_nor_dots():
    plan = dense_plan()
    figure = plan.sheet()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    axes = figure.axes[0]
    texts = [text for text in axes.texts if text.get_text() not in ("", "+y")]
    drawn = np.array([text.get_window_extent(canvas.get_renderer()).get_points() for text in texts])
    assert covered(drawn).max() == 0
    dots = axes.transData.transform([place for _, place, _ in plan.stations])
    inside = ((dots[:, None] > drawn[:, 0]) & (dots[:, None] < drawn[:, 1])).all(axis=2)
    assert not inside.any()
    assert len(texts) >= 0.9 * (len(plan.stations) + len(plan.rooms) + len(plan.given))
    frame = axes.get_window_extent().get_points()
    assert (drawn[:, 0] >= frame[0] - 1).all()
    assert (drawn[:, 1] <= frame[1] + 1).all()


def test_every_text_is_at_its_dot_or_a_line_leads_to_it():
    plan = dense_plan()
    figure = plan.sheet()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    axes, point = figure.axes[0], figure.dpi / 72
    places = {name: place for name, place, *_ in [*plan.stations, *plan.given]}
    starts = [line.get_xydata()[0] for line in axes.lines if line.get_linewidth() == 0.5]
    n_led = 0
    for text in axes.texts:
        if text.get_text() not in places:
            continue
        place = places[text.get_text()]
        low, high = text.get_window_extent(canvas.get_renderer()).get_points()
        at = axes.transData.transform(place)
        away = np.linalg.norm(np.clip(at, low, high) - at) / point
        is_led = any(np.allclose(start, place) for start in starts)
        n_led += is_led
        assert is_led or away < 8
    assert n_led > 0


def test_a_caption_says_how_many_labels_found_no_room():
    crowded = dense_plan(400, (4.0, 2.5)).picture().caption
    assert " labels found no room." in crowded
    assert "found no room" not in dense_plan(5, (40.0, 30.0)).picture().caption


def test_plans_are_the_same_bytes_again():
    assert dense_plan().plot("a").png == dense_plan().plot("a").png


@pytest.mark.parametrize("n", [1, 30])
def test_numbers_of_a_plan_without_rooms_keep_apart(n, monkeypatch):
    """Also of stations at one place, which share a label."""
    places = np.random.default_rng(1).uniform(0, 5, (n, 3))
    places = np.concatenate([places, places[:1]])
    seen = []
    monkeypatch.setattr(
        "nbv.report.figures.floor_plan.write_labels", lambda _axes, labels, _lines: seen.append(labels) or 0
    )
    FloorPlan(outline=np.zeros((0, 2, 2)), bounds=np.array([[0, 0, 0], [5, 5, 3]]), positions=places).plot()
    assert f"1,{n + 1}" in [label.text for label in seen[0]]
    at = np.array([label.place for label in seen[0]]) * 60
    middles = place_texts(at, seen[0], None, np.array([[-30.0, -30.0], [330.0, 330.0]]))
    rectangles = boxes(middles, np.array([label.size_pt for label in seen[0]]))
    assert all(covered(rectangles[[a, b]]).max() == 0 for a, b in combinations(range(len(at)), 2))
