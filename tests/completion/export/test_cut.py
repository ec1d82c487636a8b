# SPDX-License-Identifier: MIT
"""Cuts of facets, against closed forms; what is said of where a plan is cut; outlines below it."""

from dataclasses import replace

import numpy as np
import pytest

from completion.export.building.cut import cut, opening_at, plan_of, sections_of, seen_below
from completion.export.building.model import OpeningOutline
from tests.helpers.exchange_examples import SIZE, UTM, box, drawn, panorama

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def room():
    return drawn(panorama())


def test_a_box_is_cut_in_four_lines_of_its_sides():
    lines = cut(box(), np.array([0, 0, 0.3]), UP)
    assert [(line.surface, line.is_measured) for line in lines] == [
        (1, True),
        (2, False),
        (3, True),
        (4, True),
    ]
    assert [line.length_m for line in lines] == pytest.approx([2, 1, 2, 1])
    assert all(len(line.points) == 2 for line in lines)
    assert np.concatenate([line.points[:, 2] for line in lines]) == pytest.approx(0.3)


def test_facets_of_one_surface_and_state_give_one_line_around_corners():
    whole = replace(box(), surface=np.ones(8, int), provenance=np.zeros(8, int))
    (ring,) = cut(whole, np.array([0, 0, 0.5]), UP)
    assert len(ring.points) in (5, 6)  # it may begin within a side
    assert ring.length_m == pytest.approx(6)
    np.testing.assert_allclose(ring.points[0], ring.points[-1])
    (rest, *_) = cut(replace(box(), surface=np.zeros(8, int)), np.array([0, 0, 0.5]), UP)
    assert (rest.surface, rest.kind) == (0, "rest")


def test_what_lies_in_the_plane_or_beyond_is_not_cut():
    assert cut(box(), np.array([0, 0, 1.5]), UP) == ()
    flat = replace(box(), vertices=box().vertices * [1, 1, 0])
    assert cut(flat, np.zeros(3), UP) == ()


@pytest.mark.long
def test_the_plan_of_a_room_lies_on_its_walls(room):
    plan = plan_of(room)
    assert plan.height_m == pytest.approx(UTM.translation[2] + 1.1, abs=0.005)
    assert plan.caption.startswith("Plan, cut 1.1 m above the lowest floor, at z = 101.10 m")
    walls = [line for line in plan.lines if line.kind == "wall"]
    assert sum(line.length_m for line in walls) == pytest.approx(2 * (SIZE[0] + SIZE[1]), abs=0.05)
    for line in walls:
        x, y = (line.points - UTM.translation)[:, :2].T
        off = [np.abs(x).max(), np.abs(x - SIZE[0]).max(), np.abs(y).max(), np.abs(y - SIZE[1]).max()]
        assert min(off) < 0.003
    assert {line.is_measured for line in walls} == {True, False}


def test_sections_run_along_walls_through_the_middle(room):
    one, other = sections_of(room)
    assert (one.name, other.name) == ("A", "B")
    assert abs(one.along[0]) == pytest.approx(1, abs=1e-3)
    assert one.along @ other.along == pytest.approx(0, abs=1e-12)
    for section, width in ((one, SIZE[0]), (other, SIZE[1])):
        points = np.concatenate([line.points for line in section.lines if line.surface])
        assert np.ptp(points @ section.along) == pytest.approx(width, abs=0.01)
        assert np.ptp(points[:, 2]) == pytest.approx(SIZE[2], abs=0.01)
        across = np.cross(UP, section.along)
        assert np.ptp(points @ across) < 1e-6
    assert sections_of(replace(room, surface=np.zeros_like(room.surface))) == ()


def test_sentences_without_floor_without_walls_without_anything(room):
    plan = plan_of(replace(room, floor_m=None))
    assert (
        plan.caption
        == f"No floor was found: plan, cut at the height of the scanner, at z = {room.eye_m:.2f} m."
    )
    assert plan.height_m == room.eye_m
    for eye_m in (None, float(room.drawn[:, 2].max()) + 0.5):  # as over a table
        told = plan_of(replace(room, floor_m=None, eye_m=eye_m)).caption
        assert told.startswith("No floor was found: plan, cut halfway up what was scanned, at z = 101.35 m")
    assert plan_of(replace(room, floor_m=None, planes=())).caption.startswith(
        "Neither floor nor walls were found"
    )
    nothing = replace(
        room, faces=np.zeros((0, 3), int), surface=np.zeros(0, int), provenance=np.zeros(0, int)
    )
    plan = plan_of(nothing)
    assert (plan.caption, plan.lines) == ("Nothing was found that could be drawn.", ())


def test_level_tops_are_seen_below_without_holes(room):
    outlines = [points - UTM.translation[:2] for points in seen_below(room, plan_of(room).height_m)]
    sizes = sorted(float(np.ptp(points[:, 0])) for points in outlines)
    assert sizes[-1] == pytest.approx(SIZE[0], abs=0.02)  # the floor
    assert len(outlines) < 6
    assert seen_below(room, UTM.translation[2] - 1) == []


def test_an_opening_at_a_height_has_two_ends():
    points = np.array([[1, 0, 0], [2, 0, 0], [2, 0, 2], [1, 0, 2.0]])
    door = OpeningOutline(1, "door", points, (), 1.0, height_m=2.0, seen_share=1.0)
    ends = opening_at(door, 1.1)
    assert sorted(ends[:, 0]) == pytest.approx([1, 2])
    assert opening_at(door, 2.5) is None
