# SPDX-License-Identifier: MIT
"""Rows at one spacing and pairs in one mirror: found where they are, and not in what stands at random."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.suites.relations_of_parts import mirror_part, random_part, row_part
from completion.fitting.result import SurfaceFit
from completion.relations.constraint import constrain
from completion.relations.equations import RelationFrame, place
from completion.relations.evidence import CHOSEN
from completion.relations.graph import RelationGraph, relation_records
from completion.relations.options import BUILT, RelationOptions
from completion.relations.pipeline import impose, infer
from completion.relations.relation import Relation, RelationStatus
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere
from tests.helpers.long_cases import first_in_gate
from tests.helpers.part_examples import exact, flipped, scaled, transformed, walls

SIGMA = 0.02  # mm


def patterns(graph: RelationGraph) -> dict[tuple[str, frozenset[int]], RelationStatus]:
    return {(one.kind, frozenset(one.surfaces)): one.status for one in graph.relations if one.kind in CHOSEN}


def made(make, seed: int, sigma: float = SIGMA) -> tuple[list[SurfaceFit], list[Relation]]:
    return make(np.random.default_rng(seed), sigma)


def misfit(relation: Relation, fits) -> float:
    at = {number: place(fits[number].surface, np.zeros(len(fits[number].covariance)))
          for number in relation.surfaces}  # fmt: skip
    return float(np.abs(constrain(relation, at, RelationFrame(at)).value).max())


@pytest.fixture(scope="module", params=[row_part, mirror_part], ids=["rows", "mirror"])
def part(request):
    fits, meant = made(request.param, 3)
    return fits, meant, infer(fits)


def test_what_was_made_so_is_found_and_holds_exactly(part):
    fits, meant, graph = part
    for relation in meant:
        assert misfit(relation, fits) > 1e-6
        assert misfit(relation, graph.fits) < 1e-9
    assert graph.count_with(RelationStatus.REJECTED) == 0
    assert max(graph.moved_sd) < 4.0


@pytest.mark.parametrize("sigma", [0.02, 0.5])
@pytest.mark.parametrize("seed", first_in_gate(1, range(3)))
def test_nothing_is_made_of_surfaces_at_random(seed, sigma):
    assert RelationStatus.ACCEPTED not in patterns(infer(made(random_part, seed, sigma)[0])).values()


@pytest.mark.long
def test_order_changes_no_status(part):
    fits, meant, graph = part
    order = np.random.default_rng(5).permutation(len(fits))
    found, back = infer([fits[k] for k in order]), np.argsort(order)
    assert found.rank == graph.rank
    for relation in meant:
        assert misfit(relation, [found.fits[k] for k in back]) < 1e-9


@pytest.mark.long
def test_rigid_motion_flipped_normals_and_scale_change_no_status(part):
    fits, _, graph = part
    rng = np.random.default_rng(6)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = Pose.from_parts(turn * np.sign(np.linalg.det(turn)), rng.normal(size=3) * 100)
    assert patterns(graph)
    assert patterns(infer([transformed(fit, pose) for fit in fits])) == patterns(graph)
    assert patterns(infer([flipped(fit) for fit in fits])) == patterns(graph)
    assert patterns(infer([scaled(fit, 1e-3) for fit in fits])) == patterns(graph)


def test_what_is_stated_of_walls_is_tested():
    fits = walls(4, (0.0, 2.0, 4.0, 6.0, 9.0))
    row = Relation(kind="regular", surfaces=(3, 2, 1, 0))
    uneven = Relation(kind="regular", surfaces=(1, 2, 3, 4))
    pairs = Relation(kind="symmetric", surfaces=(0, 3, 1, 2))
    found = impose(fits, [row, uneven, pairs]).relations
    assert [one.status for one in found] == [
        RelationStatus.ACCEPTED,
        RelationStatus.REJECTED,
        RelationStatus.REDUNDANT,
    ]
    assert found[0].rank == 3 * 2 + 2  # all parallel, and two second differences
    assert "off" in found[1].reason
    assert impose(fits, [pairs]).rank == 3  # two pairs, three of six less than nothing


def test_what_is_forbidden_is_not_found():
    fits = walls(4, (0.0, 2.0, 4.0, 6.0))
    options = RelationOptions(kinds=("parallel", "regular"))
    (row,) = [one for one in infer(fits, options=options).relations if one.kind == "regular"]
    assert row.status is RelationStatus.ACCEPTED
    assert row.log_evidence > np.log(100)
    never = Relation(kind="regular", surfaces=row.surfaces[::-1], is_forbidden=True)
    assert not patterns(infer(fits, [never], options))


def test_three_columns_in_line_are_a_row_and_three_walls_are_not():
    columns = [exact(Cylinder((4.0 * k, 0.5 * k, 0), (0, 0, 1), 0.3)) for k in range(3)]
    options = RelationOptions(kinds=("parallel", "regular"))
    assert patterns(infer(columns, options=options)) == {
        ("regular", frozenset(range(3))): RelationStatus.ACCEPTED
    }
    assert not patterns(infer(walls(1, (0.0, 2.0, 4.0)), options=options))


def test_balls_may_be_stated_to_be_images():
    balls = [exact(Sphere((side * x, x, 0.3 * x), 0.2 * x)) for x in (1.0, 2.0) for side in (-1, 1)]
    pairs = Relation(kind="symmetric", surfaces=(0, 1, 2, 3))
    (stated,) = impose(balls, [pairs]).relations
    assert (stated.status, stated.rank) == (RelationStatus.ACCEPTED, 8 - 3)


def test_files_say_the_spacing_and_the_mirror(part):
    fits, meant, graph = part
    pose = Pose.from_parts(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([1.0, 2, 3]))
    names = list(range(1, len(fits) + 1))
    records = [one for one in relation_records(graph, fits, names, world=pose) if one["type"] in CHOSEN]
    assert meant[0].kind in {one["type"] for one in records}
    for one in records:
        if one["type"] == "regular" and one["surfaces"] == names[:6]:
            apart = graph.fits[5].surface.point - graph.fits[0].surface.point
            normal = graph.fits[0].surface.normal_direction
            assert one["spacing_m"] == pytest.approx(abs(apart @ normal) / 5)
        if meant[0].kind == one["type"] == "symmetric":
            mirror = Plane(one["mirror"]["point"], one["mirror"]["normal"])
            np.testing.assert_allclose(np.abs(mirror.normal_direction), [0, 1, 0], atol=1e-3)
            first, second = (
                pose.apply(graph.fits[number - 1].surface.point[None]) for number in one["surfaces"][:2]
            )
            sides = float(mirror.distance(first)[0]), float(mirror.distance(second)[0])
            assert sides[0] * sides[1] < 0


def test_in_buildings_patterns_are_not_looked_for():
    assert not set(CHOSEN) & set(BUILT.kinds)
    assert not patterns(infer(walls(1, (0.0, 2.0, 4.0, 6.0)), options=BUILT))
