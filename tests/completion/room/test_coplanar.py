# SPDX-License-Identifier: MIT
"""Pieces of one floor or wall are one surface; what lies a step apart, and tables of one height, are not."""

import numpy as np
import pytest

from completion.merging.scan_surfaces import SurfaceOptions, find_surfaces
from completion.room.coplanar import join_coplanar
from completion.room.planes import RoomPlane
from scenes.inclination import Up
from scenes.pose import Pose
from scenes.run.journal import NO_JOURNAL
from scenes.run.steps import Steps
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage

CAMERA = PinholeProjection.from_fov(160, 120, 70)
UP = Up(np.array([0.0, -1.0, 0.0]), 1.0)
HEIGHT_M, FAR_M = 1.5, 4.0
SIGMA_M = 0.003


def room(step_m: float = 0.0, table_m: float | None = None) -> RangeImage:
    """A floor with a wall at its end, cut in two by a board on the floor; the right part lies a step lower.

    y is down, z forward. Tables of one height stand on both sides where asked for.
    """
    rays = CAMERA.directions()
    with np.errstate(divide="ignore"):
        down = np.where(rays[..., 1] > 0, HEIGHT_M / rays[..., 1], np.inf)
        lower = np.where(rays[..., 1] > 0, (HEIGHT_M + step_m) / rays[..., 1], np.inf)
        wall = FAR_M / rays[..., 2]
        ranges = np.minimum(np.where(rays[..., 0] > 0, lower, down), wall)
        if table_m is not None:
            top = np.where(rays[..., 1] > 0, (HEIGHT_M - table_m) / rays[..., 1], np.inf)
            place = top[..., None] * rays
            on_it = (np.abs(np.abs(place[..., 0]) - 1.0) < 0.5) & (np.abs(place[..., 2] - 2.2) < 0.5)
            ranges = np.where(on_it & (top < ranges), top, ranges)
    board = 1.2 / rays[..., 2]
    before = (np.abs(board * rays[..., 0]) < 0.12) & (board < ranges)
    ranges = np.where(before, board, ranges)
    ranges = ranges + np.random.default_rng(0).normal(0, SIGMA_M, ranges.shape)
    return RangeImage(ranges, CAMERA, Pose.identity(), sigma_m=SIGMA_M)


def level_pieces(scan: RangeImage, *, across: bool) -> list[RoomPlane]:
    """Level planes of more than a tenth of a square metre after joining, of regions that are not merged."""
    with Steps.over([scan.ranges.size], 1, None, NO_JOURNAL) as steps:
        found = find_surfaces([scan], SurfaceOptions(across=False), steps)
    seen, flatness_m = found.observations, found.tolerance.flatness_m
    planes = [RoomPlane.of(surface, seen, flatness_m) for surface in found.surfaces]
    surfaces = join_coplanar(found.surfaces, planes, seen, flatness_m, UP) if across else found.surfaces
    looked_at = [RoomPlane.of(surface, seen, flatness_m) for surface in surfaces]
    return [
        plane
        for plane in looked_at
        if plane is not None and plane.area_m2 > 0.1 and abs(plane.normal @ UP.direction) > 0.99
    ]


def test_a_floor_that_a_board_cuts_in_two_is_one():
    assert len(level_pieces(room(), across=False)) == 2
    (floor,) = level_pieces(room(), across=True)
    assert float(floor.middle @ UP.direction) == pytest.approx(-HEIGHT_M, abs=0.003)


def test_a_floor_with_a_step_is_two():
    assert len(level_pieces(room(step_m=0.06), across=True)) == 2


def test_tables_of_one_height_stay_apart():
    heights = [float(plane.middle @ UP.direction) for plane in level_pieces(room(table_m=0.7), across=True)]
    assert sum(height > -HEIGHT_M + 0.5 for height in heights) == 2


def test_pixels_are_of_one_surface_each():
    scan = room()
    with Steps.over([scan.ranges.size], 1, None, NO_JOURNAL) as steps:
        found = find_surfaces([scan], SurfaceOptions(), steps)
    seen, flatness_m = found.observations, found.tolerance.flatness_m
    planes = [RoomPlane.of(surface, seen, flatness_m) for surface in found.surfaces]
    surfaces = join_coplanar(found.surfaces, planes, seen, flatness_m, UP)
    pixels = np.concatenate([surface.pixels[0].flat for surface in surfaces])
    assert len(np.unique(pixels)) == len(pixels)
    assert len(pixels) >= sum(surface.n_pixels for surface in found.surfaces)
