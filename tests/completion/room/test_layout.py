# SPDX-License-Identifier: MIT
"""The plan by walls and beams: corners, rooms behind doors, what was not seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from completion.room.layout import Layout, find_layout
from completion.room.planes import Beams, RoomPlane
from completion.room.roles import Room, to_corners
from completion.room.walls import Wall
from scenes.surfaces.catalogue import Plane

UP = np.array([0.0, 0.0, 1.0])
HEIGHT_M, LINTEL_M = 2.4, 2.0


def plan_of(corners, doors=()):
    """Walls of a closed outline, counter-clockwise, as (begin, end, doors along it); doors by wall."""
    ends = np.array(corners, dtype=np.float64)
    held = dict(doors)
    return [
        (begin, end, held.get(k, ()))
        for k, (begin, end) in enumerate(zip(ends, np.roll(ends, -1, axis=0), strict=True))
    ]


def scan(walls, eyes, n=(720, 60)):
    """Beams of eyes (k, 3) all around, from the floor to the ceiling, and which wall each meets."""
    azimuth = np.linspace(0, 2 * np.pi, n[0], endpoint=False)
    heights = np.linspace(0.02, HEIGHT_M - 0.02, n[1])
    origins, points, hits = [], [], []
    for eye in np.atleast_2d(eyes):
        for angle in azimuth:
            ray = np.array([np.cos(angle), np.sin(angle)])
            meets = []
            for k, (begin, end, doors) in enumerate(walls):
                along = end - begin
                matrix = np.column_stack([ray, -along])
                if abs(np.linalg.det(matrix)) < 1e-9:
                    continue
                far, part = np.linalg.solve(matrix, begin - eye[:2])
                if far > 1e-6 and 0 <= part <= 1:
                    meets.append((far, k, part * np.linalg.norm(along), doors))
            for height in heights:
                for far, k, at, doors in sorted(meets, key=lambda meet: meet[0]):
                    # straight to the height at which this wall would be met
                    if any(low < at < high for low, high in doors) and height < LINTEL_M:
                        continue
                    origins.append(eye)
                    points.append([*(eye[:2] + far * ray), height])
                    hits.append(k)
                    break
    return np.array(origins), np.array(points), np.array(hits)


def layout_of(walls, eyes, hidden=lambda points: np.zeros(len(points), dtype=np.bool_)):
    """The layout by what eyes see of walls, but for what is hidden."""
    origin, point, hit = scan(walls, eyes)
    seen = ~hidden(point)
    origin, point, hit = origin[seen], point[seen], hit[seen]
    beams = Beams(origin, point, np.full(len(point), 0.002), np.full(len(point), 0.01))
    stood = []
    for k, (begin, end, _) in enumerate(walls):
        own = point[hit == k]
        if len(own) < 50:
            continue
        along = (end - begin) / np.linalg.norm(end - begin)
        plane = Plane(np.array([*begin, 0.0]), np.array([-along[1], along[0], 0.0]))
        known = RoomPlane(None, plane, own, own.mean(axis=0), 1.0, 0.01, 0.002, 0.001, 0.002)
        stood.append(Wall.measured(k, known, own, beams, up=UP))
    return find_layout(stood, beams, UP, (0.1, HEIGHT_M - 0.1)), stood


def at(*places):
    """Places of the plan, at the height of a hand."""
    return np.column_stack([np.array(places, dtype=np.float64), np.full(len(places), 1.0)])


SQUARE = [(0, 0), (4, 0), (4, 3), (0, 3)]
ANGLE = [(0, 0), (5, 0), (5, 2), (2, 2), (2, 4), (0, 4)]
EYE = np.array([1.0, 1.0, 1.5])


def test_a_room_is_what_its_walls_hold():
    layout, _ = layout_of(plan_of(SQUARE), EYE)
    assert layout.scanner_rooms == (1,)
    assert (layout.rooms_at(at((0.1, 0.1), (3.9, 2.9), (2, 1))) == 1).all()
    assert (layout.rooms_at(at((-0.2, 1), (4.3, 1), (2, 3.2), (2, -0.4))) == 0).all()


def test_a_room_may_have_an_angle():
    layout, _ = layout_of(plan_of(ANGLE), EYE)
    assert (layout.rooms_at(at((4.8, 1.8), (1.8, 3.8), (0.2, 0.2))) == 1).all()
    assert (layout.rooms_at(at((3, 3), (2.2, 2.2), (5.2, 1))) == 0).all()


@pytest.mark.parametrize(("corners", "area_m2"), [(SQUARE, 12.0), (ANGLE, 14.0)])
def test_outlines_are_those_of_the_walls(corners, area_m2):
    layout, _ = layout_of(plan_of(corners), EYE)
    ((outline, enclosed),) = layout.outlines()
    assert outline.area == pytest.approx(area_m2, rel=0.02)
    assert enclosed > 0.95
    assert len(outline.exterior.coords) == len(corners) + 1
    assert (layout.walls >= 0).sum() == len(corners)


@pytest.mark.parametrize("turn_deg", [0.0, 17.0, 45.0, 90.0])
def test_the_plan_does_not_depend_on_the_axes(turn_deg):
    turn = np.radians(turn_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    corners = np.array(ANGLE, dtype=np.float64) @ rotation.T
    eye = np.array([*(rotation @ EYE[:2]), EYE[2]])
    layout, _ = layout_of(plan_of(corners), eye)
    inside = at(*(np.array([(4.8, 1.8), (1.8, 3.8), (0.2, 0.2)]) @ rotation.T))
    outside = at(*(np.array([(3.0, 3.0), (5.2, 1.0), (-0.2, 1.0)]) @ rotation.T))
    assert (layout.rooms_at(inside) == 1).all()
    assert (layout.rooms_at(outside) == 0).all()


def test_walls_go_on_to_their_corners():
    """The corner at (4, 3) is hidden by .8 m on either side."""

    def near(points):
        return np.linalg.norm(points[:, :2] - (4, 3), axis=1) < 0.8

    layout, walls = layout_of(plan_of(SQUARE), EYE, near)
    room = Room(layouts=(layout,), up=UP)
    ends = {wall.number: to_corners(wall, room) for wall in walls}
    right, top = ends[1], ends[2]
    assert right.place(np.array([[right.low[0], 1.0]]))[0, :2] == pytest.approx([4, 3], abs=0.16)
    assert top.place(np.array([[top.high[0], 1.0]]))[0, :2] == pytest.approx([4, 3], abs=0.16)
    assert (layout.rooms_at(at((3.9, 2.9))) == 1).all()


def test_a_door_parts_rooms():
    """The next room is seen through a door in the wall x = 4, from 1 to 1.9 m."""
    walls = plan_of(SQUARE, doors=[(1, [(1.0, 1.9)])])
    walls += [
        (b, e, d) for b, e, d in plan_of([(4.1, 0), (8, 0), (8, 3), (4.1, 3)]) if b[0] != 4.1 or e[0] != 4.1
    ]
    layout, found = layout_of(walls, EYE)
    assert layout.scanner_rooms == (1,)
    assert layout.rooms_at(at((2, 2)))[0] == 1
    assert layout.rooms_at(at((5.5, 1.7)))[0] == 2
    parting = next(wall for wall in found if wall.number == 1)
    along = np.column_stack([np.linspace(parting.low[0], parting.high[0], 20), np.ones(20)])
    room = Room(layouts=(layout,), up=UP)
    assert room.bounds(parting, parting.place(along)).mean() > 0.9


def two_rooms():
    """Two rooms behind each other with a door between, and a landing at the end of the second one."""
    walls = plan_of(SQUARE, doors=[(1, [(1.0, 1.9)])])
    walls += [
        (b, e, d) for b, e, d in plan_of([(4.1, 0), (8, 0), (8, 3), (4.1, 3)]) if b[0] != 4.1 or e[0] != 4.1
    ]
    layout, found = layout_of(walls, np.array([EYE, (6.0, 1.5, 1.5)]))
    places = {wall.number: wall.points + 0.12 * wall.plane.normal_direction for wall in found}
    side = np.arange(0.0, 0.95, 0.1)
    landing = np.array([(7.1 + x, 2 * y, 0.52) for x in side for y in side])
    n = 2 + max(places)
    return Room(
        roles=(*("wall" if k in places else "" for k in range(n - 1)), "floor"),
        walls=tuple(found),
        layouts=(replace(layout, floor_m=0.0),),
        up=UP,
        places=(*(places.get(k, np.zeros((0, 3))) for k in range(n - 1)), landing),
    )


def middles(room):
    """The middle of each wall by its number, in plan."""
    return {wall.number: tuple(np.round(wall.points.mean(axis=0)[:2], 1)) for wall in room.walls}


def test_a_wall_ends_what_bounds_its_room_alone():
    room = two_rooms()
    places = middles(room)
    (far,) = (number for number, (x, _) in places.items() if x == 8)
    beside = {number: x for number, (x, y) in places.items() if y in {0, 3}}
    assert len(beside) == 4
    assert {number: room.may_end(far, number) for number in beside} == {k: x > 4 for k, x in beside.items()}


def test_a_landing_ends_the_walls_beside_it_alone():
    room = two_rooms()
    landing = len(room.roles) - 1
    assert {k: room.may_end(landing, k) for k in middles(room)} == {
        k: x == 8 for k, (x, _) in middles(room).items()
    }


def test_what_has_no_role_may_end_anything():
    room = two_rooms()
    assert all(room.may_end(len(room.roles), wall.number) for wall in room.walls)


def test_without_walls_there_is_no_plan():
    beams = Beams(np.zeros((3, 3)), np.ones((3, 3)), np.zeros(3), np.zeros(3))
    layout = find_layout([], beams, UP, (0.0, 1.0))
    assert not layout.scanner_rooms
    assert not list(layout.outlines())
    assert (layout.rooms_at(np.zeros((2, 3))) == 0).all()


def test_lines_that_nearly_meet_leave_no_gap_in_a_room():
    """Between three lines is a triangle of 2 cm, smaller than the squares by which cells are told."""
    third = np.array([3**0.5, 1.0, 0.02]) / 2
    lines = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], third])
    sides = np.array(np.meshgrid([False, True], [False, True], [False, True])).reshape(3, 8).T
    cells = sides[~(sides == [True, True, False]).all(axis=1)]
    plan = Layout(
        axes=np.eye(3)[:2],
        lines=lines,
        walls=np.arange(3),
        cells=cells[np.lexsort(cells.T[::-1])],
        rooms=np.ones(len(cells), np.int64),
        enclosed=np.zeros(1),
        low=np.full(2, -1.0),
        high=np.full(2, 1.0),
    )
    ((outline, _),) = plan.outlines()
    assert not outline.interiors
    assert len(outline.exterior.coords) == 5
    assert outline.area == pytest.approx(4.0)


def test_nothing_is_in_a_room_beyond_what_the_plan_shows():
    """Nothing ends the room on one side but the plan."""
    plan = Layout(
        axes=np.eye(3)[:2],
        lines=np.array([[1.0, 0.0, 0.0]]),
        walls=np.zeros(1, np.int64),
        cells=np.array([[False], [True]]),
        rooms=np.array([0, 1]),
        enclosed=np.array([0.25]),
        low=np.array([-1.0, -1.0]),
        high=np.array([2.0, 2.0]),
    )
    places = np.array([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [1.9, 1.9, 0.0], [2.1, 0.0, 0.0], [0.5, -1.1, 0.0]])
    assert plan.rooms_at(places).tolist() == [0, 1, 1, 0, 0]
