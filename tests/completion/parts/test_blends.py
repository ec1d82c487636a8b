# SPDX-License-Identifier: MIT
"""Blends of parts against parts of known radii: of which faces, how large, and where these meet."""

import csv
import io
import json
from functools import cache

import numpy as np
import pytest
import trimesh

from benchmarks.cases.blended_parts import blended_part
from completion.parts.dimensions.blends import blends_of
from completion.parts.dimensions.pipeline import dimensions_of
from completion.parts.dimensions.table import dimensions_csv
from completion.parts.files import write_part
from completion.parts.pipeline import model_part
from scenes.mesh.labelled_mesh import LabelledMesh

NOISE_MM = 0.02
POCKET, TURNED, PRISM = 11, 10, 6


@cache
def modelled(seed, area_mm2=4.0):
    made = blended_part(seed, NOISE_MM, area_mm2)
    return made, model_part(made.points, made.face + 1, relations=None)


@pytest.mark.parametrize(("seed", "kinds"), [
    (POCKET, {"fillet": 12, "corner ball": 8}), (TURNED, {"round": 2, "fillet": 1}),
])  # fmt: skip
def test_blends_have_their_faces_their_radii_and_the_edges_behind_them(seed, kinds):
    made, part = modelled(seed)
    found = {blend.labels: blend for blend in blends_of(part)}
    assert {kind: sum(b.kind == kind for b in found.values()) for kind in kinds} == kinds
    assert len(found) == len(made.blends)
    for true in made.blends:
        blend = found[true.face + 1,]
        assert set(blend.supports) == {face + 1 for face in true.supports}
        assert abs(blend.size_m - true.radius_m) < 4 * blend.sd_m < 0.1 * true.radius_m
        assert blend.kind == true.kind
        for face in true.supports:
            off = np.abs(made.surfaces[face].distance(blend.edge))
            assert (off < 4 * blend.edge_sd_m).all()
        assert np.abs(made.surfaces[true.face].distance(blend.edge)).min() > 10 * blend.edge_sd_m.max()


def test_points_that_errors_gave_to_the_wrong_face_do_not_bias_a_narrow_radius():
    """A round of 1.2 mm with noise of 0.1 mm, divided: errors tell to which face its points are given."""
    z, n, r = [], 350, 0.0012
    for seed in range(2):
        rng = np.random.default_rng(seed)
        along, far = rng.uniform(0, 0.03, 5 * n), rng.uniform(-0.01, -r, 4 * n)
        turn, flat = rng.uniform(0, np.pi / 2, n), np.zeros(2 * n)
        arc = np.column_stack([r * np.cos(turn) - r, r * np.sin(turn) - r])
        section = [np.column_stack([far[: 2 * n], flat]), np.column_stack([flat, far[2 * n :]]), arc]
        points = np.insert(np.concatenate(section), 1, along, axis=1) + rng.normal(0, 1e-4, (5 * n, 3))
        part = model_part(points)
        (blend,) = blends_of(part)
        assert {part.fits[part.labels.index(label)].surface.kind for label in blend.supports} == {"plane"}
        z.append((blend.size_m - r) / blend.sd_m)
    assert np.abs(z).max() < 3.0


def test_an_arc_that_meets_its_faces_at_an_angle_is_no_blend():
    made, part = modelled(PRISM, 2.5)
    arcs = [k for k, surface in enumerate(made.surfaces) if surface.kind == "cylinder"]
    blended = {true.face for true in made.blends}
    assert len(blended) < len(arcs)
    assert {blend.labels[0] - 1 for blend in blends_of(part)} == blended


def test_dimensions_say_what_a_fillet_is_between_and_the_angle_of_faces_that_meet_behind_it():
    made, part = modelled(PRISM, 2.5)
    dimensions = dimensions_of(part)
    rows = list(csv.DictReader(io.StringIO(dimensions_csv(dimensions))))
    fillets = [row for row in rows if row["kind"] == "fillet radius"]
    notes = ", ".join(row["note"] for row in fillets)
    for blend in dimensions.blends:
        assert blend.note in notes
    (true,) = [each for each in made.blends if each.kind == "fillet"]
    normals = [made.surfaces[face].normal_direction for face in true.supports]
    angle = np.degrees(np.arccos(abs(normals[0] @ normals[1])))
    pair = {face + 1 for face in true.supports}
    (row,) = [
        row for row in rows if row["kind"] == "angle" and set(map(int, row["surfaces"].split())) == pair
    ]
    assert float(row["low"]) <= angle <= float(row["high"])


def test_files_hold_blends_with_the_edges_behind_them(tmp_path):
    made, part = modelled(TURNED)
    write_part(part, tmp_path)
    records = json.loads((tmp_path / "part.json").read_text())["blends"]
    assert len(records) == len(made.blends)
    assert all(record["interval"][0] < record["size"] < record["interval"][1] for record in records)
    between = {frozenset(record["between"]) for record in records}
    assert between == {frozenset(face + 1 for face in true.supports) for true in made.blends}
    assert len(records[0]["edge"]) == len(records[0]["edge_standard_deviation"]) > 1


def test_a_chamfer_is_told_by_its_width_and_its_angle():
    section = np.array([(0, 0), (40, 0), (40, 17), (35, 20), (0, 20)]) / 1000
    corners = np.concatenate([np.insert(section, 2, height, axis=1) for height in (0.0, 0.03)])
    mesh = trimesh.convex.convex_hull(corners).subdivide_to_size(0.004)
    part = model_part(LabelledMesh(mesh.vertices, mesh.faces))
    (blend,) = blends_of(part)
    assert blend.kind == "chamfer"
    widths = {0.005: np.degrees(np.arctan2(3, 5)), 0.003: np.degrees(np.arctan2(5, 3))}
    width = min(widths, key=lambda each: abs(each - blend.size_m))
    assert blend.size_m == pytest.approx(width, abs=1e-8)
    assert np.degrees(blend.angle) == pytest.approx(widths[width], abs=1e-4)
    (row,) = dimensions_of(part).of_kind("chamfer")
    assert row.note == blend.note
    assert row.value == pytest.approx(blend.size_m)
    corner = np.array([0.04, 0.02])
    assert blend.edge[:, :2] == pytest.approx(np.repeat(corner[None], len(blend.edge), axis=0), abs=1e-8)
