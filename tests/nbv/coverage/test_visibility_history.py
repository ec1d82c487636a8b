# SPDX-License-Identifier: MIT
"""Visibility histories agree with the coverage that the same views reach, step by step."""

import numpy as np
import pytest

from nbv.coverage.coverage import MET, NEVER
from nbv.coverage.measurement import measure_coverage, measure_scan_coverage, visibility_history
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene

ROOM = builtin_scene("two_occluders")
SAMPLES = sample_surface(ROOM.mesh, 0.3)
SENSOR = PinholeSensor(fov_deg=80, width=80, height=80)
VIEWS = [
    View(Pose.looking_at(place, (3, 2.5, 1.0)), SENSOR)
    for place in ((0.5, 0.5, 1.5), (5.5, 0.6, 1.6), (5.4, 4.5, 1.5), (0.6, 4.4, 1.7))
]
CANDIDATES = Candidates(np.array([[0.5, 0.5, 1.5]]), np.array([[1.0, 0.5, 0.0]]))


def seen_by(k, views=VIEWS, before=()):
    return visibility_history(ROOM.ray_caster(1), SAMPLES, Requirement(k=k), views, before)


@pytest.mark.parametrize("k", [1, 2])
def test_after_each_view_they_are_the_coverage_by_the_views_so_far(k):
    seen = seen_by(k)
    sample = np.repeat(np.arange(len(SAMPLES)), np.diff(seen.start))
    for step in range(1, len(VIEWS) + 1):
        found = measure_coverage(ROOM, VIEWS[:step], Requirement(k=k), samples=SAMPLES, candidates=CANDIDATES)
        so_far = seen.view <= step
        best = np.zeros(len(SAMPLES))
        np.maximum.at(best, sample[so_far], seen.cosine[so_far])
        assert (best == found.best_cosine).all()
        assert (np.bincount(sample[so_far], minlength=len(SAMPLES)) == found.n_views).all()
        assert ((seen.first_met <= step) == (found.state == MET)).all()
        assert seen.met[step] == pytest.approx(found.met)
    assert seen.met[0] == 0
    assert (np.diff(seen.met) >= 0).all()
    assert (seen.first_met == NEVER).any()


def test_scans_count_by_what_they_measured_and_those_before_are_number_0():
    scans = [scan_scene(ROOM, view, rng=0) for view in VIEWS]
    given = {"samples": SAMPLES, "candidates": CANDIDATES, "sensor": SENSOR}
    found = measure_scan_coverage(ROOM, scans, Requirement(), **given)
    seen = seen_by(1, scans)
    assert (np.diff(seen.start) == found.n_views).all()
    assert seen.met[-1] == pytest.approx(found.met)
    later = seen_by(1, scans[1:], scans[:1])
    assert later.met == pytest.approx(seen.met[1:])
    assert ((later.first_met == 0) == (seen.first_met == 1)).all()
    assert (later.view == np.maximum(seen.view - 1, 0)).all()


def test_without_views_nothing_is_seen():
    seen = seen_by(1, [])
    assert seen.met == (0.0,)
    assert len(seen.view) == 0
    assert (seen.first_met == NEVER).all()
