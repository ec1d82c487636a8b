# SPDX-License-Identifier: MIT
"""Relations inferred, tested and imposed: the part of figure 1, walls, and the laws that hold for any."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cases.planes import BASE, BORE, SIDE, WIDE, figure_one
from completion.fitting.euclidean import fit_euclidean
from completion.fitting.result import SurfaceFit
from completion.relations.constraint import constrain
from completion.relations.equations import RelationFrame, place
from completion.relations.estimate import Doubt, JointEstimate
from completion.relations.graph import RelationGraph
from completion.relations.options import RelationOptions
from completion.relations.pipeline import impose, infer
from completion.relations.relation import Relation, RelationStatus
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cylinder, EllipticCylinder, Plane, Torus
from tests.helpers.part_examples import exact, flipped, scaled, transformed, walls

SIGMA = 0.2  # mm


def statuses(graph: RelationGraph) -> dict[tuple[object, ...], RelationStatus]:
    return {(one.kind, frozenset(one.surfaces)): one.status for one in graph.relations}


def only(graph: RelationGraph) -> Relation:
    (one,) = (relation for relation in graph.relations if relation.is_given)
    return one


@pytest.fixture(scope="module")
def part():
    return figure_one(0, SIGMA)


@pytest.fixture(scope="module")
def graph(part):
    return infer(part)


def test_the_part_of_figure_one_keeps_thirteen_degrees_of_freedom(graph):
    assert (graph.unknowns, graph.rank, graph.free) == (31, 18, 13)
    assert graph.count_with(RelationStatus.REJECTED) == 0
    assert max(graph.moved_sd) < 3.5
    assert "13 of 31 free" in repr(graph)


def test_what_is_accepted_holds_exactly(graph):
    at = {number: place(fit.surface, np.zeros(len(fit.covariance))) for number, fit in enumerate(graph.fits)}
    frame = RelationFrame(at)
    for relation in graph.relations:
        assert np.abs(constrain(relation, at, frame).value).max() <= 1e-10


@pytest.mark.long
def test_a_radius_of_which_little_is_seen_is_known_by_its_axis():
    """Its deviation is that of Monte Carlo, a seventeenth of the fit's own; methods page, section 5."""
    before, after, predicted = [], [], []
    for seed in range(30):
        fits = figure_one(100 + seed, SIGMA, n=500)
        found = infer(fits)
        before.append(fits[WIDE].surface.radius - 60)
        after.append(found.fits[WIDE].surface.radius - 60)
        predicted.append(np.sqrt(found.fits[WIDE].covariance[4, 4]))
    assert np.std(before) > 10 * np.std(after)
    z = np.array(after) / predicted
    assert 0.62 < np.sqrt(np.mean(z**2)) < 1.41  # chi-square of 30, a thousandth to either side


@pytest.mark.parametrize(
    "wrong",
    [
        Relation(kind="angle", surfaces=(BASE, SIDE), value=np.radians(88)),
        Relation(kind="equal_radius", surfaces=(WIDE, BORE)),
        Relation(kind="radius", surfaces=(WIDE,), value=59.0),
        Relation(kind="parallel", surfaces=(BASE, SIDE)),
        Relation(kind="distance", surfaces=(0, 1), value=39.0),
    ],
    ids=lambda one: one.kind,
)
def test_what_is_stated_wrongly_is_rejected_with_its_reason(part, wrong):
    found = infer(part, [wrong])
    stated = only(found)
    assert stated.status is RelationStatus.REJECTED
    assert "off" in stated.reason
    assert found.rank == 18


def test_what_is_stated_rightly_is_accepted_and_helps(part, graph):
    found = infer(part, [Relation(kind="radius", surfaces=(WIDE,), value=60.0)])
    assert only(found).status is RelationStatus.ACCEPTED
    assert found.fits[WIDE].surface.radius == pytest.approx(60.0, abs=1e-9)
    assert found.free == graph.free - 1


def test_what_is_forbidden_is_neither_imposed_nor_implied_by_it(part):
    never = Relation(kind="parallel", surfaces=(0, 1), is_forbidden=True)
    assert ("parallel", frozenset((0, 1))) not in statuses(infer(part, [never]))


