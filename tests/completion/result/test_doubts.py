# SPDX-License-Identifier: MIT
"""What a reader should know before trusting a completion is told on stderr, in record and report."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from completion import CompletionOptions, SegmentationOptions, complete
from completion.result.record import completion_record
from nbv.cli import app
from scenes.files.scan_files import write_scan
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage

CAMERA = PinholeProjection.from_fov(120, 90, 60)


def wall(stray_m: float, sigma_m: float) -> RangeImage:
    depth = 2.0 + np.random.default_rng(0).normal(0, stray_m, CAMERA.shape)
    return RangeImage(depth / CAMERA.directions()[..., 2], CAMERA, Pose.identity(), sigma_m=sigma_m)


@pytest.mark.parametrize(("stray", "sigma", "told"), [(0.02, 0.002, 1), (0.02, 0.02, 0), (0.002, 0.0005, 0)])
def test_a_surface_whose_points_miss_it_by_centimetres_is_told_unless_the_noise_explains_it(
    stray, sigma, told
):
    options = CompletionOptions(texture=False, segmentation=SegmentationOptions(flatness_m=0.03))
    completion = complete(wall(stray, sigma), options, rng=0)
    assert len(completion.patches) == 1
    assert len(completion.warnings) == told
    for text in completion.warnings:
        assert "surface 1 (plane" in text
        assert "20 mm, 10 times the noise" in text
        assert text in completion._repr_html_()
    assert completion_record(completion)["warnings"] == list(completion.warnings)


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
