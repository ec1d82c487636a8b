# SPDX-License-Identifier: MIT
"""Nothing is inferred where a beam went through, by an audit of its own that finds what is planted."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cases.clutter import random_clutter
from benchmarks.metrics.free_space import meet, violation_of
from benchmarks.suites.free_space import free_space
from completion import CompletionOptions, complete
from completion.result.completed_model import CompletedModel
from completion.result.labelled_points import LabelledPoints
from scenes.rays.raycast import RayCaster

OPTIONS = CompletionOptions(texture=False)


@pytest.mark.long
@pytest.mark.parametrize("n_rooms", [8, 30])
def test_nothing_is_inferred_in_free_space_and_no_scan_adds_any(n_rooms) -> None:
    printed = "\n".join(free_space(n_rooms, 5000))  # raises where the law is broken
    assert "noise-free: 0 of " in printed
    assert "made the violation larger in 0 of " in printed


def test_the_same_seed_gives_the_same_clutter() -> None:
    one, same, other = random_clutter(3), random_clutter(3), random_clutter(4)
    assert one.scans[0].ranges.tobytes() == same.scans[0].ranges.tobytes()
    assert one.mode == same.mode
    assert one.scene.mesh.vertices.tobytes() != other.scene.mesh.vertices.tobytes()
    kinds = [random_clutter(seed) for seed in range(30)]
    assert {len(clutter.scans) for clutter in kinds} == {1, 2, 3}
    assert {clutter.mode for clutter in kinds} == {"conservative", "standard", "bold"}
    assert {"none", "gaussian-5mm"} <= {clutter.noise for clutter in kinds}


@pytest.mark.parametrize("seed", range(3))
def test_pairs_of_rays_and_triangles_are_those_of_the_ray_caster(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scan = random_clutter(seed).scans[0]
    rays = scan.rays().reshape(-1, 3)
    size = 10.0 ** rng.uniform(-2, 0.5, (200, 1, 1))  # from a pixel's size to more than the view
    corners = scan.origin + rng.normal(size=(200, 1, 3)) * 2 + size * rng.normal(size=(200, 3, 3))
    ray, triangle, distance, cosine = meet(scan.origin, rays, corners)
    nearest = np.full(len(rays), np.inf)
    np.minimum.at(nearest, ray, distance)
    hits = RayCaster(corners.reshape(-1, 3), np.arange(600).reshape(-1, 3)).first_hit(scan.origin[None], rays)
    differ = ~np.isclose(nearest, hits.ranges, rtol=1e-5)
    assert differ.mean() < 2e-3  # rays that graze an edge
    first = (distance == nearest[ray]) & ~differ[ray] & (cosine > 1e-3)
    assert (triangle[first] == hits.face[ray[first]]).all()
    np.testing.assert_allclose(cosine[first], hits.incidence_cosine[ray[first]], atol=2e-3)


def moved(completed: CompletedModel, towards: np.ndarray, share: float) -> LabelledPoints:
    """The inferred area moved by a share of the way to a place of the working frame."""
    mesh = completed.hypothesised
    return replace(mesh, vertices=mesh.vertices + share * (towards - mesh.vertices))


@pytest.mark.parametrize("noise", ["none", "gaussian-5mm"])
def test_what_is_moved_before_seen_surface_is_found(noise: str) -> None:
    seed = next(
        s for s in range(40) if (clutter := random_clutter(s)).noise == noise and len(clutter.scans) > 1
    )
    scans = random_clutter(seed).scans
    completed = complete(scans, OPTIONS, rng=0)
    assert violation_of(completed, scans, OPTIONS, len(scans)).n_faces == 0
    # In the first scan inferred area moves along its own shadow; the others look through it from aside.
    planted = violation_of(completed, scans, OPTIONS, len(scans), moved(completed, np.zeros(3), 0.3))
    assert planted.area_m2 > 0.01
    assert planted.deepest_m > 0.05


def test_one_beam_convicts_without_noise_and_two_with_it() -> None:
    clutter = random_clutter(6)  # one noise-free panorama
    (scan,) = clutter.scans
    completed = complete(scan, OPTIONS, rng=0)
    row, column = np.argwhere(scan.valid & (scan.ranges > 1.0))[0]
    beam = scan.points_in_sensor()[row, column] * 0.5
    across = np.cross(beam, [0.3, 0.5, 0.8])
    across /= np.linalg.norm(across)
    up = np.cross(beam, across) / np.linalg.norm(beam)
    small = 1e-3 * np.array([across, -across + up, -across - up])
    mesh = replace(
        completed.hypothesised,
        vertices=beam + small,
        faces=np.array([[0, 1, 2]], np.int32),
        surface=np.ones(3, np.int32),
        sd=np.zeros(3),
    )
    assert violation_of(completed, [scan], OPTIONS, 1, mesh).n_faces == 1
    assert violation_of(completed, [replace(scan, sigma_m=1e-3)], OPTIONS, 1, mesh).n_faces == 0
    twice = [replace(scan, sigma_m=1e-3)] * 2  # two scans' beams
    assert violation_of(completed, twice, OPTIONS, 1, mesh).n_faces == 1
