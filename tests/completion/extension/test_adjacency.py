# SPDX-License-Identifier: MIT
"""Adjacency as a table: surfaces before a camera, which of them enclose and meet, and what stands on them."""

import numpy as np
import pytest

from completion.boundary.boundary_pixels import find_boundary_pixels
from completion.evidence.evidence import Scans
from completion.extension.adjacency import Adjacency, find_adjacency, stands_upright
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import PixelSet, ScanPixels, observe
from completion.observe.tolerance import EvidenceOptions
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cylinder, Plane
from tests.completion.extension.test_enclosure import FLOOR, VAULT, WALL, rays, scan_of, within

USUAL = EvidenceOptions().tolerance()
EVERYWHERE = np.array([-9.0, -9.0]), np.array([9.0, 9.0])  # rectangles of x and z
SEEN = {
    "wall": (WALL, *EVERYWHERE),
    "floor": (FLOOR, *EVERYWHERE),
    "vault": (VAULT, None, None),
    "box": (Plane((0, 2, 0), (0, -1, 0)), np.array([-0.6, 0.0]), np.array([0.0, 1.0])),
    "board": (Plane((0, 2.2, 0), (0, -1, 0)), np.array([0.3, 0.7]), np.array([1.0, 1.6])),
    "seat": (Plane((0, 0, 0.4), (0, 0, 1)), np.array([-9.0, 0.3]), np.array([0.7, 0.5])),
    "table": (Plane((0, 0, 0.8), (0, 0, 1)), np.array([-0.6, 0.7]), np.array([0.6, 0.9])),
    "back": (WALL, np.array([-9.0, 0.8]), np.array([9.0, 9.0])),
    "pipe": (Cylinder((0.8, 2.5, 0), (0, 0, 1), 0.2), None, None),
}


def adjacency_of(*names: str) -> Adjacency:
    """Of surfaces that one camera sees, the nearest in each pixel."""
    ranges = []
    for name in names:
        surface, low, high = SEEN[name]
        ranges.append(surface.ray_ranges(*rays()) if low is None else within(surface, low, high))
    scan = scan_of(*ranges)
    seen = observe(scan, Pose.identity())
    nearest = np.where(scan.valid, 1 + np.argmin(ranges, axis=0).reshape(scan.shape), 0)
    surfaces = []
    for number, name in enumerate(names, start=1):
        size = 5 if isinstance(SEEN[name][0], Cylinder) else 3
        fit = SurfaceFit(SEEN[name][0], 0.001, 1e-8 * np.eye(size), 1000)
        surfaces.append(MergedSurface(fit, ScanPixels.of([PixelSet.of(nearest == number)]), 1))
    boundaries = [find_boundary_pixels(one.fit, one.pixels, [seen], USUAL) for one in surfaces]
    return find_adjacency(surfaces, boundaries, Scans((seen,), (nearest.astype(np.int32),), USUAL))


TABLE = {  # seen; what encloses; pairs side by side; probability that a thing stands on the floor
    "a wall and a floor": ("wall floor", "wall floor", "wall-floor", 0.25),
    "a box that stands on the floor":
        ("wall floor box", "wall floor", "wall-floor wall-box floor-box", 1.25 / 2),
    "a board that hangs before the wall":
        ("wall floor board", "wall floor", "wall-floor wall-board", 0.25 / 2),
    "one that stands and one that hangs":
        ("wall floor box board", "wall floor", "wall-floor wall-box wall-board floor-box", 1.25 / 3),
    "a seat that hides nearly all of the floor":
        ("wall floor seat", "wall floor", "wall-floor wall-seat floor-seat", 0.25),
    "a pipe that stands": ("wall floor pipe", "wall floor", "wall-floor wall-pipe floor-pipe", 1.25 / 2),
    "a vault over a floor": ("vault floor", "vault floor", "vault-floor", 0.25),
}  # fmt: skip


@pytest.mark.parametrize("law", TABLE)
def test_what_is_seen_says_what_encloses_meets_and_stands(law):
    names, enclosing, meeting, standing = TABLE[law]
    names = names.split()
    found = adjacency_of(*names)
    assert [name for name, encloses in zip(names, found.encloses, strict=True) if encloses] == [
        name for name in names if name in enclosing.split()
    ]
    assert {f"{names[i]}-{names[j]}" for i, j in np.argwhere(np.triu(found.meets, 1))} == set(meeting.split())
    assert (found.meets == found.meets.T).all()
    assert found.standing[names.index("floor")] == pytest.approx(standing)
    assert (found.standing[~found.ends] == 0).all()


def test_things_end_at_what_is_lowest_and_may_be_a_table():
    """A plane half a metre below the camera, under which nothing was seen, is no floor that is continued."""
    found = adjacency_of("back", "table")
    assert found.encloses.tolist() == [True, False]
    assert found.ends.tolist() == [True, True]
    assert found.room.bases == {1}
    seat = adjacency_of("wall", "floor", "seat")
    assert seat.room.bases == set()


def fit_of(surface, sd=1e-4):
    return SurfaceFit(surface, 0.001, sd**2 * np.eye(5 if isinstance(surface, Cylinder) else 3), 1000)


def leaning(degrees):
    """A cylinder that leans out of the vertical."""
    return Cylinder((0, 0, 0), (np.sin(np.radians(degrees)), 0, np.cos(np.radians(degrees))), 0.1)


@pytest.mark.parametrize(
    ("surface", "expected"),
    [
        (WALL, True),
        (FLOOR, False),
        (Plane((0, 0, 0), (0, -1, 0.05)), True),
        (Plane((0, 0, 0), (0, -1, 0.2)), False),
        (Cylinder((0, 0, 0), (0, 0, 1), 0.1), True),
        (Cylinder((0, 0, 0), (0, 1, 0), 0.1), False),
        (leaning(9), True),
        (leaning(20), False),
    ],
)
def test_planes_and_cylinders_stand_upright_within_one_limit(surface, expected):
    assert stands_upright(fit_of(surface), fit_of(FLOOR)) == expected
