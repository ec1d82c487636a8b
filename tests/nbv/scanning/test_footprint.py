# SPDX-License-Identifier: MIT
"""Footprint: equal areas, returns against a slow reference, mixed pixels only at jump edges."""

import numpy as np
import pytest

from nbv.scanning.beam import N_RAYS, Footprint, Intensity, beam_pattern, sub_rays
from nbv.scanning.echoes import ALL, FIRST, LAST, MEAN, STRONGEST, merge_returns
from nbv.scanning.effects import Effects
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.checks import InputError, read_only_view
from tests.helpers.sheet_scenes import EAST, before_wall, sheets

SENSOR = PinholeSensor(fov_deg=22, width=220, height=220)
WIDE = Footprint(divergence_rad=0.006, exit_diameter_m=0.004, returns="mean")


def scan(footprint, scene=None):
    return scan_scene(scene or before_wall(), EAST, SENSOR, effects=Effects(footprint=footprint), rng=0)


def distance_to_edge():
    """Angle in radians between each pixel's ray and the silhouette of the square before the wall."""
    rays = SENSOR.projection.directions()
    x, y = rays[..., 0] / rays[..., 2] * 2, rays[..., 1] / rays[..., 2] * 2
    inside = np.maximum(np.abs(x), np.abs(y)) - 0.3
    outside = np.hypot(np.maximum(np.abs(x) - 0.3, 0), np.maximum(np.abs(y) - 0.3, 0))
    return np.where(inside > 0, outside, -inside) / 2


@pytest.mark.parametrize("returns", ["mean", "first", "strongest", "last"])
def test_away_from_jump_edges_a_beam_measures_what_its_middle_ray_meets(returns):
    scanned = scan(Footprint(divergence_rad=0.006, exit_diameter_m=0.004, returns=returns))
    away = scanned.valid & (distance_to_edge() > 0.003 + 0.002 / 2 + 1e-4)
    assert away.mean() > 0.8
    assert np.abs(scanned.range_error()[away]).max() < 2e-5  # of 3 m: the beam's own curvature
    assert (scanned.truth.n_rays[away] == N_RAYS).all()


def test_mixed_pixels_lie_at_jump_edges_and_between_the_depths():
    scanned = scan(WIDE)
    depth = scanned.ranges * SENSOR.projection.directions()[..., 2]
    mixed = scanned.valid & (np.abs(depth - 2) > 1e-3) & (np.abs(depth - 3) > 1e-3)
    assert mixed.sum() > 100
    assert depth[mixed].min() > 2
    assert depth[mixed].max() < 3
    assert distance_to_edge()[mixed].max() <= 0.003 + 0.002 / 2 + 1e-4
    edge = np.abs(distance_to_edge()) < 0.001
    assert mixed[edge & scanned.valid].mean() > 0.9


@pytest.mark.parametrize(
    ("returns", "share"), [("first", (0.95, 1)), ("last", (0, 0.05)), ("strongest", (0.5, 0.9))]
)
def test_a_pulse_reports_one_of_the_two_depths(returns, share):
    scanned = scan(Footprint(divergence_rad=0.006, exit_diameter_m=0.004, returns=returns))
    depth = scanned.ranges * SENSOR.projection.directions()[..., 2]
    near = np.abs(depth - 2) < 3e-3  # a part of a slanted footprint is not at the depth of its middle
    assert (near | (np.abs(depth - 3) < 3e-3)).all()
    at_edge = np.abs(distance_to_edge()) < 0.003
    assert share[0] <= near[at_edge].mean() <= share[1]


def test_returns_within_the_range_resolution_merge():
    pulse = Footprint(divergence_rad=0.006, returns="first", range_resolution_m=1.5)
    merged, mean = scan(pulse), scan(Footprint(divergence_rad=0.006, returns="mean"))
    assert np.abs(merged.ranges - mean.ranges).max() < 1e-12


def test_mixed_pixels_lean_towards_the_brighter_side():
    extents = (2.0, -5, 0, -20, 20), (3.0, -20, 20, -20, 20)
    pixel = PinholeSensor(fov_deg=1e-3, width=1, height=1)
    effects = Effects(footprint=WIDE)
    dark, bright = (
        scan_scene(sheets(*extents, colours=(near, 0.5)), EAST, pixel, effects=effects, rng=0).ranges[0, 0]
        for near in (0.1, 0.9)
    )
    weights = np.array([1 / 4, 1 / 9])
    even = (weights @ [2, 3]) / weights.sum()
    assert 2 < bright < even < dark < 3


