# SPDX-License-Identifier: MIT
"""Dimensions of parts against parts of known size: values, intervals, patterns, preferred values, meshes."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from benchmarks.cases.dimensioned_parts import dimensioned_part
from completion.parts.dimensions.dimension import PartDimension
from completion.parts.dimensions.pipeline import dimensions_of
from completion.parts.dimensions.preferred import with_preferred
from completion.parts.dimensions.table import dimensions_csv, symbol_text, value_text
from completion.parts.pipeline import divide_part, model_part, relate_part
from scenes.mesh.labelled_mesh import LabelledMesh

NOISE_MM, AREA_MM2 = 0.02, 5.0


@pytest.fixture(scope="module")
def flange():
    """A flange by the labels of its faces, what it was built to, and its division."""
    made = dimensioned_part(9, NOISE_MM, AREA_MM2)
    division = divide_part(made.points, made.face + 1)
    return dimensions_of(relate_part(made.points, division)), made, division


@pytest.fixture(scope="module")
def plate():
    """A plate with holes in a grid, and its dimensions."""
    made = dimensioned_part(8, NOISE_MM, AREA_MM2)
    return dimensions_of(model_part(made.points, made.face + 1)), made


def only(dimensions, kind, near_mm=None):
    rows = dimensions.of_kind(kind)
    return min(rows, key=lambda row: abs(1000 * row.value - near_mm)) if near_mm is not None else rows[0]


def test_all_that_was_built_is_found_within_its_interval(flange):
    dimensions, made, _ = flange
    for kind, value in made.meant:
        row = only(dimensions, kind, value)
        assert abs(1000 * row.value - value) < 4000 * row.sd, kind
        assert row.low < row.value < row.high


def test_equal_holes_are_one_row_and_one_circle(flange):
    dimensions = flange[0]
    circle = only(dimensions, "pitch circle diameter")
    holes = only(dimensions, "hole diameter", 6.6)
    assert (circle.count, holes.count, holes.note) == (5, 5, "through")
    assert circle.note.startswith("about surface")
    assert (circle.basis, holes.basis) == ("pattern", "relations")
    assert holes.sd < 0.6 * holes.measured_sd
    assert not dimensions.of_kind("axis distance")


def test_lists_grow_with_the_features_and_not_with_their_pairs(flange):
    assert len(flange[0]) < 15


def test_rows_of_a_plate_are_pitches_from_its_edges_and_depths(plate):
    dimensions, _ = plate
    assert sorted(round(1000 * row.value, 1) for row in dimensions.of_kind("pitch")) == [19.0, 23.0]
    depth = only(dimensions, "hole depth")
    assert (depth.count, round(1000 * depth.value, 1)) == (6, 6.0)
    assert only(dimensions, "axis to plane", 11.0).value == pytest.approx(0.011, abs=4e-5)


def test_values_do_not_depend_on_where_the_part_is(flange):
    there, made, _ = flange
    turn = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]])
    turned = dimensions_of(model_part(made.points @ turn.T + [1.0, 2.0, 3.0], made.face + 1))
    assert np.linalg.det(turn) == pytest.approx(1.0)
    for kind in ("thickness", "hole diameter", "outer diameter", "pitch circle diameter"):
        for row in there.of_kind(kind):
            value = only(turned, kind, 1000 * row.value).value
            assert value == pytest.approx(row.value, abs=0.2 * row.sd), kind


def test_a_countersunk_ring_has_its_diameters_in_the_frame_of_its_file():
    profile = np.array([(4.5, 0), (30, 0), (30, 10), (7, 10), (4.5, 7.5), (4.5, 0)]) / 1000
    ring = trimesh.creation.revolve(profile, sections=48)
    dimensions = dimensions_of(model_part(LabelledMesh(ring.vertices, ring.faces)))
    assert dimensions.frame.axes == pytest.approx(np.eye(3), abs=1e-9)
    found = {kind: 1000 * only(dimensions, kind).value for kind in ("countersink diameter", "hole diameter")}
    assert found == pytest.approx({"countersink diameter": 14.0, "hole diameter": 9.0}, abs=1e-6)
    assert np.degrees(only(dimensions, "cone angle").value) == pytest.approx(90.0, abs=1e-6)
    assert [blend.kind for blend in dimensions.blends] == ["chamfer"]
    assert not dimensions.of_kind("chamfer")  # it is the countersink
    assert 1e9 * only(dimensions, "volume").value == pytest.approx(
        np.pi * (900 * 10 - 4.5**2 * 7.5 - 2.5 / 3 * (49 + 31.5 + 4.5**2)), rel=1e-6
    )


def test_a_round_angle_that_nobody_stated_holds_no_interval_shut():
    """Eight noisy cones of 89.6 degrees: relations find 90, and the interval is still that of the points."""
    held = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        half, n = np.radians(44.8), 600
        height, turn = rng.uniform(0, 0.006, n), rng.uniform(0, 2 * np.pi, n)
        radius = 0.004 + height * np.tan(half)
        cone = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)
        share, turn = np.sqrt(rng.uniform(0, 1, (2, n))), rng.uniform(0, 2 * np.pi, (2, n))
        ends = [
            np.stack([r * one * np.cos(way), r * one * np.sin(way), np.full(n, z)], axis=1)
            for r, z, one, way in zip((0.004, radius.max()), (0.0, 0.006), share, turn, strict=True)
        ]
        points = np.concatenate([cone, *ends]) + rng.normal(0, 1e-4, (3 * n, 3))
        row = only(dimensions_of(model_part(points, np.repeat([1, 2, 3], n))), "cone angle")
        assert row.high - row.low > np.radians(0.1)
        held.append(row.low <= 2 * half <= row.high)
    assert sum(held) >= 6


def cylinder_mesh(rng=None, noise=0.0):
    mesh = trimesh.creation.cylinder(0.02, 0.03, sections=48).subdivide_to_size(0.004)
    vertices, away = mesh.vertices.copy(), np.hypot(*mesh.vertices[:, :2].T)
    vertices[:, :2] *= np.where(away > 0.0195, 0.02 / np.maximum(away, 1e-9), 1.0)[:, None]
    if rng is not None:
        vertices += rng.normal(0, noise, vertices.shape)
    return LabelledMesh(vertices, mesh.faces)


@pytest.mark.parametrize("noise", [0.0, 3e-5])
def test_volume_and_area_are_those_of_the_surfaces_of_a_mesh(noise):
    mesh = cylinder_mesh(np.random.default_rng(0), noise)
    label = np.where(np.hypot(*mesh.vertices[:, :2].T) > 0.0199, 1, 2 + (mesh.vertices[:, 2] > 0))
    high = mesh.corners[:, :, 2].mean(axis=1)
    triangles = np.where(np.abs(high) < 0.0145, 1, 2 + (high > 0))
    dimensions = dimensions_of(replace(model_part(mesh, label), triangle_surface=triangles))
    volume, area = only(dimensions, "volume"), only(dimensions, "area")
    within = 4 if noise else 0
    assert volume.value == pytest.approx(np.pi * 0.02**2 * 0.03, rel=1e-6, abs=within * volume.sd)
    assert area.value == pytest.approx(2 * np.pi * 0.02 * 0.05, rel=1e-6, abs=within * area.sd)


def test_an_open_mesh_has_an_area_and_no_volume():
    box = trimesh.creation.box((0.1, 0.06, 0.03))
    box.update_faces(np.arange(12) > 1)
    dimensions = dimensions_of(model_part(LabelledMesh(box.vertices, box.faces)))
    assert not dimensions.of_kind("volume")
    assert len(dimensions.of_kind("area")) == 1
    assert any("the mesh is open" in doubt for doubt in dimensions.doubts)


def length(kind, value_mm, sd_mm=0.002):
    sd = sd_mm / 1000
    return PartDimension(kind=kind, value=value_mm / 1000, sd=sd, measured_sd=sd, surfaces=(1,))


def test_a_metric_part_is_not_read_in_inches_and_an_inch_part_is():
    metric = with_preferred([length("thickness", value) for value in (12, 25, 40.5, 8.2, 4.3665)])
    assert [row.preferred.series for row in metric[:4]] == ["1 mm", "1 mm", "0.5 mm", "0.1 mm"]
    assert metric[4].preferred is None or metric[4].preferred.probability < 0.5
    inches = with_preferred([length("thickness", 25.4 * value) for value in (0.25, 1.5, 0.3125, 2.0)])
    assert all(row.preferred.series.endswith(" in") for row in inches)
    assert min(row.preferred.probability for row in inches) > 0.9


def test_a_hole_is_one_for_a_thread_where_its_diameter_is():
    core, clearance, none = with_preferred(
        [length("hole diameter", 6.8), length("hole diameter", 6.6), length("outer diameter", 6.8)]
    )
    assert "M8 core (ISO 2306)" in core.preferred.series
    assert "M6 clearance, medium (ISO 273)" in clearance.preferred.series
    assert "M8" not in none.preferred.series


def test_a_poorly_known_length_tells_nothing():
    (row,) = with_preferred([length("thickness", 12.0, 0.8)])
    assert row.preferred is None or row.preferred.probability < 0.5


def test_probable_values_are_imposed_and_others_are_not(flange):
    told, made, division = flange
    imposed = dimensions_of(relate_part(made.points, division, imposes_preferred=True))
    hub = only(imposed, "outer diameter", 60.0)
    assert hub.value == pytest.approx(0.06, abs=1e-12)
    assert hub.is_determined
    free = only(imposed, "outer diameter", 111.37)
    assert free.value == pytest.approx(only(told, "outer diameter", 111.37).value, abs=1e-6)
    assert not free.is_determined


def test_the_table_is_in_the_units_that_it_names(flange):
    rows = list(csv.DictReader(io.StringIO(dimensions_csv(flange[0]))))
    assert len(rows) == len(flange[0])
    outer = next(row for row in rows if row["kind"] == "outer diameter")
    assert outer["unit"] == "mm"
    assert float(outer["low"]) < float(outer["value"]) < float(outer["high"])
    assert {row["unit"] for row in rows} == {"mm", "deg"}


def test_values_are_printed_to_the_digits_that_are_known():
    row = replace(length("hole diameter", 9.00134, 0.0021), count=6)
    assert value_text(row) == "9.0013 mm \u00b1 0.0041"
    assert symbol_text(row) == "6 \u00d7 \u2300 9.001 mm"
