# SPDX-License-Identifier: MIT
"""Candidates: what the tree finds against a comparison of all with all, on random parts and on scans."""

import numpy as np
import pytest

from completion.fitting.result import SurfaceFit
from completion.merging.agreement import NO_DOUBT, FittedPart, PoseDoubt, compare, compare_all, lies_on
from completion.merging.candidates import find_candidates, find_hosts
from completion.observe.observation import observe
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import SegmentationOptions
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cylinder, Plane
from tests.helpers.completion_examples import example


def random_parts(n, seed, n_scans=1):
    """Parts of walls, floors and columns of a building, large and small, known well and badly, and tilted.

    Of several scans with poses that are a little off.
    """
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(n):
        place = rng.integers(0, 5, 3) * [4.0, 4.0, 2.5] + rng.normal(0, 0.01, 3)
        size, scale = 10 ** rng.uniform(-1.3, 0.5), 10 ** rng.uniform(-3.5, -2)
        if rng.random() < 0.8:
            normal = rng.choice([-1.0, 1.0]) * np.eye(3)[rng.integers(3)] + rng.normal(
                0, rng.choice([0.001, 0.3]), 3
            )
            surface = Plane(place, normal)
            uv = rng.uniform(-size, size, (50, 2)) + rng.uniform(-8, 8, 2)
        else:
            surface = Cylinder(place, np.array([0.0, 0, 1]) + rng.normal(0, 0.01, 3), rng.choice([0.1, 0.5]))
            uv = rng.uniform(-size, size, (50, 2))
        sd = np.array(
            [1e-3, 1e-3 / size, 1e-3 / size] if surface.kind == "plane" else [1e-3, 1e-3, 0.01, 0.01, 1e-3]
        )
        fit = SurfaceFit(surface, scale, np.diag(np.square(sd)), 50)
        points = surface.from_uv(uv)
        points += rng.normal(0, scale, (50, 1)) * surface.normal(points)
        doubt = NO_DOUBT if n_scans == 1 else PoseDoubt(int(rng.integers(n_scans)), 0.01, 0.003)
        parts.append(FittedPart.of(fit, points, scale, 0.001, doubt))
    return parts


def parts_of_scan(name):
    seen = observe(example(name, "gaussian-2mm"), Pose.identity())
    regions = segment(seen, SegmentationOptions(min_pixels=20))
    points = [seen.points_at(region.pixels.flat[::7]) for region in regions]
    return [
        FittedPart.of(region.fit, some, 0.002, 0.001) for region, some in zip(regions, points, strict=True)
    ]


PARTS = {
    "none": list,
    "one": lambda: random_parts(1, 0),
    "few": lambda: random_parts(20, 1),
    "many": lambda: random_parts(300, 2),
    "many others": lambda: random_parts(300, 3),
    "of several scans": lambda: random_parts(300, 4, n_scans=3),
    "occluders": lambda: parts_of_scan("two_occluders"),
    "cylinders": lambda: parts_of_scan("two_cylinders"),
}


@pytest.fixture(scope="module", params=PARTS)
def parts(request):
    return PARTS[request.param]()


def compared_with_all(parts):
    """All heights of all middles over all surfaces, and their variances."""
    middles = np.array([one.middle() for one in parts]).reshape(-1, 3)
    height = np.array([one.fit.surface.distance(middles) for one in parts])
    variance = np.array([one.variance_at(middles, one.own_doubt()) for one in parts])
    near = np.square(height) <= 25 * (variance + np.diag(variance)[None])
    curved = np.array([one.form.is_curved for one in parts])
    normal = np.array([one.fit.surface.normal(m[None])[0] for one, m in zip(parts, middles, strict=True)])
    near &= (curved[:, None] == curved[None]) & (curved[:, None] | (normal @ normal.T >= 0.5))
    return np.argwhere(np.triu(near & near.T, 1))


def test_candidates_are_those_of_a_full_comparison(parts):
    expected = compared_with_all(parts) if parts else np.zeros((0, 2))
    assert find_candidates(parts).tolist() == expected.tolist()


def test_no_host_is_missed_and_most_parts_are_none(parts):
    small = parts[::10]
    hosts = find_hosts(small, parts)
    for one, found in zip(small, hosts, strict=True):
        assert {i for i, large in enumerate(parts) if lies_on(one, large)} <= set(found)
        assert found == sorted(found)
    if len(parts) > 100:
        assert sum(map(len, hosts)) < 0.2 * len(small) * len(parts)


def test_pairs_compare_together_as_they_do_one_by_one(parts):
    pairs = find_candidates(parts)
    chi2, log_evidence = compare_all(parts, pairs)
    found = [compare(parts[i], parts[j]) for i, j in pairs]
    np.testing.assert_array_equal(chi2, [one.chi2 for one in found])
    np.testing.assert_allclose(log_evidence, [one.log_evidence for one in found], rtol=1e-12)


def test_a_wall_is_a_candidate_at_either_end_of_a_building():
    def wall(at):
        points = Plane((at, 0, 1), (0, -1, 0)).from_uv(np.random.default_rng(0).uniform(-1, 1, (100, 2)))
        fit = SurfaceFit(Plane((at, 0, 1), (0, -1, 0)), 0.002, np.diag([1e-8, 1e-8, 1e-8]), 100)
        return FittedPart.of(fit, points, 0.002, 0.0)

    assert find_candidates([wall(0.0), wall(100.0)]).tolist() == [[0, 1]]
