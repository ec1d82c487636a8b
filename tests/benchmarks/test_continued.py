# SPDX-License-Identifier: MIT
"""What is continued of a thing, on a wall behind a board, each taken for the thing in turn."""

import numpy as np
import pytest

from benchmarks.cases.rooms import hypothesis_of
from benchmarks.metrics.continued import continued_area
from completion import CompletionOptions, complete
from completion.extension.patch import Provenance
from nbv import PinholeSensor, scan_scene
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder
from scenes.world.builtin import builtin_scene
from tests.helpers.evaluation_examples import plain_wall


def test_area_counts_for_the_thing_that_it_is_continued_from() -> None:
    wall = plain_wall()
    completed = complete([wall.scan], CompletionOptions(texture=False), rng=0)
    hypothesis = hypothesis_of(completed, [wall.scan])
    is_wall = np.array([name.startswith("wall") for name in wall.scene.surface_names])
    held = continued_area(completed, hypothesis, [wall.scan], is_wall)
    assert held.n_surfaces == 1
    assert held.enclosed_m2 > 0.3
    assert held.beyond_m2 == held.turned_m2 == 0
    others = continued_area(completed, hypothesis, [wall.scan], ~is_wall)
    assert others.enclosed_m2 + others.turned_m2 + others.beyond_m2 == 0
    blind = RangeImage(wall.scan.ranges, wall.scan.projection, wall.scan.world_from_sensor, name="blind")
    with pytest.raises(InputError, match="blind: has no truth"):
        continued_area(completed, hypothesis, [blind], is_wall)


@pytest.mark.long
def test_backs_of_round_things_are_counted_apart() -> None:
    scene = builtin_scene("drum_and_post")
    pose = Pose.looking_at((0.6, 0.6, 1.5), (3.0, 2.4, 0.8))
    scan = scan_scene(scene, pose, PinholeSensor(fov_deg=75, width=160, height=120), truth=True, rng=0)
    completed = complete([scan], CompletionOptions(texture=False), rng=0)
    hypothesis = hypothesis_of(completed, [scan])
    is_round = np.array([isinstance(surface, Cylinder) for surface in scene.surfaces])
    held = continued_area(completed, hypothesis, [scan], is_round)
    backs = around = 0.0
    for patch in completed.patches:
        if isinstance(patch.grid.surface, Cylinder):
            along = patch.grid.axes()[1][:, None]
            between = (along >= patch.limits.own_low[1]) & (along <= patch.limits.own_high[1])
            inferred = patch.hypothesised & (patch.provenance != Provenance.INTERIOR) & between
            around += float(np.count_nonzero(inferred)) * patch.grid.cell_area
            is_back = inferred & (patch.provenance == Provenance.FULL_TURN)
            backs += float(np.count_nonzero(is_back)) * patch.grid.cell_area
    assert held.turned_m2 == pytest.approx(around, rel=0.05)
    assert around > backs > 0.1
