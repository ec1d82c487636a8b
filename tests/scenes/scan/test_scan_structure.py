# SPDX-License-Identifier: MIT
"""Structure of scans: what E57 states of itself; what is left out is told; conventions of poses found out."""

import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.clouds.e57 import check_e57
from scenes.io.describe import scan_warnings
from scenes.io.formats.header import range_warnings
from scenes.io.formats.station import scan_from_station
from scenes.io.point_files import read_points
from scenes.io.rgbd.depth import depth_warnings
from scenes.io.scan_files import read_scan, read_scans
from scenes.pose import Pose, rotation_of
from scenes.scan.convention import convention_doubt
from scenes.scan.range_image import RangeImage
from tests.helpers.scan_examples import PROJECTIONS, example_scan
from tests.robustness.bad_files import scans

Change = Callable[[bytes], bytes]


def put(at: int, number: int) -> Change:
    return lambda data: data[:at] + struct.pack("<Q", number) + data[at + 8 :]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d[:40], "not an E57 file"),
        (put(16, 10), "truncated or damaged E57: 10 bytes in pages of 1024 announced"),
        (put(40, 512), "in pages of 512"),
        (put(24, 10**9), "bytes of XML from byte 1,000,000,000 of"),
        (put(24, 1022), "its XML begins within a checksum, at byte 1,022"),
        (put(32, 15_000), "truncated E57: 15,000 bytes of XML announced"),
        (scans.e57_xml(lambda x: x[:-9]), "its XML is damaged"),
        (scans.e57_xml(scans.laughing_xml), "definitions of its own"),
        (scans.e57_xml(lambda x: x.replace(b"<guid", b"<a>" * 70 + b"<guid", 1)), "nested more than 64 deep"),
        (scans.e57_xml(lambda x: x.replace(b'recordCount="', b'recordCount="-')), "announces '-572' points"),
        (
            scans.e57_xml(lambda x: x.replace(b'recordCount="572', b'recordCount="99999999')),
            "exceed the limit",
        ),
    ],
)
def test_e57_that_lies_is_refused(tmp_path: Path, change: Change, message: str) -> None:
    file = scans.spoilt("e57", change)(tmp_path)
    with pytest.raises(InputError, match=message):
        check_e57(file)
    with pytest.raises(InputError, match=r"a\.e57: "):
        read_points(file)


def test_sound_e57_passes(tmp_path: Path) -> None:
    file = scans.spoilt("e57", scans.e57_xml(lambda xml: xml))(tmp_path)
    check_e57(file)
    assert read_scan(file).valid.sum() == 572


@pytest.mark.parametrize("motion", [0.05, 0.3])
def test_conventions_of_poses_are_found_out(motion: float) -> None:
    def seen(pose: Pose, said: Pose) -> RangeImage:
        depth = scans.depth_from(pose) / scans.CAMERA.directions()[..., 2]
        noise = np.random.default_rng(0).normal(0, 0.005, depth.shape)
        return RangeImage(depth + noise, scans.CAMERA, said)

    poses = [Pose.looking_at((motion * k, -4 + motion * k, 1.2), (0.1, 0, 1.0)) for k in range(4)]
    opengl = Pose(np.diag([1.0, -1, -1, 1]))
    assert convention_doubt([seen(pose, pose) for pose in poses]) == ""
    assert convention_doubt([seen(pose, pose) for pose in poses[:1]]) == ""
    assert convention_doubt([]) == ""
    turned = convention_doubt([seen(pose, pose @ opengl) for pose in poses])
    assert turned.startswith("the poses seem to be OpenGL's (y up, z backwards): so depths agree to 0.")
    assert turned.endswith("if so, multiply each by diag(1, -1, -1, 1) from the right")
    if motion > 0.1:
        inverted = convention_doubt([seen(pose, pose.inverse()) for pose in poses])
        assert inverted.endswith("if so, invert each")


def test_what_is_left_out_of_scans_is_told(tmp_path: Path) -> None:
    scan = example_scan(PROJECTIONS["pinhole"])
    assert scan_warnings(replace(scan, warnings=("5 points were left out",))) == ["5 points were left out"]
    assert range_warnings(np.array([1.0, 2.0, -1.0, np.nan, np.inf, 0])) == (
        "1 negative ranges were left out",
    )
    assert range_warnings(np.zeros(3)) == ()
    with pytest.raises(InputError, match="2 of 3 ranges or depths are negative: they lie behind the camera"):
        range_warnings(np.array([-1.0, -2.0, 3.0, np.inf]))
    assert depth_warnings(np.array([1.0, 255.0])) == (
        "its depths are whole numbers up to 255: 8-bit depth in a wider image?",
    )
    assert depth_warnings(np.array([1.5, 200.0])) == depth_warnings(np.array([0.0, 256.0])) == ()


def test_points_off_their_pixels_are_told() -> None:
    scan = example_scan(PROJECTIONS["pinhole"], off_rays_m=1e-3)
    assert scan_warnings(scan) == []
    points = np.roll(scan.points_in_sensor(), 5, axis=1)
    moved = replace(scan, ranges=np.linalg.norm(points, axis=-1), sensor_points=points, colour=None)
    (doubt,) = scan_warnings(moved)
    assert doubt.startswith("half of its points lie 5")


def test_quaternions_are_named() -> None:
    np.testing.assert_allclose(rotation_of([0, 0, 0, 1.05], "it"), np.eye(3), atol=1e-12)
    for bad in ([0, 0, 0, 3], [0, 0, 0, 0], [np.nan, 0, 0, 1], [0, 0, 1]):
        with pytest.raises(InputError, match=r"pose 7 has the quaternion .* which is no rotation"):
            rotation_of(bad, "pose 7")


def test_stations_far_away_see_the_same(tmp_path: Path) -> None:
    """At UTM's 5,400 km the same pixels have the same ranges, to float64's rounding there."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-2, 2, (900, 2)), np.full(900, 5.0)])[:, [0, 2, 1]]
    far = np.array([4.5e5, 5.4e6, 100.0])
    near_scan = scan_from_station(points, np.zeros(3))
    far_scan = scan_from_station(points + far, far)
    assert near_scan.valid.sum() == pytest.approx(far_scan.valid.sum(), rel=0.01)
    assert np.median(near_scan.ranges[near_scan.valid]) == pytest.approx(
        np.median(far_scan.ranges[far_scan.valid]), abs=1e-6
    )


def test_folders_of_frames_keep_their_warnings(tmp_path: Path) -> None:
    assert [scan.warnings for scan in read_scans(scans.fill(tmp_path))] == [()] * 3
