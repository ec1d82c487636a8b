# SPDX-License-Identifier: MIT
"""Rooms, doorways and storeys: of generated houses, a house without ceiling, and a real building."""

from dataclasses import replace

import numpy as np
import pytest

from nbv.visibility.candidates import bounding_surface
from nbv.visibility.samples import sample_surface
from nbv.visibility.site import find_site
from nbv.visibility.site_options import SiteOptions
from scenes.checks import InputError
from scenes.io.scene_files import load_scene
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.world.builtin import builtin_scene
from scenes.world.scene import Scene
from tests.helpers.buildings import house
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.long_cases import first_in_gate


def duplex():
    return load_scene(data_path("buildings/duplex.glb"), up="y")


def inside(site):
    return [room for room in site.rooms.rooms if not room.is_outside]


def test_open_doorways_join_rooms_and_shut_doors_part_them():
    open_, shut = (find_site(house(3, closed=closed).scene()) for closed in (False, True))
    assert len(inside(open_)) == len(inside(shut)) > 1
    assert all(not room.joined for room in inside(shut))
    assert {number for room in inside(open_) for number in room.joined} >= {
        room.number for room in inside(open_)
    }
    connected = find_site(house(3, closed=True).scene(), SiteOptions(rooms="connected"))
    assert len(connected.chosen) == 1
    left_out = len(inside(shut)) - 1
    assert any(f"{left_out} room" in warning for warning in connected.warnings)


def test_stairs_join_storeys():
    site = find_site(house(31, storeys=2, slab_m=0.25).scene())
    assert {room.storey for room in inside(site)} == {1, 2}
    assert any(room.stairs for room in inside(site))
    for room in inside(site):
        assert all(site.rooms.rooms[other - 1].storey != room.storey for other in room.stairs)


@pytest.mark.long
def test_outdoors_is_asked_for():
    scene = house(4).scene()
    within, without = find_site(scene), find_site(scene, SiteOptions(outdoors=True))
    assert len(without.chosen) > len(within.chosen)
    assert len(without.positions) > len(within.positions)


@pytest.mark.long
def test_rooms_are_chosen_by_number():
    scene = house(4).scene()
    site = find_site(scene, SiteOptions(rooms=(1,)))
    assert set(site.position_room.tolist()) == {1}
    with pytest.raises(InputError, match="there is no room 99 in building: it has"):
        find_site(scene, SiteOptions(rooms=(99,)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"heights_m": ()}, "heights_m holds no height"),
        ({"heights_m": (-1.0,)}, "heights_m must be positive, metres, got -1"),
        ({"spacing_m": np.nan}, "spacing_m must be positive, metres, got nan"),
        ({"clearance_m": 0.0}, "clearance_m must be positive"),
        ({"rooms": (0,)}, "rooms are numbered from 1, got 0"),
        ({"rooms": "some"}, "rooms must be all, connected, or their numbers"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        SiteOptions(**options)


def test_ground_alone_is_outside_and_a_house_without_ceiling_has_rooms():
    made = house(5)
    ground = made.scene().without(["[!g]*"])
    with pytest.raises(InputError, match=r"all \d+\.\d m2 of floor in building lie outside; give --outdoors"):
        find_site(ground)
    bare = house(5, ground=False).scene().without(["roof*"])
    site = find_site(bare)
    assert any("no ceiling over" in warning for warning in site.warnings)
    assert len(inside(site)) == len(made.rooms)


def test_faces_that_are_turned_over_are_told():
    mesh = builtin_scene("two_occluders").mesh
    turned = LabelledMesh(mesh.vertices, mesh.faces[:, ::-1], mesh.face_surface)
    names = tuple(f"surface {k}" for k in range(int(mesh.face_surface.max()) + 1))
    site = find_site(Scene(turned, (None,) * len(names), names, "turned"))
    assert len(inside(site)) == 1
    assert any("turns its back upwards" in warning for warning in site.warnings)


@pytest.mark.long
@pytest.mark.parametrize("seed", first_in_gate(1, [1, 12, 21, 32]))
def test_what_bounds_rooms_and_what_is_set_apart_is_all_there_is(seed):
    made = house(seed, storeys=2 if seed > 30 else 1)
    scene = made.scene()
    samples, site = sample_surface(scene.mesh, 0.15), find_site(scene)
    found = bounding_surface(samples, site, scene.ray_caster())
    whole = found.samples.total_m2 + sum(found.apart_m2.values())
    assert whole == pytest.approx(samples.total_m2)
    floor = sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1, _ in made.rooms)
    level = np.abs(samples.normals[:, 2]) > 0.9
    slab = np.array([name.startswith("slab") for name in scene.surface_names])[samples.surface]
    up = slab & level & (samples.normals[:, 2] > 0)
    covered = sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1, _ in made.furniture) + (7.0 if seed > 30 else 0)
    assert floor - covered - 0.02 * floor <= found.samples.areas[up].sum() <= 1.04 * floor  # and doorways
    assert found.samples.areas[slab & ~level].sum() < 0.02 * floor + 2.0
    ground = np.array([name.startswith("ground") for name in scene.surface_names])[samples.surface]
    assert not found.samples.areas[ground].any()


@pytest.mark.long
def test_other_rooms_and_storeys_are_set_apart():
    scene = house(33, storeys=2, closed=True).scene()
    rooms = inside(find_site(scene))
    one = find_site(scene, SiteOptions(rooms=(rooms[0].number,)))
    samples = sample_surface(scene.mesh, 0.2)
    found = bounding_surface(samples, one, scene.ray_caster())
    assert {"another_room", "another_storey", "inside_a_solid", "outside"} == set(found.apart_m2)
    assert found.samples.total_m2 == pytest.approx(
        2 * rooms[0].floor_m2 + 2.6 * 4 * np.sqrt(rooms[0].floor_m2), rel=0.3
    )


@pytest.mark.long
@requires_data
def test_every_room_of_the_duplex_is_found_with_doors_shut_and_open():
    scene = duplex()
    shut, open_ = find_site(scene), find_site(scene.without(["*Door*"]))
    for site in (shut, open_):
        large = [room for room in inside(site) if room.floor_m2 > 1.2 and room.number in site.position_room]
        assert [sum(room.storey == storey for room in large) for storey in (1, 2)] == [4, 10]
        level = site.positions[:, 2, None] - np.array([0.4, 1.0, 1.6, 2.2])
        assert (np.abs(level[:, :, None] - [0.0, 3.1]) < 0.13).any(axis=(1, 2)).all()
    assert not any(room.joined for room in inside(shut))
    living = [room for room in inside(open_) if room.storey == 1 and room.floor_m2 > 40]
    assert [len(room.stairs) for room in living] == [1, 1]
    reached = open_.rooms.reachable_from(living[0].number)
    assert reached >= {
        room.number for room in inside(open_) if room.floor_m2 > 1.2
    }  # by the front doors, too


def test_without_leaves_out_by_name():
    scene = house(6, closed=True).scene()
    assert any("surfaces left out by name" in warning for warning in scene.without(["door*"]).warnings)
    assert scene.without([]) is scene
    with pytest.raises(InputError, match="no surface of building has a name like 'window'"):
        scene.without(["window"])
    with pytest.raises(InputError, match="nothing is left of building"):
        scene.without(["*"])
    assert replace(scene, name="x").without(["door*"]).name == "x"
