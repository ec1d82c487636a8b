# SPDX-License-Identifier: MIT
"""Growing and its end: what is walked over, and clouds that are no parts."""

from functools import partial

import numpy as np
import pytest

from completion.parts.division import pipeline, proposals
from completion.parts.division.growing import (
    _is_explained,
    likely,
    reachable,
    refine_surface,
    walked,
)
from completion.parts.division.neighbourhoods import look_around
from completion.parts.division.pipeline import segment_part
from tests.helpers.generated_parts import PARTS, sampled


@pytest.mark.parametrize("kind", ["plane", "cylinder"])
def test_walking_reaches_what_a_look_at_all_points_reaches(kind):
    points, true, _ = sampled(PARTS["plate"](), 4e-3, 1e-4, 1)
    about = look_around(points, noise_m=1e-4)
    for number in range(1, true.max() + 1):
        begin = np.flatnonzero(true == number)[:40]
        for surface in likely(about, kind, begin):
            surface, covariance = refine_surface(surface, points[begin], about.tolerance_m)
            explains = partial(_is_explained, about, surface, covariance)
            explained = explains(np.full(len(points), np.nan), np.arange(len(points)))
            every = reachable(about.links.indptr, about.links.indices, explained, begin)
            reached = walked(
                about.links,
                np.ones(len(points), np.bool_),
                begin,
                partial(explains, np.full(len(points), np.nan)),
            )
            assert (reached == every).all()


def test_a_free_form_ends_early_and_is_told(monkeypatch):
    rng = np.random.default_rng(5)
    points = rng.normal(size=(3_000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    wave = rng.normal(size=(3, 30)) * 4
    points *= 1 + 0.03 * np.sin(points @ wave + rng.uniform(0, 6, 30)).sum(axis=1, keepdims=True)
    monkeypatch.setattr(proposals, "MANY_FACES", 8)
    found = segment_part(points)
    assert len(found.fits) <= 8
    assert (found.labels > 0).mean() < proposals.LEAST_OF_MANY
    (told,) = found.warnings
    assert f"the {len(found.fits)} largest faces have" in told
    assert "unseen complete" in told


def test_more_faces_than_parts_have_are_told(monkeypatch):
    monkeypatch.setattr(pipeline, "MANY_FACES", 6)
    points, _, _ = sampled(PARTS["plate"](), 4e-3, 1e-4, 1)
    found = segment_part(points)
    (told,) = found.warnings
    assert told.startswith(f"{len(found.fits)} faces have ")
    assert "if this is a scan of a room or a plant" in told
