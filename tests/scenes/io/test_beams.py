# SPDX-License-Identifier: MIT
"""A scan as mere beams: read as it was measured, or refused by name."""

import numpy as np
import pytest

from nbv.scanning.scanner import scan_scene
from scenes.checks import InputError
from scenes.io.scan_files import read_scan
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from tests.helpers.exchange_houses import SENSOR


@pytest.fixture(scope="module")
def scan():
    pose = Pose.looking_at((2.0, 3.6, 1.5), (6.0, 2.5, 1.5))
    return scan_scene(builtin_scene("two_occluders"), pose, SENSOR, noise="none")


def beams(scan, **more):
    rays = scan.rays().reshape(-1, 3)
    return {"origin": scan.origin, "directions": 2.0 * rays, "ranges": scan.ranges.ravel(), **more}


@pytest.mark.long
def test_beams_are_read_as_a_scan(scan, tmp_path):
    path = tmp_path / "beams.npz"
    np.savez(path, **beams(scan, sigma_m=0.003))
    found = read_scan(path)
    assert found.sigma_m == 0.003
    assert found.origin == pytest.approx(scan.origin)
    assert found.valid.sum() == pytest.approx(scan.valid.sum(), rel=0.02)
    one, other = (each.points()[each.valid] for each in (found, scan))
    assert one.min(axis=0) == pytest.approx(other.min(axis=0), abs=1e-6)
    assert one.max(axis=0) == pytest.approx(other.max(axis=0), abs=1e-6)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"ranges": np.ones(3)}, r"directions have shape \(\d+, 3\), ranges \(3,\)"),
        ({"directions": np.zeros((4, 3)), "ranges": np.ones(4)}, "4 of 4 directions are not finite"),
        ({"sigma_m": -1.0}, "sigma_m is -1.0"),
        ({"origin": np.array([np.nan, 0, 0])}, "origin"),
    ],
)
def test_wrong_beams_are_refused(scan, tmp_path, wrong, told):
    path = tmp_path / "wrong.npz"
    np.savez(path, **(beams(scan) | wrong))
    with pytest.raises(InputError, match=told):
        read_scan(path)
