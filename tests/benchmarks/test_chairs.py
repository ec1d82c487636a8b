# SPDX-License-Identifier: MIT
"""Outlines drawn on real frames: what they hold, and what is counted of the surfaces within."""

import numpy as np
import pytest

from benchmarks.cases.frames import REAL
from benchmarks.suites.ledger import CHAIRS, HOLE, continued_in, mask_of, masked_frames
from completion import CompletionOptions
from tests.helpers.evaluation_examples import plain_wall


def test_outlines_are_of_known_frames_and_lie_in_them() -> None:
    n_frames = {source.name: source.n_frames for source in REAL}
    held = list(masked_frames())
    assert len(held) >= 6
    assert len({source for source, _, _ in held}) >= 3
    for source, frame, things in held:
        assert 0 <= frame < n_frames[source]
        assert set(things) <= {*CHAIRS, HOLE, "sofa"}
        for outline in (one for own in things.values() for one in own):
            assert len(outline) >= 3
            corners = np.array(outline)
            assert (corners >= 0).all()
            assert (corners <= (640, 480)).all()


def test_a_mask_is_the_area_of_its_outlines() -> None:
    square = ((10, 20), (29, 20), (29, 39), (10, 39))  # pixels 10 to 29, 20 to 39, their rims drawn
    mask = mask_of([square, ((50, 0), (59, 0), (59, 9), (50, 9))], (60, 80))
    assert mask.shape == (60, 80)
    assert mask.sum() == pytest.approx(20 * 20 + 10 * 10)
    assert mask[20:40, 10:30].all()
    assert not mask_of([], (60, 80)).any()


def test_what_is_continued_counts_for_the_outline_that_holds_most_of_a_surface() -> None:
    scan = plain_wall().scan
    rows, columns = scan.shape
    whole = ((0, 0), (columns, 0), (columns, rows), (0, rows))
    third = ((0, 0), (columns // 3, 0), (columns // 3, rows), (0, rows))
    found = continued_in(scan, {"all": [whole], "part": [third]}, CompletionOptions(texture=False))
    assert found["all"].enclosed_m2 > 0.3
    assert found["all"].beyond_m2 == pytest.approx(sum(found["all"].beyond_by_reason.values()))
    assert found["part"].enclosed_m2 == 0
    through = continued_in(scan, {"all": [whole], HOLE: [whole]}, CompletionOptions(texture=False))
    assert through["all"].n_surfaces == 0
