# SPDX-License-Identifier: MIT
import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

import completion
from benchmarks.metrics.free_space import violation_of
from completion import (
    Completion,
    CompletionOptions,
    EvidenceOptions,
    Provenance,
    SegmentationOptions,
    TexturingOptions,
    complete,
    pipeline,
)
from completion.merging import scan_surfaces
from completion.merging.scan_surfaces import SurfaceOptions
from completion.observe.tolerance import FLATNESS_M, Tolerance
from completion.result import labelled_points as observed_points
from completion.result.labelled_points import mesh_area
from completion.result.meshes import display_mesh, model_parts
from completion.result.record import completion_record
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.checks import InputError
from scenes.io.meshes.glb_writer import glb_of
from scenes.io.meshes.ply import read_mesh_ply
from scenes.pose import Pose
from scenes.run import mapping
from scenes.run import mapping as spill
from scenes.run.atomic import json_text
from scenes.scan import pixels
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, surfaces_close
from tests.helpers.completion_examples import PLAIN, VIEWS, completed, distance_to_truth, example, scene
from tests.helpers.long_cases import first_in_gate


@pytest.fixture(scope="module")
def chair() -> Completion:
    return completed("chair_before_wall", options=CompletionOptions())


@pytest.mark.parametrize("name", first_in_gate(3, list(VIEWS)))
def test_inferred_area_lies_on_true_surfaces_and_never_in_free_space(name):
    found = completed(name)
    assert found.hypothesised_m2 > 0.1
    assert found.free_space_violation_m2 == 0
    points = found.world_from_reference.apply(found.hypothesised.vertices)
    near = distance_to_truth(scene(name), points) < 0.002
    assert near.mean() > 0.98


@pytest.mark.parametrize("seed", first_in_gate(2, range(6)))
def test_no_hypothesis_in_free_space_from_anywhere(seed):
    """The law of the method: from random places in the room an audit of its own finds nothing."""
    rng = np.random.default_rng(seed)
    eye = [rng.uniform(0.3, 5.7), rng.uniform(0.3, 1.2), rng.uniform(0.3, 2.4)]
    view = Pose.looking_at(eye, [rng.uniform(1, 5), rng.uniform(2, 4), rng.uniform(0, 1.5)])
    sensor = PinholeSensor(fov_deg=70, width=160, height=120)
    scan, bold = (
        scan_scene(scene("two_occluders"), view, sensor),
        CompletionOptions(texture=False, mode="bold"),
    )
    found = complete(scan, bold, rng=0)
    assert found.hypothesised_m2 > 1
    assert found.free_space_violation_m2 == 0
    assert violation_of(found, [scan], bold, 1).n_faces == 0


@pytest.mark.long
def test_noise_costs_little_free_space():
    found = completed("two_occluders", "gaussian-2mm")
    assert found.hypothesised_m2 > 5
    assert found.free_space_violation_m2 < 50e-6 * found.hypothesised_m2


def test_wall_behind_the_chair_is_filled(chair):
    """Hidden part of the wall and floor, measured on the true scene: at least 95 % of it is inferred."""
    view = VIEWS["chair_before_wall"]
    caster = scene("chair_before_wall").ray_caster()
    y, z = np.meshgrid(np.linspace(-1.4, 1.4, 141), np.linspace(0.02, 2.1, 105))
    wall = np.column_stack([y.ravel(), np.full(y.size, 1.2), z.ravel()])
    inside = np.isfinite(example("chair_before_wall").projection.pixels(view.inverse().apply(wall))).all(
        axis=1
    )
    hidden = wall[inside & caster.are_blocked(view.translation[None], wall + [0, -1e-4, 0])]
    vertices = chair.world_from_reference.apply(chair.hypothesised.vertices)
    distance, _ = cKDTree(vertices).query(hidden)
    assert len(hidden) > 300
    assert np.mean(distance < 0.02) > 0.95


def test_cylinders_are_closed_around_the_back_and_through_the_board():
    found = complete(example("two_cylinders", pixels=320), PLAIN)
    cylinders = [patch for patch in found.patches if isinstance(patch.grid.surface, Cylinder)]
    assert len(cylinders) == 2
    for patch in cylinders:
        full = patch.grid.surface.period * 1.8
        assert patch.limits.full_turn
        assert patch.observed_m2 + patch.hypothesised_m2 > 0.93 * full
        kinds = set(np.unique(patch.provenance))
        assert {Provenance.FULL_TURN, Provenance.BETWEEN} <= kinds


