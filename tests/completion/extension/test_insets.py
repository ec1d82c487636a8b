# SPDX-License-Identifier: MIT
"""Panes that are seen through a wall end at their reveals, wherever something hides them."""

import numpy as np
import pytest

from completion import Completion, CompletionOptions, complete
from completion.extension.adjacency import find_insets
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.pose import Pose
from scenes.world.builtin import Finish, SceneBuilder
from tests.helpers.long_cases import first_in_gate

GREY = Finish((0.5, 0.5, 0.5))
CAMERA = PinholeSensor(fov_deg=75, width=240, height=180)
WALL_Y, DEPTH = 2.0, 0.1


def facade(is_chimney: bool = False) -> Completion:
    """Complete a wall, two panes 10 cm behind it, and a board that hides half of each and what is between.

    Instead of the panes there may be a wall beside a chimney breast that stands 10 cm before it.
    """
    build = SceneBuilder("facade", "room")
    build.add_rectangle("floor", (-2, 0, -1), (4, 0, 0), (0, 3, 0), GREY)
    if is_chimney:
        build.add_rectangle("breast", (-0.4, WALL_Y, -1), (0.8, 0, 0), (0, 0, 2), GREY)
        build.add_rectangle("wall", (-2, WALL_Y + DEPTH, -1), (4, 0, 0), (0, 0, 2), GREY)
    else:
        holes = [(0.6, 0.8, 1.4, 1.8), (2.6, 0.8, 3.4, 1.8)]
        build.add_panel("wall", (-2, WALL_Y, -1), (4, 0, 0), (0, 0, 2), GREY, holes)
        build.add_rectangle("panes", (-2, WALL_Y + DEPTH, -1), (4, 0, 0), (0, 0, 2), GREY)
    build.add_rectangle("board", (-0.5, 1.0, -0.6), (1.0, 0, 0), (0, 0, 0.8), GREY)
    scan = scan_scene(
        build.finish(), Pose.looking_at((0, 0, 0), (0, 1, 0)), CAMERA, noise="gaussian-2mm", rng=0
    )
    return complete(scan, CompletionOptions(texture=False), rng=0)


def behind_wall(completed: Completion) -> list[int]:
    """Indices of what lies 10 cm behind the wall, larger than a tenth of a square metre."""
    middles = [one.source.points(completed.observations).mean(axis=0) for one in completed.patches]
    return [
        k
        for k, (one, middle) in enumerate(zip(completed.patches, middles, strict=True))
        if abs(middle[2] - WALL_Y - DEPTH) < 0.02 and one.observed_m2 > 0.1
    ]


def test_panes_end_at_their_reveals() -> None:
    completed = facade()
    panes = behind_wall(completed)
    hosts = find_insets([one.source for one in completed.patches], completed.observations, 0.005)
    assert panes
    walls = {int(hosts[k]) for k in panes}
    assert len(walls) == 1
    assert completed.patches[walls.pop()].limits.encloses
    for k in panes:
        patch = completed.patches[k]
        assert patch.limits.is_inset
        assert not patch.limits.encloses
        x = patch.grid.centres()[patch.hypothesised.ravel()][:, 0]
        # Nothing is claimed of the pane behind the wall between the windows.
        assert not np.any(np.abs(x) < 0.55)


def test_a_wall_beside_a_chimney_breast_stays_a_wall() -> None:
    completed = facade(is_chimney=True)
    (wall,) = behind_wall(completed)
    assert completed.patches[wall].limits.encloses
    assert not any(one.limits.is_inset for one in completed.patches)


@pytest.mark.parametrize("n", first_in_gate(1, [0, 1]))
def test_fewer_than_two_surfaces_have_no_insets(n: int) -> None:
    completed = facade()
    found = find_insets([one.source for one in completed.patches[:n]], completed.observations, 0.005)
    assert found.tolist() == [-1] * n


def test_a_wall_is_no_inset_of_the_moulding_on_it() -> None:
    build = SceneBuilder("panelled", "room")
    build.add_rectangle("floor", (-2, 0, -1), (4, 0, 0), (0, 3, 0), GREY)
    build.add_rectangle("wall", (-2, WALL_Y, -1), (4, 0, 0), (0, 0, 2), GREY)
    hole = [(0.15, 0.15, 2.25, 1.45)]
    build.add_panel("moulding", (-1.2, WALL_Y - 0.04, -0.8), (2.4, 0, 0), (0, 0, 1.6), GREY, hole)
    pose = Pose.looking_at((0, 0, 0), (0, 1, 0))
    scan = scan_scene(build.finish(), pose, CAMERA, noise="gaussian-2mm", rng=0)
    completed = complete(scan, CompletionOptions(texture=False), rng=0)
    sources = [one.source for one in completed.patches]
    depth = np.array([one.points(completed.observations)[:, 2].mean() for one in sources])
    assert np.count_nonzero(np.abs(depth - WALL_Y) < 0.01) == 1
    assert np.count_nonzero(np.abs(depth - WALL_Y + 0.04) < 0.01) >= 1
    assert (find_insets(sources, completed.observations, 0.001) < 0).all()
