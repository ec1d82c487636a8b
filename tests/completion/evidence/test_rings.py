# SPDX-License-Identifier: MIT
"""A cylinder's cross-sections: seen through, it is not there, nor does it go on beyond."""

import numpy as np
import pytest
from scipy import ndimage

from completion import CompletionOptions, complete
from completion.evidence.evidence import Evidence, Label
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder


def evidence(labels, own) -> Evidence:
    none = np.zeros(labels.shape, dtype=np.bool_)
    number = np.full(labels.shape, -1)
    return Evidence(labels, own, own, number, number.astype(np.int32), number.astype(np.int32), none, none)


def column(*rows: tuple[int, int]) -> Evidence:
    """Rows of 12 cells behind an occluder, the first of which are measured and the next seen through."""
    labels = np.full((len(rows), 12), Label.OCCLUDED, np.int8)
    own = np.zeros(labels.shape, dtype=np.bool_)
    for row, (n_measured, n_passed) in enumerate(rows):
        labels[row, :n_measured], own[row, :n_measured] = Label.VISIBLE, True
        labels[row, n_measured : n_measured + n_passed] = Label.FREE
    return evidence(labels, own)


def test_a_hidden_stretch_beside_a_measured_one_goes_on():
    assert not column((0, 0), (4, 0), (0, 0)).rings_passed().any()


def test_a_ring_of_which_more_is_passed_than_measured_ends_the_cylinder():
    passed = column((0, 0), (5, 0), (4, 1), (1, 4), (0, 0), (0, 0)).rings_passed()
    np.testing.assert_array_equal(passed, [False, False, False, True, True, True])


def test_stray_beams_through_a_measured_ring_do_not():
    assert not column((6, 2), (0, 0), (3, 3)).rings_passed().any()


def test_a_cylinder_measured_again_beyond_a_gap_is_there_again():
    passed = column((5, 0), (0, 5), (0, 0), (5, 0)).rings_passed()
    np.testing.assert_array_equal(passed, [False, True, False, False])


def test_the_other_way_up_is_the_same():
    rows = [(0, 0), (5, 0), (4, 1), (1, 4), (0, 0)]
    np.testing.assert_array_equal(column(*rows).rings_passed()[::-1], column(*rows[::-1]).rings_passed())


@pytest.mark.parametrize("width", [0, 1, 2])
def test_a_cylinder_closes_behind_its_limb_whose_pixels_saw_the_wall_as_well(width):
    camera = PinholeProjection.from_fov(160, 120, 60)
    rays = camera.directions()
    column = Cylinder((0, 0, 2), (0, 1, 0), 0.25)
    near = column.ray_ranges(np.zeros(3), rays.reshape(-1, 3)).reshape(camera.shape)
    wall = 4.0 / rays[..., 2]
    hit = np.isfinite(near)
    ranges = np.where(hit, near, wall)
    inner = ndimage.binary_erosion(hit, np.ones((1, 3)), iterations=width, border_value=1) if width else hit
    mixed = hit & ~inner
    ranges[mixed] = 0.5 * (near[mixed] + wall[mixed])
    noise = np.random.default_rng(0).normal(0, 0.002, camera.shape)
    scan = RangeImage(ranges + noise, camera, Pose.identity(), sigma_m=0.002)
    found = complete(scan, CompletionOptions(texture=False))
    (patch,) = (one for one in found.patches if isinstance(one.grid.surface, Cylinder))
    height = np.ptp(patch.grid.surface.to_uv(patch.source.points(found.observations))[:, 1])
    pixel = 2.0 / camera.fx
    passed = np.arcsin(np.sqrt(2 * (width + 1) * pixel / 0.25)) if width else 0.0  # of the back, either side
    assert patch.hypothesised_m2 > 0.95 * (np.pi - 2 * passed) * 0.25 * height
    beside = patch.evidence.through & patch.evidence.limb  # of the wall's beams, which no echo was lost of
    assert beside.any()
    assert not (patch.hypothesised & beside & (patch.evidence.labels == Label.NO_RETURN)).any()
    assert found.free_space_violation_m2 == 0
