# SPDX-License-Identifier: MIT
"""What is continued of a thing, on a wall behind a board, each taken for the thing in turn."""

import numpy as np
import pytest

from benchmarks.cases.rooms import hypothesis_of
from benchmarks.metrics.continued import Continued, continued_area_of
from completion import CompletionOptions, complete
from completion.extension.patch import Provenance
from completion.result.completed_model import CompletedModel
from nbv import PinholeSensor, scan_scene
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder
from scenes.world.builtin import builtin_scene
from tests.helpers.evaluation_examples import plain_wall


def continued(completed: CompletedModel, scan: RangeImage, is_thing: np.ndarray) -> Continued:
    """Continued area of surfaces of which more than half of the pixels are of the thing, by the truth."""
    owner, true = completed.owners[0], scan.truth.surface
    on_thing = [is_thing[true[(owner == k) & (true >= 0)]] for k in range(1, len(completed.patches) + 1)]
    hypothesis = hypothesis_of(completed, [scan])
    return continued_area_of(
        completed, hypothesis, np.array([2 * part.sum() > len(part) for part in on_thing])
    )


def test_area_counts_for_the_thing_that_it_is_continued_from() -> None:
    wall = plain_wall()
    completed = complete([wall.scan], CompletionOptions(texture=False), rng=0)
    is_wall = np.array([name.startswith("wall") for name in wall.scene.surface_names])
    held = continued(completed, wall.scan, is_wall)
    assert held.n_surfaces == 1
    assert held.enclosed_m2 > 0.3
    assert held.beyond_m2 == held.turned_m2 == 0
    others = continued(completed, wall.scan, ~is_wall)
    assert others.enclosed_m2 + others.turned_m2 + others.beyond_m2 == 0


@pytest.mark.long
def test_backs_of_round_things_are_counted_apart() -> None:
    scene = builtin_scene("drum_and_post")
    pose = Pose.looking_at((0.6, 0.6, 1.5), (3.0, 2.4, 0.8))
    scan = scan_scene(scene, pose, PinholeSensor(fov_deg=75, width=160, height=120), truth=True, rng=0)
    completed = complete([scan], CompletionOptions(texture=False), rng=0)
    is_round = np.array([isinstance(surface, Cylinder) for surface in scene.surfaces])
    held = continued(completed, scan, is_round)
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
