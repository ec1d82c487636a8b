# SPDX-License-Identifier: MIT
"""What a scan surely did not get to is hidden from it, place by place; and blocks change nothing."""

import numpy as np
import pytest

from completion.evidence import evidence as module
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Scans, weigh
from completion.evidence.form import form_of
from completion.evidence.reach import is_beyond, reach_of
from completion.evidence.sight import look, pixel_of, sight_of
from completion.observe.observation import observe
from completion.observe.rays import deviation_at
from completion.observe.tolerance import EvidenceOptions
from completion.observe.triple import triple
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

TOLERANCE = EvidenceOptions().tolerance(registration_m=0.002)
PROJECTIONS = {
    "pinhole": PinholeProjection(90, 70, 60.0, 62.0, 44.0, 35.0),
    "turning": SphericalProjection(
        np.linspace(-np.pi, np.pi, 120, endpoint=False), np.linspace(1.0, -0.9, 60)
    ),
    "rising": SphericalProjection(np.linspace(-0.7, 0.8, 80), np.linspace(-0.5, 1.2, 50) ** 3),
}


def draw_scan(kind, seed):
    """A scan of near and far patches, of holes and of noise, from anywhere."""
    rng = np.random.default_rng(seed)
    camera = PROJECTIONS[kind]
    ranges = np.kron(rng.uniform(0.5, 4.0, (6, 6)), np.ones((20, 20)))[: camera.shape[0], : camera.shape[1]]
    ranges = np.pad(
        ranges, [(0, size - held) for size, held in zip(camera.shape, ranges.shape, strict=True)], mode="edge"
    )
    ranges = ranges + rng.normal(0, 0.003, camera.shape)
    ranges[rng.random(camera.shape) < 0.1] = np.nan
    eye = rng.uniform(-1, 1, 3)
    pose = Pose.looking_at(eye, eye + rng.normal(size=3))
    return RangeImage(ranges, camera, pose)


@pytest.mark.parametrize("kind", PROJECTIONS)
def test_beyond_means_hidden_at_every_place(kind):
    rng, n_beyond = np.random.default_rng(5), 0
    for trial in range(60):
        seen = observe(draw_scan(kind, trial), Pose.identity(), 0.003)
        sight, reach = sight_of(seen, TOLERANCE), reach_of(seen)
        normal, middle = (
            rng.normal(size=3),
            seen.scan.origin + rng.normal(size=3) * rng.choice([1.0, 3.0, 9.0]),
        )
        plane, radius = Plane(middle, normal), float(rng.uniform(0.02, 0.6))
        height, sd = float(plane.distance(seen.scan.origin[None])[0]), float(rng.uniform(0, 0.01))
        if not is_beyond(sight.eye, sight.angles, reach, triple(middle), radius, height, sd):
            continue
        n_beyond += 1
        turn = rng.uniform(0, 2 * np.pi, 200)
        at = plane.to_uv(middle[None]) + (radius * np.sqrt(rng.random(200)) * [np.cos(turn), np.sin(turn)]).T
        for place in plane.from_uv(at):
            pixel = pixel_of(sight.eye, sight.angles, triple(place))
            if pixel >= 0 and np.isfinite(sight.ranges[pixel]):
                beam = sight.ranges[pixel], deviation_at(sight.noise, sight.ranges[pixel])
                said = look(sight.eye, form_of(plane), triple(place), sd, beam)
                assert said.behind > said.allowed
    assert n_beyond > 8


def test_evidence_is_the_same_with_blocks_left_out_and_without(monkeypatch):
    scans = [draw_scan("turning", seed) for seed in range(5)] + [
        draw_scan("pinhole", seed) for seed in range(5)
    ]
    observations = tuple(observe(scan, Pose.identity(), 0.003) for scan in scans)
    owners = tuple(
        np.full(seen.valid.shape, number % 3, np.int32) for number, seen in enumerate(observations)
    )
    grid = ChartGrid.over(
        Plane((0.5, 0.2, 0.1), (0.2, 1.0, 0.3)),
        np.array([-9.0, -9.0]),
        np.array([9.0, 9.0]),
        0.1,
        full_turn=False,
    )
    held, sd = Scans(observations, owners, TOLERANCE), np.full(grid.shape[0] * grid.shape[1], 0.002)
    found = weigh(grid, sd, held, 1)
    nothing = tuple(
        one._replace(far=np.full_like(one.far, 1e9)) for one in held.reach
    )  # no block is left out
    object.__setattr__(held, "reach", nothing)
    plain = weigh(grid, sd, held, 1)
    for name in Evidence.__slots__:
        np.testing.assert_array_equal(getattr(found, name), getattr(plain, name), err_msg=name)
    assert min(grid.shape) > module._BLOCK
    assert (found.labels == module.Label.OCCLUDED).mean() > 0.2
