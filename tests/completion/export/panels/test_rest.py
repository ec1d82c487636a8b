# SPDX-License-Identifier: MIT
"""The rest: few triangles within what the scans tell, that bridge nothing and meet the panels in vertices."""

import numpy as np
import pytest

from completion.export.panels.model import PanelModel
from completion.export.panels.stitching import divide_triangles
from completion.export.panels.unexplained import PixelMesh, decimate, deviation, light_rest
from completion.export.panels.welding import edges_of, vertices_within_edges
from completion.options import CompletionOptions
from completion.pipeline import complete
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.mesh.triangle_distance import distances
from scenes.surfaces.catalogue import Plane
from tests.helpers.completion_examples import example
from tests.helpers.long_cases import first_in_gate

PLAIN = CompletionOptions(texture=False)
FLOOR = Plane(np.zeros(3), np.array([0.0, 0.0, 1.0]))


def flat(x, y):
    return 0 * x


def sheet(n=41, height=flat):
    """A square metre about the origin as a grid of triangles."""
    y, x = (np.mgrid[:n, :n] / (n - 1) - 0.5).reshape(2, -1)
    k = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([k, k + 1, k + n], 1), np.stack([k + 1, k + n + 1, k + n], 1)])
    return np.stack([x, y, height(x, y)], axis=1), faces


def bumpy(x, y):
    return 0.1 * np.sin(5 * x) * np.cos(4 * y)


@pytest.fixture(scope="module", params=["chair_before_wall", "pipe_rack"])
def done(request):
    return complete(example(request.param, pixels=160), PLAIN)


def test_a_flat_sheet_is_left_with_few_triangles_and_its_border():
    vertices, faces = sheet()
    places, few = decimate(vertices, faces, 1e-3)
    assert len(few) <= 3200 / 200
    assert triangle_areas(places[few]).sum() == pytest.approx(1.0, abs=4e-3)
    assert np.abs(places[:, 2]).max() < 1e-9


@pytest.mark.parametrize("bound_m", first_in_gate(1, [1e-3, 4e-3, 8e-3]))
def test_the_bound_holds_and_a_wider_one_needs_fewer(bound_m):
    whole = sheet(81, bumpy)
    few = decimate(*whole, bound_m)
    assert deviation(whole, few) <= bound_m
    assert np.quantile(distances(whole[0], few[0][few[1]]), 0.95) <= 1.05 * bound_m  # of some places
    assert len(few[1]) < 0.25 * len(whole[1])
    assert len(decimate(*whole, 2 * bound_m)[1]) < len(few[1])


def test_it_is_the_same_again_and_in_other_units():
    whole = sheet(41, bumpy)
    one, again, other = (
        decimate(*whole, 4e-3),
        decimate(*whole, 4e-3),
        decimate(1024 * whole[0], whole[1], 4.096),
    )
    assert one[0].tobytes() == again[0].tobytes()
    assert one[1].tobytes() == again[1].tobytes()
    assert other[1].tolist() == one[1].tolist()
    assert other[0] == pytest.approx(1024 * one[0], rel=1e-9)


def test_no_triangle_bridges_a_step():
    """Two sheets one bound apart, a third beside them half a metre behind: each stays by itself."""
    vertices, faces = sheet(31, bumpy)
    offsets = np.array([[0, 0, 0], [1.004, 0, 0], [1.004, 0, 0.5]])
    points = np.concatenate([vertices + offset for offset in offsets])
    places, few = decimate(points, np.concatenate([faces + k * len(vertices) for k in range(3)]), 4e-3)
    part = (places[:, 0] > 0.502).astype(int) + (places[:, 2] > 0.3)
    assert (part[few] == part[few[:, :1]]).all()
    assert triangle_areas(places[few]).sum() == pytest.approx(
        3 * triangle_areas(vertices[faces]).sum(), rel=0.02
    )


def test_a_hole_stays_a_hole():
    vertices, faces = sheet(61)
    radius = np.linalg.norm(vertices[faces].mean(axis=1), axis=1)
    _, few = kept = decimate(vertices, faces[radius > 0.2], 4e-3)
    assert np.linalg.norm(kept[0][few].mean(axis=1), axis=1).min() > 0.15
    area = triangle_areas(vertices[faces[radius > 0.2]]).sum()
    assert triangle_areas(kept[0][few]).sum() == pytest.approx(area, rel=0.02)


def test_without_a_bound_or_triangles_all_stays():
    whole = sheet(5, bumpy)
    assert decimate(*whole, 0.0)[1] is whole[1]
    none = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    assert len(decimate(*none, 1e-3)[1]) == 0
    assert deviation(whole, none) == np.inf


