# SPDX-License-Identifier: MIT
"""Overlap: closed forms of stiffness, brute-force sharing, connection, and scans that really register."""

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from nbv.cover.instance import CoverInstance
from nbv.cover.overlap import OverlapGraph, OverlapOptions, components, connect
from nbv.cover.pipeline import CoverOptions
from nbv.plan.planning import plan_views
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import SurfaceSamples, sample_surface
from nbv.visibility.viewpoints import Candidates, sensor_directions
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from tests.helpers.registration_examples import displaced, points_of, register

ROOM = builtin_scene("two_occluders")
SENSOR = PinholeSensor(fov_deg=70, width=140, height=140, name="small")


def patches(*planes: tuple[tuple, tuple, tuple]) -> SurfaceSamples:
    """Return a grid of samples on unit squares: corner and two sides of each."""
    points, normals = [], []
    for corner, one, other in planes:
        u, v = (np.stack(np.meshgrid(*2 * [np.arange(10) / 10 + 0.05]), axis=-1).reshape(-1, 2)).T
        points.append(np.array(corner) + u[:, None] * np.array(one) + v[:, None] * np.array(other))
        normals.append(np.tile(np.cross(one, other), (100, 1)))
    n = 100 * len(planes)
    zeros = np.zeros(n, np.int32)
    return SurfaceSamples(np.vstack(points), np.vstack(normals), np.full(n, 0.01), zeros, zeros)


