# SPDX-License-Identifier: MIT
"""Profiles: what a sweep makes of faces, curves divided anew, a plate and a shaft, their drawing."""

from __future__ import annotations

import io
from itertools import pairwise

import ezdxf
import numpy as np
import pytest
import shapely
import trimesh

from completion.fitting.result import SurfaceFit
from completion.parts.pipeline import model_part
from completion.parts.profiles.chain import Chain, Piece, Segment
from completion.parts.profiles.drawing import drawn_sheet, scale_text, value_text
from completion.parts.profiles.measures import leaders_of, ordinates_of
from completion.parts.profiles.outline import _area, outline_of
from completion.parts.profiles.partition import curves_of, partition
from completion.parts.profiles.pipeline import profiles_of
from completion.parts.profiles.profile import Profile, profile_record
from completion.parts.profiles.refit import without_breaks
from completion.parts.profiles.sheet_files import sheet_dxf, sheet_svg
from completion.parts.profiles.sweep import Sweep, directions_of
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Torus
from tests.helpers.step_examples import box
from tests.helpers.swept_parts import SIGMA_MM, part_of, plate, shaft


@pytest.fixture(scope="module")
def plates() -> tuple[Profile, ...]:
    """The profiles of the plate."""
    return profiles_of(part_of(plate(), (0.0, 6.0, 15.0)))


@pytest.mark.parametrize(
    ("surface", "free"),
    [
        (Plane((0.02, 0.03, 0.01), (1, 0, 0)), 0),
        (Cylinder((0.01, 0, 0), (1, 0, 0), 0.02), 4),
        (Cone((0.03, 0, 0), (-1, 0, 0), 0.02, 0.3), 5),
        (Torus((0.02, 0, 0), (1, 0, 0), 0.03, 0.005), 6),
        (Sphere((0.02, 0, 0), 0.01), 3),
    ],
)
def test_surfaces_of_revolution_are_lines_and_arcs_with_their_deviation(surface, free):
    axis = SurfaceFit(Cylinder((0, 0, 0), (1, 0, 0), 1.0), 0.0, np.diag([1e-12, 1e-12, 1e-10, 1e-10, 0]), 9)
    sweep = Sweep("revolved", Pose.identity(), axis)
    n = {Plane: 3, Sphere: 4, Cylinder: 5, Cone: 6, Torus: 7}[type(surface)]
    covariance = np.diag(np.full(n, 1e-12))
    covariance[free, free] = 1e-8
    wall = sweep.wall(SurfaceFit(surface, 1e-5, covariance, 100))
    grid = surface.from_uv(np.column_stack([np.linspace(-0.004, 0.004, 9), np.linspace(-0.003, 0.003, 9)]))
    flat = sweep.flatten(grid)
    np.testing.assert_allclose(wall.surface.distance(flat * [1, 1, 0]), 0, atol=1e-12)
    assert np.sqrt(np.diag(wall.covariance).max()) == pytest.approx(
        1e-4 * (np.cos(0.3) if free == 4 and n == 6 else 1), rel=0.01
    )


def test_what_is_not_swept_is_no_wall():
    axis = SurfaceFit(Cylinder((0, 0, 0), (0, 0, 1), 1.0), 0.0, np.zeros((5, 5)), 9)
    sweep = Sweep("extruded", Pose.identity(), axis)
    exact = 1e-12 * np.eye(3)
    assert sweep.wall(SurfaceFit(Plane((0, 0, 0), (1, 0, 0.01)), 0.0, exact, 9)) is None
    assert sweep.wall(SurfaceFit(Sphere((0, 0, 0), 1.0), 0.0, 1e-12 * np.eye(4), 9)) is None
    assert sweep.cap(SurfaceFit(Plane((0, 0, 0.2), (0, 0, -1)), 0.0, exact, 9)) == pytest.approx(
        (0.2, 1e-6), rel=1e-3
    )


def test_a_curve_is_divided_into_its_lines_and_arcs():
    rng = np.random.default_rng(3)
    outer = plate().loops[0]
    places = np.concatenate([one.places(rng.random(int(60 * one.length))) for one in outer.segments])
    places = 1e-3 * (places + 0.1 * rng.normal(size=places.shape))
    ((curve, along),) = curves_of(places, rng.random(len(places)), 8e-4)
    chain, walls = partition(curve, along, 1e-4, 8e-4)
    assert chain.is_ring
    assert sorted(wall.surface.kind for wall in walls) == ["cylinder"] * 2 + ["plane"] * 4
    radii = [1e3 * wall.surface.radius for wall in walls if isinstance(wall.surface, Cylinder)]
    np.testing.assert_allclose(radii, 8.0, atol=0.1)


