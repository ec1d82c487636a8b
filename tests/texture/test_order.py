# SPDX-License-Identifier: MIT
"""The order of filling against its definition, and the canvas it is read from."""

import numpy as np
import pytest
from numpy.typing import NDArray

from texture.engine.compiled_front import CompiledFront
from texture.sampling.canvas import Canvas, Front, OrderName


def draw_canvas(seed: int, wrap: tuple[bool, bool], window: int = 7) -> Canvas:
    rng = np.random.default_rng(seed)
    levels = rng.integers(0, 256, (9, 14, 2))
    hole = rng.random((9, 14)) < 0.5
    hole[2:7, 3:9] = True
    return Canvas.around_hole(levels, ~hole & (rng.random(hole.shape) < 0.6), hole, wrap, window)


def count_by_hand(canvas: Canvas, radius: int, wrap: tuple[bool, bool]) -> NDArray[np.int64]:
    height, width = canvas.unfilled.shape
    modes = ["wrap" if wraps else "constant" for wraps in wrap]
    padded = np.pad(canvas.known[:height, :width], ((radius, radius), (0, 0)), mode=modes[0])  # type: ignore[call-overload]
    padded = np.pad(padded, ((0, 0), (radius, radius)), mode=modes[1])  # type: ignore[call-overload]
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * radius + 1, 2 * radius + 1))
    counts: NDArray[np.int64] = windows.sum(axis=(2, 3))
    return counts


WRAPS = [(False, False), (True, False), (False, True), (True, True)]


@pytest.mark.parametrize("wrap", WRAPS)
def test_the_paper_order_visits_the_whole_front_by_filled_neighbours(wrap: tuple[bool, bool]) -> None:
    canvas = draw_canvas(0, wrap)
    visits = Front(canvas, "paper").list_visits(1, 0)
    counts = count_by_hand(canvas, 1, wrap)
    assert set(visits.tolist()) == set(np.flatnonzero(canvas.unfilled & (counts > 0)).tolist())
    assert (np.diff(counts.ravel()[visits]) <= 0).all()


@pytest.mark.parametrize("wrap", WRAPS)
def test_the_window_order_visits_the_best_eighth(wrap: tuple[bool, bool]) -> None:
    canvas = draw_canvas(1, wrap)
    visits = Front(canvas, "window").list_visits(1, 0)
    front = np.flatnonzero(canvas.unfilled & (count_by_hand(canvas, 1, wrap) > 0))
    counts = count_by_hand(canvas, 3, wrap).ravel()
    assert visits.size == np.ceil(front.size / 8)
    assert set(visits.tolist()) <= set(front.tolist())
    assert counts[visits].tolist() == sorted(counts[front].tolist(), reverse=True)[: visits.size]


@pytest.mark.parametrize("order", ["paper", "window"])
def test_ties_are_broken_at_random_anew_in_each_pass(order: OrderName) -> None:
    hole = np.zeros((30, 90), dtype=np.bool_)
    hole[10:20] = True
    canvas = Canvas.around_hole(np.zeros((30, 90, 1), dtype=np.int64), ~hole, hole, (False, True), 5)
    orders = {
        tuple(Front(canvas, order).list_visits(key, pass_number).tolist())
        for key in (0, 1)
        for pass_number in (0, 1)
    }
    assert len(orders) == 4
    # 180 pixels in random order: about half of the consecutive pairs rise.
    visits = Front(canvas, order).list_visits(0, 0)
    rising = np.count_nonzero(np.diff(visits) > 0)
    assert abs(rising - visits.size / 2) < 4 * np.sqrt(visits.size / 12)


def test_nothing_is_visited_where_nothing_is_known() -> None:
    canvas = Canvas.empty((4, 5), 1, (False, True), 3)
    assert Front(canvas, "paper").list_visits(0, 0).size == 0
    assert Front(canvas, "window").list_visits(0, 0).size == 0


@pytest.mark.parametrize("order", ["paper", "window"])
@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("window", [3, 7, 11])  # the last reaches round a wrapped canvas and meets itself
def test_a_front_kept_while_filling_is_that_found_anew(
    window: int, wrap: tuple[bool, bool], order: OrderName
) -> None:
    canvas, rng = draw_canvas(4, wrap, window), np.random.default_rng(0)
    front, compiled, n_filled = Front(canvas, order), CompiledFront(canvas, order), 0
    while front.n_unfilled:
        visits = front.list_visits(3, n_filled)
        assert visits.tolist() == Front(canvas, order).list_visits(3, n_filled).tolist()
        assert visits.tolist() == compiled.list_visits(3, n_filled).tolist()
        chosen = visits[rng.random(visits.size) < 0.4]
        for pixel in chosen.tolist():
            canvas.write(*divmod(pixel, 14), source=0, levels=np.array([1, 2]), error=0.0)
        assert front.advance(visits) == chosen.size
        assert compiled.advance(visits) == chosen.size
        n_filled += chosen.size
        assert front.n_unfilled == compiled.n_unfilled == np.count_nonzero(canvas.unfilled)
    assert front.list_visits(3, 0).size == 0
    assert n_filled > 40


@pytest.mark.parametrize("wrap", WRAPS)
def test_a_template_holds_what_is_around_the_pixel_when_it_is_read(wrap: tuple[bool, bool]) -> None:
    canvas = draw_canvas(2, wrap)
    canvas.write(0, 1, source=5, levels=np.array([7, 8]), error=0.25)
    assert not canvas.unfilled[0, 1]
    assert canvas.errors[0, 1] == 0.25
    for row, column in [(0, 0), (8, 13), (4, 5), (0, 13)]:
        template = canvas.read_template(row, column)
        for i, j in np.ndindex(7, 7):
            there = [row + i - 3, column + j - 3]
            there = [at % size if wraps else at for at, size, wraps in zip(there, (9, 14), wrap, strict=True)]
            inside = 0 <= there[0] < 9 and 0 <= there[1] < 14
            assert template.known[i, j] == (inside and canvas.known[there[0], there[1]])
            if template.known[i, j]:
                assert (template.levels[i, j] == canvas.levels[there[0], there[1]]).all()


def test_a_narrowed_template_knows_only_its_middle() -> None:
    template = draw_canvas(3, (True, True)).read_template(4, 4)
    narrowed = template.narrow(3)
    assert not narrowed.known[[0, 1, 5, 6]].any()
    assert not narrowed.known[:, [0, 1, 5, 6]].any()
    np.testing.assert_array_equal(narrowed.known[2:5, 2:5], template.known[2:5, 2:5])
    np.testing.assert_array_equal(template.narrow(7).known, template.known)
