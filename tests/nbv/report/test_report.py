# SPDX-License-Identifier: MIT
"""Reports: names are escaped, nothing is loaded from elsewhere, pictures show what they say."""

import re
from dataclasses import replace

import numpy as np
import pytest

from nbv.coverage.coverage import MET, Coverage
from nbv.coverage.measurement import measure_coverage, visibility_history
from nbv.report.blocks.coverage_tables import outline_of
from nbv.report.blocks.page import Bar, BarShare, Cell, Gallery, Headline, Page, PageSection, Table, Text
from nbv.report.coverage_report import coverage_page
from nbv.report.figures import plots
from nbv.report.figures.drawing import MeshDrawing, passes_hidden
from nbv.report.figures.floor_plan import FloorPlan
from nbv.report.figures.picture import (
    aim,
    aside_cameras,
    hatch,
    overview_cameras,
    picture_of,
    range_colours,
    segment_pixels,
)
from nbv.report.figures.plots import coverage_curve
from nbv.report.figures.surface_values import fine_coverage, nearest_samples
from nbv.run.wording import percent
from nbv.scanning.scanner import scan_scene
from nbv.visibility.samples import sample_surface
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.scan.colour import surface_colour
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from scenes.scan.thumbnail import upright
from tests.helpers.room_examples import ROOM, VIEW

EVIL = "<script>alert('x')</script>"


@pytest.fixture(scope="module")
def scene():
    return ROOM


@pytest.fixture(scope="module")
def view():
    return VIEW


@pytest.fixture(scope="module")
def coverage(scene, view):
    return measure_coverage(scene, [view], samples=sample_surface(scene.mesh, 0.25))


def test_everything_that_comes_from_outside_is_escaped():
    table = Table(
        (EVIL, f"#{EVIL}"), ((Cell(EVIL, swatch=EVIL), Cell(EVIL, share=0.5, state="measured")),), EVIL
    )
    picture = picture_of(np.zeros((2, 2, 3)), EVIL, EVIL)
    page = Page(
        title=EVIL,
        kicker=EVIL,
        summary=EVIL,
        headlines=(Headline(EVIL, EVIL, EVIL, "measured"),),
        bar=Bar(EVIL, (BarShare(EVIL, "measured", 1.0, EVIL),)),
        sections=(PageSection(EVIL, (table, Text(EVIL), Gallery((picture,), 2))),),
        options={EVIL: EVIL},
        seed=0,
        warnings=(EVIL,),
    )
    html = page.to_html()
    assert EVIL not in html
    assert html.count("<script") == 1  # the page's own
    assert html.count("&lt;script&gt;") >= 12


def test_a_scene_with_evil_names_makes_a_harmless_report(scene, view, coverage):
    names = (EVIL, *scene.surface_names[1:])
    evil = replace(scene, name=EVIL, surface_names=names, warnings=(EVIL,))
    named = Coverage(
        coverage.samples, coverage.requirement, coverage.best_cosine, coverage.n_views, coverage.state,
        coverage.reason, names, coverage.n_faces,
    )  # fmt: skip
    seen = visibility_history(evil.ray_caster(1), coverage.samples, coverage.requirement, [view])
    arguments = ([view], seen, view.sensor, 1)
    page = replace(coverage_page(evil, named, *arguments), options={"plan": EVIL})
    html = page.to_html()
    assert EVIL not in html
    assert html.count("<script") == html.count("</script") == 2  # the page's own, and the 3-D view's data
    assert "&lt;script&gt;" in html
    again = replace(coverage_page(evil, named, *arguments), options={"plan": EVIL})
    assert html == again.to_html()
    assert set(re.findall(r'(?:src|srcset|href)="([^":]*):', html)) == {"data"}
    assert "http:" not in html
    assert "https:" not in html
    assert "url(" not in html


def test_percent_never_rounds_up_to_all():
    assert percent(0.9999) == ">99.9"
    assert percent(0.0001) == "<0.1"
    assert percent(1.0) == "100"


def floor_plan(scene, **more):
    return FloorPlan(outline=outline_of(scene), bounds=scene.mesh.bounds(), positions=np.eye(3), **more)


@pytest.mark.long
def test_plots_are_the_same_bytes_again_and_of_dark_pages_others(scene, monkeypatch):
    monkeypatch.setattr(plots, "_DARK", replace(plots.LIGHT, ink="#dfe6ea"))
    drawn = [
        (
            coverage_curve([0.2, 0.5, 0.6], 0.9, 0.99, 2, (2, 0.4, 0.7)),
            floor_plan(scene).plot(),
        )
        for _ in range(2)
    ]
    assert drawn[0] == drawn[1]
    assert drawn[0][0].light != drawn[0][0].dark


def test_the_floor_plan_cuts_walls_and_boxes(scene):
    outline = outline_of(scene)
    length = np.linalg.norm(outline[:, 1] - outline[:, 0], axis=1).sum()
    assert length == pytest.approx(2 * (6 + 5) + 4 * 0.7, abs=1e-6)  # the low box ends below the cut


def test_range_colours_leave_out_what_did_not_come_back():
    ranges = np.array([[1.0, 2.0], [np.inf, 3.0]])
    colours, low, high = range_colours(ranges)
    assert colours[..., 3].tolist() == [[1, 1], [0, 1]]
    assert 1 <= low < high <= 3
    assert range_colours(np.full((2, 2), np.inf))[0][..., 3].sum() == 0


def test_segments_have_the_colours_of_the_table():
    image = segment_pixels(np.array([[0, 1, 2]], np.int32), np.array([[True, True, False]]))
    red = int(surface_colour(1)[1:3], 16) / 255
    assert image[0, 1, 0] == pytest.approx(red)
    assert image[0, :, 3].tolist() == [1, 1, 0]
    assert surface_colour(0) == surface_colour(-1)