def test_part_of_a_beam_brings_back_part_of_the_light():
    scene = sheets((2.0, -5, 0, -20, 20), colours=(1.0,))
    pixel = PinholeSensor(fov_deg=1e-3, width=1, height=1)
    light = Intensity(reference_range_m=2.0)
    half = scan_scene(scene, EAST, pixel, effects=Effects(footprint=WIDE, intensity=light), rng=0)
    assert 6 <= half.truth.n_rays[0, 0] <= 10
    assert half.intensity[0, 0] == pytest.approx(half.truth.n_rays[0, 0] / 16, rel=1e-3)


def test_the_pattern_samples_equal_areas_about_the_centre():
    pattern = beam_pattern()
    assert pattern.shape == (N_RAYS, 2)
    assert np.abs(pattern.mean(axis=0)).max() < 1e-12
    radius = np.linalg.norm(pattern, axis=1)
    assert radius.max() < 1
    assert (radius < 0.5).sum() == 4  # the inner quarter of the area
    assert np.mean(radius**2) == pytest.approx(0.5)  # as over a disc
    assert np.abs(pattern.T @ pattern / N_RAYS - np.eye(2) / 4).max() < 1e-12


def test_sub_rays_fill_the_beam():
    drawn = np.random.default_rng(0).standard_normal((50, 3))
    along = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
    along[0] = [0, 0, -1.0]
    beam = Footprint(divergence_rad=0.01, exit_diameter_m=0.02)
    starts, directions = sub_rays(along, beam, np.linspace(0, 6, 50))
    ends = (starts + directions * 5.0).reshape(50, N_RAYS, 3)
    off = np.linalg.norm(ends - 5.0 * along[:, None], axis=2)
    assert np.allclose(off, np.linalg.norm(beam_pattern(), axis=1) * beam.diameter_m(np.array(5.0)) / 2)
    assert np.abs(np.einsum("bij,bj->bi", starts.reshape(50, N_RAYS, 3), along)).max() < 1e-12


def slow_returns(ranges, cosine, rho, which, resolution):
    """Range, cosine, reflectivity and rays of the chosen return and of all, by plain Python."""
    hits = sorted((r, c, w) for r, c, w in zip(ranges, cosine, rho, strict=True) if np.isfinite(r))
    groups = []
    for hit in hits:
        if groups and (which == MEAN or hit[0] - groups[-1][-1][0] <= resolution):
            groups[-1].append(hit)
        else:
            groups.append([hit])
    if not groups:
        return [np.inf, 0, 0, 0], []
    light, merged = [], []
    for group in groups:
        part = np.array(group)
        weight = np.maximum(part[:, 1] * part[:, 2], 1e-12) / part[:, 0] ** 2
        light.append(weight.sum())
        merged.append([*(weight @ part / weight.sum()), len(part)])
    return merged[{LAST: -1, STRONGEST: int(np.argmax(light))}.get(which, 0)], merged


@pytest.mark.parametrize("which", [FIRST, STRONGEST, LAST, MEAN, ALL])
def test_returns_agree_with_the_slow_reference(which):
    rng = np.random.default_rng(which)
    ranges = rng.choice([1.0, 1.05, 1.3, 2.0, np.inf], (300, 16)) + rng.uniform(0, 0.02, (300, 16))
    ranges[0] = np.inf
    cosine, rho = read_only_view(rng.uniform(0, 1, (300, 16))), rng.uniform(0, 1, (300, 16))
    out, more = np.empty((4, 300)), np.empty((5, 4800))
    n_more, further = merge_returns(ranges, cosine, rho, which, 0.1, out, more), []
    for beam in range(300):
        expected, merged = slow_returns(ranges[beam], cosine[beam], rho[beam], which, 0.1)
        np.testing.assert_allclose(out[:, beam], expected, rtol=1e-9)
        further += [[beam, *one] for one in merged[1:]]
    if which == ALL:
        np.testing.assert_allclose(more[:, :n_more].T, further, rtol=1e-9)
    else:
        assert n_more == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"divergence_rad": -1.0}, "divergence_rad must be between"),
        ({"divergence_rad": 0.0}, "a divergence or an exit diameter"),
        ({"divergence_rad": 0.001, "returns": "second"}, "first, strongest, last, mean, all, got 'second'"),
        ({"divergence_rad": 0.001, "range_resolution_m": 0.0}, "strongest returns need a range_resolution_m"),
        ({"divergence_rad": 0.001, "range_resolution_m": -1.0}, "range_resolution_m must be 0 or more"),
    ],
)
def test_impossible_footprints_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        Footprint(**options)