def test_a_plate_has_its_loops_heights_and_relations(plates):
    (profile,) = plates
    assert [(loop.kind, len(loop.segments), loop.is_through) for loop in profile.loops] == [
        ("outer", 6, False), ("slot", 4, False), ("hole", 1, True),
    ]  # fmt: skip
    outer, slot, _ = profile.loops
    assert 1e3 * (outer.high_m - outer.low_m) == pytest.approx(15, abs=0.01)
    assert 1e3 * (slot.high_m - slot.low_m) == pytest.approx(9, abs=0.01)
    assert outer.polygon.area * 1e6 == pytest.approx(plate().loops[0].polygon.area, rel=2e-3)
    kinds = [relation.kind for relation in profile.relations()]
    assert kinds.count("tangent") >= 7
    assert kinds.count("equal_radius") == 2
    assert kinds.count("perpendicular") == 1
    widths = [measure.value for axis in (0, 1) for measure in ordinates_of(profile, axis)]
    halves = [measure.half for axis in (0, 1) for measure in ordinates_of(profile, axis)]
    assert max(widths) == pytest.approx(60, abs=2 * max(halves))
    assert sorted({round(one.value) for one in leaders_of(profile) if one.sign == "R"}) == [5, 8]
    assert profile_record(profile)["free"] == profile.free


def test_a_shaft_has_a_section_from_axis_to_axis():
    profile = profiles_of(part_of(shaft()))[0]
    (loop,) = profile.loops
    assert (loop.kind, [segment.wall for segment in loop.segments].count(-1)) == ("turned", 1)
    assert sorted("A" if one.centre is not None else "L" for one in loop.segments if one.wall >= 0) == list(
        "ALLLLL"
    )
    (angle,) = [one for one in leaders_of(profile) if one.sign == "\u00b0"]
    assert angle.value == pytest.approx(np.degrees(np.arctan2(6, 25)), abs=2 * angle.half)
    diameters = [measure.value for measure in ordinates_of(profile, 1)]
    assert min(abs(value - 24) for value in diameters) < 0.02