def test_hatch_is_half_transparent():
    assert 0 < hatch((40, 40)).min() < 0.4 < hatch((40, 40)).max() <= 1


def test_back_faces_are_looked_through():
    near = [[0, 0, 1], [0, 1, 1], [1, 0, 1]]  # seen from above from behind
    far = [[-5, -5, 0], [5, -5, 0], [0, 9, 0]]
    mesh = LabelledMesh(np.array([*near, *far], float), np.array([[0, 1, 2], [3, 4, 5]]))
    camera = aim(
        np.array([0.2, 0.2, 5.0]), np.array([0.2, 0.2, 0.0]), np.array([0.0, 1, 0]), np.full(2, 0.01),
        mirrored=False,
    )  # fmt: skip
    layer = MeshDrawing(mesh).look(camera, (3, 3))
    assert (layer.face == 1).all()
    assert np.allclose(layer.points[..., 2], 0)
    assert (MeshDrawing(mesh, -mesh.face_normals()).look(camera, (3, 3)).face == 0).all()


def test_overview_cameras_hold_the_whole_box(scene):
    bounds = scene.mesh.bounds()
    corners = np.array(np.meshgrid(*bounds.T)).reshape(3, -1).T
    for camera in overview_cameras(bounds):
        local = (corners - camera.origin) @ camera.axes.T
        assert (np.abs(local[:, :2] / local[:, 2:]) <= camera.slope).all()


def test_aside_cameras_look_at_what_was_scanned_and_keep_a_mirrored_image_mirrored(scene, view):
    scan = scan_scene(scene, view)
    for camera in aside_cameras(scan):
        assert np.linalg.norm(camera.origin - scan.origin) > 0.3
        assert np.linalg.det(camera.axes) == pytest.approx(1)
    projection = replace(scan.projection, fy=-scan.projection.fy)
    mirrored = replace(scan, projection=projection)
    assert np.linalg.det(aside_cameras(mirrored)[0].axes) == pytest.approx(-1)


def test_hidden_space_is_behind_what_was_measured(scene, view):
    scan = scan_scene(scene, view)
    inner = scene.mesh.bounds() + np.array([[0.1] * 3, [-0.1] * 3])
    from_scanner = aim(
        scan.origin, np.array([5.0, 4, 1]), np.array([0.0, 0, 1]), np.full(2, 0.3), mirrored=False
    )
    everywhere = np.ones((24, 24), dtype=bool)
    ahead = passes_hidden(from_scanner, everywhere, [scan], inner)
    aside = aside_cameras(scan)[0]
    assert passes_hidden(aside, everywhere, [scan], inner).any()
    assert 0 < ahead.mean() < 1  # behind the boxes, not where the walls were met
    assert not passes_hidden(aside, ~everywhere, [scan], inner).any()
    beside = passes_hidden(aside, everywhere, [scan], inner, beside_counts=True)
    assert beside.sum() > passes_hidden(aside, everywhere, [scan], inner).sum()


def test_fine_coverage_keeps_the_area_and_the_states(scene, coverage):
    fine = fine_coverage(scene.mesh, coverage)
    a, b, c = np.moveaxis(fine.corners, 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    assert area.sum() == pytest.approx(coverage.total_m2 + sum(coverage.apart_m2.values()))
    assert len(area) > 10 * len(scene.mesh.faces)
    assert area[fine.state == MET].sum() / area.sum() == pytest.approx(coverage.met, abs=0.03)
    assert (scene.mesh.face_surface[fine.face] == fine.surface).all()


def test_the_nearest_sample_is_one_of_the_same_face(coverage):
    samples = coverage.samples
    found = nearest_samples(samples, samples.points + 0.01, samples.face.astype(np.int64))
    assert (samples.face[found] == samples.face).all()
    assert len(nearest_samples(samples, np.zeros((0, 3)), np.zeros(0, np.int64))) == 0


def test_panoramas_are_drawn_upright_with_equal_angles_and_camera_images_as_they_are():
    height = np.broadcast_to(np.linspace(-1.0, 0.5, 30)[:, None], (30, 21))
    upwards = SphericalProjection(np.linspace(0.75, -0.75, 21), np.linspace(-1.0, 0.5, 30))
    drawn = upright(height, upwards, most=60)
    assert drawn.shape == (60, 60)
    assert drawn[0, 0] > drawn[-1, 0]
    sideways = np.broadcast_to(upwards.azimuths, (30, 21))
    assert upright(sideways, upwards, most=60)[0, 0] < upright(sideways, upwards, most=60)[0, -1]
    camera = PinholeProjection.from_fov(21, 30, 60)
    np.testing.assert_array_equal(upright(height, camera, most=60), height)
    assert upright(height, camera, most=10).shape == (10, 7)


def test_a_panorama_is_drawn_upright_however_its_rows_and_columns_run():
    """The scanner looks level, as one on a tripod does; some files list rows upwards."""
    elevations, azimuths = np.radians(np.linspace(-25, 25, 40)), np.radians(np.linspace(-30, 30, 50))
    for rows in (elevations, elevations[::-1]):
        for columns in (azimuths, azimuths[::-1]):
            projection = SphericalProjection(columns, rows)
            pose = Pose.looking_at((0.5, 0.5, 1.5), (5.0, 4.0, 1.2))
            ranges = np.full(projection.shape, 3.0)
            for camera in aside_cameras(RangeImage(ranges, projection, pose)):
                assert camera.axes[1] @ [0.0, 0.0, 1.0] < -0.8
                assert np.linalg.det(camera.axes) == pytest.approx(1)
