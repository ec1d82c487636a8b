# SPDX-License-Identifier: MIT
"""Gaps: the compiled search for a strip, which leaves out what cannot matter, against all of them."""

from itertools import permutations

import numpy as np
import pytest

from completion.evidence.sight import sight_of
from completion.fitting.result import SurfaceFit
from completion.merging.agreement import FittedPart
from completion.merging.gaps import Sights, gap_is_hidden
from completion.observe.observation import observe
from completion.observe.tolerance import EvidenceOptions
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane
from tests.helpers.long_cases import first_in_gate

TOLERANCE = EvidenceOptions(registration_m=0.001).tolerance()
WALL = Plane((0, 4, 0), (0, -1, 0), (1, 0, 0))
COLUMN = Cylinder((0, 4.0, 0), (0, 0, 1), 1.5, (0, -1, 0))
CAMERAS = (
    PinholeProjection.from_fov(64, 48, 80),
    SphericalProjection.regular(160, 48, 360.0, (-40.0, 40.0)),
    SphericalProjection.regular(40, 40, 20.0, (-10.0, 10.0)),
)


def scans_of(surface, through, rng):
    """Scans of a surface, in blocks hidden, without echo or crossed by beams; the last ends before it."""
    for camera, x in zip(CAMERAS, (-1.0, 0.5, 40.0), strict=True):
        pose = Pose.looking_at((x, 0.3 * x, 0.2), (0, 4, 0))
        rays = camera.directions().reshape(-1, 3) @ pose.rotation.T
        ranges = surface.ray_ranges(np.broadcast_to(pose.translation, rays.shape), rays).reshape(camera.shape)
        blocks = (camera.shape[0] // 4 + 1, camera.shape[1] // 4 + 1)
        share = [0.5 - through, 0.3, 0.2, through] if x < 40 else [0.0, 0.8, 0.2, 0.0]
        factor = np.kron(rng.choice([1.0, 0.5, np.inf, 1.4], blocks, p=share), np.ones((4, 4)))
        seen = ranges * factor[: camera.shape[0], : camera.shape[1]]
        yield observe(RangeImage(seen, camera, pose, sigma_m=0.002), Pose.identity())


def part_of(surface, middle, rng, n=120):
    points = surface.from_uv(rng.uniform(-0.4, 0.4, (n, 2)) + [middle, 0.0])
    fit = SurfaceFit(surface, 0.001, 1e-8 * np.eye(3 if surface is WALL else 5), n)
    return FittedPart.of(fit, points, 0.003, 0.001)


def nearest(points, others):
    """Indices of the others (m, 2) of each point (n, 2), nearest first."""
    return np.argsort(np.linalg.norm(points[:, None] - others[None], axis=2), axis=1, kind="stable")


def facing(uv, other):
    order = np.argsort(np.linalg.norm(uv[:, None] - other[None], axis=2).min(axis=1), kind="stable")
    return uv[np.concatenate([order[:20], order[20:][:: (len(uv) - 20) // 20][:20]])]


def is_hidden(one, other, observations):
    """The definition: all steps of all bridges against all scans, and then all strips."""
    surface = other.fit.surface
    start, end = surface.to_uv(one.points), surface.to_uv(other.points)
    first, second = facing(start, end), facing(end, start)
    along = ((np.arange(24) + 0.5) / 24)[:, None]
    uv = first[:, None, None] + along * (second[None, :, None] - first[:, None, None])
    places = surface.from_uv(uv.reshape(-1, 2))
    seen, crossed = np.zeros(len(places), bool), np.zeros(len(places), bool)
    for observation in observations:
        scan = observation.scan
        pixel = np.rint(scan.pixels(places))
        inside = np.flatnonzero(np.isfinite(pixel).all(axis=1))
        row, column = pixel[inside].astype(int).T
        echo = np.isfinite(scan.ranges[row, column])
        inside, ranges = inside[echo], scan.ranges[row[echo], column[echo]]
        ray = places[inside] - scan.origin
        distance = np.linalg.norm(ray, axis=1)
        slope = np.einsum("ij,ij->i", ray, surface.normal(places[inside])) / distance
        cosine = np.maximum(np.abs(slope), 1e-3)
        oblique = distance * scan.projection.pixel_angle * np.tan(np.arccos(cosine)) / 2
        sigma = observation.noise.deviation(ranges)
        allowed = TOLERANCE.along_ray(sigma, np.full(len(ranges), 0.003), cosine) + oblique
        crossed[inside] |= distance - ranges < -allowed
        seen[inside] = True
    bridge = (len(first), len(second), 24)
    closed = ~crossed.reshape(bridge).any(axis=2) & (seen.reshape(bridge).mean(axis=2) > 0.5)
    near_first, near_second = nearest(first, first)[:, :3], nearest(second, second)[:, :3]
    return bool((closed[near_first].all(axis=1) & closed[:, near_second].all(axis=2)).any())


@pytest.mark.parametrize("surface", first_in_gate(1, [WALL, COLUMN]), ids=["wall", "column"])
def test_a_gap_is_hidden_as_all_bridges_and_all_scans_say_in_any_order(surface):
    verdicts = []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        observations = list(scans_of(surface, 0.08 * (seed % 4), rng))
        one, other = part_of(surface, -1.0, rng), part_of(surface, 1.0, rng)
        verdicts.append(is_hidden(one, other, observations))
        for order in permutations(observations):
            sights = Sights.of([sight_of(seen, TOLERANCE) for seen in order])
            assert gap_is_hidden(one, other, sights) == verdicts[-1]
    assert 4 < sum(verdicts) < 20
