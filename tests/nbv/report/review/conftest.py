# SPDX-License-Identifier: MIT
"""A completion to review: a wall, hidden by a chair, in one small scan."""

from dataclasses import dataclass, replace

import pytest

from completion.merging.scan_surfaces import find_surfaces
from completion.options import CompletionOptions
from nbv.report.review.server import ReviewServer
from nbv.report.review.session import ReviewSession
from nbv.scanning.effects import Effects
from nbv.scanning.noise_models import ConstantNoise
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.inclination import Up
from scenes.pose import Pose
from scenes.run.journal import NO_JOURNAL
from scenes.run.steps import Steps
from scenes.world.builtin import builtin_scene

OPTIONS = CompletionOptions(texture=False, up=Up.along("z"))


@dataclass(frozen=True)
class Measured:
    """A scan and its surfaces."""

    scan: object
    surfaces: object

    def session(self, file):
        """A session on it."""
        return ReviewSession(self.surfaces, self.scan.world_from_sensor, OPTIONS, file, n_threads=1)


def make_scan():
    """A chair before a wall."""
    pose = Pose.looking_at((0.5, -2.2, 1.5), (0.0, 0.8, 0.7))
    camera = PinholeSensor(fov_deg=65, width=120, height=120)
    noisy = Effects(noise=ConstantNoise(constant_m=0.001))
    scan = scan_scene(builtin_scene("chair_before_wall"), pose, camera, effects=noisy, rng=0)
    return replace(scan, truth=None)


@pytest.fixture(scope="session")
def measured():
    scan = make_scan()
    with Steps.over([scan.ranges.size], 1, None, NO_JOURNAL) as steps:
        return Measured(scan, find_surfaces([scan], OPTIONS.of_surfaces, steps))


@pytest.fixture
def session(measured, tmp_path):
    return measured.session(tmp_path / "history.json")


@pytest.fixture
def server(session):
    return ReviewServer(session, "a room <script>alert(1)</script>", PinholeSensor(fov_deg=60), lambda: ["x"])
