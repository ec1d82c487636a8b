# SPDX-License-Identifier: MIT
"""A real foot tunnel before a depth camera: a vault and its floor, nothing else."""

import cv2
import numpy as np
import pytest

from completion import CompletionOptions, complete
from completion.merging.merged_surface import MergedSurface
from completion.merging.pipeline import merge
from completion.observe.observation import observe
from completion.observe.tolerance import EvidenceOptions
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import SegmentationOptions
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane
from tests.helpers.data_paths import data_path, requires_data

pytestmark = requires_data


def tunnel() -> RangeImage:
    """Depths in millimetres, with the calibration that lies beside them."""
    folder = data_path("range/cape_tunnel")
    depth = cv2.imread(str(folder / "depth_0.png"), cv2.IMREAD_UNCHANGED) / 1000.0
    stored = cv2.FileStorage(str(folder / "calib_params.xml"), cv2.FILE_STORAGE_READ)
    (fx, _, cx), (_, fy, cy), _ = stored.getNode("IR_intrinsic_params").mat()
    camera = PinholeProjection(depth.shape[1], depth.shape[0], fx, fy, cx, cy)
    ranges = np.where(depth > 0, depth / camera.directions()[..., 2], np.inf)
    return RangeImage(ranges, camera, Pose.identity())


@pytest.fixture(scope="module")
def found() -> list[MergedSurface]:
    observation = observe(tunnel(), Pose.identity())
    return merge([observation], [segment(observation, SegmentationOptions())], EvidenceOptions().tolerance())


def test_the_vault_is_one_concave_cylinder_over_a_flat_floor(found):
    vault, floor = (one.fit.surface for one in found[:2])
    assert isinstance(vault, Cylinder)
    assert isinstance(floor, Plane)
    assert vault.concave
    assert vault.radius == pytest.approx(1.54, abs=0.03)
    assert sum(one.n_pixels for one in found[:2]) > 0.99 * tunnel().valid.sum()  # the rest are splinters


def test_the_floor_runs_along_the_vault_below_its_axis(found):
    vault, floor = (one.fit.surface for one in found[:2])
    assert abs(vault.direction @ floor.normal_direction) < np.sin(np.radians(1.5))
    assert 0 < floor.distance(vault.point[None])[0] < vault.radius


@pytest.mark.long
def test_the_floor_ends_at_the_vault():
    completed = complete(tunnel(), CompletionOptions(texture=False), rng=0)
    vault = completed.patches[0].source.fit.surface
    assert completed.hypothesised_m2 > 0.05
    assert vault.distance(completed.hypothesised.vertices).min() > -0.03