def test_what_others_say_already_is_redundant_and_moves_nothing(part, graph):
    stated = [Relation(kind="parallel", surfaces=pair) for pair in ((0, 1), (1, 6), (0, 6))]
    found = infer(part, stated)
    assert [one.status for one in found.relations if one.is_given] == [
        RelationStatus.ACCEPTED,
        RelationStatus.ACCEPTED,
        RelationStatus.REDUNDANT,
    ]
    assert found.rank == graph.rank
    for one, two in zip(found.fits, graph.fits, strict=True):
        np.testing.assert_allclose(one.surface.point, two.surface.point, atol=1e-9)


def test_of_three_distances_the_wrong_one_goes_whatever_its_place():
    for order in ((0, 1, 2), (2, 1, 0), (1, 2, 0)):
        fits = walls(3, (0.0, 2.0, 5.0))
        stated = [
            Relation(kind="distance", surfaces=(0, 1), value=2.0),
            Relation(kind="distance", surfaces=(1, 2), value=3.0),
            Relation(kind="distance", surfaces=(0, 2), value=5.0004),
        ]
        found = impose(fits, [stated[k] for k in order])
        held = {one.surfaces for one in found.relations if one.holds}
        assert len(held) == 2  # which of them is wrong nobody can tell at .4 mm
        lost = [one for one in found.relations if not one.holds]
        assert lost[0].status is RelationStatus.REJECTED


def test_the_wrong_one_of_a_conflict_is_told_by_the_fits():
    fits = walls(3, (0.0, 2.0, 5.0), sigma=1e-4)
    stated = [
        Relation(kind="distance", surfaces=(0, 1), value=2.0),
        Relation(kind="distance", surfaces=(0, 2), value=5.00005),
        Relation(kind="distance", surfaces=(1, 2), value=3.0),
    ]
    for order in ((0, 1, 2), (2, 1, 0), (1, 0, 2)):
        found = impose(fits, [stated[k] for k in order], RelationOptions(level=1e-9))
        assert {one.surfaces for one in found.relations if not one.holds} == {(0, 2)}, order


def test_a_wall_that_is_off_square_is_not_imposed():
    found = infer(walls(1, (0.0, 3.0, 6.0), turns_deg=(0.0, 0.0, 0.3)))
    state = statuses(found)
    assert state["parallel", frozenset((0, 1))] is RelationStatus.ACCEPTED
    assert {state.get(("parallel", frozenset(pair))) for pair in ((0, 2), (1, 2))} == {
        None,
        RelationStatus.REJECTED,
    }


def test_of_walls_built_within_a_tolerance_the_wall_is_pulled_no_more_than_that():
    fits = walls(1, (0.0, 3.0, 6.0, 9.0), turns_deg=(0.0, 0.0, 0.1, 0.0))
    hard, soft = infer(fits), infer(fits, options=RelationOptions(tolerance_deg=0.15, tolerance_m=5e-3))
    assert hard.count_with(RelationStatus.REJECTED) >= 1
    assert soft.count_with(RelationStatus.REJECTED) == 0
    turned = soft.fits[2].surface.normal_direction @ fits[2].surface.normal_direction
    assert np.degrees(np.arccos(min(1.0, turned))) < 0.03  # it is seen better than things are built


def test_gravity_makes_walls_upright():
    fits = walls(5, (0.0, 3.0, 6.0))
    found = infer(fits, options=RelationOptions(up=np.array([0, 0, 1.0])))
    assert sum(one.kind == "vertical" and one.holds for one in found.relations) == 1
    for fit in found.fits:
        assert fit.surface.normal_direction[2] == pytest.approx(0.0, abs=1e-10)


def test_round_and_equal_distances_are_found():
    found = infer(walls(2, (0.0, 2.0, 4.0, 7.0)), options=RelationOptions(round_length_m=0.5))
    lengths = {one.surfaces: one.value for one in found.relations if one.kind == "distance" and one.holds}
    assert lengths == {(0, 1): 2.0, (1, 2): 2.0, (2, 3): 3.0}
    found = infer(walls(2, (0.0, 2.0, 4.0, 7.1)))
    equal = [one.surfaces for one in found.relations if one.kind == "equal_distance" and one.holds]
    assert equal == [(0, 1, 1, 2)]


