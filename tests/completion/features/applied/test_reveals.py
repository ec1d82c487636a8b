# SPDX-License-Identifier: MIT
"""Reveals: where sides and depth say, never where a beam passed, none of a side that nobody saw."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cases.walls import opening_case
from completion import CompletionOptions, complete
from completion.evidence.evidence import Label
from completion.extension.patch import Provenance
from completion.features.engine.template import FeatureSide, FeatureStatus, TemplateFit
from completion.features.stated import reveals_of
from completion.observe.observation import observe
from completion.result.record import completion_record

PLAIN = CompletionOptions(texture=False)


@pytest.fixture(scope="module")
def case():
    return opening_case(100, "window", 0.5)


@pytest.fixture(scope="module")
def done(case):
    return complete(case.scan, PLAIN, rng=0)


def faces_of(done):
    return [patch for patch in done.patches if patch.feature]


@pytest.mark.long
def test_inferred_reveals_lie_on_true_ones(case, done):
    y0, z0, y1, z1 = case.hole
    low, high = np.array([case.x, y0, z0]), np.array([case.x + case.depth, y1, z1])
    faces = faces_of(done)
    assert sum(face.hypothesised_m2 for face in faces) > 0.02
    for face in faces:
        normal = done.world_from_reference.rotate(face.grid.surface.normal_direction[None])[0]
        axis = int(np.argmax(np.abs(normal)))
        assert abs(normal[axis]) > 0.999
        places = done.world_from_reference.apply(face.grid.centres())
        side = low[axis] if normal[axis] > 0 else high[axis]
        assert np.abs(places[:, axis] - side).max() < 0.01
        assert (places >= low - 0.02).all()
        assert (places <= high + 0.02).all()


def test_nothing_is_inferred_where_beams_passed_or_nobody_looked(done):
    for face in faces_of(done):
        assert (face.evidence.labels[face.hypothesised] == Label.OCCLUDED).all()
        assert (face.provenance[face.hypothesised] == Provenance.FEATURE).all()
        assert not (face.hypothesised & face.observed).any()


def test_no_reveal_of_a_side_that_nobody_saw(done):
    for number, fit in enumerate(done.features, start=1):
        n_seen = len(fit.sides) - len(fit.unseen)
        assert sum(face.feature == number for face in done.patches) <= n_seen


def test_the_record_says_which_feature_a_face_is_of(done):
    text = json.loads(json.dumps(completion_record(done), default=np.ndarray.tolist))
    features = [surface["feature"] for surface in text["surfaces"]]
    assert features == [patch.feature for patch in done.patches]
    for surface, patch in zip(text["surfaces"], done.patches, strict=True):
        if patch.feature:
            away = patch.grid.surface.distance(done.world_from_reference.inverse().apply([surface["anchor"]]))
            assert abs(away[0]) < 0.05


def test_a_shallow_or_unknown_depth_gives_no_reveals(case, done):
    seen = observe(case.scan, case.scan.world_from_sensor)
    surfaces = [patch.source for patch in done.patches if not patch.feature]
    fit = next(fit for fit in done.features if fit.status is FeatureStatus.FOUND)
    owners = [np.zeros(case.scan.shape, np.int32)]

    def n_faces(fit: TemplateFit) -> int:
        return len(reveals_of([fit], surfaces[:1], [seen], owners, 0.002))

    wall = replace(fit, geometry={**fit.geometry, "surface": 1})
    n_seen = len(fit.sides) - len(fit.unseen)
    assert n_faces(wall) == n_seen
    for more in ({"depth_m": 0.01}, {"depth_m": np.nan}, {"depth_sd_m": np.inf}, {"depth_sd_m": 0.2}):
        assert n_faces(replace(wall, geometry={**wall.geometry, **more})) == 0
    assert n_faces(replace(wall, status=FeatureStatus.AMBIGUOUS)) == 0
    unseen = tuple(FeatureSide(side.name, 0, 0, side.total, np.inf) for side in fit.sides)
    assert n_faces(replace(wall, sides=unseen)) == 0
    doorway = replace(
        wall, kind="doorway", sides=tuple(FeatureSide(s.name, 5, 0, 5, 0.01) for s in fit.sides)
    )
    assert n_faces(doorway) == 3
