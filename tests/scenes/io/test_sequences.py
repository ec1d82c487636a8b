# SPDX-License-Identifier: MIT
"""Sequences: the pixels of many frames are in files, those of a few in memory, and the same numbers."""

import numpy as np
import pytest

from scenes import Pose
from scenes.io.rgbd.writer import write_rgbd
from scenes.io.scan_files import read_scans, write_scan
from scenes.io.scan_request import ScanRequest, read_request
from scenes.run.mapping import is_mapped
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage


def frames(n):
    projection = PinholeProjection.from_fov(96, 72, 60)
    rng = np.random.default_rng(0)
    return [
        RangeImage(
            rng.uniform(1, 3, (72, 96)),
            projection,
            Pose.looking_at([k, 0, 1], [k + 1, 0, 1]),
            colour=rng.integers(0, 256, (72, 96, 3)).astype(np.uint8),
        )
        for k in range(n)
    ]


@pytest.mark.parametrize(("n", "mapped"), [(8, False), (9, True)])
def test_more_than_eight_frames_of_a_folder_are_read_into_files(tmp_path, n, mapped):
    write_rgbd(frames(n), tmp_path / "walk")
    scans = read_scans(tmp_path / "walk")
    assert [is_mapped(scan.ranges) for scan in scans] == [mapped] * n
    assert [is_mapped(scan.colour) for scan in scans] == [mapped] * n
    alone = read_scans(f"{tmp_path / 'walk'}#{n}")[0]
    np.testing.assert_array_equal(scans[-1].ranges, alone.ranges)
    np.testing.assert_array_equal(scans[-1].colour, alone.colour)


def test_more_than_eight_files_are_read_into_files_by_a_request(tmp_path):
    for k, scan in enumerate(frames(9)):
        write_scan(scan, tmp_path / f"{k}.npz")
    paths = tuple(str(tmp_path / f"{k}.npz") for k in range(9))
    assert all(is_mapped(scan.ranges) for scan in read_request(ScanRequest(paths)).scans)
    assert not any(is_mapped(scan.ranges) for scan in read_request(ScanRequest(paths[:8])).scans)
