# SPDX-License-Identifier: MIT
"""Pixels: blocks cover an image, mending copies only what must be, and is what a whole image would give."""

import numpy as np
import pytest

from scenes.pose import Pose
from scenes.scan import pixels
from scenes.scan.pixels import mend_pixels, ranges_of, row_blocks
from scenes.scan.range_image import RangeImage
from tests.helpers.scan_examples import PROJECTIONS, example_scan


@pytest.mark.parametrize("shape", [(1, 1), (300, 500), (3, 200_000), (70_000, 1)])
def test_blocks_cover_the_rows(shape: tuple[int, int]) -> None:
    rows = np.concatenate([np.arange(shape[0])[block] for block in row_blocks(shape)])
    np.testing.assert_array_equal(rows, np.arange(shape[0]))


def test_what_is_sound_and_read_only_is_not_copied() -> None:
    image = np.add.outer(np.arange(0.0, 12.0, 4), np.arange(4.0))
    copy = mend_pixels(image, np.float64, lambda _, held: held < 0, 0)
    assert copy is not image
    image.setflags(write=False)
    assert mend_pixels(image, np.float64, lambda _, held: held < 0, 0) is image
    better = mend_pixels(image, np.float64, lambda _, held: held > 5, 5)
    np.testing.assert_array_equal(better, np.minimum(image, 5))
    assert image.max() == 11
    assert not better.flags.writeable


def test_blocks_of_any_size_give_the_same_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    scan = example_scan(PROJECTIONS["panorama"], off_rays_m=1e-3)
    points, colour = scan.points_in_sensor().copy(), np.array(scan.colour)
    points[rng.random(scan.shape) < 0.1] *= np.array([1, np.nan, 1])
    colour[~np.isfinite(points).all(axis=-1)] = np.nan

    def made() -> RangeImage:
        return RangeImage.from_points(points, scan.projection, Pose.identity(), colour)

    whole = made()
    monkeypatch.setattr(pixels, "_BLOCK", 1)
    for name in ("ranges", "sensor_points", "colour"):
        np.testing.assert_array_equal(getattr(made(), name), getattr(whole, name))
    expected = np.linalg.norm(points, axis=-1)
    np.testing.assert_array_equal(ranges_of(points), np.where(np.isfinite(expected), expected, np.inf))


def test_points_given_as_float32_are_held_so() -> None:
    scan = example_scan(PROJECTIONS["panorama"], off_rays_m=1e-3)
    single = scan.points_in_sensor().astype(np.float32)
    held = RangeImage.from_points(single, scan.projection, scan.world_from_sensor)
    double = RangeImage.from_points(single.astype(np.float64), scan.projection, scan.world_from_sensor)
    assert held.sensor_points is not None
    assert held.sensor_points.dtype == np.float32
    for name in ("points", "points_in_sensor", "rays"):
        np.testing.assert_array_equal(getattr(held, name)(), getattr(double, name)())
    np.testing.assert_array_equal(held.ranges, double.ranges)
