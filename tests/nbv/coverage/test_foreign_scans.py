# SPDX-License-Identifier: MIT
"""Scans that are of another place than the scene."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nbv.coverage.measurement import check_scans
from scenes.checks import InputError
from scenes.io.scan_files import write_scan
from scenes.io.scene_files import open_scene
from scenes.pose import Pose
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage

SCENE = open_scene("builtin:two_occluders")
CASTER = SCENE.ray_caster()
STANDS = np.array([1.0, 1.0, 1.4])


def scan(scale: float = 1.0) -> RangeImage:
    """What a scanner in the scene sees, all lengths scaled."""
    around = SphericalProjection.regular(120, 60, 360.0, (-80.0, 80.0))
    pose = Pose.looking_at(STANDS, STANDS + [1.0, 0.0, 0.0])
    rays = pose.rotate(around.directions().reshape(-1, 3))
    hits = CASTER.first_hit(STANDS[None], rays)
    return RangeImage(scale * hits.ranges.reshape(around.shape), around, pose, name="theirs")


def test_a_scan_of_the_scene_raises_no_doubt() -> None:
    assert check_scans(SCENE.mesh, CASTER, [scan(), scan()]) == ()


@pytest.mark.parametrize(
    ("given", "cause"),
    [
        (lambda: scan().transform(Pose.from_parts(np.eye(3), np.array([40.0, 0, 0]))), "poses"),
        (lambda: scan(1000.0), "units"),
        (lambda: scan(0.3048), "units"),
    ],
)
def test_a_scan_of_another_place_is_refused(given: Any, cause: str) -> None:
    sentence = r"theirs: \d+ of [\d,]+ beams.* meet the scene within 5 cm or 1 % .*another place.*; check .*"
    with pytest.raises(InputError, match=sentence + cause):
        check_scans(SCENE.mesh, CASTER, [scan(), given()])


def test_a_scan_that_fits_in_part_is_doubted_with_its_number() -> None:
    whole = scan()
    ranges = np.array(whole.ranges)
    ranges[:, :84] *= 0.5
    (doubt,) = check_scans(SCENE.mesh, CASTER, [whole, replace(whole, ranges=ranges, name="partly")])
    assert doubt.startswith("partly: ")
    assert "is the scan of this scene" in doubt


@pytest.mark.parametrize("command", ["coverage", "plan"])
def test_commands_refuse_in_one_line(tmp_path: Path, command: str) -> None:
    from typer.testing import CliRunner

    from nbv.cli import app

    write_scan(scan(0.3), tmp_path / "a.npz")
    arguments = [
        command,
        "builtin:two_occluders",
        "--scans",
        str(tmp_path / "a.npz"),
        "-o",
        str(tmp_path / "o"),
    ]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert "the scan is of another place" in result.output
