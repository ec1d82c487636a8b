# SPDX-License-Identifier: MIT
"""Angles of planes against what is stated of them: scans that are bent, pairs that are found."""

import numpy as np

from benchmarks.cases.sensors import UNIT_PER_M, distorted
from benchmarks.suites.dimensions import pairs_of, summary
from completion import CompletionOptions, complete
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage

CAMERA = PinholeProjection.from_fov(96, 72, 70)


def corner(tilt=0.0):
    """A scan into a corner of two walls and a floor, exact; one wall is off square by `tilt`, radians."""
    normals = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 0, -1.0], [0, -1.0, 0]])
    offsets = np.array([-1.2, -3.0, -1.1])
    rays = CAMERA.directions()
    with np.errstate(divide="ignore"):
        ranges = offsets / (rays @ normals.T)
    ranges = np.where(ranges > 0, ranges, np.inf).min(axis=-1)
    return RangeImage(ranges, CAMERA, Pose.identity(), sigma_m=0.001)


def test_scans_are_bent_by_so_many_units():
    scan = corner()
    for seed in (0, 1):
        bend = (distorted(scan, seed, 3.0).ranges - scan.ranges)[scan.valid] / np.square(
            scan.ranges[scan.valid]
        )
        assert abs(np.sqrt(np.mean(np.square(bend))) / UNIT_PER_M - 3.0) < 0.01
    assert distorted(scan, 0).sigma_m is None
    np.testing.assert_array_equal(distorted(scan, 0).ranges, distorted(scan, 0).ranges)
    assert not np.array_equal(distorted(scan, 0).ranges, distorted(scan, 1).ranges)


def test_pairs_are_as_far_off_as_the_walls_are():
    options = CompletionOptions(texture=False, relations=None)
    pairs = pairs_of("corner", complete(corner(np.radians(2.0)), options, rng=0))
    assert len(pairs) == 3
    off = sorted(one.off_deg for one in pairs)
    np.testing.assert_allclose(off, [0, 0, 2.0], atol=0.02)
    assert all(one.without_deg <= one.stated_deg < 0.1 for one in pairs)  # sigma is stated: no distortion
    assert summary("corner", pairs).count("|") == 10
