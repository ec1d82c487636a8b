# SPDX-License-Identifier: MIT
from dataclasses import replace

import numpy as np
import pytest

from completion.merging.merged_surface import MergedSurface
from completion.merging.pipeline import merge
from completion.observe.observation import Observation, PixelSet, observe
from completion.observe.tolerance import FLATNESS_M, EvidenceOptions
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import Region, SegmentationOptions
from completion.segmentation.relief import find_seams, plate_of, together, typical_relief
from scenes.checks import IntArray
from scenes.io.scan_request import ScanRequest, read_request
from scenes.scan.range_image import RangeImage
from tests.helpers.completion_examples import example
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.long_cases import first_in_gate
from tests.helpers.uneven_scans import BEYOND, GROUND, LEAF, WALL, Yard

TUNING, HELD_OUT = (0, 1), (100, 101)  # seeds of yards
SEEDS = [HELD_OUT[0], *(pytest.param(seed, marks=pytest.mark.long) for seed in (*TUNING, *HELD_OUT[1:]))]
REALISTIC = [  # relief and noise, metres
    (0.02, 0.01),
    *(pytest.param(*pair, marks=pytest.mark.long) for pair in ((0.005, 0.005), (0.02, 0.005))),
]


def observed() -> Observation:
    """A scan of the room with two occluders."""
    scan = example("two_occluders")
    return observe(scan, scan.world_from_sensor)


def owners(scan: RangeImage, options: SegmentationOptions = SegmentationOptions()) -> IntArray:  # noqa: B008
    """The number of the surface of each pixel, from 1; 0 for none."""
    seen = observe(scan, scan.world_from_sensor)
    merged: list[MergedSurface] = merge([seen], [segment(seen, options)], EvidenceOptions().tolerance())
    found = np.zeros(scan.shape, dtype=np.int64)
    for number, surface in enumerate(merged, start=1):
        found.ravel()[surface.pixels[0].flat] = number
    return found


def largest(owner: IntArray, here: np.ndarray) -> tuple[int, float]:
    """The surface that most of some pixels are of, and its share of those that are of any."""
    count = np.bincount(owner[here & (owner > 0)])
    return int(np.argmax(count)), float(count.max() / count.sum())


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("relief", "noise"), REALISTIC)
def test_uneven_ground_is_one_surface_and_walls_stay_walls(relief, noise, seed):
    scan, what = Yard(seed=seed, relief_m=relief, noise_m=noise).scan()
    owner = owners(scan)
    ground, share = largest(owner, what == GROUND)
    assert share > 0.97
    assert np.mean(owner[what == GROUND] == 0) < 0.02
    walls = np.unique(owner[what == WALL], return_counts=True)
    named = walls[0][(walls[1] > 0.02 * walls[1].sum()) & (walls[0] > 0)]
    assert len(named) == 4
    assert ground not in named


@pytest.mark.parametrize("seed", first_in_gate(1, SEEDS))
@pytest.mark.parametrize(("relief", "noise"), REALISTIC)
@pytest.mark.parametrize("change", [{"step_m": 0.03}, {"ramp_deg": 2.0, "size_m": 16.0}])
def test_a_step_and_a_ramp_stay_apart_from_uneven_ground(change, relief, noise, seed):
    scan, what = replace(Yard(seed=seed, relief_m=relief, noise_m=noise), **change).scan()
    owner = owners(scan)
    assert largest(owner, what == GROUND)[0] != largest(owner, what == BEYOND)[0]


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
def test_a_door_leaf_stays_apart_from_its_wall(seed):
    scan, what = Yard(seed=seed, relief_m=0.02, noise_m=0.01, leaf_m=0.04).scan()
    owner = owners(scan)
    leaf, share = largest(owner, what == LEAF)
    assert share > 0.9
    assert np.mean(owner[what == WALL] == leaf) < 0.01


@pytest.mark.long
@pytest.mark.parametrize("change", first_in_gate(1, [{"step_m": 0.03}, {"ramp_deg": 2.0, "size_m": 16.0}]))
def test_flat_surfaces_that_meet_are_not_uneven(change):
    scan, what = replace(Yard(seed=3), **change).scan()
    owner = owners(scan)
    assert largest(owner, what == GROUND)[0] != largest(owner, what == BEYOND)[0]


@pytest.mark.long
def test_a_yard_to_forty_metres():
    scan, what = Yard(seed=102, relief_m=0.02, noise_m=0.01, size_m=40.0).scan(0.4)
    assert largest(owners(scan), what == GROUND)[1] > 0.97


def test_what_joined_says_how_uneven_it_is_and_predicts_it():
    scan, what = Yard(seed=0, relief_m=0.02).scan()
    seen = observe(scan, scan.world_from_sensor)
    regions = segment(seen, SegmentationOptions())
    ground = max(regions, key=lambda one: np.count_nonzero(what.ravel()[one.pixels.flat] == GROUND))
    assert 0.0015 < ground.relief_m < 0.006  # waves of 20 mm from crest to trough
    sd = ground.fit.standard_deviation(seen.points_at(ground.pixels.flat[::1000]))
    assert sd.min() >= 0.9 * ground.relief_m
    assert FLATNESS_M <= typical_relief([regions]) <= 0.006


@pytest.mark.long
def test_stated_flatness_joins_and_parts():
    scan, _ = Yard(seed=0, relief_m=0.02, noise_m=0.002).scan()
    n = {flat: len(segmented(scan, flat)) for flat in (0.0005, 0.01)}
    assert n[0.01] < n[0.0005]


def segmented(scan: RangeImage, flatness_m: float) -> list[Region]:
    seen = observe(scan, scan.world_from_sensor)
    return segment(seen, SegmentationOptions(flatness_m=flatness_m))


def test_no_planes_have_no_relief():
    assert typical_relief([[], []]) == FLATNESS_M


def test_plates_of_pieces_together_weigh_by_pixels():
    seen = observed()
    one, other = (
        plate_of(region.fit.surface, region.pixels, seen)
        for region in segment(seen, SegmentationOptions())[:2]
    )
    both = together([one, other])
    share = len(both.points) - len(one.points)
    assert both.n_pixels == one.n_pixels + other.n_pixels
    assert share / len(both.points) == pytest.approx(other.n_pixels / both.n_pixels, abs=0.15)
    assert together([one]).relief(one.plane) == one.relief(one.plane) < FLATNESS_M


def test_pieces_touch_across_four_pixels_and_no_farther():
    seen = observed()
    rows, columns = seen.scan.shape
    labels = np.zeros((rows, columns), dtype=np.int64)
    labels[:, : columns // 2], labels[:, columns // 2 + 3 :] = 1, 2
    near = find_seams([pixels(labels, k) for k in (1, 2)], seen)
    assert list(near) == [(0, 1)]
    assert len(near[0, 1]) == rows
    labels[:, columns // 2 + 3 : columns // 2 + 8] = 0
    assert find_seams([pixels(labels, k) for k in (1, 2)], seen) == {}
    assert find_seams([], seen) == {}


def pixels(labels: IntArray, k: int) -> PixelSet:
    return PixelSet.of(labels == k)


@pytest.mark.long
@requires_data
def test_a_real_floor_is_one_surface():
    (scan,) = read_request(ScanRequest((str(data_path("range/align3d_sample2")) + "#1",), up="auto")).scans
    owner = owners(scan)
    points = scan.points()
    below = np.nan_to_num(points[..., 2], posinf=0, neginf=0) < -1.405  # the rug lies 25 mm higher
    near = below & (np.nan_to_num(points[..., 1], posinf=9) < 7.0)
    assert largest(owner, near)[1] > 0.9
