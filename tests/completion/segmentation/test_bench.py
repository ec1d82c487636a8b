# SPDX-License-Identifier: MIT
"""Some frames of the benchmark instances; all of them in benchmarks/test_segmentation_speed.py."""

import numpy as np
import pytest

from benchmarks.cases.segmented import frames, judged, prepared, segmented
from tests.helpers.data_paths import requires_bench
from tests.helpers.long_cases import first_in_gate

pytestmark = requires_bench


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "chosen"), first_in_gate(1, [("drum_and_post", (1, 3, 6)), ("office", (1, 4, 8))])
)
def test_faces_are_found_whole_and_accurately(name, chosen):
    n_faces = n_correct = 0
    angles, radii = [], []
    for k in chosen:
        frame = frames(name)[k]
        judgement = judged(name, frame, segmented(prepared(frame)))
        assert judgement.score.over == ()
        assert judgement.n_huge == 0
        assert judgement.n_wrong_kind == 0
        n_faces += frame.n_faces
        n_correct += len(judgement.score.correct)
        angles += judgement.angle_deg
        radii += judgement.radius_error_m
    assert n_correct >= 0.95 * n_faces
    assert np.median(angles) <= 0.01
    assert len(radii) == len(chosen) * (2 if name == "drum_and_post" else 1)
    assert np.median(radii) <= 0.0002
