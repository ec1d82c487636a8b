# SPDX-License-Identifier: MIT
"""What the 3-D views of reports hold: the areas, classes and places of what they show."""

from dataclasses import replace

import numpy as np
import pytest

from completion.extension.patch import Provenance
from completion.options import CompletionOptions
from completion.pipeline import complete
from completion.result.unknown import unknown_part
from nbv.coverage.coverage import MET, REACHABLE, UNREACHABLE
from nbv.coverage.measurement import measure_coverage, visibility_history
from nbv.plan.tour import Leg, Tour
from nbv.report.blocks.coverage_tables import fields_of, outline_of, place_cells, scans_table
from nbv.report.figures import picture
from nbv.report.figures.floor_plan import FloorPlan
from nbv.report.figures.picture import best_side, overview_cameras
from nbv.report.figures.plots import coverage_curve
from nbv.report.figures.surface_values import cut_finely, fine_coverage
from nbv.report.viewer.layers import Category, Layer, best_camera, focus
from nbv.report.viewer.markers import box_edges, given_markers, slope_of, tour_lines, view_markers, zone_lines
from nbv.report.viewer.scan_views import _CATEGORIES, completion_view, find_occluders, state_view
from nbv.report.viewer.scene_view import near_hull, scene_view
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, SphericalSensor, View
from nbv.scans.next_stations import plan_next_stations
from nbv.scans.scan_coverage import cover_by_scans
from nbv.scans.scan_map import ScanMap
from nbv.scans.state_mesh import SHADOW, StateMesh
from nbv.visibility.samples import sample_surface
from nbv.visibility.zones import Box, Zones
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.world.builtin import builtin_scene
from tests.helpers.view_examples import AROUND, CANDIDATES, COARSE

ROOM = builtin_scene("two_occluders")
SAMPLES = sample_surface(ROOM.mesh, 0.2)
SENSOR = PinholeSensor(fov_deg=80, width=80, height=80, name="small")
VIEWS = [View(Pose.looking_at(at, (3, 2.5, 1.0)), SENSOR) for at in ((0.5, 0.5, 1.5), (5.4, 4.5, 1.5))]
GREY = Category("grey", (0.5, 0.5, 0.5))
PLAIN = CompletionOptions(texture=False)