def test_moving_the_world_changes_nothing_but_coordinates():
    motion = Pose.looking_at((50, -20, 7), (3, 4, 6))
    here = completed("two_cylinders")
    there = complete(example("two_cylinders").transform(motion), PLAIN)
    assert there.hypothesised_m2 == pytest.approx(here.hypothesised_m2, rel=1e-3)
    for one, other in zip(here.patches, there.patches, strict=True):
        assert surfaces_close(one.grid.surface, other.grid.surface, angle=1e-8, length=1e-8)
        assert one.observed_m2 == pytest.approx(other.observed_m2, rel=1e-3)


@pytest.mark.long
def test_bolder_modes_infer_more():
    area = {}
    for mode in ("conservative", "standard", "bold"):
        found = completed("two_occluders", pixels=120, options=CompletionOptions(texture=False, mode=mode))
        area[mode] = found.hypothesised_m2
        assert found.free_space_violation_m2 == 0
    assert area["conservative"] < area["standard"] <= area["bold"] * 1.005  # cells differ in size


def test_a_second_scan_turns_inferred_into_measured():
    sensor = PinholeSensor(fov_deg=65, width=200, height=200)
    truth = scene("chair_before_wall")
    other = scan_scene(truth, Pose.looking_at((-1.2, -1.6, 1.4), (0.1, 0.9, 0.6)), sensor)
    one = completed("chair_before_wall")
    both = complete([example("chair_before_wall"), other], PLAIN)
    assert both.free_space_violation_m2 == 0
    assert both.hypothesised_m2 < 0.5 * one.hypothesised_m2
    points = both.world_from_reference.apply(both.hypothesised.vertices)
    assert np.mean(distance_to_truth(truth, points) < 0.002) > 0.98


