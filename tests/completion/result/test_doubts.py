# SPDX-License-Identifier: MIT
"""What a reader should know before trusting a completion is told on stderr, in record and report."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from completion import CompletionOptions, SegmentationOptions, complete
from completion.merging.pieces import UnconfirmedRegions
from completion.observe.observation import PixelSet
from completion.result.record import completion_record
from nbv.cli import app
from nbv.report.completion_report import pose_sections
from scenes.inclination import Up
from scenes.io.scan_files import write_scan
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from tests.helpers.crate_scans import misplaced, scan
from tests.helpers.lidar_sweeps import ranges_to

CAMERA = PinholeProjection.from_fov(120, 90, 60)


def wall(stray_m: float, sigma_m: float) -> RangeImage:
    depth = 2.0 + np.random.default_rng(0).normal(0, stray_m, CAMERA.shape)
    return RangeImage(depth / CAMERA.directions()[..., 2], CAMERA, Pose.identity(), sigma_m=sigma_m)


def street(high_m, ceiling_m=None):
    """A panorama between walls on all sides or on one alone, `high_m` high, with a car on the ground."""
    walls = [[-9.0, 6.0, -1.7, 9.0, 6.5, high_m]]
    if ceiling_m is not None:
        walls += [[-9.0, -6.5, -1.7, 9.0, -6.0, high_m], [-9.5, -6.5, -1.7, -9.0, 6.5, high_m]]
        walls += [[9.0, -6.5, -1.7, 9.5, 6.5, high_m], [-9.5, -6.5, ceiling_m, 9.5, 6.5, ceiling_m + 0.2]]
    grid = SphericalProjection.regular(240, 80, 360.0, (-50.0, 60.0))
    pose = Pose.looking_at((0, 0, 0), (1, 0, 0))
    rays = pose.rotate(grid.directions()).reshape(-1, 3)
    car = [3.0, -2.0, -1.7, 5.0, 2.0, -0.9]
    ranges = ranges_to(np.zeros_like(rays), rays, np.array([*walls, car]))
    ranges = np.where(ranges < 25.0, ranges, np.inf) + np.random.default_rng(0).normal(0, 0.002, len(rays))
    return RangeImage(ranges.reshape(grid.shape), grid, pose, sigma_m=0.002)


@pytest.mark.parametrize(
    ("given", "is_told"), [((4.0,), True), ((1.0,), True), ((8.0,), True), ((2.5, 2.5), False)]
)
def test_ground_behind_things_outdoors_is_told_and_a_floor_is_not(given, is_told):
    completion = complete(street(*given), CompletionOptions(texture=False, up=Up.along("z")), rng=0)
    said = [text for text in completion.warnings if "outdoors ground is seldom level" in text]
    assert len(said) == is_told
    if is_told:
        ground, _, inferred = said[0].split(" m2")[0].split()
        assert 1 <= float(ground) <= float(inferred)
        assert float(inferred) == pytest.approx(completion.hypothesised_m2, abs=1 + 0.05 * float(inferred))


@pytest.mark.parametrize(("stray", "sigma", "told"), [(0.02, 0.002, 1), (0.02, 0.02, 0), (0.002, 0.0005, 0)])
def test_a_surface_whose_points_miss_it_by_centimetres_is_told_unless_the_noise_explains_it(
    stray, sigma, told
):
    options = CompletionOptions(
        texture=False, up=Up.along("z"), segmentation=SegmentationOptions(flatness_m=0.03)
    )
    completion = complete(wall(stray, sigma), options, rng=0)
    assert len(completion.patches) == 1
    assert len(completion.warnings) == told
    for text in completion.warnings:
        assert "surface 1 (plane" in text
        assert "rms 20 mm, 10 times the range noise" in text
        assert text in completion._repr_html_()
    assert completion_record(completion)["warnings"] == list(completion.warnings)


def test_what_single_frames_took_for_surfaces_is_counted():
    seen = complete(wall(0.002, 0.002), CompletionOptions(texture=False, up=Up.along("z")), rng=0)
    assert seen.unconfirmed == UnconfirmedRegions(0, 0)
    assert "unconfirmed" not in completion_record(seen)
    (plane,) = seen.measured_surfaces.regions[0]
    noise = replace(plane, pixels=PixelSet(np.arange(300, dtype=np.int32), plane.pixels.shape))
    regions = ([plane, noise, noise, noise],)
    left_out = replace(seen, measured_surfaces=replace(seen.measured_surfaces, regions=regions))
    (text,) = set(left_out.warnings) - set(seen.warnings)
    assert text.startswith("3 regions of single frames (900 pixels) are of no surface")
    assert completion_record(left_out)["unconfirmed"] == {"n_regions": 3, "n_pixels": 900}


@pytest.mark.long
def test_poses_that_contradict_each_other_are_told_with_numbers_by_pair():
    scans = [scan(0), scan(1), misplaced(scan(2), 0.5, 0.03, 0)]
    good, bad, kept = (
        complete(some, CompletionOptions(texture=False, up=Up.along("z"), moves_scans=moves), rng=0)
        for some, moves in ((scans[:2], True), (scans, True), (scans, False))
    )
    assert good.warnings == ()
    for found, cure in ((bad, "the scans were moved by up to"), (kept, "they were kept")):
        told = [
            text for text in found.warnings if text.startswith("poses contradict what was measured: scans")
        ]
        assert len(told) == 1
        assert cure in told[0]
        record = completion_record(found)["poses"]
        assert [one["scans"] for one in record["pairs"]] == [[1, 2], [1, 3], [2, 3]]
        assert f"{1000 * max(one['offset_m'] for one in record['pairs']):.0f} mm apart" in told[0]
        assert [one["scan"] for one in record["scans"]] == [1, 2, 3]
        (section,) = pose_sections(found.registration)
        assert len(section.blocks[0].rows) == 3
    assert (
        pose_sections(complete(scans[0], CompletionOptions(texture=False, up=Up.along("z"))).registration)
        == ()
    )
    assert completion_record(bad)["poses"]["scans"][2]["moved_m"] > 0.005
    assert completion_record(kept)["poses"]["scans"][2]["error_m"] > 0.01


def test_steps_that_hide_the_noise_are_told_in_all_three_places(tmp_path):
    grid = SphericalProjection.regular(120, 90, 60.0, (-22.0, 22.0))
    ranges = np.round(3.0 / grid.directions()[..., 2] / 0.02) * 0.02
    write_scan(RangeImage(ranges, grid, Pose.identity(), name="rounded"), tmp_path / "rounded.npz")
    done = CliRunner().invoke(
        app, ["complete", str(tmp_path / "rounded.npz"), "--no-texture", "-o", str(tmp_path / "out")]
    )
    assert done.exit_code == 0
    text = "rounded: its ranges come in steps of 20 mm"
    assert f"warning: {text}" in done.stderr
    record = json.loads((tmp_path / "out/completion.json").read_text())
    assert [warning[: len(text)] for warning in record["warnings"]] == [text]
    page = (tmp_path / "out/report.html").read_text()
    assert f'<p class="warning">{text}' in page
