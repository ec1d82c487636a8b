# SPDX-License-Identifier: MIT
"""Things and runs of pipes: which surfaces are one object, and which cylinders are pipes."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from completion.export.building.model import CylinderElement
from completion.export.building.proxies import find_proxies
from completion.export.building.runs import segments_in_runs
from tests.helpers.exchange_examples import box

D = 0.05  # diameter of pipes


def model_of(*boxes):
    """A model whose sides are surfaces 1, 2, ...: six of each box, given by its corners."""
    meshes = [trimesh.creation.box(bounds=bounds) for bounds in boxes]
    mesh = trimesh.util.concatenate(meshes)
    side = np.concatenate(
        [
            6 * k + np.unique(one.face_normals.round(), axis=0, return_inverse=True)[1].ravel()
            for k, one in enumerate(meshes)
        ]
    )
    kinds = ("rest", *["plane"] * (6 * len(boxes)))
    return replace(
        box(), vertices=mesh.vertices, faces=mesh.faces, surface=side + 1,
        provenance=np.zeros(len(side), int), kinds=kinds,
    )  # fmt: skip


TABLE = [((0, 0, 0.7), (1.2, 0.8, 0.74))]
LEGS = [((x, y, 0), (x + 0.05, y + 0.05, 0.7)) for x in (0, 1.15) for y in (0, 0.75)]


@pytest.mark.parametrize(
    ("boxes", "sizes"),
    [
        ([((0, 0, 0), (1, 1, 1))], [6]),  # a crate
        ([*TABLE, *LEGS], [30]),  # a table on its legs
        ([((0, 0, 0), (1, 1, 1)), ((1.2, 0, 0), (2, 1, 1))], [6, 6]),  # two cupboards with a gap of 20 cm
        ([((0, 0, 0), (9, 0.01, 0.01)), ((4, 0.03, 0), (5, 0.04, 0.01))], [12]),  # a long rail and a board
    ],
)
def test_surfaces_that_touch_are_one_thing(boxes, sizes):
    model = model_of(*boxes)
    assert [len(numbers) for numbers in find_proxies(model, ())] == sizes


def test_structure_and_what_no_surface_explains_link_nothing():
    model = model_of(((0, 0, 0), (1, 1, 1)), ((0, 0, -0.1), (5, 5, 0)), ((2, 2, 0), (3, 3, 1)))
    floor = range(7, 13)
    assert [len(numbers) for numbers in find_proxies(model, floor)] == [6, 6]
    assert [len(numbers) for numbers in find_proxies(model, ())] == [18]
    rest = replace(model, surface=np.where(np.isin(model.surface, floor), 0, model.surface))
    assert [len(numbers) for numbers in find_proxies(rest, ())] == [6, 6]
    assert find_proxies(model, range(1, 19)) == ()


def segments(*ends, diameter=D):
    return [
        CylinderElement(
            number=k, kind="cylinder", patch=None, world=None, ends=np.array(pair, float), surface=None,
            radius_m=diameter / 2, radius_sd_m=1e-4, is_solid=True,
        )
        for k, pair in enumerate(ends, start=1)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("ends", "runs"),
    [
        ([((0, 0, 0), (6, 0, 0))], set()),  # one alone, however long
        ([((0, 0, 0), (1, 0, 0)), ((1.4, 0, 0), (3, 0, 0))], {1, 2}),  # behind a clamp
        ([((0, 0, 0), (1, 0, 0)), ((1.1, 0, 0.1), (1.1, 0, 2))], {1, 2}),  # an elbow
        ([((0, 0, 0), (1, 0, 0)), ((1.1, 0, 0.1), (1.1, 0, 2)), ((9, 0, 0), (9, 0, 2))], {1, 2}),
        ([((0, 0, 0), (0, 0, 2)), ((0.15, 0, 0.3), (0.15, 0, 2))], {1, 2}),  # flow and return
        ([((0, 0, 0), (0, 0, 0.3)), ((0.06, 0, 0), (0.06, 0, 0.3))], set()),  # bottles
        ([((x, y, 0), (x, y, 0.7)) for x in (0, 1.0) for y in (0, 0.6)], set()),  # legs of a table
        ([((0, 0, 0), (1, 0, 0)), ((0.5, 0.5, 0), (0.5, 2, 0))], set()),  # a tee is no bend
        ([((0, 0, 0), (1, 0, 0)), ((3, 0, 0), (3.5, 0, 0))], set()),  # too far for a gap
    ],
)
def test_pipes_are_those_of_a_run(ends, runs):
    assert segments_in_runs(segments(*ends)) == runs


def test_a_run_has_one_radius():
    thin, thick = segments(((0, 0, 0), (1, 0, 0)), ((1.2, 0, 0), (3, 0, 0)))
    assert segments_in_runs([thin, replace(thick, radius_m=1.3 * D / 2)]) == frozenset()
    assert segments_in_runs([thin, replace(thick, radius_m=1.05 * D / 2)]) == {1, 2}
    assert segments_in_runs([]) == frozenset()
