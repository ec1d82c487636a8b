# SPDX-License-Identifier: MIT
"""Panels: few facets that meet in the true folds of a room, each of one surface and one state."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from completion.export.panels.model import meeting_covariance, rotate_covariances
from completion.export.panels.sheet import Sheet, spread_provenance
from completion.export.panels.welding import edges_of, vertices_within_edges
from completion.extension.patch import Provenance
from completion.options import CompletionOptions
from completion.pipeline import complete
from scenes.io.meshes.ply import read_mesh_ply
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.pose import Pose
from tests.helpers.completion_examples import example

PLAIN = CompletionOptions(texture=False)
SCENES = ("two_occluders", "chair_before_wall", "engaged_column", "pipe_rack")


@pytest.fixture(scope="module")
def done():
    """Completed scans of built-in scenes by name, without texture."""
    return {name: complete(example(name, pixels=160), PLAIN) for name in SCENES}


@pytest.mark.long
def test_the_room_has_its_folds_and_corners(done):
    """A corner of a room behind two boxes: walls and floor meet at right angles, boxes stand on the floor."""
    panels = done["two_occluders"].panels()
    right = np.array([fold.dihedral_deg for fold in panels.folds])
    assert np.abs(right[:, None] - [90.0, 270.0]).min(axis=1).max() < 0.05
    assert {fold.kind for fold in panels.folds} == {"ends", "through"}
    assert len(panels.corners) >= 1
    for fold in panels.folds:
        for number in fold.surfaces:
            surface = done["two_occluders"].patches[number - 1].grid.surface
            assert np.abs(surface.distance(fold.points)).max() < 1e-9
            assert set(fold.goes_on) <= set(fold.surfaces)


@pytest.mark.parametrize("name", SCENES)
def test_facets_are_few_and_fit_together(done, name):
    panels, pixels = done[name].panels(), done[name].observed_mesh()
    assert len(panels.faces) < 0.05 * len(pixels.faces)  # of a scan of 160 x 160
    assert vertices_within_edges(panels.vertices, panels.faces, 1e-4) == []
    edges, count, _ = edges_of(panels.faces)
    goes_on = {number for fold in panels.folds for number in fold.goes_on}
    many = {tuple(edge) for edge in edges[count > 2].tolist()}
    for face, surface in zip(panels.faces.tolist(), panels.face_surface.tolist(), strict=True):
        for k in range(3):
            many -= {tuple(sorted((face[k], face[(k + 1) % 3])))} if surface in goes_on else set()
    assert not many  # of more than two facets, one is of a surface that goes on


@pytest.mark.parametrize("name", SCENES)
def test_facets_lie_on_their_surface_and_face_the_sensor(done, name):
    panels = done[name].panels()
    for number, patch in enumerate(done[name].patches, start=1):
        own = panels.faces[panels.face_surface == number]
        if not len(own):
            continue
        surface, corners = patch.grid.surface, panels.vertices[own]
        assert np.abs(surface.distance(corners.reshape(-1, 3))).max() < 1e-3
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        large = np.linalg.norm(normals, axis=1) > 1e-6
        outward = surface.normal(corners.mean(axis=1))
        assert ((normals * outward).sum(axis=1)[large] > 0).all()


@pytest.mark.parametrize("name", SCENES)
def test_their_area_is_that_of_the_cells_but_for_a_border(done, name):
    panels = done[name].panels()
    areas = triangle_areas(panels.vertices[panels.faces])
    for number, patch in enumerate(done[name].patches, start=1):
        covered = patch.provenance >= 0
        rim = covered & ~ndimage.binary_erosion(covered)
        told = covered.sum() * patch.grid.cell_area
        border = 2 * max(rim.sum(), 9) * patch.grid.cell_area
        assert areas[panels.face_surface == number].sum() == pytest.approx(told, abs=border)


@pytest.mark.parametrize("name", SCENES)
def test_measured_facets_lie_where_it_was_measured(done, name):
    """Within the measured cells, dilated by one for what lies between pixels, and for straight borders."""
    panels = done[name].panels()
    for number, patch in enumerate(done[name].patches, start=1):
        own = (panels.face_surface == number) & panels.is_measured
        weights = np.random.default_rng(0).dirichlet(np.ones(3), 20)
        uv = np.einsum("nk,mkd->mnd", weights, panels.corner_uv[own]).reshape(-1, 2)
        near = ndimage.binary_dilation(patch.observed, np.ones((3, 3)), iterations=3)
        inside, cells = patch.grid.cells_at(uv)
        sheet = Sheet(number, patch, None, spread_provenance(patch, patch.provenance))
        measured = near.ravel()[cells] | (sheet.provenance_at(uv[inside]) == Provenance.MEASURED)
        assert measured.mean() > 0.995 if len(cells) else True


@pytest.mark.long
def test_moving_the_world_moves_the_vertices():
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    pose = Pose.from_parts(turn, np.array([3.0, -20.0, 5.0]))
    scan = example("two_occluders", pixels=120)
    one, other = complete(scan, PLAIN), complete(scan.transform(pose), PLAIN)
    here, there = (done.world_from_reference.apply(done.panels().vertices) for done in (one, other))
    off, _ = cKDTree(pose.apply(here)).query(there)
    assert np.quantile(off, 0.9) < 1e-3  # where corners are as good, rounding may choose another
    for fold, moved in zip(one.panels().folds, other.panels().folds, strict=True):
        places, told = (w.world_from_reference.apply(f.points) for w, f in ((one, fold), (other, moved)))
        assert pose.apply(places) == pytest.approx(told, abs=1e-6)


def test_the_covariance_of_a_corner_is_that_of_planes_that_are_moved(done):
    scan = done["two_occluders"]
    panels = scan.panels()
    corner = panels.corners[0]
    sheets = [Sheet(k, scan.patches[k - 1], None, np.zeros((1, 1), np.int8)) for k in corner.surfaces]
    normals = np.stack([sheet.surface.normal(corner.point[None])[0] for sheet in sheets])
    sd = np.array([sheet.patch.stated.standard_deviation(corner.point[None])[0] for sheet in sheets])
    offsets = np.random.default_rng(0).normal(size=(20_000, 3)) * sd
    moved = np.linalg.solve(normals[None], offsets[..., None])[..., 0]
    told = meeting_covariance(sheets, corner.point)
    assert np.cov(moved.T) == pytest.approx(told, rel=0.1, abs=0.05 * np.abs(told).max())
    assert corner.covariance == pytest.approx(told)


def test_the_files_hold_facets_with_their_state_and_folds(done, tmp_path):
    scan = done["two_occluders"]
    scan.save(tmp_path)
    mesh, panels = read_mesh_ply(tmp_path / "model.ply"), scan.panels()
    assert mesh.vertices == pytest.approx(scan.world_from_reference.apply(panels.vertices))
    assert mesh.faces.tolist() == [*panels.faces.tolist(), *panels.remainder.faces.tolist()]
    is_rest = np.arange(len(mesh.faces)) >= len(panels.faces)
    assert ((mesh.face_properties["surface"] == 0) == is_rest).all()
    assert not mesh.face_properties["state"][is_rest].any()
    assert set(mesh.face_properties) == {"surface", "state", "provenance"}
    assert ((mesh.face_properties["state"] == 0) == (mesh.face_properties["provenance"] == 0)).all()
    assert "state 0 measured 1 inferred" in mesh.comments
    record = json.loads((tmp_path / "completion.json").read_text())
    assert len(record["folds"]) == len(panels.folds)
    assert record["panels"]["triangles"] + record["panels"]["rest_triangles"] == len(mesh.faces)
    fold = record["folds"][0]
    assert fold["length_m"] == pytest.approx(np.linalg.norm(np.diff(fold["points"], axis=0), axis=1).sum())
    assert 0 <= fold["measured_share"] <= 1
    (edges, count, _), length = edges_of(panels.faces), record["panels"]["open_edges_m"]
    open_edges = panels.vertices[edges[count == 1]]
    told = np.linalg.norm(open_edges[:, 1] - open_edges[:, 0], axis=1).sum()
    assert sum(length.values()) == pytest.approx(told)


def test_nothing_gives_no_panels():
    scan = example("two_occluders", pixels=40)
    empty = complete(scan.transform(Pose.identity()), CompletionOptions(texture=False, min_area_m2=1e6))
    panels = empty.panels()
    assert len(panels.faces) == len(panels.folds) == 0


def test_covariances_do_not_depend_on_how_arrays_lie_in_memory(done):
    scan = done["two_occluders"]
    folds = scan.panels().folds
    for fold in folds[:4]:
        if 0 in fold.surfaces:
            continue
        sheets = []
        for number in fold.surfaces:
            patch = scan.patches[number - 1]
            other = replace(patch.stated, covariance=np.asfortranarray(patch.stated.covariance))
            sheets.append(Sheet(number, replace(patch, stated=other), None, np.zeros((1, 1), np.int8)))
        told = [meeting_covariance(sheets, place) for place in fold.points[[0, -1]]]
        np.testing.assert_array_equal(np.stack(told), fold.covariance)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    told = rotate_covariances(folds[0].covariance, turn)
    np.testing.assert_array_equal(told, rotate_covariances(folds[0].covariance, np.asfortranarray(turn)))
    assert told == pytest.approx(turn @ folds[0].covariance @ turn.T, abs=1e-15)
