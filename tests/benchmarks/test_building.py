# SPDX-License-Identifier: MIT
"""A house of a file, furnished anew: its rectangles, what stands in them, and the walk through it."""

import numpy as np
import pytest
import shapely

from benchmarks.cases.frames import FURNISHED, FurnishedWalk
from benchmarks.cases.houses.house import furnished, rectangles_of
from benchmarks.cases.houses.solids import Part, box, scene_of
from scenes.world.scene import Scene

DOOR = (2.5, 3.5)  # from where to where along y, in the wall between both rooms


def two_rooms() -> Scene:
    """Rooms of 4.0 x 5 and 2.8 x 5 m, a wall with a doorway between, all walls 20 cm thick and 2.5 m high."""
    walls = [
        ((-0.2, -0.2), (7.2, 0.0)),
        ((-0.2, 5.0), (7.2, 5.2)),
        ((-0.2, 0.0), (0.0, 5.0)),
        ((7.0, 0.0), (7.2, 5.0)),
        ((4.0, 0.0), (4.2, DOOR[0])),
        ((4.0, DOOR[1]), (4.2, 5.0)),
    ]
    parts = [
        Part(f"wall {k}", box((*low, 0.0), (*high, 2.5)), (0.8,) * 3) for k, (low, high) in enumerate(walls)
    ]
    parts += [
        Part("floor", box((-0.2, -0.2, -0.2), (7.2, 5.2, 0.0)), (0.5,) * 3),
        Part("ceiling", box((-0.2, -0.2, 2.5), (7.2, 5.2, 2.7)), (0.9,) * 3),
    ]
    return scene_of("two rooms", parts)


def test_rectangles_fill_the_rooms_and_cross_no_wall() -> None:
    shell = two_rooms()
    found = rectangles_of(shell, shell.ray_caster())
    areas = [float(np.prod(np.subtract(one.high, one.low))) for one in found]
    assert sum(areas) == pytest.approx(4.0 * 5 + 2.8 * 5, rel=0.15)
    for one in found:
        assert one.high[0] <= 4.06 or one.low[0] >= 4.14  # cells of 10 cm
        assert (one.level, one.height) == pytest.approx((0.0, 2.5), abs=1e-6)


@pytest.mark.long
def test_furniture_stands_in_the_rooms_and_leaves_the_doorway_clear() -> None:
    shell = two_rooms()
    house = furnished(shell, np.random.default_rng(1))
    again = furnished(shell, np.random.default_rng(1))
    assert np.array_equal(house.scene.mesh.vertices, again.scene.mesh.vertices)
    names = np.array(house.scene.surface_names)
    own = np.char.startswith(names, "room ")
    assert own.sum() > 10
    corners = house.scene.mesh.corners[own[house.scene.mesh.face_surface]]
    assert corners.min() > -1e-6
    assert (corners.reshape(-1, 3).max(axis=0) <= (7.0 + 1e-6, 5.0 + 1e-6, 2.5 + 1e-6)).all()
    doorway = shapely.box(3.6, DOOR[0] + 0.1, 4.6, DOOR[1] - 0.1)
    low = corners[(corners[..., 2].min(axis=1) < 1.8) & (corners[..., 2].max(axis=1) > 0.05)]
    assert not any(doorway.contains(shapely.Point(*place)) for place in low.reshape(-1, 3)[::7, :2])
    for floor, level in house.standing:
        assert level == pytest.approx(0.0, abs=1e-6)
        assert floor.area > 0


def test_sources_of_furnished_walks_are_many_and_fresh() -> None:
    assert len(FURNISHED) >= 20
    assert len({one.seed for one in FURNISHED}) == len(FURNISHED)
    assert all(one.n_frames // one.each >= 30 for one in FURNISHED)


@pytest.mark.long
def test_a_walk_through_a_real_house_sees_what_was_put_there() -> None:
    source: FurnishedWalk = FURNISHED[3]
    if not source.path.exists():
        pytest.skip(f"{source.path} is absent")
    one = FurnishedWalk(source.house, source.path, source.kept, source.seed, source.up, n_frames=24)
    assert len(one.frames) == 3
    seen = np.concatenate([scan.truth.surface[scan.valid] for scan in one.frames if scan.truth is not None])
    names = np.array(one.building.scene.surface_names)[seen]
    assert np.char.startswith(names, "room ").any()
    assert np.char.startswith(names, "Ifc").any()
    assert not np.char.startswith(names, "IfcFurnishing").any()
