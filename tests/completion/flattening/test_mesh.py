# SPDX-License-Identifier: MIT
"""Meshes: vertices go to their planes, creases stay creases, no face turns over or crosses another."""

from dataclasses import replace

import numpy as np
import pytest

from completion.flattening.flat import FlatteningOptions, RegionKind
from completion.flattening.mesh_movement import hold_back, new_crossings
from completion.flattening.pipeline import flatten_mesh
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.surfaces.catalogue import Sphere
from tests.helpers.wall_examples import (
    SHAPE,
    corner_mesh,
    faces_of,
    panelled,
    plane_fit,
    wall_mesh,
)


def turned_over(before, after, faces) -> int:
    normals = [
        np.cross(at[faces[:, 1]] - at[faces[:, 0]], at[faces[:, 2]] - at[faces[:, 0]])
        for at in (before, after)
    ]
    return int(np.sum(np.sum(normals[0] * normals[1], axis=1) <= 0))


@pytest.fixture(scope="module")
def wall():
    mesh = wall_mesh(panelled(0))
    return mesh, flatten_mesh(*mesh)


def test_vertices_of_the_plane_lie_on_it_and_relief_stands_out(wall) -> None:
    (vertices, faces, labels, _), flat = wall
    height = flat.vertices[:, 2]
    assert np.array_equal(height == 0, ~flat.is_relief)
    assert flat.is_relief.mean() == pytest.approx((28 * 28 + 12 * 8) / labels.size, abs=0.003)
    assert np.median(height[flat.is_relief]) == pytest.approx(0.005, abs=0.0004)
    assert np.array_equal(flat.vertices[:, :2], vertices[:, :2])
    assert np.allclose(flat.moved_m, np.abs(height - vertices[:, 2]), atol=1e-12)
    assert turned_over(vertices, flat.vertices, faces) == 0
    assert not flat.is_held.any()


@pytest.mark.long
def test_moved_and_turned_mesh_gives_the_same(wall) -> None:
    (vertices, faces, labels, _), flat = wall
    pose = Pose.looking_at((3, -1, 2), (0, 1, 1))
    there = flatten_mesh(
        pose.apply(vertices), faces, labels, [plane_fit(pose.apply(np.zeros((1, 3)))[0], pose.matrix[:3, 2])]
    )
    assert (there.is_relief == flat.is_relief).mean() > 0.999
    both = ~there.is_relief & ~flat.is_relief
    assert np.allclose(there.vertices[both], pose.apply(flat.vertices[both]), atol=1e-9)


@pytest.mark.long
def test_pixels_of_a_range_image_move_along_their_rays(wall) -> None:
    (vertices, faces, labels, fits), _ = wall
    origin = np.array([0.4, 0.3, 1.5])
    flat = flatten_mesh(vertices, faces, labels, fits, origin=origin)
    before, after = vertices - origin, flat.vertices - origin
    assert np.allclose(np.cross(before, after), 0, atol=1e-12)
    assert np.abs(flat.vertices[~flat.is_relief, 2]).max() < 1e-12
    assert turned_over(vertices, flat.vertices, faces) == 0


@pytest.mark.long
def test_vertices_on_two_planes_go_to_their_crease() -> None:
    vertices, faces, labels, fits = corner_mesh(5)
    flat = flatten_mesh(vertices, faces, labels, fits)
    crease = np.arange(SHAPE[0]) * SHAPE[1]
    assert np.abs(flat.vertices[crease][:, [0, 2]]).max() < 1e-12
    assert turned_over(vertices, flat.vertices, faces) == 0
    rim = np.arange(SHAPE[1])
    assert np.array_equal(flat.vertices[rim[2:], :2], vertices[rim[2:], :2])  # free rims stay where they are


