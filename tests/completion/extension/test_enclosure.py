# SPDX-License-Identifier: MIT
"""Which surfaces enclose a room: walls with niches and vaults do, what stands in the room does not."""

import numpy as np
import pytest

from completion import Completion, CompletionOptions, complete
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane

CAMERA = PinholeProjection(160, 120, 110.0, 110.0, 79.5, 59.5)
POSE = Pose.looking_at((0.0, 0.0, 1.4), (0.0, 3.0, 1.3))
REACH_M = 6.0


def scan_of(*ranges) -> RangeImage:
    """The nearest of ranges (n,) of the camera's rays, as a noise-free scan."""
    nearest = np.min(ranges, axis=0).reshape(CAMERA.directions().shape[:2])
    return RangeImage(np.where(nearest < REACH_M, nearest, np.inf), CAMERA, POSE, sigma_m=0.001)


def rays():
    directions = POSE.rotate(CAMERA.directions()).reshape(-1, 3)
    return np.broadcast_to(POSE.translation, directions.shape), directions


def within(plane, low, high, *, inside=True):
    """Ranges to a plane inside or outside a rectangle of x and z."""
    origins, directions = rays()
    reach = plane.ray_ranges(origins, directions)
    at = origins + np.where(np.isfinite(reach), reach, 0.0)[:, None] * directions
    hit = ((at[:, [0, 2]] > low) & (at[:, [0, 2]] < high)).all(axis=1)
    return np.where(hit == inside, reach, np.inf)


def completed(scan) -> Completion:
    return complete(scan, CompletionOptions(texture=False), rng=0)


def patch_on(found, surface):
    """The patch whose surface the given one is."""
    for patch in found.patches:
        points = patch.grid.surface.from_uv(patch.grid.centres_uv()[patch.observed])
        at = found.world_from_reference.apply(points)
        facing = np.einsum(
            "ij,ij->i",
            found.world_from_reference.rotate(patch.grid.surface.normal(points)),
            surface.normal(at),
        )
        if np.abs(surface.distance(at)).max() < 0.02 and facing.min() > 0.99:
            return patch
    raise LookupError(surface)


WALL, BACK, FLOOR = Plane((0, 3, 0), (0, -1, 0)), Plane((0, 3.4, 0), (0, -1, 0)), Plane((0, 0, 0), (0, 0, 1))
NICHE = np.array([-0.4, 0.5]), np.array([1.0, 2.2])


def before_a_niche() -> RangeImage:
    """A wall and a floor; in the wall a niche that many beams end in; its sides absorb light."""
    origins, directions = rays()
    lit = within(WALL, *NICHE, inside=False)
    deep = np.where(np.isinf(lit), within(BACK, *NICHE), np.inf)
    return scan_of(lit, deep, FLOOR.ray_ranges(origins, directions))


def test_a_wall_encloses_though_much_is_seen_through_its_niche():
    scan = before_a_niche()
    share = np.mean(scan.points()[scan.valid][:, 1] > 3.2)
    assert share > 0.13
    found = completed(scan)
    assert patch_on(found, WALL).limits.encloses


def test_the_back_of_a_niche_does_not_go_on_behind_the_wall():
    found = completed(before_a_niche())
    back = patch_on(found, BACK)
    at = found.world_from_reference.apply(back.grid.centres()[back.hypothesised.ravel()])
    beside = (at[:, 0] < NICHE[0][0] - 0.1) | (at[:, 0] > NICHE[1][0] + 0.2)
    assert beside.sum() * back.grid.cell_area < 0.02


def test_the_front_of_a_box_does_not_enclose():
    origins, directions = rays()
    box = Plane((0, 2, 0), (0, -1, 0))
    front = within(box, np.array([-0.6, 0.0]), np.array([0.5, 1.0]))
    ranges = front, WALL.ray_ranges(origins, directions), FLOOR.ray_ranges(origins, directions)
    found = completed(scan_of(*ranges))
    assert not patch_on(found, box).limits.encloses
    assert patch_on(found, WALL).limits.encloses


@pytest.fixture(scope="module")
def tunnel() -> Completion:
    """A vault over a floor, and a box that hides where they meet."""
    origins, directions = rays()
    box = within(Plane((0, 1.5, 0), (0, -1, 0)), np.array([0.4, 0.0]), np.array([1.3, 0.8]))
    ranges = VAULT.ray_ranges(origins, directions), FLOOR.ray_ranges(origins, directions), box
    return completed(scan_of(*ranges))


VAULT = Cylinder((0, 0, 0.8), (0, 1, 0), 1.5, concave=True)


def test_a_floor_ends_at_the_vault(tunnel):
    floor = patch_on(tunnel, FLOOR)
    assert floor.hypothesised_m2 > 0.1
    mesh = tunnel.hypothesised
    at = tunnel.world_from_reference.apply(mesh.vertices)
    assert VAULT.distance(at).min() > -0.01
    assert FLOOR.distance(at).min() > -0.01


def test_a_pipe_seen_from_outside_does_not_enclose():
    origins, directions = rays()
    pipe = Cylinder((0, 2.5, 0), (0, 0, 1), 0.4)
    ranges = pipe.ray_ranges(origins, directions), WALL.ray_ranges(origins, directions)
    found = completed(scan_of(*ranges))
    assert patch_on(found, pipe).limits.enclosures
    shapes = [cut for patch in found.patches for cut in patch.limits.cuts]
    assert shapes
    assert not any(isinstance(shape, Cylinder) for shape in shapes)
