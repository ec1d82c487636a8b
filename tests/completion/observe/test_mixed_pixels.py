# SPDX-License-Identifier: MIT
"""Mixed pixels of wide beams are found and say nothing; thin beams, and limbs of columns, are left alone."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cases.rooms import random_case
from completion import CompletionOptions, complete
from completion.boundary.meshing import mesh_cells
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.free_space import free_cells
from completion.evidence.reach import reach_of
from completion.evidence.sight import sight_of
from completion.observe.mixed_pixels import MixedBeams, find_mixed
from completion.observe.observation import Observation, observe
from completion.observe.tolerance import EvidenceOptions
from completion.result.audit import audit, bundle
from nbv.scanning.beam import Footprint
from nbv.scanning.effects import Effects
from nbv.scanning.noise_models import ConstantNoise
from scenes.checks import BoolArray
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane
from tests.helpers.long_cases import first_in_gate

SIGMA_M = 0.002
CAMERA = PinholeProjection.from_fov(240, 180, 60)
NOISE = np.random.default_rng(0).normal(0, SIGMA_M, CAMERA.shape)


def room(width: float) -> RangeImage:
    """A generated room before a phase scanner whose beam is so many pixels wide."""
    case = random_case(0)
    effects = Effects(noise=ConstantNoise(constant_m=SIGMA_M))
    if width:
        angle = width * case.views[0].sensor.projection.pixel_angle
        effects = replace(effects, footprint=Footprint(divergence_rad=angle, returns="mean"))
    return case.scans(effects, 0)[0]


def found_in(scan: RangeImage) -> BoolArray:
    seen = observe(scan, scan.world_from_sensor)
    return scan.valid & ~seen.valid


@pytest.mark.parametrize("width", first_in_gate(1, [4, 2]))
def test_what_lies_between_two_surfaces_is_found(width):
    scan = room(width)
    truth = scan.truth.ranges
    mixed = scan.valid & (np.abs(scan.ranges - truth) > 0.05)
    found = found_in(scan)
    assert found[mixed].mean() > 0.7
    beside = np.zeros_like(mixed)  # beams that met two surfaces, if only in part
    for shift in range(-width, width + 1):
        for axis in (0, 1):
            beside |= np.abs(np.roll(truth, shift, axis) - truth) > 0.03
    assert found[~beside].mean() < 1e-3


def test_a_thin_beam_has_none():
    assert not found_in(room(0)).any()


def before_wall(ranges_of_wall: float = 3.0) -> tuple[np.ndarray, BoolArray]:
    column = Cylinder((0, 0, 2), (0, 1, 0), 0.3)
    near = column.ray_ranges(np.zeros(3), CAMERA.directions().reshape(-1, 3)).reshape(CAMERA.shape)
    wall = ranges_of_wall / CAMERA.directions()[..., 2]
    return np.where(np.isfinite(near), near, wall), np.isfinite(near)


def test_the_limb_of_a_column_is_not_mixed():
    ranges, _ = before_wall()
    scan = RangeImage(ranges + NOISE, CAMERA, Pose.identity(), sigma_m=SIGMA_M)
    assert not found_in(scan).any()


def veiled(width: int) -> RangeImage:
    """A board before a wall, with so many mixed pixels around it."""
    share = np.zeros(CAMERA.shape)
    share[50:130, 80:160] = 1.0
    for _ in range(width):
        share = (share + np.roll(share, 1, 0) + np.roll(share, 1, 1) + np.roll(share, (1, 1), (0, 1))) / 4
    depth = 1.5 * share + 3.0 * (1 - share)
    return RangeImage((depth + NOISE) / CAMERA.directions()[..., 2], CAMERA, Pose.identity(), sigma_m=SIGMA_M)


def test_the_wall_behind_a_veil_is_filled_and_the_reader_told():
    completed = complete(veiled(4), CompletionOptions(texture=False))
    wall = max(completed.patches, key=lambda patch: patch.observed_m2)
    board = 80 * 80 * (3.0 / CAMERA.fx) ** 2  # seen from the camera, on the wall
    assert wall.hypothesised_m2 > 0.97 * board
    assert completed.free_space_violation_m2 == 0
    assert any("lie between two surfaces" in text for text in completed.warnings)


def passed_by(seen: Observation, low: tuple[float, float], high: tuple[float, float]) -> tuple[float, float]:
    """Shares of a board 1 m before the camera that beams passed: by the evidence, and by the audit."""
    board = Plane((0, 0, 1.0), (0, 0, -1), (1, 0, 0))
    grid = ChartGrid.over(board, low, high, 0.01, full_turn=False)
    tolerance, n = EvidenceOptions().tolerance(), grid.shape[0] * grid.shape[1]
    free = free_cells(grid, np.zeros(n), [sight_of(seen, tolerance)], [reach_of(seen)])
    mesh = mesh_cells(grid, np.ones(grid.shape, dtype=np.bool_), (), (), merged=False)
    sd = np.zeros(len(mesh.vertices))
    violation = audit(mesh.vertices, mesh.faces, sd, [seen], [bundle(seen)], tolerance=tolerance).violation_m2
    return float(np.mean(free)), violation / (n * grid.cell_area)


def only_mixed(depth: float) -> Observation:
    """A scan whose beams were left out but for those at its right rim, with readings at some depth."""
    ranges = depth / CAMERA.directions()[..., 2]
    seen = observe(RangeImage(ranges, CAMERA, Pose.identity(), sigma_m=0.0), Pose.identity())
    mixed = np.arange(CAMERA.shape[1]) < CAMERA.shape[1] - 1 + np.zeros(CAMERA.shape)
    rim = replace(seen.scan, ranges=np.where(mixed, np.inf, ranges))
    return replace(seen, scan=rim, mixed=MixedBeams.of(ranges, mixed))


def test_a_mixed_beam_passed_what_lies_well_before_both_surfaces():
    assert passed_by(only_mixed(1.5), (-0.4, -0.3), (0.4, 0.3)) == (1, pytest.approx(1))


@pytest.mark.parametrize("depth", [1.01, 0.9])
def test_a_mixed_beam_tells_nothing_of_what_lies_near_its_range_or_beyond(depth):
    assert passed_by(only_mixed(depth), (-0.4, -0.3), (0.4, 0.3)) == (0, 0)


def test_a_place_that_only_mixed_beams_looked_at_is_no_surface():
    """The rim of a board: what stood before it would have stopped these beams."""
    seen = observe(veiled(4), Pose.identity())
    assert not seen.valid[70:110, 80:84].any()
    left, right = ((column - CAMERA.cx) / CAMERA.fx for column in (79.5, 83.5))
    passed, convicted = passed_by(seen, (left, -0.09), (right, 0.09))
    assert passed > 0.95
    assert convicted > 0.8


def test_a_sharp_image_is_told_nothing():
    seen = observe(veiled(0), Pose.identity())
    assert isinstance(seen, Observation)
    assert seen.valid.all()
    assert not seen.scan.warnings


@pytest.mark.long
def test_few_jumps_do_not_tell():
    ranges = np.full(CAMERA.shape, 3.0)
    ranges[60:70, 100:120] = 1.5
    ranges[60:70, 99] = 2.2
    assert not find_mixed(ranges, observe(veiled(0), Pose.identity()).noise.numbers()).any()