@pytest.mark.long
def test_rows_beside_a_crease_do_not_go_onto_it_too() -> None:
    """Where three rms are more than a cell, the row beside the crease is within reach of the other wall."""
    vertices, faces, labels, fits = corner_mesh(5)
    loose = [replace(fit, rms=0.004) for fit in fits]
    flat = flatten_mesh(vertices, faces, labels, loose)
    assert not flat.is_held.any()
    assert not flat.is_relief.any()
    row = 1 + np.arange(SHAPE[0]) * SHAPE[1]
    assert np.array_equal(flat.vertices[row[1:-1], :2], vertices[row[1:-1], :2])


@pytest.mark.long
def test_other_surfaces_and_unlabelled_vertices_stay(wall) -> None:
    (vertices, faces, labels, fits), _ = wall
    some = labels.copy()
    some[: 5 * SHAPE[1]] = 0
    some[5 * SHAPE[1] : 8 * SHAPE[1]] = 2
    ball = type(fits[0])(Sphere((0, 0, 0), 1.0), 0.001, np.zeros((4, 4)), 100)
    flat = flatten_mesh(vertices, faces, some, [fits[0], ball])
    assert np.all(flat.moved_m[some != 1] == 0)
    assert [one.label for one in flat.surfaces] == [1]


def test_small_planes_stay_and_say_why() -> None:
    vertices, faces, labels, fits = wall_mesh(panelled(0)[:12, :12])
    flat = flatten_mesh(vertices, faces, labels, fits)
    assert np.all(flat.moved_m == 0)
    assert flat.surfaces[0].reason.startswith("144 cells of 10 mm on 12 x 12 are too few")


def test_regions_of_meshes_have_areas_in_square_metres(wall) -> None:
    _, flat = wall
    area = sorted(one.area_m2 for one in flat.surfaces[0].regions if one.kind is RegionKind.RELIEF)
    assert area == pytest.approx([0.0096, 0.0784], rel=0.05)


@pytest.mark.long
def test_larger_cells_on_request(wall) -> None:
    mesh, _ = wall
    flat = flatten_mesh(*mesh, FlatteningOptions(cell_m=0.02))
    assert flat.surfaces[0].cell_m == 0.02
    assert flatten_mesh(*mesh, FlatteningOptions(most_cells=1280)).surfaces[0].cell_m == pytest.approx(
        0.02, rel=0.02
    )


def test_crossings_are_found_and_held_back() -> None:
    """A post that stands a little above a sheet: the sheet must not be lifted through it."""
    sheet = np.stack(
        [*np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 5)), np.zeros((5, 5))], -1
    ).reshape(-1, 3)
    post = np.array([[0.55, 0.6, 0.1], [0.6, 0.6, 0.5], [0.5, 0.6, 0.5]])
    before = np.concatenate([sheet, post])
    faces = np.concatenate([faces_of((5, 5)), [[25, 26, 27]]]).astype(np.int32)
    after = before.copy()
    after[:25, 2] = 0.2
    crossing = new_crossings(before, after, faces, np.any(after != before, axis=1)[faces].any(axis=1))
    assert crossing[-1]
    assert crossing.sum() >= 2
    held, is_held = hold_back(before, after, faces)
    assert is_held.any()
    assert not is_held[25:].any()
    assert not new_crossings(before, held, faces, np.ones(len(faces), bool)).any()
    assert not new_crossings(before, before, faces, np.ones(len(faces), bool)).any()


def test_faces_that_would_turn_over_are_held_back() -> None:
    before = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    faces = np.array([[0, 1, 2], [1, 3, 2]], np.int32)
    after = before.copy()
    after[0] = (2.0, 2.0, 0)
    held, is_held = hold_back(before, after, faces)
    assert np.array_equal(held, before)
    assert is_held.tolist() == [True, False, False, False]


@pytest.mark.parametrize(
    ("labels", "text"),
    [
        (np.ones(7, int), "expected one label for each of 5120 vertices"),
        (np.full(5120, 2), "label 2 has no fit: there are 1"),
    ],
)
def test_bad_labels_are_named(wall, labels, text) -> None:
    (vertices, faces, _, fits), _ = wall
    with pytest.raises(InputError, match=text):
        flatten_mesh(vertices, faces, labels, fits)