def area_of(corners):
    a, b, c = np.moveaxis(corners, 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def channel(layer, key):
    return next(one for one in layer.channels if one.key == key)


@pytest.fixture(scope="module")
def coverage():
    return measure_coverage(ROOM, VIEWS, samples=SAMPLES, candidates=CANDIDATES)


@pytest.fixture(scope="module")
def seen(coverage):
    return visibility_history(ROOM.ray_caster(1), SAMPLES, coverage.requirement, VIEWS)


@pytest.fixture(scope="module")
def completion():
    chair = builtin_scene("chair_before_wall")
    sensor = PinholeSensor(fov_deg=60, width=160, height=160, name="small")
    return complete([scan_scene(chair, View(Pose.looking_at((0.3, -1.6, 1.1), (0, 1, 0.8)), sensor))], PLAIN)


def test_a_scene_keeps_its_area_and_its_states(coverage, seen):
    view = scene_view(ROOM, coverage, seen)
    assert [layer.key for layer in view.layers] == ["enclosure", "occluders"]
    areas = np.zeros(3)
    for layer in view.layers:
        state = channel(layer, "state").values[layer.place]
        areas += np.bincount(state, area_of(layer.vertices[layer.faces]), 3)
    wanted = [SAMPLES.areas[coverage.state == kind].sum() for kind in (UNREACHABLE, REACHABLE, MET)]
    assert areas.sum() == pytest.approx(coverage.total_m2)
    assert areas == pytest.approx(np.array(wanted), abs=0.02 * coverage.total_m2)
    assert view.met == seen.met


def test_what_stands_in_a_room_is_told_from_what_encloses_it():
    middles = ROOM.mesh.corners.mean(axis=1)
    inner = ~near_hull(middles, ROOM.mesh.vertices)
    names = {ROOM.surface_names[k] for k in np.unique(ROOM.mesh.face_surface[inner])}
    assert names
    assert all("box" in name for name in names)
    assert not any("wall" in ROOM.surface_names[k] for k in np.unique(ROOM.mesh.face_surface[inner]))
    flat = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    assert near_hull(flat, flat).all()


def test_an_object_is_one_layer(coverage, seen):
    assert [layer.key for layer in scene_view(replace(ROOM, mode="object"), coverage, seen).layers] == [
        "surface"
    ]


def test_outside_the_region_nothing_is_said(coverage, seen):
    region = Box((-0.1, -0.1, -0.1), (3.0, 5.1, 2.8))
    view = scene_view(ROOM, coverage, seen, zones=Zones(region))
    for layer in view.layers:
        middles = layer.vertices[layer.faces].mean(axis=1)
        outside = layer.place == len(SAMPLES)
        assert (outside == (region.distance(middles) > 1e-3)).all()
        assert channel(layer, "surface").values[-1] == 65535
        assert np.isnan(channel(layer, "quality").values[-1])


def test_pieces_carry_the_texture_of_their_face(coverage):
    fine = fine_coverage(ROOM.mesh, coverage, 1.0)
    corners = np.einsum("mij,mjk->mik", fine.weights, ROOM.mesh.corners[fine.face])
    assert corners == pytest.approx(fine.corners)
    assert (fine.best_cosine == coverage.best_cosine[fine.sample]).all()


def test_triangles_are_cut_until_none_is_larger():
    corners = np.array(
        [[[0, 0, 0, 1], [2, 0, 0, 3], [0, 2, 0, 1]], [[0, 0, 1, 0], [0.1, 0, 1, 0], [0, 0.1, 1, 0]]]
    )
    pieces, part = cut_finely(corners, 0.2)
    areas = area_of(pieces[..., :3])
    assert areas.max() <= 0.2
    assert np.bincount(part, areas) == pytest.approx([2.0, 0.005])
    first = pieces[part == 0]
    assert first[..., 3] == pytest.approx(1 + first[..., 0])


@pytest.mark.long
def test_a_completion_keeps_the_areas_that_it_tells(completion):
    view = completion_view(completion, is_room=False)
    areas = {layer.key: area_of(layer.vertices[layer.faces]) for layer in view.layers}
    inferred = next(layer for layer in view.layers if layer.key == "inferred")
    assert areas["inferred"].sum() == pytest.approx(completion.hypothesised_m2, rel=0.05)
    assert areas["measured"].sum() > 0.5 * completion.observed_m2
    assert (channel(inferred, "provenance").values != Provenance.MEASURED).all()
    assert (channel(inferred, "confidence").values >= 0.5 - 1e-9).all()
    assert channel(inferred, "sd").values.max() <= 20.0
    corners = completion.world_from_reference.apply(completion.hypothesised.vertices)
    low, high = corners.min(axis=0), corners.max(axis=0)
    used = inferred.vertices[inferred.faces].reshape(-1, 3)
    cell = max(float(patch.grid.cell.max()) for patch in completion.patches)
    assert (used > low - 3 * cell).all()
    assert (used < high + 3 * cell).all()


def test_occluders_are_what_hides_inferred_surface(completion):
    hiding = find_occluders(completion.patches)
    largest = int(np.argmax([patch.observed_m2 for patch in completion.patches])) + 1
    assert largest not in hiding
    view = completion_view(completion, is_room=False)
    measured = next(layer for layer in view.layers if layer.key == "measured")
    assert not set(np.unique(channel(measured, "surface").values)) & {0, *hiding}


def test_incidence_on_measured_surface_is_that_of_the_scan(completion):
    view = completion_view(completion, is_room=False)
    measured = next(layer for layer in view.layers if layer.key == "measured")
    corners = measured.vertices[measured.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    way = view.markers[0].origin - corners.mean(axis=1)
    cosine = (
        np.abs((normals * way).sum(axis=1)) / np.linalg.norm(normals, axis=1) / np.linalg.norm(way, axis=1)
    )
    found = channel(measured, "quality").values
    known = np.isfinite(found)
    assert known.mean() > 0.9
    assert found[known] == pytest.approx(np.degrees(np.arccos(np.clip(cosine, 0, 1)))[known], abs=0.1)


def test_what_is_unknown_is_a_layer_of_its_own_beside_measured_and_inferred(completion):
    """Hidden, neither measured nor inferred: no cell of it is of another state, and all are in one colour."""
    view = completion_view(completion, is_room=False)
    layers = {layer.key: layer for layer in view.layers}
    unknown = layers["unknown"]
    assert len(unknown.faces)
    assert unknown.paint.colour == picture.UNKNOWN
    assert unknown.paint.pattern == "hatched"
    assert unknown.skin is None
    states = {}
    for key, layer in layers.items():
        here = channel(layer, "state")
        states[key] = {here.categories[k].label for k in np.unique(here.values)}
    assert states.pop("unknown") == {"unknown"}
    assert states.pop("inferred") == {"inferred"}
    assert set.union(*states.values()) == {"measured"}
    area = 0.0
    for number, patch in enumerate(completion.patches, start=1):
        part = unknown_part(patch)
        area += area_of(part.vertices[part.faces]).sum()
        cells = np.zeros(patch.grid.shape, np.bool_)
        middles = part.vertices[part.faces].mean(axis=1)
        cells.ravel()[patch.grid.cells_of(middles)[1]] = True
        assert not (cells & (patch.observed | patch.hypothesised)).any(), number
        assert not (cells & patch.evidence.open).any(), number
    assert area_of(unknown.vertices[unknown.faces]).sum() == pytest.approx(area)


def test_states_of_scans_are_coloured_by_family():
    """Grey is measured, blue inferred, amber unknown: none has the colour of another."""
    greys, blue, ambers = _CATEGORIES[:2], _CATEGORIES[2], _CATEGORIES[3:]
    assert all(np.ptp(category.colour) < 0.03 for category in greys)
    assert blue.colour[2] - blue.colour[0] > 0.5
    assert all(category.colour[0] - category.colour[2] > 0.25 for category in ambers)
    assert len({(category.colour, category.pattern) for category in _CATEGORIES}) == len(_CATEGORIES)


@pytest.mark.long
def test_scans_without_a_model_show_what_is_measured_and_where_the_unknown_begins():
    scans = [scan_scene(ROOM, View(Pose.looking_at((1, 1, 1.5), (5, 4, 1.2)), AROUND), rng=0, name="first")]
    scan_map = ScanMap.of(scans, AROUND, options=COARSE)
    coverage = cover_by_scans(scan_map, completion=complete(scan_map.scans, PLAIN, rng=0))
    state = StateMesh.of(coverage)
    plan = plan_next_stations(scan_map, AROUND, coverage.requirement, views=1, options=COARSE, n_threads=1)
    poses = [view.world_from_sensor for view in plan.views]
    view = state_view(coverage, state, (), poses=poses, sensor=AROUND)
    assert [layer.key for layer in view.layers] == ["measured", "inferred", "unseen", "frontier"]
    assert [marker.name for marker in view.markers] == ["A", "1"]
    assert [marker.is_step for marker in view.markers] == [False, True]
    assert not view.layers[3].shown
    unseen = view.layers[2]
    normals = np.cross(
        *(unseen.vertices[unseen.faces[:, k]] - unseen.vertices[unseen.faces[:, 0]] for k in (1, 2))
    )
    assert ((normals * state.front[state.mesh.face_surface == SHADOW]).sum(axis=1) > 0).all()
    alone = state_view(coverage, state, ())
    assert [marker.is_step for marker in alone.markers] == [True]
    table = scans_table(scans, lettered=True)
    assert [cell.text for cell in table.rows[0]][:2] == ["A", "first"]


def test_fields_of_view_from_above():
    level = Pose.looking_at((0, 0, 1), (5, 0, 1))
    down = Pose.looking_at((0, 0, 1), (1e-6, 0, 0))
    wedge, patch = fields_of([level, down], [PinholeProjection.from_fov(101, 101, 60)] * 2, 2.0)
    reach = np.linalg.norm(wedge, axis=1)
    assert reach.max() == pytest.approx(2.0, rel=1e-6)
    ahead = wedge[reach > 0.1]
    assert np.degrees(np.abs(np.arctan2(ahead[:, 1], ahead[:, 0]))).max() == pytest.approx(30.0, abs=0.5)
    assert np.abs(patch).max() == pytest.approx(2 * np.sin(np.radians(30)), abs=0.05)
    (circle,) = fields_of([level], [SphericalSensor(width=90, height=45).projection], 2.0)
    assert np.linalg.norm(circle, axis=1).min() > 1.9


def test_the_field_of_view_of_a_cone_is_round():
    cone = PinholeSensor(fov_deg=60, width=101, height=101, aperture="circular")
    pyramid = replace(cone, aperture="square")
    up = Pose.looking_at((0, 0, 1), (1e-6, 0, 5))
    disc, square = fields_of([up, up], [cone, pyramid], 2.0)
    assert np.linalg.norm(disc, axis=1).min() == pytest.approx(2 * np.sin(np.radians(30)), rel=0.02)
    assert np.linalg.norm(disc, axis=1).max() == pytest.approx(2 * np.sin(np.radians(30)), rel=1e-6)
    assert np.linalg.norm(square, axis=1).max() > 1.1 * np.linalg.norm(disc, axis=1).max()
    marker, other = view_markers([up, up], [cone, pyramid])
    assert (marker.is_cone, other.is_cone) == (True, False)
    assert marker.slope == pytest.approx((np.tan(np.radians(30)),) * 2)


def test_the_floor_plan_draws_fields_and_the_curve_other_planners():
    shown = {"outline": outline_of(ROOM), "bounds": ROOM.mesh.bounds(), "positions": np.eye(3)}
    fields = fields_of([VIEWS[0].world_from_sensor] * 3, [SENSOR.projection] * 3, 1.0)
    plain, with_fields = FloorPlan(**shown).plot(), FloorPlan(**shown, fields=fields).plot()
    given = FloorPlan(**shown, given=np.eye(3), given_fields=fields).plot()
    assert len({plain.light, with_fields.light, given.light}) == 3
    alone = coverage_curve([0.2, 0.5], 0.9, 0.99, None)
    assert coverage_curve([0.2, 0.5], 0.9, 0.99, None, others={"random": np.array([0.1, 0.2])}) != alone


def test_markers_know_their_sensors_and_lines_their_ends():
    assert slope_of(PinholeProjection.from_fov(40, 20, 90)) == pytest.approx((1.0, 0.5))
    assert slope_of(SphericalSensor(width=90, height=45).projection) is None
    narrow = SphericalSensor(90, -45, 45, width=90, height=90).projection
    assert slope_of(narrow) == pytest.approx((1.0, 1.0), rel=0.03)
    poses = [view.world_from_sensor for view in VIEWS]
    (first, _), (given, _) = (make(poses, [SENSOR.projection] * 2) for make in (view_markers, given_markers))
    assert (first.name, given.name) == ("1", "A")
    assert first.axes[2] == pytest.approx(poses[0].rotation[:, 2])
    edges = box_edges(Box((0, 0, 0), (1, 2, 3)))
    assert np.sort(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)) == pytest.approx(
        [1] * 4 + [2] * 4 + [3] * 4
    )
    zones = zone_lines(Zones(Box((0, 0, 0), (1, 1, 1)), [Box((0, 0, 0), (1, 1, 1))] * 2))
    assert [(one.key, len(one.ends)) for one in zones] == [("region", 12), ("keep-out", 24)]
    way = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    (tour,) = tour_lines(Tour((0, 1, 2), (Leg(way, 2.0), Leg(np.zeros((0, 3)), np.inf))))
    assert len(tour.ends) == 2
    assert tour_lines(None) == ()


def test_the_first_side_is_the_one_that_shows_most_and_what_looks_away_does_not_shrink_the_picture():
    """A corner of two walls and a floor, and far outside a wall that looks away."""
    wall = np.array([[0, 0, 0], [0, 2, 0], [0, 2, 2], [0, 0, 2.0]])
    other, floor = wall[:, [1, 0, 2]][::-1], np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0.0]])
    away = 0.5 * wall[::-1] + [-9.0, 0, 0]
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    layers = [Layer(str(k), "", one, faces, GREY) for k, one in enumerate((wall, other, floor, away))]
    camera = best_camera(np.array([[-9.0, 0, 0], [2, 2, 2]]), layers)
    assert (camera.axes[2][:2] < 0).all()
    assert focus(layers, camera.axes[2], is_room=True) == pytest.approx(np.array([[0, 0, 0], [2, 2, 2.0]]))
    assert focus(layers, camera.axes[2], is_room=False)[0, 0] == -9.0
    assert (focus([], camera.axes[2], is_room=True) == 0).all()
    assert best_side(overview_cameras(ROOM.mesh.bounds()), floor[faces]) == 0  # alike from all around


def test_headings_and_elevations_are_those_of_the_axis():
    place, heading, elevation = place_cells(Pose.looking_at((1, 2, 3), (1, 3, 4)))
    assert (place.text, heading.text, elevation.text) == ("1.00, 2.00, 3.00", "90", "45")
