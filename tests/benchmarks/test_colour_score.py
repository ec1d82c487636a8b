# SPDX-License-Identifier: MIT
"""Colour of inferred area against what other scans saw: equal, known to differ, and not seen."""

import numpy as np
import pytest

from benchmarks.metrics.other_scans import score_colour
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import Finish, SceneBuilder


def scan_of_wall(colour: tuple[float, float, float]) -> RangeImage:
    build = SceneBuilder("wall", "object")
    build.add_rectangle("wall", (-3, 2, -2), (6, 0, 0), (0, 0, 4), Finish(colour))
    view = Pose.looking_at((0, 0, 0), (0, 2, 0))
    return scan_scene(build.finish(), view, PinholeSensor(fov_deg=60, width=160, height=160), rng=0)


def places(n: int = 4000) -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.column_stack([rng.uniform(-0.8, 0.8, n), np.full(n, 2.0), rng.uniform(-0.8, 0.8, n)])


def test_equal_colours_have_no_difference_and_grey_levels_a_known_one():
    scans = [scan_of_wall((0.6, 0.6, 0.6)), scan_of_wall((0.6, 0.6, 0.6))]
    points = places()
    for grey in (153, 120):
        score = score_colour(points, np.full((len(points), 3), grey, np.uint8), scans)
        lightness = [116 * (((level / 255 + 0.055) / 1.055) ** 2.4) ** (1 / 3) - 16 for level in (153, grey)]
        assert score.n_points == len(points)
        np.testing.assert_allclose(score.difference, abs(np.subtract(*lightness)), atol=0.1)
        assert score.median == pytest.approx(abs(np.subtract(*lightness)), abs=0.1)


def test_texture_counts_by_its_mean():
    points = places(40_000)
    colours = np.repeat(np.random.default_rng(1).choice([133, 173], len(points))[:, None], 3, axis=1)
    score = score_colour(points, colours.astype(np.uint8), [scan_of_wall((0.6, 0.6, 0.6))])
    assert score.median < 1.5  # pixel by pixel the difference is 8


def test_what_no_scan_measured_is_not_compared():
    scan = scan_of_wall((0.6, 0.6, 0.6))
    points = places()
    grey = np.full((len(points), 3), 10, np.uint8)
    for others in ([], [RangeImage(scan.ranges, scan.projection, scan.world_from_sensor)]):
        assert np.isnan(score_colour(points, grey, others).median)
    before = points - [0, 0.1, 0]  # 10 cm before the wall
    assert score_colour(before, grey, [scan]).n_points == 0
    assert score_colour(before, grey, [scan], tolerance_m=0.2).n_points == len(points)
    behind = points * [1, -1, 1]
    assert score_colour(behind, grey, [scan]).n_points == 0