def filleted_boss(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) on a disc of 80 mm with a boss of 32 mm and a fillet of 6 mm between, and their faces."""
    turn = np.linspace(np.pi, 1.5 * np.pi, 30)
    fillet = np.column_stack([22 + 6 * np.cos(turn), 16 + 6 * np.sin(turn)])[::-1]
    section = np.array([(0, 0), (40, 0), (40, 10), *fillet, (16, 40), (0, 40)])
    number = np.array([0, 1, 2, *[3] * 29, 4, 5])
    rng = np.random.default_rng(1)
    begin, step = section[:-1], np.diff(section, axis=0)
    area = np.linalg.norm(step, axis=1) * (begin[:, 0] + step[:, 0] / 2)
    piece = rng.choice(len(step), n, p=area / area.sum())
    share = rng.uniform(size=n)
    span = np.square(begin[piece, 0] + [[0.0], [1.0]] * step[piece, 0])  # even by area
    radius = np.sqrt(span[0] + share * (span[1] - span[0]))
    along = np.where(step[piece, 0] == 0, share, (radius - begin[piece, 0]) / (step[piece, 0] + 1e-300))
    angle, height = rng.uniform(0, 2 * np.pi, n), begin[piece, 1] + along * step[piece, 1]
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    return 1e-3 * (points + rng.normal(0, SIGMA_MM, points.shape)), number[piece] + 1


def test_what_a_fillet_adds_to_a_section_is_not_swept():
    points, face = filleted_boss(8_000)
    part = model_part(points, face, relations=None)
    sample = [points[face == number] for number in part.labels]
    (sweep, _), *_ = directions_of(part, sample)
    outline = outline_of(part, sample, sweep, 1.0)
    pieces = [stretch.chain.pieces for stretch in outline.stretches]
    assert [len(each) <= 2 for each in pieces] == [True, True]  # more with all of the fillet
    radii = [{round(outline.walls[one.wall].surface.radius * 1e3) for one in each} for each in pieces]
    assert radii == [{40}, {16}]


def test_lines_that_hardly_turn_meet_where_they_were_seen_to():
    first = Plane((0.0, 0, 0), (0, 1, 0))
    second = Plane((0.01, 1e-5, 0), (1e-4, 1, 0))
    near = np.array([0.01, 0.0])
    chain = Chain((Piece(0, 0.0, 0.01), Piece(1, 0.0, 0.01)), (True, True), (near,), is_closed=False)
    assert [segment.length < 0.05 for segment in chain.trace([first, second])] == [True, True]


@pytest.mark.parametrize(("chord", "n"), [(0.4e-3, 1), (3e-3, 2)])
def test_a_chord_that_noise_hides_is_of_its_circle(chord, n):
    circle = SurfaceFit(Cylinder((0, 0, 0), (0, 0, 1), 4e-3), 2e-5, np.diag([1e-12, 1e-12, 0, 0, 1e-12]), 500)
    height = np.sqrt(16e-6 - chord**2 / 4)
    line = SurfaceFit(Plane((0, height, 0), (0, 1, 0)), 2e-5, np.diag([1e-12, 1e-4, 0]), 40)
    pieces = (Piece(0, 0.0, 2 * np.pi * 4e-3 - chord), Piece(1, -chord / 2, chord / 2))
    corners = (np.array([-chord / 2, height]), np.array([chord / 2, height]))
    chain = Chain(pieces, (True, True), corners, is_closed=True)
    assert len(without_breaks(chain, [circle, line], [circle, line]).pieces) == n


def test_a_sheet_is_made_higher_where_texts_need_it(plates):
    sheet = drawn_sheet(plates * 200, "many")
    assert (sheet.width_mm, sheet.height_mm > 594) == (841, True)


def test_the_drawing_is_the_same_twice_and_cutters_read_its_outlines(plates):
    sheet = drawn_sheet(plates, "plate")
    assert sheet_svg(sheet, "plate") == sheet_svg(drawn_sheet(plates, "plate"), "plate")
    data = sheet_dxf(sheet)
    assert data == sheet_dxf(sheet)
    document = ezdxf.read(io.StringIO(data.decode()))
    space = document.modelspace()
    outlines = space.query('LWPOLYLINE[layer=="OUTLINE" | layer=="CUT"]')
    assert [one.closed for one in outlines] == [True, True]
    (circle,) = space.query("CIRCLE")
    assert circle.dxf.radius == pytest.approx(4.0, abs=0.02)
    assert (document.units, scale_text(sheet.scale)) == (4, "2 : 1")


@pytest.mark.parametrize(
    ("half", "text"),
    [(np.nan, "1.23"), (1e-9, "1.235"), (0.0011, "1.235 \u00b10.002"), (0.4, "1.2 \u00b10.4")],
)
def test_values_have_the_digits_that_their_interval_leaves(half, text):
    assert value_text(1.2346, half) == text


@pytest.mark.parametrize("sections", [36, 96])
def test_a_countersink_of_a_model_keeps_its_angle_and_mouth(sections):
    section = [[4.5, 0], [4.5, 9.5], [7, 12], [20, 12], [20, 0], [4.5, 0]]
    mesh = trimesh.creation.revolve(1e-3 * np.array(section), sections=sections)
    rounded = (mesh.vertices + [0.046, 0, 0]).astype(np.float32).astype(np.float64)
    part = model_part(LabelledMesh(rounded, np.asarray(mesh.faces, np.int32)))
    turned = next(one for one in profiles_of(part) if one.sweep.kind == "revolved")
    segments = [one for loop in turned.loops for one in loop.segments]
    slopes = [(one.end - one.start)[:2] for one in segments if one.centre is None]
    cone = next(slope for slope in slopes if np.abs(slope).min() > 1e-4)
    assert np.abs(cone) == pytest.approx([2.5e-3, 2.5e-3], abs=1e-6)


def test_exact_points_have_profiles_too():
    """Points without any noise, of a block 18 x 12 x 8 mm: its section is a rectangle."""
    block = model_part(np.concatenate([own for _, own in box((0.018, 0.012, 0.008))]))
    (profile,) = profiles_of(block)
    (loop,) = profile.loops
    sides = [float(np.linalg.norm(one.end - one.start)) for one in loop.segments]
    assert [one.centre for one in loop.segments] == [None] * 4
    assert sorted([*sides[:2], loop.high_m - loop.low_m]) == pytest.approx([0.008, 0.012, 0.018], abs=1e-6)


def test_an_outline_that_crosses_itself_is_its_largest_part() -> None:
    corners = np.array([[0.0, 0], [1, 1], [3, -1], [3, 3], [1, 1], [0, 2]])  # two triangles tip to tip
    lines = [Segment.line(0, one, two) for one, two in pairwise([*corners, corners[0]])]
    chain = Chain(pieces=(), is_forward=(), corners=tuple(corners), is_closed=True, on_axis=False)
    area = _area(chain, lines)
    assert isinstance(area, shapely.Polygon)
    assert area.area == pytest.approx(4.0)  # of the right one; the left one has 1
    flat = [Segment.line(0, one, two) for one, two in pairwise(np.array([[0.0, 0], [1, 0], [2, 0], [0, 0]]))]
    assert _area(chain, flat).is_empty
