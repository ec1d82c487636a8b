# SPDX-License-Identifier: MIT
"""Back sides of things whose symmetries and volumes are known in closed form."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cases.houses.solids import box, lathe
from completion.backs.options import BackOptions
from completion.backs.pipeline import find_back
from completion.backs.views import Setting, ThingView, prepare_sight, scale_of
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor
from scenes import InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.world.scene import Scene
from tests.completion.backs.things import setting_of, view_of

BOX = box((-0.3, -0.2, 0), (0.3, 0.2, 0.5))
BOX_SIZE = float(np.linalg.norm([0.6, 0.4, 0.5]))
CYLINDER = lathe([(0, 0), (0.2, 0), (0.2, 0.5), (0, 0.5)], 96)
VESSEL_PROFILE = np.array([(0, 0), (0.1, 0), (0.2, 0.2), (0.08, 0.4), (0.1, 0.45), (0, 0.45)])
VESSEL = lathe(VESSEL_PROFILE, 96)
CHIRAL = np.concatenate(
    [
        box((-0.3, -0.2, 0), (0.3, 0.0, 0.1)),
        box((0.05, -0.1, 0.1), (0.3, 0.3, 0.25)),
        box((-0.25, -0.15, 0.1), (-0.15, -0.05, 0.5)),
    ]
)


@pytest.fixture(scope="module")
def of_box():
    view = view_of(BOX)
    return view, find_back([view], setting_of(view))


@pytest.fixture(scope="module")
def of_cylinder():
    view = view_of(CYLINDER)
    return view, find_back([view], setting_of(view))


def off_box(points, half=(0.3, 0.2, 0.25), middle=(0, 0, 0.25)):
    """Distance (n,) of points from the surface of a box."""
    q = np.abs(points - np.array(middle)) - np.array(half)
    return np.abs(np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0))


def test_both_mirrors_of_a_box_are_found_and_asserted(of_box) -> None:
    _, back = of_box
    mirrors = [one for one in back.sure if one.kind == "mirror"]
    assert len(mirrors) == 2
    for one in mirrors:
        assert np.abs(one.normal[:2]).max() > np.cos(np.radians(0.3))
        assert abs(one.offset_m) < 0.005 * BOX_SIZE
    assert abs(mirrors[0].normal @ mirrors[1].normal) < 0.01


def test_what_is_asserted_of_a_box_is_its_back(of_box) -> None:
    view, back = of_box
    away = off_box(back.asserted.points)
    assert np.mean(away < 0.01 * BOX_SIZE) > 0.98
    hidden = back.asserted.points @ view.scan.origin < 0
    assert hidden.mean() > 0.5
    assert set(np.unique(back.asserted.origin)) == {1}


def test_the_closed_box_has_the_volume_of_the_box(of_box) -> None:
    _, back = of_box
    assert back.volume.closed == pytest.approx(0.6 * 0.4 * 0.5, rel=0.05)
    assert back.volume.least <= 0.12 <= back.volume.most
    assert back.volume.certain_most > 0.12


def test_a_closed_mesh_is_watertight_and_turned_outwards(of_box, of_cylinder) -> None:
    for _, back in (of_box, of_cylinder):
        faces = back.shape.faces
        edges = Counter(
            map(tuple, np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).tolist())
        )
        assert set(edges.values()) == {1}
        assert all((b, a) in edges for a, b in edges)
        assert back.shape.volume_m3 > 0
        assert len(back.shape.origin) == len(back.shape.probability) == len(faces)


def test_faces_have_the_probability_of_their_symmetry(of_box, of_cylinder) -> None:
    for _, back in (of_box, of_cylinder):
        origin, likely = back.shape.origin, back.shape.probability
        assert (likely[origin == 0] == 1).all()
        assert (likely[origin >= 3] == 0).all()
        p = [one.probability for one in back.chosen]
        assert set(np.unique(likely[np.isin(origin, [1, 2])])) <= {*p, float(np.prod(p))}


def test_the_axis_of_a_cylinder_is_asserted(of_cylinder) -> None:
    _, back = of_cylinder
    (axis,) = back.sure
    assert axis.kind == "axis"
    assert np.linalg.norm(axis.axis[:2]) < 0.005 * back.size_m
    radius = np.linalg.norm(back.asserted.points[:, :2], axis=1)
    side = back.asserted.points[:, 2] < 0.48
    assert np.mean(np.abs(radius[side] - 0.2) < 0.01 * back.size_m) > 0.97
    assert back.volume.closed == pytest.approx(np.pi * 0.04 * 0.5, rel=0.05)
    assert set(np.unique(back.asserted.origin)) == {2}


def test_a_vessel_takes_up_its_solid_of_revolution() -> None:
    view = view_of(VESSEL)
    back = find_back([view], setting_of(view))
    r, z = VESSEL_PROFILE.T
    volume = np.pi / 3 * np.sum(np.diff(z) * (r[1:] ** 2 + r[1:] * r[:-1] + r[:-1] ** 2))
    assert [one.kind for one in back.sure] == ["axis"]
    assert back.volume.closed == pytest.approx(volume, rel=0.06)


@pytest.mark.parametrize("azimuth", [0.3, 1.9, 3.4, 5.2])
def test_nothing_is_asserted_of_a_thing_without_symmetry(azimuth) -> None:
    view = view_of(CHIRAL, azimuth)
    back = find_back([view], setting_of(view))
    assert back.sure == ()
    assert len(back.asserted.points) == 0
    assert not (np.isin(back.shape.origin, [1, 2]) & (not back.chosen)).any()


@pytest.mark.parametrize("covered", [0.15, 0.3, 0.4])
def test_a_covered_box_is_refused_or_right(covered) -> None:
    view = view_of(BOX, covered=covered)
    back = find_back([view], setting_of(view))
    for one in back.sure:
        assert np.abs(one.normal[:2]).max() > np.cos(np.radians(1.0))
        assert abs(one.offset_m) < 0.01 * BOX_SIZE
    if len(back.asserted.points):
        assert np.mean(off_box(back.asserted.points) < 0.02 * BOX_SIZE) > 0.95


def test_beams_refute_what_is_asserted(of_box, of_cylinder) -> None:
    for view, back in (of_box, of_cylinder):
        pixel = view.scan.pixels(back.asserted.points)
        seen = np.isfinite(pixel).all(axis=1)
        row, column = np.rint(pixel[seen]).astype(int).T
        away = np.linalg.norm(back.asserted.points[seen] - view.scan.origin, axis=1)
        assert (view.scan.ranges[row, column] - away).max() <= 0.0151 * back.size_m


def test_more_views_replace_inferred_by_measured_surface(of_box) -> None:
    view, one = of_box
    behind = view_of(BOX, 0.6 + np.pi, seed=1)
    two = find_back([view, behind], setting_of(view))
    assert len(two.asserted.points) < 0.2 * len(one.asserted.points)
    measured = [np.mean(back.shape.origin == 0) for back in (one, two)]
    assert measured[1] > measured[0] + 0.1
    assert two.volume.closed == pytest.approx(0.12, rel=0.04)


def test_the_same_seed_gives_the_same_bytes(of_box) -> None:
    view, back = of_box
    again = find_back([view], setting_of(view))
    assert again.asserted.points.tobytes() == back.asserted.points.tobytes()
    assert again.shape.vertices.tobytes() == back.shape.vertices.tobytes()
    assert [one.probability for one in again.hypotheses] == [one.probability for one in back.hypotheses]


def test_a_turned_world_turns_the_result(of_box) -> None:
    view, back = of_box
    turn = Pose.from_parts(np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]), np.array([1.0, 2.0, 0.0]))
    moved = ThingView(view.scan.transform(turn), view.of_thing)
    other = find_back([moved], setting_of(view))
    assert other.volume.closed == pytest.approx(back.volume.closed, rel=0.04)
    assert len(other.sure) == len(back.sure)


def test_a_panoramic_scanner_sees_the_same_box() -> None:
    floor = box((-20, -20, -1), (20, 20, 0))
    every = np.concatenate([BOX, floor])
    surface = np.repeat(np.arange(2, dtype=np.int32), [len(BOX), len(floor)])
    mesh = LabelledMesh(
        every.reshape(-1, 3), np.arange(3 * len(every), dtype=np.int32).reshape(-1, 3), surface
    )
    scene = Scene(mesh, (None,) * 2, ("thing", "floor"), "x", "object")
    sensor = SphericalSensor(
        azimuth_span_deg=360, elevation_min_deg=-80, elevation_max_deg=40, width=1800, height=600
    )
    pose = Pose.looking_at((1.6, 1.1, 1.2), (0, 0, 1.2))
    scan = scan_scene(scene, pose, sensor)
    noisy = scan.ranges + 1e-3 * np.random.default_rng(0).normal(size=scan.shape)
    view = ThingView(replace(scan, ranges=noisy, sigma_m=1e-3, truth=None), scan.truth.surface == 0)
    back = find_back([view], Setting(0.0, 1e-3))
    assert len(back.sure) == 2
    assert back.volume.closed == pytest.approx(0.12, rel=0.06)


def test_a_front_alone_is_as_deep_as_to_the_wall() -> None:
    cupboard = box((-0.4, -0.25, 0), (0.4, 0.25, 1.8))
    wall = box((-20, 0.3, 0), (20, 0.4, 20))
    view = view_of(np.concatenate([cupboard]), -np.pi / 2, 0.0)
    setting = setting_of(view, [0.0, -1.0, 0.0, -0.3])
    depth = find_back([view], setting).extents.depth
    assert len(wall)
    assert depth.why == "front alone, wall behind"
    assert depth.least < 0.05
    assert depth.most == pytest.approx(0.55, abs=0.01)


def test_a_seen_side_gives_the_depth() -> None:
    view = view_of(box((-0.4, -0.25, 0), (0.4, 0.25, 1.2)), -1.0, 0.35)
    depth = find_back([view], setting_of(view, [0.0, -1.0, 0.0, -0.5])).extents.depth
    assert depth.least <= 0.5 <= depth.most
    assert depth.most - depth.least < 0.1


def test_a_normal_of_a_flat_face_is_that_face_s(of_box) -> None:
    view, _ = of_box
    sight = prepare_sight(view, scale_of([view], setting_of(view)))
    top = (
        sight.thing
        & (sight.points[:, 2] > 0.495)
        & (np.abs(sight.points[:, 0]) < 0.2)
        & (np.abs(sight.points[:, 1]) < 0.1)
    )
    assert np.median(sight.normals[top, 2]) > np.cos(np.radians(6))


def test_least_changes_what_is_asserted(of_box) -> None:
    view, back = of_box
    none = find_back([view], setting_of(view), BackOptions(least=0.9999))
    assert len(none.asserted.points) < len(back.asserted.points)
    assert none.volume.closed == back.volume.closed


def test_wrong_input_is_refused(of_box) -> None:
    view, _ = of_box
    with pytest.raises(InputError, match="no views"):
        find_back([], setting_of(view))
    with pytest.raises(InputError, match=r"not within 1\.\.2 m"):
        find_back([view], setting_of(view), BackOptions(size_m=(1.0, 2.0)))
    with pytest.raises(InputError, match="of_thing has shape"):
        ThingView(view.scan, view.of_thing[1:])
    with pytest.raises(InputError, match="no pixel of the thing"):
        ThingView(view.scan, np.zeros_like(view.of_thing))
    with pytest.raises(InputError, match="walls must be finite"):
        Setting(0.0, 0.001, np.zeros((2, 3)))
    with pytest.raises(InputError, match="support_m and sigma_m"):
        Setting(np.nan, 0.001)
    with pytest.raises(InputError, match="least must lie"):
        BackOptions(least=0.3)
    with pytest.raises(InputError, match="size_m must be"):
        BackOptions(size_m=(2.0, 1.0))


def test_the_image_s_border_is_no_end(of_box) -> None:
    view, _ = of_box
    columns = np.flatnonzero(view.of_thing.any(axis=0))
    first = int(columns[0] + 0.3 * len(columns))
    camera = view.scan.projection
    part = replace(
        view.scan,
        ranges=view.scan.ranges[:, first:],
        projection=replace(camera, width=camera.width - first, cx=camera.cx - first),
        colour=None,
    )
    cut = ThingView(part, view.of_thing[:, first:])
    assert cut.is_cut_by_image
    assert not view.is_cut_by_image
    sight = prepare_sight(cut, scale_of([cut], setting_of(view)))
    assert sight.cut.any()
    assert not prepare_sight(view, scale_of([view], setting_of(view))).cut.any()
    back = find_back([cut], setting_of(view))
    for one in back.sure:
        assert abs(one.offset_m) < 0.01 * BOX_SIZE
    assert back.volume.certain_most is None
