# SPDX-License-Identifier: MIT
"""Quantities of a house of boxes: the truth that rays give, and what a completion says of it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cases.buildings import TrueBuilding
from benchmarks.suites.buildings import Pair, areas, openings, rooms, thicknesses, walls
from completion.export.building.parts import BuildingParts
from tests.helpers.exchange_examples import UTM, box
from tests.helpers.exchange_houses import HIGH_M, PARTITION_M, completed_house, house, house_parts

CLASS = {"wall": "IfcWall", "partition": "IfcWall", "floor": "IfcSlab"}  # else a ceiling


@pytest.fixture(scope="module")
def truth():
    scene = house()
    words = [name.split()[0] for name in scene.surface_names]
    classes = tuple(CLASS.get(word, "IfcCovering") for word in words)
    mesh = scene.mesh
    return TrueBuilding.of(mesh.vertices, mesh.faces.astype(int), mesh.face_surface, classes)


def test_sides_show_what_rooms_see(truth):
    sides = list(truth.sides())
    largest = max(side.area_m2 for side in sides)
    assert largest == pytest.approx((4 + PARTITION_M + 3) * HIGH_M, rel=0.05)  # along both lower rooms
    for side in sides:
        assert np.abs(side.normal).sum() == 1
        assert side.places.shape[1] == 3


def test_pairs_are_right_within_five_percent():
    assert Pair("wall", 1.0, 1.049).is_right
    assert not Pair("wall", 1.0, 0.94).is_right
    assert Pair("wall", 2.0, 1.0).error == 0.5


def test_an_empty_model_has_nothing_right(truth):
    nothing = BuildingParts(box(), (), (), storeys=(), rooms=(), columns=(), pipes=())
    sides, points = list(truth.sides()), np.zeros((1, 3))
    assert all(pair.said == 0 for pair in areas(sides, nothing, points))
    assert list(openings(truth, nothing)) == []  # the house has no leaf
    assert list(walls(truth, sides, nothing, points)) == []
    assert list(thicknesses(truth, (), np.random.default_rng(0))) == []
    assert list(rooms(truth, nothing)) == []


@pytest.mark.long
def test_a_completed_house_is_right(truth):
    parts = house_parts(noise="none")
    moved = [replace(face, frame=_home(face.frame)) for face in parts.faces]
    (wall,) = [replace(body, frame=_home(body.frame)) for body in parts.bodies if body.kind == "wall"]
    (pair,) = thicknesses(truth, [wall], np.random.default_rng(0))
    assert pair.true == pytest.approx(PARTITION_M, abs=1e-3)
    assert pair.is_right
    here = replace(parts, faces=tuple(moved), bodies=(wall,))
    points = completed_house("none").observed_mesh().vertices
    sides = list(truth.sides())
    found = list(
        areas(sides, here, completed_house("none").world_from_reference.apply(points) - UTM.translation)
    )
    assert np.mean([pair.is_right for pair in found]) > 0.7
    assert min(pair.seen for pair in found) > 0.5


def _home(frame):
    return replace(frame, origin=frame.origin - UTM.translation)
