# SPDX-License-Identifier: MIT
import numpy as np
import pytest

from completion.boundary.boundary_pixels import find_boundary_pixels
from completion.fitting.result import SurfaceFit
from completion.observe.observation import FEW, PixelSet, ScanPixels, find_key_frames, observe
from completion.observe.tolerance import EvidenceOptions
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

CAMERA = PinholeProjection.from_fov(80, 60, 60)
WALL = Plane((0, 0, 0), (0, -1, 0), (1, 0, 0))  # is seen from both sides
START = (0.0, -4.0, 0.0)
USUAL = EvidenceOptions().tolerance()


def look(eye, at=None):
    """A frame from a place that looks straight at the wall, or at a point."""
    pose = Pose.looking_at(eye, (eye[0], 0.0, eye[2]) if at is None else at)
    rays = pose.rotate(CAMERA.directions().reshape(-1, 3))
    ranges = WALL.ray_ranges(np.array(eye), rays)
    ranges = np.where(np.isfinite(ranges), ranges, WALL.flip().ray_ranges(np.array(eye), rays))
    return observe(RangeImage(ranges.reshape(CAMERA.shape), CAMERA, pose), Pose.identity(), 0.001)


STILL = [look(START)] * FEW


def test_all_of_few_scans_are_key_frames():
    assert find_key_frames(STILL) == tuple(range(FEW))
    assert find_key_frames([*STILL, STILL[0]]) == (0,)


@pytest.mark.parametrize(
    ("eye", "is_key"),
    [
        ((0.2, -4.0, 0.0), False),  # a step aside
        ((3.0, -4.0, 0.0), True),  # mostly beside what was seen
        ((0.0, -3.0, 0.0), False),  # a bit nearer
        ((0.0, -1.7, 0.0), True),  # more than twice as fine
        ((0.0, -6.0, 0.0), True),  # farther back: what lies around is new
        ((0.0, 4.0, 0.0), True),  # from behind
    ],
)
def test_a_frame_that_shows_something_new_is_a_key_frame(eye, is_key):
    sequence = [*STILL, look(eye), look(eye)]  # what was shown once is not new
    assert find_key_frames(sequence) == ((0, FEW) if is_key else (0,))


def test_the_law_of_a_walk():
    """Key frames follow each other in even steps; walking back shows nothing new."""
    there = [look((0.1 * k, -4.0, 0.0)) for k in range(FEW)]
    keys = find_key_frames([*there, *there[::-1]])
    assert keys[0] == 0
    assert max(keys) < FEW
    assert 3 < len(keys) < FEW // 4
    assert np.ptp(np.diff(keys)) <= 2  # even steps


def test_frames_that_measured_nothing_are_no_key_frames():
    nothing = RangeImage(np.full(CAMERA.shape, np.inf), CAMERA, Pose.identity())
    assert find_key_frames([observe(nothing, Pose.identity(), 0.001)] * (FEW + 1)) == tuple(range(FEW + 1))
    assert find_key_frames([*STILL, observe(nothing, Pose.identity(), 0.001)]) == (0,)


def test_boundaries_are_those_of_key_frames_if_these_measured_the_surface():
    fit = SurfaceFit(WALL, 0.0, np.zeros((3, 3)), 1000)
    seen = [look(START), look((0.3, -4.0, 0.0)), look((0.6, -4.0, 0.0))]
    whole, none = PixelSet.of(seen[0].valid), PixelSet.union([], CAMERA.shape)

    def of(pixels, keys):
        return find_boundary_pixels(fit, ScanPixels.of(pixels), seen, USUAL, keys).uv

    np.testing.assert_array_equal(of([whole] * 3, (1,)), of([none, whole, none], None))
    np.testing.assert_array_equal(of([whole, none, whole], (1,)), of([whole, none, whole], None))
    assert len(of([whole] * 3, (0, 2))) == 2 * len(of([whole, none, none], None))