def test_few_surfaces_met_by_chance_are_left_undecided():
    """One pair of a direction known to 3 deg: that well any two may agree."""
    pair = [
        exact(Plane((0, 0, 0), (0, 0, 1), (1, 0, 0)), 0.05),
        exact(Plane((0, 0, 2), (0, 0, 1), (1, 0, 0)), 0.05),
    ]
    found = infer(pair)
    assert found.rank == 0
    assert {one.status for one in found.relations} == {RelationStatus.UNDECIDED}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_order_changes_no_status(part, graph, seed):
    order = np.random.default_rng(seed).permutation(len(part))
    found = infer([part[k] for k in order])
    assert found.rank == graph.rank
    back = np.argsort(order)
    for number, fit in enumerate(graph.fits):
        other = found.fits[back[number]].surface
        np.testing.assert_allclose(other.point, fit.surface.point, atol=1e-6)


@pytest.mark.parametrize("seed", [4, 5])
def test_rigid_motion_changes_no_status(part, graph, seed):
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn * np.sign(np.linalg.det(turn)), rng.normal(size=3) * 100
    pose = Pose(matrix)
    found = infer([transformed(fit, pose) for fit in part])
    assert statuses(found) == statuses(graph)
    for one, two in zip(found.fits, graph.fits, strict=True):
        np.testing.assert_allclose(one.surface.point, two.surface.transform(pose).point, atol=1e-6)


def test_flipped_normals_change_no_status(part, graph):
    assert statuses(infer([flipped(fit) for fit in part])) == statuses(graph)


def test_scale_changes_no_status(part, graph):
    assert statuses(infer([scaled(fit, 1e-3) for fit in part])) == statuses(graph)


def test_freedom_of_the_covariances_widens_the_test():
    fits = walls(1, (0.0, 3.0), turns_deg=(0.0, 0.13))
    stated = [Relation(kind="parallel", surfaces=(0, 1))]
    known, few = (only(impose(fits, stated, doubt=Doubt(freedom=[np.inf, nu]))).p for nu in (np.inf, 5.0))
    assert few > known


def test_errors_that_walls_share_do_not_part_them():
    """A scanner that leans turns both walls alike: each is in doubt, what they are to each other is not."""
    fits = walls(1, (0.0, 3.0))
    turned = np.cross([0, 0, np.radians(1.0)], fits[0].surface.normal_direction)
    lean = [
        -np.array([[0.0], [fit.surface.u_direction @ turned], [fit.surface.v_direction @ turned]])
        for fit in fits
    ]
    stated = [Relation(kind="parallel", surfaces=(0, 1))]
    both, one = np.concatenate(lean), np.concatenate([lean[0], np.zeros((3, 1))])
    alike = impose(fits, stated, doubt=Doubt(shared=both @ both.T))
    apart = impose(fits, stated, doubt=Doubt(shared=one @ one.T))
    assert only(alike).p == pytest.approx(only(impose(fits, stated)).p, rel=0.05)
    assert only(apart).p > only(alike).p
    assert np.sqrt(np.diag(alike.fits[0].covariance)[1:]).max() == pytest.approx(np.radians(1.0), rel=0.01)


def test_bad_input_is_named():
    fits = walls(1, (0.0, 3.0))
    with pytest.raises(InputError, match=r"parallel of surfaces \[0, 2\]: there are 2, from 0"):
        infer(fits, [Relation(kind="parallel", surfaces=(0, 2))])
    with pytest.raises(InputError, match="surface 1: its covariance is not finite"):
        infer([fits[0], replace(fits[1], covariance=np.full((3, 3), np.nan))])
    with pytest.raises(InputError, match="EllipticCylinder: relations are known of planes"):
        infer([*fits, exact(EllipticCylinder((0, 0, 0), (0, 0, 1), (0.5, 0.4)))])
    for name, value in [
        ("tolerance_deg", -1.0),
        ("tolerance_m", np.nan),
        ("level", 0.0),
        ("round_angle_deg", 91.0),
        ("round_length_m", 0.0),
    ]:
        with pytest.raises(InputError, match=name):
            RelationOptions(**{name: value})
    with pytest.raises(InputError, match="up"):
        RelationOptions(up=np.zeros(3))


