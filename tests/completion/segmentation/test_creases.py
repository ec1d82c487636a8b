# SPDX-License-Identifier: MIT
"""Edges that a window-matching camera rounds are edges; truly rounded ones, and other sensors', stay."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from completion.observe.observation import Observation, observe
from completion.observe.packed_surfaces import pack
from completion.observe.range_noise import RangeNoise
from completion.segmentation.competition import sharpen_creases
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import SegmentationOptions
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane

CAMERA = PinholeProjection.from_fov(320, 240, 45)
WINDOW = 9  # pixels
QUADRATIC = 0.0015  # noise per square of the range, 1/m
WALLS = tuple(Plane((0, 0, 0.9), (side, -0.3, -1)) for side in (-1.0, 1.0))
AXIS = np.cross(WALLS[0].normal_direction, WALLS[1].normal_direction)
AXIS /= np.linalg.norm(AXIS)


def rounding(radius: float) -> Cylinder:
    """The cylinder that touches both walls from behind."""
    inwards = np.array([WALLS[0].normal_direction, WALLS[1].normal_direction, AXIS])
    return Cylinder((0, 0, 0.9) + np.linalg.solve(inwards, [-radius, -radius, 0.0]), AXIS, radius)


def edge(radius: float, seed: int = 0) -> Observation:
    """An upright edge of 88 degrees, rounded or sharp, as a camera sees it that averages over windows."""
    rays = CAMERA.directions().reshape(-1, 3)
    ranges = np.maximum(*(wall.ray_ranges(np.zeros_like(rays), rays) for wall in WALLS))
    if radius:
        cylinder = rounding(radius)
        met = cylinder.ray_ranges(np.zeros_like(rays), rays)
        hit = np.flatnonzero(np.isfinite(met))
        sideways = cylinder.normal(met[hit, None] * rays[hit])[:, 0]
        hit = hit[np.abs(sideways) <= abs(WALLS[0].normal_direction[0])]
        ranges[hit] = met[hit]
    seen = cv2.blur(ranges.reshape(CAMERA.shape), (WINDOW, WINDOW))
    rng = np.random.default_rng(seed)
    shared = cv2.blur(rng.normal(0, WINDOW, seen.shape), (WINDOW, WINDOW))
    noise = np.sqrt(0.75) * shared + np.sqrt(0.25) * rng.normal(0, 1, seen.shape)
    return observe(RangeImage(seen + QUADRATIC * seen**2 * noise, CAMERA, Pose.identity()), Pose.identity())


def strip(observation: Observation, radius: float, half_width: int) -> tuple[FloatArray, FloatArray]:
    """Labels before and after: walls 1 and 2, and a stretch of the edge as a cylinder, 3."""
    labels = np.ones(CAMERA.shape, np.int32)
    labels[:, 160:] = 2
    labels[100:140, 160 - half_width : 160 + half_width] = 3
    models = np.array([pack(surface, np.zeros(3)) for surface in (*WALLS, rounding(radius))])
    return labels, sharpen_creases(labels, models, observation)


@pytest.mark.parametrize("seed", range(10))
def test_an_edge_rounded_by_the_camera_goes_back_to_its_walls(seed):
    before, after = strip(edge(0.0, seed), 0.015, 9)
    assert set(after[before == 3]) == {1, 2}
    assert np.array_equal(after[before != 3], before[before != 3])
    middle = after[120, 151:169]
    assert (np.diff(middle) >= 0).all()  # left to the left wall, right to the right one


@pytest.mark.parametrize("seed", range(10))
def test_a_rounded_edge_is_a_cylinder(seed):
    before, after = strip(edge(0.06, seed), 0.06, 16)
    assert np.array_equal(before, after)


@pytest.mark.parametrize("noise", [RangeNoise(0.002, 0.0), RangeNoise(0.002, 0.001)])
def test_sensors_that_average_nothing_round_nothing(noise):
    matching = edge(0.0)
    before, after = strip(replace(matching, noise=noise), 0.015, 9)
    assert np.array_equal(before, after)
    assert (matching.noise.window_pixels(1.0), noise.window_pixels(1.0)) == (WINDOW, 1)


def test_a_wide_rounded_edge_is_found_and_a_sharp_one_is_not():
    found = {
        radius: [
            region.fit.surface.radius
            for region in segment(edge(radius), SegmentationOptions())
            if isinstance(region.fit.surface, Cylinder)
        ]
        for radius in (0.0, 0.1)
    }
    assert found[0.0] == []
    assert found[0.1] == pytest.approx([0.1], abs=0.005)
