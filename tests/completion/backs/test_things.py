# SPDX-License-Identifier: MIT
"""Things that stand in a room: apart from it, from each other, and from what they stand on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from completion import Completion, CompletionOptions, complete
from completion.backs.thing import Thing
from completion.backs.thing_records import surroundings, thing_record
from completion.backs.things import find_things, why_none
from nbv.scanning.effects import Effects
from nbv.scanning.noise_models import ConstantNoise
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, Sensor, SphericalSensor
from scenes.checks import FloatArray
from scenes.inclination import Up
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import Finish, SceneBuilder

GREY = Finish((0.5, 0.5, 0.5))
SIGMA_M = 0.002
CAMERA = PinholeSensor(fov_deg=65, width=240, height=180)
EYE, AIM = (2.0, 0.4, 1.5), (2.0, 3.0, 0.5)
BOXES = {"left": ((1.1, 2.5, 0), (1.5, 2.8, 0.5)), "middle": ((1.8, 2.4, 0), (2.2, 2.7, 0.4)),
         "right": ((2.6, 2.5, 0), (2.9, 2.9, 0.6))}  # fmt: skip
Build = Callable[[SceneBuilder], None]


class Seen:
    """Scans of a room of 4 x 4 x 2.5 m with what `build` puts there, and the things that are found."""

    def __init__(
        self, build: Build, views: Sequence[Pose] = (), *, shell: bool = True, sensor: Sensor = CAMERA
    ) -> None:
        builder = SceneBuilder("room", "room")
        if shell:
            builder.add_box("shell", (0, 0, 0), (4, 4, 2.5), GREY, inward=True)
        build(builder)
        scene = builder.finish()
        self.scans: tuple[RangeImage, ...] = tuple(
            scan_scene(scene, pose, sensor, effects=Effects(noise=ConstantNoise(constant_m=SIGMA_M)), rng=k)
            for k, pose in enumerate(views or [Pose.looking_at(EYE, AIM)])
        )
        self.names = [name.split()[0] for name in scene.surface_names]
        self.completion: Completion = complete(self.scans, CompletionOptions(texture=False), rng=0)
        self.things = find(self.completion)

    def truth(self, name: str, scan: int = 0) -> np.ndarray:
        truth = self.scans[scan].truth
        assert truth is not None
        wanted = np.array([one == name for one in self.names] + [False])
        return wanted[truth.surface] & self.scans[scan].valid

    def thing(self, name: str, scan: int = 0) -> Thing:
        """The thing that has most of the pixels of `name`, which must be nearly those of its own."""
        true = self.truth(name, scan)
        masks = [thing.mask(scan, true.shape) for thing in self.things]
        k = int(np.argmax([(mask & true).sum() for mask in masks]))
        assert (masks[k] & true).sum() / (masks[k] | true).sum() > 0.8, name
        return self.things[k]


def find(completion: Completion) -> tuple[Thing, ...]:
    done = completion.completed
    return find_things(done.patches, done.scans, done.room, done.up, completion.world_from_reference)


def three_boxes(build: SceneBuilder) -> None:
    for name, (low, high) in BOXES.items():
        build.add_box(name, low, high, GREY)


def table(build: SceneBuilder) -> None:
    build.add_box("table", (1.4, 1.8, 0.68), (2.6, 2.6, 0.72), GREY)
    for k, (x, y) in enumerate([(1.45, 1.85), (2.5, 1.85), (1.45, 2.5), (2.5, 2.5)]):
        build.add_box(f"table leg {k}", (x, y, 0), (x + 0.05, y + 0.05, 0.68), GREY)
    build.add_box("box", (1.8, 2.0, 0.72), (2.1, 2.2, 0.92), GREY)


def role_of(completion: Completion, number: int | None) -> str:
    assert number is not None
    return completion.patches[number].limits.role


@cache
def boxes() -> Seen:
    return Seen(three_boxes)


@cache
def on_table() -> Seen:
    return Seen(table)


def test_three_boxes_on_a_floor_are_three_things() -> None:
    seen = boxes()
    assert len(seen.things) == 3
    for name, (low, high) in BOXES.items():
        thing = seen.thing(name)
        assert role_of(seen.completion, thing.stands_on) == "floor"
        assert thing.stands_on_thing is None
        assert thing.support_m == pytest.approx(0.0, abs=0.01)
        assert thing.box.axes[2] @ [0, 0, 1] > 0.999
        assert thing.box.high[2] == pytest.approx(high[2], abs=0.02)
        assert thing.leans_at == thing.touches == thing.occluded_by == thing.hides == ()
        assert [(cut.scan, cut.border, cut.occluder) for cut in thing.cuts] == [(0, False, False)]
        middle = (np.array(low) + high)[:2] / 2
        places = (thing.box.low + thing.box.high)[:2] / 2 @ thing.box.axes[:2, :2]
        assert places == pytest.approx(middle, abs=0.2)  # the back is not seen
    assert seen.things[0].pixels[0].size >= seen.things[1].pixels[0].size >= seen.things[2].pixels[0].size


def test_measured_area_and_surfaces_are_those_of_the_box() -> None:
    seen = boxes()
    thing = seen.thing("middle")
    true = seen.truth("middle")
    angle = CAMERA.projection.pixel_angle
    assert thing.measured_m2 == pytest.approx(
        float((seen.scans[0].ranges[true] * angle) ** 2 @ np.ones(true.sum())), rel=0.1
    )
    assert thing.surfaces
    owners = seen.completion.owners[0]
    for number in thing.surfaces:
        assert seen.truth("middle")[owners == number + 1].mean() > 0.9


def test_a_box_on_a_table_stands_on_the_table() -> None:
    seen = on_table()
    box, desk = seen.thing("box"), seen.thing("table")
    assert len(seen.things) == 2
    assert box.stands_on_thing == desk.index
    assert box.stands_on in desk.surfaces
    assert box.support_m == pytest.approx(0.72, abs=0.01)
    assert role_of(seen.completion, desk.stands_on) == "floor"
    assert box.index in desk.occluded_by


def test_a_box_against_a_wall_leans_at_it() -> None:
    seen = Seen(lambda build: build.add_box("box", (1.2, 3.6, 0), (1.8, 4.0, 0.7), GREY))
    box = seen.thing("box")
    assert [role_of(seen.completion, number) for number in box.leans_at] == ["wall"]
    done = seen.completion.completed
    around = surroundings(box, done.patches, done.room, seen.completion.world_from_reference)
    (wall,) = [wall for wall in around.walls if wall.surface in box.leans_at]
    assert wall.normal == pytest.approx([0, -1, 0], abs=0.02)
    assert wall.offset_m == pytest.approx(-4.0, abs=0.02)
    assert wall.gap_m == pytest.approx(0.0, abs=0.07)  # rows of pixels on its top are 5 cm apart
    assert 0 < wall.sd_m < 0.02
    assert around.support_m == pytest.approx(0.0, abs=0.01)


def test_a_box_away_from_walls_leans_at_none_but_has_one_behind_it() -> None:
    seen = Seen(lambda build: build.add_box("box", (1.2, 3.0, 0), (1.8, 3.4, 0.7), GREY))
    box = seen.thing("box")
    assert box.leans_at == ()
    done = seen.completion.completed
    walls = surroundings(box, done.patches, done.room, seen.completion.world_from_reference).walls
    assert [wall.gap_m for wall in walls if wall.normal[1] < -0.9] == [pytest.approx(0.6, abs=0.05)]


def test_a_box_at_the_border_of_the_image_is_cut_by_it() -> None:
    seen = Seen(lambda build: build.add_box("box", (0.2, 2.2, 0), (1.0, 2.6, 0.5), GREY))
    (cut,) = seen.thing("box").cuts
    assert (cut.border, cut.occluder) == (True, False)


def test_a_pillar_cuts_a_box_that_stays_one_thing() -> None:
    def pillar(build: SceneBuilder) -> None:
        build.add_box("box", (1.4, 2.6, 0), (2.6, 3.0, 0.6), GREY)
        build.add_cylinder("pillar", (2.0, 1.8, 0), (0, 0, 2.5), 0.1, GREY, caps=False)

    seen = Seen(pillar)
    box = seen.thing("box")
    assert [(cut.border, cut.occluder) for cut in box.cuts] == [(False, True)]
    assert len(seen.things) == 1  # the pillar goes up to the ceiling
    columns = np.unique(np.nonzero(box.mask(0, seen.scans[0].shape))[1])
    assert np.diff(columns).max() > 5  # it is on both sides of the pillar


def test_a_thing_before_another_hides_it() -> None:
    def two(build: SceneBuilder) -> None:
        build.add_box("near", (1.8, 1.9, 0), (2.1, 2.1, 0.5), GREY)
        build.add_box("far", (1.5, 2.5, 0), (2.5, 2.8, 0.9), GREY)

    seen = Seen(two)
    near, far = seen.thing("near"), seen.thing("far")
    assert near.hides == (far.index,)
    assert far.occluded_by == (near.index,)
    assert near.touches == far.touches == ()


def test_two_scans_from_both_sides_show_one_box() -> None:
    views = [
        Pose.looking_at((2.0, 0.5, 1.4), (2.0, 2.2, 0.4)),
        Pose.looking_at((3.6, 3.2, 1.4), (2.0, 2.2, 0.4)),
    ]
    seen = Seen(lambda build: build.add_box("box", (1.8, 2.0, 0), (2.3, 2.4, 0.5), GREY), views)
    (box,) = seen.things
    assert seen.thing("box", 0) is seen.thing("box", 1) is box
    assert [cut.scan for cut in box.cuts] == [0, 1]
    assert np.sort(box.box.size) == pytest.approx([0.4, 0.5, 0.5], abs=0.03)


def test_a_tilted_scanner_sees_the_same_boxes() -> None:
    pose = Pose.looking_at(EYE, AIM)
    spin = np.eye(4)
    angle = np.radians(18)
    spin[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    seen = Seen(three_boxes, [pose @ Pose(spin)])
    for name, (_, high) in BOXES.items():
        thing = seen.thing(name)
        assert thing.box.high[2] == pytest.approx(high[2], abs=0.03)


def test_without_a_floor_things_stand_on_what_is_known() -> None:
    def top(build: SceneBuilder) -> None:
        build.add_rectangle("table", (1.0, 1.2, 0.7), (2, 0, 0), (0, 1.6, 0), GREY)
        build.add_box("box", (1.8, 1.9, 0.7), (2.2, 2.1, 0.9), GREY)

    seen = Seen(top, [Pose.looking_at((2.0, 0.9, 1.5), (2.0, 2.0, 0.7))], shell=False)
    box = seen.thing("box")
    assert box.support_m == pytest.approx(0.7, abs=0.01)
    assert box.stands_on is not None
    assert all(not patch.limits.role for patch in [seen.completion.patches[box.stands_on]])


def test_the_seam_of_a_panorama_cuts_nothing() -> None:
    around = SphericalSensor(
        elevation_min_deg=-60, elevation_max_deg=60, width=480, height=160, name="around"
    )
    pose = Pose.looking_at((2.0, 0.8, 1.4), (2.0, 0.0, 1.4))  # the seam is opposite
    seen = Seen(
        lambda build: build.add_box("box", (1.7, 2.3, 0), (2.3, 2.7, 0.6), GREY), [pose], sensor=around
    )
    (box,) = seen.things
    assert seen.thing("box") is box
    columns = np.nonzero(box.mask(0, seen.scans[0].shape).any(axis=0))[0]
    assert {0, 479} <= set(columns.tolist())
    assert [(cut.border, cut.occluder) for cut in box.cuts] == [(False, False)]


def test_a_scan_without_returns_has_no_things() -> None:
    scan = boxes().scans[0]
    empty = replace(scan, ranges=np.full(scan.shape, np.inf))
    assert find(complete([empty], CompletionOptions(texture=False), rng=0)) == ()


def test_an_empty_room_has_no_things() -> None:
    assert Seen(lambda _: None).things == ()


def test_what_is_seen_through_a_door_is_no_thing_of_the_room() -> None:
    def door(build: SceneBuilder) -> None:
        build.add_rectangle("floor", (0, 0, 0), (4, 0, 0), (0, 7, 0), GREY)
        hole = [(1.5, 0.0, 2.5, 2.0)]
        build.add_panel("wall", (4, 3.5, 0), (-4, 0, 0), (0, 0, 2.5), GREY, hole)
        build.add_panel("back", (0, 3.6, 0), (4, 0, 0), (0, 0, 2.5), GREY, hole)
        for name, (corner, along) in {"west": ((0, 7, 0), (0, -7, 0)), "east": ((4, 0, 0), (0, 7, 0)),
                                      "north": ((4, 7, 0), (-4, 0, 0))}.items():  # fmt: skip
            build.add_rectangle(name, corner, along, (0, 0, 2.5), GREY)
        build.add_box("beyond", (1.7, 5.0, 0), (2.2, 5.4, 0.7), GREY)
        build.add_box("here", (0.9, 2.4, 0), (1.2, 2.7, 0.5), GREY)

    seen = Seen(door, shell=False)
    assert [thing.index for thing in seen.things] == [seen.thing("here").index]


def test_nothing_is_told_where_up_is_undecided() -> None:
    done = boxes().completion.completed
    unsure = replace(done.up, is_decided=False)
    pose = boxes().completion.world_from_reference
    assert find_things(done.patches, done.scans, done.room, unsure, pose) == ()
    assert "up is undecided" in why_none(unsure)
    assert why_none(Up(np.array([0.0, 0.0, 1.0]))) == ""


def test_records_count_from_one() -> None:
    seen = on_table()
    done, pose = seen.completion.completed, seen.completion.world_from_reference
    around = [surroundings(thing, done.patches, done.room, pose) for thing in seen.things]
    records = [thing_record(*pair) for pair in zip(seen.things, around, strict=True)]
    box, desk = seen.thing("box"), seen.thing("table")
    record = records[box.index]
    assert box.stands_on is not None
    assert record["thing"] == box.index + 1
    assert record["stands_on"] == box.stands_on + 1
    assert record["stands_on_thing"] == desk.index + 1
    assert records[desk.index]["stands_on_thing"] is None
    assert record["cut"] == [{"scan": 1, "border": False, "occluder": False}]
    assert np.shape(record["box"]["axes"]) == (3, 3)


def test_the_same_scans_give_the_same_things() -> None:
    first, second = boxes().things, find(boxes().completion)
    for one, other in zip(first, second, strict=True):
        assert np.array_equal(one.pixels[0], other.pixels[0])
        assert np.array_equal(one.box.low, other.box.low)


def corners_of(thing: Thing) -> FloatArray:
    return np.stack([thing.box.low, thing.box.high]) @ thing.box.axes


def test_things_move_with_the_world() -> None:
    done = boxes().completion.completed
    pose = boxes().completion.world_from_reference
    shift = Pose.from_parts(np.eye(3), np.array([3.0, -2.0, 1.0]))
    moved = find_things(done.patches, done.scans, done.room, done.up, shift @ pose)
    for one, other in zip(boxes().things, moved, strict=True):
        assert corners_of(other) == pytest.approx(corners_of(one) + shift.translation, abs=1e-9)
        assert other.support_m == pytest.approx((one.support_m or 0.0) + 1.0, abs=1e-9)