def test_nothing_has_no_relations():
    assert infer([]).relations == ()
    assert infer(walls(1, (0.0,))).free == 3


def rings(seed: int, sigma: float = 2e-5) -> list[SurfaceFit]:
    """A shaft of 20 mm with a shoulder, fillets of 5 mm at two heights, and an edge rounded alike."""
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = Pose.from_parts(turn * np.sign(np.linalg.det(turn)), rng.normal(size=3))
    true = [
        Cylinder((0, 0, 0), (0, 0, 1), 0.02),
        Torus((0, 0, 0.005), (0, 0, 1), 0.025, 0.005),
        Torus((0, 0, 0.095), (0, 0, -1), 0.025, 0.005),
        Cylinder((0.1, 0, 0.005), (0, 1, 0), 0.005),
    ]
    bounds = [(0.06, 0.03), (0.07, 0.006), (0.07, 0.006), (0.004, 0.04)]
    fits = []
    for surface, (u, v) in zip(true, bounds, strict=True):
        points = surface.from_uv(np.column_stack([rng.uniform(-u, u, 600), rng.uniform(-v, v, 600)]))
        points += rng.normal(0, sigma, (600, 1)) * surface.normal(points)
        fits.append(fit_euclidean(pose.apply(points), surface.kind, surface.transform(pose)))
    return fits


@pytest.mark.parametrize("seed", range(4))
def test_tori_are_coaxial_and_share_radii(seed):
    found = infer(rings(seed))
    held = [one.kind for one in found.relations if one.status is RelationStatus.ACCEPTED]
    assert [held.count(kind) for kind in ("coaxial", "equal_radius", "equal_ring_radius")] == [2, 2, 1]
    shaft, *fillets, edge = (one.surface for one in found.fits)
    for torus in fillets:
        assert torus.tube_radius == pytest.approx(edge.radius, abs=1e-12)
        assert np.linalg.norm(np.cross(torus.direction, shaft.direction)) < 1e-10
    assert found.count_with(RelationStatus.REJECTED) == 0


@pytest.mark.long
def test_covariances_of_related_tori_are_those_of_monte_carlo():
    off, predicted = [], []
    for seed in range(24):
        found = infer(rings(100 + seed))
        off.append(found.fits[1].surface.radius - 0.025)
        predicted.append(np.sqrt(found.fits[1].covariance[5, 5]))
    ratio = np.sqrt(np.mean(np.square(np.array(off) / predicted)))
    assert abs(ratio - 1) < 4 / np.sqrt(48)


def test_what_relations_determine_has_no_variance_below_nothing(part):
    estimate = JointEstimate(part, None, np.zeros(3))
    for number, fit in enumerate(part):
        stretch = estimate.columns(number)
        values, vectors = np.linalg.eigh(fit.covariance)
        left = (vectors * np.where(values == values.min(), -1e-17 * values, values)) @ vectors.T
        estimate.covariance[stretch, stretch] = left
        known = estimate.covariance_of(number)
        assert min(np.trace(known), *np.linalg.eigvalsh(known) + 1e-15 * values.max()) >= 0
        assert np.allclose(known, left, atol=1e-15 * values.max())


def test_what_would_leave_a_surface_no_radius_is_rejected():
    bore = SurfaceFit(Cylinder((0, 0, 0), (0, 0, 1), 1e-3), 0.0, 1e-4 * np.eye(5), 100)
    estimate = JointEstimate([bore], None, np.zeros(3))
    assert not estimate.impose(Relation(kind="radius", surfaces=(0,), value=0.0), [0])
    assert not estimate.imposed
    assert not estimate.x.any()
    assert estimate.impose(Relation(kind="radius", surfaces=(0,), value=2e-3), [0])
    assert bore.surface.radius + estimate.x[4] == pytest.approx(2e-3)