FLOOR, WALL, SIDE = (
    ((0, 0, 0), (1, 0, 0), (0, 1, 0)),
    ((0, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((0, 0, 0), (0, 0, 1), (1, 0, 0)),
)
OPPOSITE = ((1.0, 0, 0), (0, 1, 0), (0, 0, 1))


def stiffness_of(samples: SurfaceSamples) -> float:
    both = csr_array(np.ones((2, len(samples))))
    return float(OverlapGraph.of(both, samples, OverlapOptions(min_stiffness=0.0)).links(0).stiffness[1])


def test_stiffness_has_its_closed_forms():
    assert stiffness_of(patches(FLOOR)) == pytest.approx(0, abs=1e-12)
    assert stiffness_of(patches(WALL, OPPOSITE, FLOOR)) == pytest.approx(0, abs=1e-12)  # a corridor
    corner = stiffness_of(patches(FLOOR, WALL, SIDE))
    assert corner > 0.02
    stretched = patches(*(tuple(10 * np.array(part) for part in plane) for plane in (FLOOR, WALL, SIDE)))
    unit = SurfaceSamples(
        stretched.points, stretched.normals / 100, stretched.areas, stretched.face, stretched.surface
    )
    assert stiffness_of(unit) == pytest.approx(corner)


def test_stiffness_does_not_depend_on_where_the_world_lies():
    samples = patches(FLOOR, WALL, SIDE)
    motion = Pose.looking_at((30.0, -20, 5), (31, -18, 7))
    moved = SurfaceSamples(
        motion.apply(samples.points),
        motion.rotate(samples.normals),
        samples.areas,
        samples.face,
        samples.surface,
    )
    assert stiffness_of(moved) == pytest.approx(stiffness_of(samples), rel=1e-6)


def test_overlap_is_what_two_views_share_of_the_smaller():
    rng = np.random.default_rng(0)
    samples = patches(FLOOR, WALL, SIDE)
    dense = rng.uniform(size=(12, 300)) < rng.uniform(0.1, 0.9, (12, 1))
    graph = OverlapGraph.of(csr_array(dense.astype(float)), samples, OverlapOptions(min_overlap=0.4))
    links = graph.links(3)
    shared = (dense & dense[3]).sum(axis=1) / np.minimum(dense.sum(axis=1), dense[3].sum())
    assert links.overlap == pytest.approx(shared)
    assert (links.linked == (shared >= 0.4) & (np.arange(12) != 3)).all()
    assert graph.registrable.all()
    assert not OverlapGraph.of(
        csr_array(np.ones((2, 100))), patches(FLOOR), OverlapOptions()
    ).registrable.any()


def chain(n_steps: int) -> tuple[CoverInstance, OverlapGraph]:
    """Return corners in a row, far apart but for their candidates: number k sees corners k and k + 1."""
    rows = np.zeros((n_steps, n_steps + 1))
    rows[np.arange(n_steps), np.arange(n_steps)] = rows[np.arange(n_steps), np.arange(n_steps) + 1] = 1
    corner = patches(FLOOR, WALL, SIDE)
    shift = 5.0 * np.repeat(np.arange(n_steps + 1), len(corner))[:, None] * np.array([1, 0, 0])
    n = n_steps + 1
    samples = SurfaceSamples(
        np.tile(corner.points, (n, 1)) + shift,
        np.tile(corner.normals, (n, 1)),
        np.tile(corner.areas, n),
        np.tile(corner.face, n),
        np.tile(corner.surface, n),
    )
    matrix = csr_array(np.repeat(rows, len(corner), axis=1))
    return CoverInstance(matrix, samples.areas), OverlapGraph.of(matrix, samples, OverlapOptions())


def test_views_are_added_until_all_hang_together_and_no_more():
    instance, graph = chain(5)
    joined = connect(instance, graph, (0, 2, 4))
    assert set(joined.chosen) == {0, 1, 2, 3, 4}
    assert (joined.n_added, joined.apart) == (2, ())
    far = connect(instance, graph, (0, 4))  # no one candidate joins the two: a way of three does
    assert set(far.chosen) == {0, 1, 2, 3, 4}
    spare = connect(instance, graph, (0, 1, 2, 3, 4))
    assert spare.n_added == 0
    assert instance.is_met_by(instance.times_seen(spare.chosen))


def test_what_no_candidate_joins_stays_apart():
    instance, graph = chain(5)
    without = instance.only(np.array([True, True, False, True, True]))
    parted = OverlapGraph.of(without.matrix, chain_samples(graph), OverlapOptions())
    joined = connect(without, parted, (0, 4))
    assert len(joined.apart) == 1
    assert connect(instance, graph, ()).chosen == ()


def chain_samples(graph: OverlapGraph) -> SurfaceSamples:
    areas = graph.terms[:, 0]
    corner = patches(FLOOR, WALL, SIDE)
    n = len(areas) // len(corner)
    zeros = np.zeros(len(areas), np.int32)
    return SurfaceSamples(
        graph.terms[:, 1:4] / areas[:, None], np.tile(corner.normals, (n, 1)), areas, zeros, zeros
    )


@pytest.fixture(scope="module")
def plan():
    rng = np.random.default_rng(0)
    positions = rng.uniform([0.4, 0.4, 1.2], [5.6, 4.6, 2.2], (60, 3))
    return plan_views(
        ROOM,
        SENSOR,
        method="cover",
        requirement=Requirement(max_incidence_deg=70),
        candidates=Candidates(positions, sensor_directions(SENSOR, 1)),
        samples=sample_surface(ROOM.mesh, 0.2),
        target=0.97,
        overlap=OverlapOptions(min_overlap=0.3),
        budgets=CoverOptions(polish_steps=2000),
        rng=0,
    )


def test_a_plan_with_overlap_is_connected_and_still_covers(plan):
    assert plan.stations.n_groups == 1
    assert plan.coverage.met_of_reachable > 0.96
    assert "of the views are there for overlap" in plan.stopped_because
    assert "over views that can be registered" in plan.lower_bound.kind
    assert all(overlap.share >= 0.3 and overlap.stiffness >= 0.02 for overlap in plan.stations.overlaps)


@pytest.mark.long
def test_noisy_scans_of_the_plan_register_along_its_links(plan):
    """Every scan, displaced by 3 cm and 1 deg, finds back to the one it is linked to in a spanning tree."""
    n, sigma = len(plan.views), 0.002
    pairs = np.array([(overlap.first, overlap.second) for overlap in plan.stations.overlaps])
    graph = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    assert connected_components(graph, directed=False)[0] == 1
    order, before = breadth_first_order(graph, 0, directed=False)
    scans = [scan_scene(ROOM, view, noise="gaussian-2mm", rng=k) for k, view in enumerate(plan.views)]
    rng = np.random.default_rng(1)
    for number in order[1:]:
        moved, fixed = scans[number], scans[before[number]]
        motion = displaced(moved, rng, 1.0, 0.03)
        back = register(motion.apply(points_of(moved)), points_of(fixed))
        left = np.linalg.norm((back @ motion).apply(points_of(moved)) - points_of(moved), axis=1)
        assert np.sqrt(np.mean(left**2)) < 2 * sigma  # of single points; before it was 3 cm and more


def test_a_corridor_is_no_link_and_does_not_register():
    """Two views that share all of two parallel walls and the floor slide along them."""
    samples = patches(FLOOR, WALL, OPPOSITE)
    both = OverlapGraph.of(csr_array(np.ones((2, 300))), samples, OverlapOptions())
    assert not both.links(0).linked.any()
    assert len(set(components(both.linked_to_any((0, 1)), (0, 1)))) == 2
    rng = np.random.default_rng(0)
    first, second = (corridor_scan(rng) for _ in range(2))
    shift = np.array([0.01, 0.05, 0.01])
    left = (register(second + shift, first).apply(second + shift) - second).mean(axis=0)
    assert abs(left[1]) > 0.03  # along the corridor nothing holds
    assert np.abs(left[[0, 2]]).max() < 0.001


def corridor_scan(rng: np.random.Generator) -> np.ndarray:
    """Return noisy points on the floor and two walls of a corridor along y, 2 x 6 x 2 m."""
    flat = rng.uniform([0, 0, 0], [2, 6, 2], (3, 2000, 3)) + rng.normal(0, 0.001, (3, 2000, 3))
    for plane, (axis, at) in zip(flat, ((2, 0.0), (0, 0.0), (0, 2.0)), strict=True):
        plane[:, axis] = at + rng.normal(0, 0.001, 2000)
    return flat.reshape(-1, 3)


def test_options_are_checked():
    with pytest.raises(InputError, match="min_overlap"):
        OverlapOptions(min_overlap=1.5)
    with pytest.raises(InputError, match="min_stiffness"):
        OverlapOptions(min_stiffness=0.5)