def test_triangles_are_divided_at_all_their_edges():
    faces, source = divide_triangles(
        np.array([[0, 1, 2], [2, 1, 3]]), {(0, 1): (0, 4, 1), (1, 2): (1, 5, 6, 2)}
    )
    assert np.bincount(source).tolist() == [4, 3]
    edges, count, _ = edges_of(faces)
    shared = {tuple(edge) for edge in edges[count == 2].tolist()}
    assert {(1, 5), (5, 6), (2, 6)} <= shared
    assert not {(0, 1), (1, 2)} & {tuple(edge) for edge in edges.tolist()}


def half_a_floor():
    """A panel x < 0, and pixels of it and of bumps at x > 0, the former a little over its border."""
    corners = np.array([[-0.5, -0.5, 0], [0, -0.5, 0], [0, 0.5, 0], [-0.5, 0.5, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    one, none = np.ones(2, np.int32), np.zeros(2, np.int8)
    panels = PanelModel(corners, faces, one, none, corners[faces][..., :2], (), (), {})
    vertices, pixels = sheet(41, lambda x, y: np.where(x > 0.03, 0.05 * np.cos(9 * y) + 0.02, 0.0))
    owner = (vertices[:, 0] < 0.03).astype(np.int64)
    kept = (owner[pixels] == 0).any(axis=1)
    return panels, PixelMesh(vertices, pixels[kept], owner, np.full(len(vertices), 4e-3))


def test_rim_and_border_have_the_same_vertices():
    panels, pixels = half_a_floor()
    model = light_rest(panels, pixels, [FLOOR], np.array([0.075]))
    assert (
        vertices_within_edges(model.vertices, np.concatenate([model.faces, model.remainder.faces]), 1e-4)
        == []
    )
    rest, of_panels = edges_of(model.remainder.faces), edges_of(model.faces)
    shared = {tuple(e) for e in rest[0][rest[1] == 1].tolist()} & {tuple(e) for e in of_panels[0].tolist()}
    ends = model.vertices[np.array(sorted(shared))]
    assert np.abs(ends[..., 0]).max() < 1e-9
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(1.0)  # the whole side
    assert triangle_areas(model.vertices[model.faces]).sum() == pytest.approx(0.5)
    assert model.vertices[model.faces][..., :2] == pytest.approx(model.corner_uv)
    assert (model.face_surface == 1).all()
    free = pixels.vertices[pixels.owner == 0]
    facets = model.vertices[np.concatenate([model.faces, model.remainder.faces])]
    assert np.quantile(distances(free, facets), 0.95) <= 4e-3


def test_what_lies_on_panels_is_not_told_twice():
    panels, pixels = half_a_floor()
    low = pixels.vertices * [1.0, 1.0, 0.05] - [0.6, 0.0, 0.0]  # by 3.5 mm at most above the panel
    on = PixelMesh(low, pixels.faces, pixels.owner, pixels.error_m)
    assert len(light_rest(panels, on, [FLOOR], np.array([0.075])).remainder.faces) < 50


def test_without_rest_nothing_is_added():
    panels, pixels = half_a_floor()
    none = PixelMesh(pixels.vertices, pixels.faces[:0], pixels.owner, pixels.error_m)
    model = light_rest(panels, none, [FLOOR], np.array([0.075]))
    assert model is panels
    assert len(model.remainder.faces) == len(model.remainder.vertex) == 0


def test_the_rest_of_a_scan_lies_within_its_error_with_the_panels(done):
    panels, rest, pixels = done.panels(), done.light_remainder, done.remainder
    free = pixels.points.surface == 0
    bound_m = np.median(pixels.error_m[free])
    faces = np.concatenate([panels.faces[panels.is_measured], panels.remainder.faces])
    off = distances(pixels.points.vertices[free], panels.vertices[faces])
    assert np.quantile(off, 0.95) <= bound_m
    assert len(rest.faces) < 0.6 * len(pixels.points.faces)
    assert (
        vertices_within_edges(panels.vertices, np.concatenate([panels.faces, panels.remainder.faces]), 1e-4)
        == []
    )


def test_its_vertices_have_what_is_known_of_the_nearest_points(done):
    rest, pixels, source = (
        done.light_remainder,
        done.remainder.points,
        done.panels().remainder.source,
    )
    apart = np.linalg.norm(rest.vertices[:, None] - pixels.vertices[None], axis=2)
    assert apart[np.arange(len(source)), source] == pytest.approx(apart.min(axis=1))
    assert rest.sd.tolist() == pixels.sd[source].tolist()
    assert rest.colour.tolist() == pixels.colour[source].tolist()
    assert (rest.provenance == 0).all()
    assert rest.faces.max() == len(rest.vertices) - 1
