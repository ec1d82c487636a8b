# SPDX-License-Identifier: MIT
"""Frames of directions: three at right angles, and one with several across it."""

from __future__ import annotations

import numpy as np
import pytest

from completion.relations.graph import direction_frames, frame_records
from completion.relations.pipeline import infer
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere
from tests.helpers.part_examples import exact

FLOOR = Plane((0, 0, 0), (0, 0, 1), (1, 0, 0))
PILLAR = Cylinder((1, 1, 0), (0, 0, -1), 0.3)
BALL = Sphere((1, 1, 1), 0.3)


def wall(turn_deg: float, place: float) -> Plane:
    turn = np.radians(turn_deg)
    normal = np.array([np.cos(turn), np.sin(turn), 0.0])
    return Plane(place * normal, normal, (0, 0, 1))


def test_a_room_is_a_manhattan_frame():
    surfaces = [FLOOR, wall(0, 1), wall(90, 2), wall(180, 3), PILLAR, BALL]
    graph = infer([exact(one, 1e-4) for one in surfaces])
    (frame,) = direction_frames(graph)
    assert frame.kind == "manhattan"
    assert [one.surfaces for one in frame.directions] == [(0, 4), (1, 3), (2,)]
    vectors = np.array([one.vector for one in frame.directions])
    np.testing.assert_allclose(vectors @ vectors.T, np.eye(3), atol=1e-9)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    (record,) = frame_records(graph, "abcdef", turn)
    assert [one["surfaces"] for one in record["directions"]] == [["a", "e"], ["b", "d"], ["c"]]
    np.testing.assert_allclose(np.abs(record["directions"][1]["direction"]), [0, 1, 0], atol=1e-3)
    assert 0 < record["directions"][0]["standard_deviation_deg"] < np.degrees(1e-4)


def test_walls_at_several_angles_are_an_atlanta_frame():
    surfaces = [FLOOR, *(wall(turn, 1 + turn / 50) for turn in (0, 90, 37, 127, 300))]
    frames = direction_frames(infer([exact(one, 1e-4) for one in surfaces]))
    assert [frame.kind for frame in frames] == ["atlanta", "manhattan", "manhattan"]
    upright, *across = frames[0].directions
    assert upright.surfaces == (0,)
    assert {one.surfaces for one in across} == {(1,), (2,), (3,), (4,), (5,)}


@pytest.mark.parametrize("surfaces", [[], [BALL], [FLOOR, wall(0, 1)]])
def test_two_directions_are_no_frame(surfaces):
    assert direction_frames(infer([exact(one, 1e-4) for one in surfaces])) == ()
