# SPDX-License-Identifier: MIT
"""Ends of cylinders: a pipe that vanishes behind a board goes on, a limb that meets the next one does not."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cases.houses.solids import Part, box, capsule, quads, scene_of, tube
from completion import CompletionOptions, complete
from completion.extension.confidence import KNOWN_PAST_END, PAST_END, PastEnds, probability_past_end
from completion.extension.extent import Extent
from nbv import PinholeSensor, scan_scene
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cylinder

PIPE = Cylinder(np.zeros(3), np.array([0.0, 0, 1]), 0.05)
EXTENT = Extent(
    chart=PIPE, enclosures=(), cuts=(), neighbours=(), own_low=np.array([-0.07, 1.0]),
    own_high=np.array([0.07, 3.0]), ends=np.array([[-np.inf, -1.0], [np.inf, np.inf]]),
    end_probability=np.array([[0.0, 1.0], [0.0, 0.0]]), ended=np.zeros((2, 2), dtype=np.bool_),
    full_turn=True, encloses=False, seen_ends=np.array([0.25, 0.75]), tilt=0.08, radius_sd=0.009,
)  # fmt: skip


@pytest.mark.parametrize(
    ("along", "side", "past", "seen"), [(0.5, 0, 0.25, 0.25), (2.0, -1, 0.0, 0.25), (4.0, 1, 0.5, 0.75)]
)
def test_places_past_an_end_know_how_far_and_what_was_seen_there(along, side, past, seen):
    found = PastEnds.of(np.array([along]), EXTENT)
    assert found.side.tolist() == [side]
    expected = [np.log(past + 0.02), np.log(0.1), np.log(0.01), seen]
    np.testing.assert_allclose(found.known[0], expected)
    assert len(KNOWN_PAST_END) == len(PAST_END) - 1 == found.known.shape[1]


def test_a_cylinder_is_less_probable_the_farther_and_the_better_its_end_was_seen():
    away = PastEnds.of(np.linspace(0.9, -4, 50), EXTENT).known
    assert (np.diff(probability_past_end(away)) < 0).all()
    near = PastEnds.of(np.array([0.9]), EXTENT).known
    for worse in ({"seen_ends": np.ones(2)}, {"tilt": 1.0}, {"radius_sd": 0.1}):
        other = PastEnds.of(np.array([0.9]), replace(EXTENT, **worse)).known
        assert probability_past_end(other) < probability_past_end(near)


def inferred_of(pipe, before) -> float:
    """Area inferred of a pipe below 0.9 m, square metres, seen with what stands before it or meets it."""
    room = quads([[[-2, 3, 0], [2, 3, 0], [2, 3, 2.5], [-2, 3, 2.5]],
                  [[-2, 0, 0], [2, 0, 0], [2, 3, 0], [-2, 3, 0]]])  # fmt: skip
    solids = {"room": room, "pipe": tube(*pipe, 0.05), "other": before}
    scene = scene_of("end of a pipe", [Part(name, held, (0.6, 0.5, 0.4)) for name, held in solids.items()])
    pose = Pose.looking_at((0.3, -1.0, 1.4), (0.0, 2.0, 1.1))
    camera = PinholeSensor(fov_deg=60, width=320, height=240)
    scan = scan_scene(scene, pose, camera, noise="gaussian-2mm", rng=0)
    completed = complete(scan, CompletionOptions(texture=False), rng=0)
    along = np.subtract(pipe[1], pipe[0]) / np.linalg.norm(np.subtract(pipe[1], pipe[0]))
    found = [
        patch
        for patch in completed.patches
        if isinstance(patch.grid.surface, Cylinder)
        and abs(completed.world_from_reference.rotate(patch.grid.surface.direction[None])[0] @ along) > 0.99
    ]
    assert found
    heights = [completed.world_from_reference.apply(patch.grid.centres())[:, 2] for patch in found]
    return sum(
        float(np.count_nonzero(patch.hypothesised.ravel() & (height < 0.9))) * patch.grid.cell_area
        for patch, height in zip(found, heights, strict=True)
    )


def test_a_pipe_goes_on_behind_a_board_and_ends_at_what_it_meets():
    board = box([-0.5, 1.4, 0.0], [0.5, 1.42, 1.0])
    assert inferred_of(([0, 2, 0], [0, 2, 2.0]), board) > 0.1
    arm = capsule([0, 2, 1.0], [-0.1, 1.6, 0.5], 0.05)  # hides what would be the pipe's continuation
    assert inferred_of(([0, 2, 1.0], [0.3, 2.1, 2.0]), arm) < 0.01
