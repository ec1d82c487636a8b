# SPDX-License-Identifier: MIT
"""Parts of a house whose walls, slabs and rooms are known: thicknesses, areas, volumes, what is not said."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from completion.export.building.bodies import ScanBeams, find_bodies
from completion.export.building.faces import (
    FaceFrame,
    common,
    faces_of,
    fill_holes,
    inside,
    less,
    polygons,
    rings,
    smooth,
    straighten_sides,
    union,
    wide,
)
from completion.export.building.limits import MOST_THICKNESS_M
from completion.export.building.parts import building_parts, find_columns, find_pipes, with_gaps, within_rooms
from completion.export.building.rooms import bands, find_storeys, shut_volume, storey_at
from completion.observe.tolerance import EvidenceOptions
from scenes.pose import Pose
from tests.helpers.exchange_examples import SIZE, UTM, box, drawn, panorama, parts_of
from tests.helpers.exchange_houses import (
    DOOR,
    HIGH_M,
    PARTITION_M,
    ROOMS,
    SLAB_M,
    completed_house,
    house_parts,
)

NO_BEAMS = ScanBeams((), (), Pose.identity())


@pytest.fixture(scope="module")
def parts():
    return house_parts()


@pytest.mark.long
def test_the_partition_is_a_wall_of_its_thickness(parts):
    (wall,) = [body for body in parts.bodies if body.kind == "wall"]
    assert abs(wall.thickness_m - PARTITION_M) < 4 * wall.thickness_sd_m + 1e-4
    assert wall.area.area == pytest.approx(3.0 * HIGH_M - DOOR[0] * DOOR[1], rel=0.02)
    assert 0 < wall.measured_share <= 1
    assert wall.confidence == 1
    assert wall.angle_deg < 0.1
    place = wall.place - UTM.translation
    assert min(abs(place[0] - 4.0), abs(place[0] - 4.0 - PARTITION_M)) < 0.002


def test_the_slab_lies_between_a_ceiling_and_the_floor_above(parts):
    (slab,) = [body for body in parts.bodies if body.kind == "slab"]
    assert slab.thickness_m == pytest.approx(SLAB_M, abs=0.002)
    assert slab.frame.normal[2] > 0.99
    assert slab.area.area == pytest.approx(12.0, rel=0.02)


@pytest.mark.long
def test_walls_seen_from_one_side_have_no_thickness():
    one = house_parts(places=(0,))
    assert not one.bodies
    assert len(one.storeys[0].walls) >= 4


def test_what_beams_went_through_is_no_body():
    done = completed_house()
    parts = house_parts()
    beams = ScanBeams.of(
        done.observations,
        done.measured_surfaces.reach,
        done.world_from_reference,
        EvidenceOptions().tolerance(),
    )
    face = next(face for face in parts.faces if face.element.kind == "ceiling" or face.is_level)
    below = beams.free(face.area, face.frame, -1.0)  # a metre before the face is air
    assert below.area > 0.2 * face.area.area
    assert beams.free(face.area, face.frame, 0.15).area < 0.01 * face.area.area
    assert NO_BEAMS.free(face.area, face.frame, -1.0).is_empty


def test_another_surface_between_two_faces_takes_that_place(parts):
    wall = next(body for body in parts.bodies if body.kind == "wall")
    one, other = (next(face for face in parts.faces if face.number == k) for k in wall.surfaces)
    middle = FaceFrame(one.frame.place(np.zeros(2), -PARTITION_M / 2), *_axes(one.frame))
    between = replace(one, frame=middle, element=replace(one.element, number=99))
    found = find_bodies((one, other, between), NO_BEAMS)
    assert all(body.thickness_m < 0.6 * PARTITION_M for body in found)
    (alone,) = find_bodies((one, other), NO_BEAMS)
    assert alone.surfaces == wall.surfaces


def _axes(frame):
    return frame.right, frame.up, frame.normal


@pytest.mark.parametrize("apart", [MOST_THICKNESS_M + 0.05, -0.1])
def test_faces_too_far_apart_or_face_to_face_are_no_wall(parts, apart):
    wall = next(body for body in parts.bodies if body.kind == "wall")
    one, other = (next(face for face in parts.faces if face.number == k) for k in wall.surfaces)
    moved = FaceFrame(one.frame.place(np.zeros(2), -apart), *_axes(other.frame))
    assert find_bodies((one, replace(other, frame=moved)), NO_BEAMS) == ()


def test_the_doorway_is_found_on_both_sides_of_the_partition(parts):
    wall = next(body for body in parts.bodies if body.kind == "wall")
    for number in wall.surfaces:
        face = next(face for face in parts.faces if face.number == number)
        (door,) = [one for one in face.openings if one.kind == "door"]
        assert (door.width_m, door.height_m) == pytest.approx(DOOR, abs=0.03)
        assert np.ptp((door.points - UTM.translation)[:, 0]) < 1e-3
        assert (door.points - UTM.translation)[:, 1].min() == pytest.approx(1.0, abs=0.02)


def test_without_beams_a_gap_is_no_opening(parts):
    known = sum(len(face.openings) for face in parts.faces)
    bare = [replace(face, openings=()) for face in parts.faces]
    assert sum(len(face.openings) for face in with_gaps(bare, parts.rooms, NO_BEAMS)) == 0 < known


def test_nothing_is_inferred_beyond_rooms_and_what_was_measured_stays():
    parts, model = house_parts(), drawn(completed_house())
    before = {face.number: face for face in faces_of(model)}
    shorter = 0
    for face in parts.faces:
        assert face.measured.equals(before[face.number].measured)
        assert less(face.inferred, [before[face.number].inferred]).area < 1e-3
        shorter += face.area.area < before[face.number].area.area - 0.1
    assert shorter == 4  # walls of both storeys, beside the slab; the others end at their corners
    wall = next(body for body in parts.bodies if body.kind == "wall")
    heights = wall.frame.place(shapely.get_coordinates(wall.area))[:, 2] - UTM.translation[2]
    assert heights.max() < HIGH_M + 0.02
    assert within_rooms(parts.faces, parts.storeys, ())[0].area.equals(parts.faces[0].area)


def test_walls_are_cut_at_the_floors_of_storeys_that_they_go_through(parts):
    tall = max(parts.faces, key=lambda face: face.highest_m - face.lowest_m)
    pieces = bands(parts.storeys, tall.area, tall.frame, tall.lowest_m)
    assert [k for k, _ in pieces] == [0, 1]
    assert sum(part.area for _, part in pieces) == pytest.approx(tall.area.area)
    low = shapely.box(*(tall.frame.flat(np.array([tall.frame.origin]))[0] + 0.01), 0.2, 0.2)
    assert len(bands(parts.storeys, low, tall.frame, tall.lowest_m)) == 1


def test_storeys_have_their_floors_ceilings_and_walls(parts):
    low, high = parts.storeys
    assert low.elevation_m == pytest.approx(UTM.translation[2], abs=0.002)
    assert high.elevation_m - low.elevation_m == pytest.approx(HIGH_M + SLAB_M, abs=0.003)
    assert low.ceiling_m - low.elevation_m == pytest.approx(HIGH_M, abs=0.003)
    assert len(high.walls) >= 4
    assert storey_at(parts.storeys, UTM.translation[2] + 1.0) == 0
    assert storey_at(parts.storeys, UTM.translation[2] + 4.0) == 1
    assert storey_at(parts.storeys, UTM.translation[2] - 4.0) == 0
    assert find_storeys((), ()) == ()


def test_rooms_have_their_area_height_and_volume(parts):
    assert [room.closed for room in parts.rooms] == [True] * 3
    assert [room.storey for room in parts.rooms] == [0, 0, 1]
    for room, (wide_m, deep_m) in zip(parts.rooms, ROOMS, strict=True):
        assert room.area_m2 == pytest.approx(wide_m * deep_m, rel=0.004)
        assert room.height_m == pytest.approx(HIGH_M, abs=0.003)
        assert room.volume_m3 == pytest.approx(wide_m * deep_m * HIGH_M, rel=0.005)
        assert 0.5 < room.measured_share <= 1
        assert len(room.surfaces) >= 6


def test_a_room_without_all_walls_is_open_and_has_no_volume():
    room = next(one for one in parts_of(panorama("office")).rooms)
    assert (room.closed, room.volume_m3) == (False, None)
    assert room.volume_origin == "no volume: walls were not found all around it"


def test_a_room_without_a_ceiling_has_no_volume():
    model = drawn(panorama())
    ceiling = next(one.number for one in model.planes if one.kind == "ceiling")
    kept = model.surface != ceiling
    open_above = replace(
        model, faces=model.faces[kept], surface=model.surface[kept], provenance=model.provenance[kept]
    )
    (room,) = building_parts(open_above, NO_BEAMS).rooms
    assert (room.height_m, room.volume_m3) == (None, None)
    assert "a ceiling was not found" in room.volume_origin
    assert room.area_m2 == pytest.approx(SIZE[0] * SIZE[1], rel=0.001)


def test_a_room_whose_facets_close_has_their_volume():
    low, high = np.zeros(3), np.array([2.0, 3.0, 2.5])
    vertices = np.array([[x, y, z] for x in (0, 2.0) for y in (0, 3.0) for z in (0, 2.5)])
    hull = shapely.MultiPoint(vertices).convex_hull
    assert hull.area == 6
    faces = np.array([
        [0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ])  # fmt: skip
    model = replace(box(), vertices=vertices, faces=faces, surface=np.repeat(np.arange(1, 7), 2))
    assert shut_volume(model, range(1, 7)) == pytest.approx(np.prod(high - low))
    assert shut_volume(model, range(1, 6)) is None
    assert shut_volume(model, ()) is None


def test_columns_stand_on_floors_and_pipes_do_not():
    office = parts_of(panorama("office"))
    (column,) = office.columns
    assert column.cylinder.radius_m == pytest.approx(0.15, abs=0.002)
    assert column.top_m - column.bottom_m == pytest.approx(2.6, abs=0.05)
    assert find_columns(office.model.cylinders, (), ()) == ()
    assert office.pipes == ()
    (pipe,) = find_pipes(office.model.cylinders, ())
    assert pipe.number == column.surfaces[0]
    hollow = replace(pipe, is_solid=False)
    assert find_pipes((hollow,), ()) == ()


def test_areas_are_polygons_alone():
    square, beside = shapely.box(0, 0, 2, 2), shapely.box(2, 0, 3, 1)
    assert common(square, beside).is_empty
    assert union([square, beside]).area == pytest.approx(5)
    assert less(square, [shapely.box(0, 0, 1, 2)]).area == pytest.approx(2)
    assert wide(union([square, beside]), 1.5).area == pytest.approx(4, abs=0.4)
    assert wide(shapely.box(0, 0, 5, 0.1), 0.2).is_empty
    holed = less(square, [shapely.box(0.5, 0.5, 1, 1)])
    assert fill_holes(holed).area == pytest.approx(4)
    slit = less(square, [shapely.box(0.5, 0.5, 0.505, 1.5)])
    assert smooth(slit, 0.02).area == pytest.approx(4, abs=1e-3)
    bent = shapely.Polygon([(0, 0), (1, 1e-4), (2, 0), (2, 2), (0, 2)])
    assert len(rings(polygons(straighten_sides(bent))[0])[0]) == 4
    assert inside(union([square, shapely.box(5, 5, 5.5, 5.5)])) == pytest.approx([1, 1], abs=0.05)
    ring, hole = rings(shapely.Polygon(square.exterior, [shapely.box(0.5, 0.5, 1, 1).exterior.coords]))
    assert (len(ring), len(hole)) == (4, 4)
    assert [len(one) for one in map(rings, polygons(square))] == [1]
