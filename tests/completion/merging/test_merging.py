# SPDX-License-Identifier: MIT
"""Merging as a table: what a scan sees between parts of a wall, and how many surfaces there are.

Seen: . the wall   , a wall farther off   # something before it   o a beam went through   ? no echo
"""

import numpy as np
import pytest
from scipy import ndimage

from completion.fitting.euclidean import fit_plane
from completion.merging.pipeline import merge
from completion.observe.observation import PixelSet, observe
from completion.observe.tolerance import EvidenceOptions
from completion.segmentation.regions import Region
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage

BLOCK = 8  # pixels


def merged(seen: str, *, farther_m=0.05, across=True):
    """The surfaces of a picture whose connected parts are the regions."""
    projection = PinholeProjection.from_fov(BLOCK * len(seen.split()[0]), BLOCK * len(seen.split()), 60)
    depths = {".": 3.0, ",": 3.0 + farther_m, "#": 1.5, "o": 5.0, "?": np.inf}
    depth = np.kron([[depths[symbol] for symbol in row] for row in seen.split()], np.ones((BLOCK, BLOCK)))
    scan = RangeImage(depth / projection.directions()[..., 2], projection, Pose.identity(), sigma_m=0.0)
    observation = observe(scan, Pose.identity())
    part, n_parts = ndimage.label(np.isin(depth, (3.0, 3.0 + farther_m)))
    masks = [part == number for number in range(1, n_parts + 1)]
    regions = [
        Region(fit_plane(observation.scan.points()[mask], np.zeros(3)), PixelSet.of(mask)) for mask in masks
    ]
    return merge([observation], [regions], EvidenceOptions().tolerance(), across=across), observation


TABLE = {
    "an occluder cuts a wall apart": ("..##.. ..##.. ..##..", {}, 1),
    "and into three parts": (".#..#. .#..#. .#..#.", {}, 1),
    "what beams went through is no wall": ("..oo.. ..oo.. ..oo..", {}, 2),
    "a wide gap without echo hides nothing": (".????. .????. .????.", {}, 2),
    "a hidden strip beside a window will do": ("..oo.. ..oo.. ..##.. ..##..", {}, 1),
    "parallel walls are two": ("..##,, ..##,, ..##,,", {}, 2),
    "a step within what real walls differ by is none": ("..##,, ..##,, ..##,,", {"farther_m": 0.003}, 1),
    "without the cue nothing is joined": ("..##.. ..##.. ..##..", {"across": False}, 2),
}  # fmt: skip


@pytest.mark.parametrize("law", TABLE)
def test_what_lies_between_says_whether_parts_are_one_surface(law):
    seen, given, expected = TABLE[law]
    surfaces, observation = merged(seen, **given)
    assert len(surfaces) == expected
    assert sum(one.n_pixels for one in surfaces) == sum(seen.count(symbol) for symbol in ".,") * BLOCK**2
    assert [one.n_pixels for one in surfaces] == sorted((one.n_pixels for one in surfaces), reverse=True)
    for one in surfaces:
        assert np.abs(one.fit.surface.distance(one.points([observation]))).max() < 0.01


@pytest.mark.parametrize(("sigma_m", "n_surfaces"), [(0.05, 1), (0.15, 2)])
def test_what_is_small_joins_where_its_height_says_something(sigma_m, n_surfaces):
    depth = np.full((48, 64), 1.5)
    depth[:, :24] = 3.0  # a wall, and far off a spot that is near its plane
    depth[20:24, 60:64] = 3.04
    projection = PinholeProjection.from_fov(64, 48, 60)
    ranges = depth / projection.directions()[..., 2]
    observation = observe(RangeImage(ranges, projection, Pose.identity(), sigma_m=sigma_m), Pose.identity())
    masks = [depth == 3.0, depth == 3.04]
    regions = [
        Region(fit_plane(observation.scan.points()[mask], np.zeros(3)), PixelSet.of(mask)) for mask in masks
    ]
    assert len(merge([observation], [regions], EvidenceOptions().tolerance())) == n_surfaces