def test_same_seed_same_bytes_on_one_and_two_threads(tmp_path):
    scan = example("textured_cylinder", pixels=120)
    for n_threads in (1, 2):
        complete(scan, rng=7, n_threads=n_threads).save(tmp_path / str(n_threads))
    for name in ("completed.glb", "observed.ply", "hypothesised.ply", "completion.json"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes(), name


def test_texture_comes_from_the_surface_itself(chair):
    """Mean and most texels are those of the surface, whose mean is far from that of every other one."""
    textures = [
        texture
        for patch, texture in zip(chair.patches, chair.textures, strict=True)
        if patch.hypothesised_m2 > 0.05
    ]
    measured, made = (
        [texture.image[getattr(texture, part)].astype(int) for texture in textures]
        for part in ("measured", "synthesised")
    )
    assert len(textures) == 2  # wall and floor
    assert np.abs(measured[0].mean(axis=0) - measured[1].mean(axis=0)).max() > 0.15 * 255
    for own, copied in zip(measured, made, strict=True):
        assert len(copied) > 400
        np.testing.assert_allclose(copied.mean(axis=0), own.mean(axis=0), atol=0.02 * 255)
        assert np.isin(copied @ [1, 256, 65536], own @ [1, 256, 65536]).mean() > 0.7


def test_scans_without_colour_are_left_grey():
    scan = example("chair_before_wall")
    bare = RangeImage(scan.ranges, scan.projection, scan.world_from_sensor, sigma_m=0.0)
    found = complete(bare)
    assert set(found.textures) == {None}
    assert len(glb_of(model_parts(found))) > 1000


def test_files_say_what_is_inferred(chair, tmp_path):
    chair.save(tmp_path)
    model = trimesh.load(tmp_path / "completed.glb")
    states = {name.split()[0] for name in model.graph.nodes_geometry}
    assert states == {"observed", "hypothesised"}
    low, high = model.bounds  # y is up in glTF
    assert high[1] - low[1] == pytest.approx(2.2, abs=0.2)
    inferred = read_mesh_ply(tmp_path / "hypothesised.ply")
    assert (inferred.vertex_properties["provenance"] > 0).all()
    assert set(inferred.vertex_properties["surface"]) <= set(range(1, len(chair.patches) + 1))
    assert (inferred.vertex_properties["sd"] >= 0).all()
    measured = read_mesh_ply(tmp_path / "observed.ply")
    assert (measured.vertex_properties["provenance"] == 0).all()
    assert len(measured.vertices) == example("chair_before_wall").valid.sum()
    record = json.loads((tmp_path / "completion.json").read_text())
    assert record == json.loads(json_text(completion_record(chair)))
    assert record["mode"] == "standard"
    for surface in record["surfaces"]:
        assert {
            "id",
            "kind",
            "parameters",
            "standard_deviation",
            "observed_m2",
            "hypothesised_m2",
        } <= surface.keys()
        for segment in surface["boundary"]:
            assert {"kind", "provenance", "confidence", "points"} <= segment.keys()


def test_pictures_can_leave_out_or_mark_what_is_inferred(chair):
    without, with_it = display_mesh(chair, hypothesised=False), display_mesh(chair)
    assert (without.face_surface == 0).all()
    shown, told = with_it.face_areas().sum() - without.face_areas().sum(), chair.hypothesised_m2
    assert shown == pytest.approx(told, rel=0.1)  # facets have straight borders, cells have stairs
    marked = display_mesh(chair, mark=True)
    assert (with_it.appearance.face_image[with_it.face_surface == 1] >= 0).all()
    assert (marked.appearance.face_image[marked.face_surface == 1] == -1).all()


def test_openings_are_found_and_outlines_closed():
    camera = PinholeProjection.from_fov(160, 120, 60)
    depth = np.full(camera.shape, 3.0)
    depth[40:70, 60:100] = 5.0  # a window
    scan = RangeImage(depth / camera.directions()[..., 2], camera, Pose.identity(), sigma_m=0.0)
    (wall,) = complete(scan, PLAIN).surfaces[:1]
    (opening,) = wall.openings
    pixel = 3.0 / camera.fx
    assert opening.area_m2 == pytest.approx(30 * 40 * pixel**2, rel=0.1)
    outline = wall.boundary
    assert {segment.kind for segment in outline} >= {"edge", "frame"}
    assert all(segment.provenance == "measured" for segment in outline)


@pytest.mark.parametrize("shape", [(1, 1), (20, 30)])
def test_empty_scans_give_empty_completions(shape, tmp_path):
    camera = PinholeProjection(shape[1], shape[0], 50, 50, 0, 0)
    found = complete(RangeImage(np.full(shape, np.inf), camera, Pose.identity()))
    assert found.patches == ()
    assert found.hypothesised_m2 == found.observed_m2 == found.free_space_violation_m2 == 0
    found.save(tmp_path)
    assert json.loads((tmp_path / "completion.json").read_text())["surfaces"] == []
    assert not trimesh.load_scene(tmp_path / "completed.glb").geometry


def test_options_change_the_result():
    scan = example("two_occluders", "gaussian-2mm", pixels=96)
    base = completed("two_occluders", "gaussian-2mm", pixels=96)
    for options in (
        CompletionOptions(texture=False, sigma_m=0.02),
        CompletionOptions(texture=False, cues=()),
        CompletionOptions(texture=False, max_sd_m=1e-6),
        CompletionOptions(texture=False, evidence=EvidenceOptions(n_sigma=1.0)),
        CompletionOptions(texture=False, evidence=EvidenceOptions(registration_m=0.05)),
        CompletionOptions(texture=False, evidence=EvidenceOptions(flatness_m=0.02)),
    ):
        assert complete(scan, options).hypothesised_m2 != base.hypothesised_m2
    coarse = CompletionOptions(texturing=TexturingOptions(max_texels=500, window=5, max_samples=500))
    sizes = [texture.grid.shape for texture in complete(scan, coarse).textures]
    assert 250 < max(rows * columns for rows, columns in sizes) <= 500


def test_registration_and_flatness_have_one_home_and_the_stage_may_say_otherwise():
    several, one = SurfaceOptions(registration_m=0.02), SurfaceOptions().tolerance(1)
    assert several.tolerance(2).registration_m == 0.02
    assert one.registration_m == 0.0
    own = SurfaceOptions(registration_m=0.02, evidence=EvidenceOptions(registration_m=0.001))
    assert own.tolerance(2).registration_m == own.tolerance(1).registration_m == 0.001
    rough = SegmentationOptions(flatness_m=0.01)
    assert SurfaceOptions(segmentation=rough).tolerance(1).flatness_m == 0.01
    apart = SurfaceOptions(segmentation=rough, evidence=EvidenceOptions(flatness_m=0.002))
    assert apart.tolerance(1).flatness_m == 0.002
    assert one.flatness_m == SegmentationOptions().least_flatness_m == FLATNESS_M


def test_what_is_said_of_registration_and_flatness_reaches_merging_evidence_and_audit(monkeypatch):
    held = []
    for module, stage in (
        (scan_surfaces, "merge"),
        (scan_surfaces, "Scans"),
        (pipeline, "find_boundary_pixels"),
        (pipeline, "audit"),
    ):
        work = getattr(module, stage)

        def noted(*given, _work=work, **named):
            held.extend(one for one in (*given, *named.values()) if isinstance(one, Tolerance))
            return _work(*given, **named)

        monkeypatch.setattr(module, stage, noted)
    scan = example("textured_cylinder", pixels=60)
    options = CompletionOptions(
        texture=False,
        segmentation=SegmentationOptions(flatness_m=0.003),
        evidence=EvidenceOptions(registration_m=0.02),
    )
    complete([scan, scan], options)
    assert len(held) >= 4
    assert {(one.registration_m, one.flatness_m) for one in held} == {(0.02, 0.003)}


def test_progress_is_told_stage_by_stage():
    told = []
    complete(example("chair_before_wall", pixels=64), PLAIN, progress=lambda *step: told.append(step))
    assert [stage for stage, done, total in told if done == total] == [
        "noise and normals", "segment", "features", "extend", "audit",
    ]  # fmt: skip


def test_bad_arguments_are_refused():
    with pytest.raises(InputError, match="give at least one scan"):
        complete([])
    with pytest.raises(InputError, match="mode must be conservative, standard or bold, got 'brave'"):
        complete(example("chair_before_wall"), CompletionOptions(mode="brave"))


@pytest.mark.parametrize("cues", [("merging", "colinear"), "merging"])
def test_cues_that_there_are_not_are_refused(cues):
    with pytest.raises(InputError, match=r"cues must be some of merging, relations, intersection, .*, got '"):
        CompletionOptions(cues=cues)


def test_the_face_is_complete():
    assert sorted(completion.__all__) == completion.__all__
    assert all(hasattr(completion, name) for name in completion.__all__)


@pytest.mark.parametrize(
    ("options", "field", "bad"),
    [
        (CompletionOptions, "sigma_m", np.nan),
        (CompletionOptions, "sigma_m", -1.0),
        (CompletionOptions, "registration_m", np.inf),
        (CompletionOptions, "max_sd_m", -0.02),
        (SegmentationOptions, "min_pixels", 2),
        (SegmentationOptions, "max_angle_deg", 100.0),
        (CompletionOptions, "min_area_m2", np.nan),
        (SegmentationOptions, "flatness_m", -0.001),
        (EvidenceOptions, "flatness_m", np.nan),
        (TexturingOptions, "max_texels", 0),
    ],
)
def test_options_that_cannot_be_meant_are_refused_by_name(options, field, bad) -> None:
    with pytest.raises(InputError, match=f"{field} must be .* or more, got|{field} must be between .* got"):
        options(**{field: bad})


@pytest.mark.long
def test_of_many_points_observed_holds_every_other_row_and_column(chair, tmp_path, monkeypatch):
    chair.save(tmp_path / "all")
    monkeypatch.setattr(
        observed_points, "_MOST_POINTS", len(read_mesh_ply(tmp_path / "all/observed.ply").vertices) / 3
    )
    few = replace(chair)  # nothing derived yet
    few.save(tmp_path / "few")
    few.save(tmp_path / "full", observed="full")
    steps = {
        name: json.loads((tmp_path / name / "completion.json").read_text())["observed_step"]
        for name in ("all", "few", "full")
    }
    assert steps == {"all": 1, "few": 2, "full": 1}
    for file in (tmp_path / "all").iterdir():
        same = (tmp_path / "few" / file.name).read_bytes() == file.read_bytes()
        assert same == (file.name not in ("observed.ply", "completion.json")), file.name
        assert (tmp_path / "full" / file.name).read_bytes() == file.read_bytes()
    scan, thin = example("chair_before_wall"), read_mesh_ply(tmp_path / "few/observed.ply")
    np.testing.assert_allclose(thin.vertices, scan.points()[::2, ::2][scan.valid[::2, ::2]], atol=1e-5)
    assert thin.faces.max() < len(thin.vertices)
    area = [
        mesh_area(part.vertices, part.faces) for part in (thin, read_mesh_ply(tmp_path / "all/observed.ply"))
    ]
    assert area[0] == pytest.approx(area[1], rel=0.1)
    with pytest.raises(InputError, match="observed is 'half'; known: auto, full"):
        few.save(tmp_path / "none", observed="half")


@pytest.mark.long
def test_on_disk_and_in_memory_come_to_the_same_files(tmp_path, monkeypatch):
    scans = [example("chair_before_wall", "gaussian-2mm", side) for side in (100, 90)]
    options = CompletionOptions(registration_m=0.001)
    complete(scans, options, rng=0).save(tmp_path / "memory")
    monkeypatch.setattr(spill, "IN_MEMORY", 0)
    for module in (mapping, pixels):
        monkeypatch.setattr(module, "LARGE", 1_000)
    monkeypatch.setattr(mapping, "_PAUSE_S", 0.0)
    monkeypatch.setattr(mapping, "_RESIDENT", -(10**12))  # memory is given back whenever somebody asks
    mapped = [replace(scan, ranges=scan.ranges.copy()) for scan in scans]
    assert all(mapping.is_mapped(scan.ranges) for scan in mapped)
    found = complete(mapped, options, rng=0)
    assert mapping.is_mapped(found.patches[0].confidence)
    found.save(tmp_path / "disk")
    for file in (tmp_path / "memory").iterdir():
        assert file.read_bytes() == (tmp_path / "disk" / file.name).read_bytes(), file.name
