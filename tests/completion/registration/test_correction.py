# SPDX-License-Identifier: MIT
"""Poses of scans: how far off they are is told, small motions cure it, and what moved counts apart."""

from functools import cache

import numpy as np
import pytest

from completion.evidence.sight import sight_of
from completion.observe.observation import observe
from completion.observe.tolerance import EvidenceOptions
from completion.registration import limits
from completion.registration.correction import Registration
from completion.registration.facets import facets_of
from completion.registration.pipeline import check_poses, correct_poses, register_scans
from completion.registration.prior import settle
from completion.registration.registered import pose_doubts
from completion.registration.verdict import Verdict
from scenes.io.scan_files import read_scan
from scenes.pose import Pose
from tests.helpers.crate_scans import misplaced, scan
from tests.helpers.data_paths import data_path, requires_data

WORLD = Pose.identity()
SIZES = ((0.1, 0.005), (0.2, 0.02), (0.5, 0.02), (1.0, 0.05))  # degrees, metres


def registered(scans, **options) -> Registration:
    observations = [observe(view, WORLD) for view in scans]
    return correct_poses(observations, range(len(scans)), stated_m=0.005, **options)


@cache
def with_one_off(turn_deg: float, shift_m: float, seed: int) -> Registration:
    return registered([scan(0), scan(1), misplaced(scan(2), turn_deg, shift_m, seed)])


def apart(view, motion) -> float:
    """Root mean square by which a motion shifts what a scan measured, along the normals, metres."""
    facets = facets_of(observe(view, WORLD))
    shift = motion.apply(facets.centre) - facets.centre
    return float(np.sqrt(np.mean(np.square(np.einsum("ij,ij->i", shift, facets.normal)))))


@pytest.mark.parametrize("seed", range(3))
def test_exact_poses_stay_as_they_are_to_the_bit(seed):
    registration = registered([scan(k, seed=seed) for k in range(4)])
    assert not registration.is_moved
    assert np.array_equal(registration.motions, np.tile(np.eye(4), (4, 1, 1)))
    assert len(registration.pairs) >= 3
    assert (registration.left_m < 0.005).all()  # the usual tolerance is not raised
    assert max(pair.offset_m for pair in registration.pairs) < 0.001
    assert max(pair.contradicted_m2 / pair.overlap_m2 for pair in registration.pairs) < 0.01


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("turn", "shift"), SIZES)
def test_what_one_pose_is_off_is_told_by_its_pairs_and_no_other(turn, shift, seed):
    bad, registration = misplaced(scan(2), turn, shift, seed), with_one_off(turn, shift, seed)
    true = apart(bad, bad.world_from_sensor @ scan(2).world_from_sensor.inverse())
    offsets = {(pair.first, pair.second): pair.offset_m for pair in registration.pairs}
    for pair in ((0, 2), (1, 2)):
        assert offsets[pair] == pytest.approx(true, rel=0.5)  # on that part of the scan which both measured
    assert offsets[0, 1] < 0.2 * true + 0.001


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("turn", "shift"), SIZES)
def test_motions_bring_scans_together_as_well_as_is_told(turn, shift, seed):
    bad, registration = misplaced(scan(2), turn, shift, seed), with_one_off(turn, shift, seed)
    now = Pose(np.linalg.inv(registration.motions[0]) @ registration.motions[2]) @ bad.world_from_sensor
    error = apart(scan(2), now @ scan(2).world_from_sensor.inverse())
    assert error < 0.003
    assert error < 2.0 * registration.left_m[2]
    assert (registration.left_m < 0.005).all()


def test_the_scan_that_is_off_moves_and_not_the_others():
    registration = with_one_off(1.0, 0.05, 0)
    assert registration.moved_m[2] > 4 * max(registration.moved_m[0], registration.moved_m[1])


def test_poses_that_are_kept_are_known_no_better_than_they_are():
    scans = [scan(0), scan(1), misplaced(scan(2), 0.5, 0.03, 1)]
    kept = registered(scans, moves=False)
    moved = registered(scans)
    assert not kept.is_moved
    assert kept.left_m[2] > 2 * 0.8 * min(pair.offset_m for pair in moved.pairs if pair.second == 2)
    assert (kept.left_m[:2] < 0.01).all()
    assert [pair.offset_m for pair in kept.pairs] == [pair.offset_m for pair in moved.pairs]
    assert all(pair.still_contradicted_m2 == pair.contradicted_m2 for pair in kept.pairs)


def test_a_crate_that_moved_is_a_contradiction_and_no_error_of_the_poses():
    same, moved = registered([scan(0), scan(2)]), registered([scan(0), scan(2, crate_x=2.6)])
    (before,), (after,) = same.pairs, moved.pairs
    assert before.still_contradicted_m2 < 0.01
    assert after.still_contradicted_m2 > 0.1  # a crate's side is .42 m2
    assert after.depth_m > 0.1
    assert not moved.is_moved
    assert (moved.left_m < 0.005).all()


def test_scans_that_share_nothing_say_nothing():
    away = scan(1).with_facts(world_from_sensor=Pose.looking_at((50, 0, 1), (60, 0, 1)))
    registration = registered([scan(0), away])
    assert registration.pairs == ()
    assert np.isnan(registration.left_m).all()
    assert registered([scan(0)]).pairs == ()


def test_scans_beyond_those_that_settle_together_settle_among_them(monkeypatch):
    monkeypatch.setattr(limits, "N_TOGETHER", 3)
    bad = misplaced(scan(3), 0.5, 0.03, 2)
    scans = [scan(0), scan(1), scan(2), bad]
    registration = correct_poses([observe(view, WORLD) for view in scans], (0, 1, 2), stated_m=0.005)
    now = Pose(np.linalg.inv(registration.motions[0]) @ registration.motions[3]) @ bad.world_from_sensor
    assert apart(scan(3), now @ scan(3).world_from_sensor.inverse()) < 0.003
    assert {pair.second for pair in registration.pairs} == {1, 2, 3}
    assert registration.moved_m[3] > 0.01


@requires_data
def test_dining_room_poses_are_told_to_be_centimetres_off_by_pair():
    """The poses of this sequence were chained from frame to frame by hand; the first is 6 cm off the last."""
    scans = [
        read_scan(
            data_path(f"range/nyu_dining#{k}"), intrinsics=(518.0, 519.0, 325.5, 253.5), depth_scale=1000.0
        )
        for k in range(1, 6)
    ]
    registration = correct_poses(
        [observe(view, scans[0].world_from_sensor) for view in scans], range(5), stated_m=0.005
    )
    assert len(registration.pairs) == 10
    offset = {(pair.first, pair.second): pair.offset_m for pair in registration.pairs}
    assert 0.04 < offset[0, 4] < 0.09
    assert offset[3, 4] < 0.015
    assert all(pair.left_m < 0.01 for pair in registration.pairs)
    assert sum(pair.still_contradicted_m2 for pair in registration.pairs) < sum(
        pair.contradicted_m2 for pair in registration.pairs
    )


def test_of_scans_that_share_nothing_no_pose_is_taken_to_be_off_without_end():
    observations, tolerance = [observe(scan(k), WORLD) for k in range(2)], EvidenceOptions().tolerance()
    facets, sights = (
        [facets_of(view) for view in observations],
        [sight_of(view, tolerance) for view in observations],
    )
    corrections = settle(facets, sights, [])
    assert np.array_equal(corrections.motions, np.tile(np.eye(4), (2, 1, 1)))
    assert np.abs(corrections.covariance).max() < 10.0  # metres and radians, squared


def check_agreement(scans, corrected, free):
    """Hold poses as corrected and as found from any start to three deviations of each other, by groups."""
    for network in free.groups:
        first, *others = network.group.poses
        for k in others:
            held = [Pose(corrected.motions[i]) @ scans[i].world_from_sensor for i in (first, k)]
            pose = Pose(np.vstack([network.group.poses[k], [0, 0, 0, 1]]))
            apart = pose.inverse() @ held[0].inverse() @ held[1]
            facets = facets_of(observe(scans[k].with_facts(world_from_sensor=WORLD), WORLD))
            shift = np.einsum("ij,ij->i", apart.apply(facets.centre) - facets.centre, facets.normal)
            deviation = np.hypot(free.pose_deviation(k), corrected.left_m[k] / 2)
            assert np.sqrt(np.mean(np.square(shift))) < 3 * deviation


@pytest.mark.long
def test_scans_with_poses_and_without_come_to_the_same_groups_and_poses():
    scans = [scan(0), scan(1), misplaced(scan(2), 1.0, 0.05, 0)]
    corrected, free = registered(scans), register_scans(scans)
    assert corrected.groups == tuple(tuple(network.group.poses) for network in free.groups) == ((0, 1, 2),)
    assert not corrected.refused
    check_agreement(scans, corrected, free)


@pytest.fixture(scope="module")
def photographs():
    """Frames with poses up to 18 cm off; warped photographs show that correcting by 315 mm is worse."""
    return [read_scan(data_path(f"range/nvblox_3dmatch#{k}")) for k in range(1, 6)]


@pytest.fixture(scope="module")
def corrected_photographs(photographs):
    observations = [observe(view, photographs[0].world_from_sensor) for view in photographs]
    return correct_poses(observations, range(5), stated_m=0.005)


@pytest.mark.long
@requires_data
def test_frames_that_no_motion_brings_together_are_two_groups_that_stay(photographs, corrected_photographs):
    assert corrected_photographs.groups == ((0, 1, 2), (3, 4))
    assert corrected_photographs.refused == {(i, j) for i in range(3) for j in (3, 4)}
    assert not corrected_photographs.is_moved
    (doubt,) = pose_doubts(corrected_photographs)
    assert doubt.startswith("poses contradict what was measured: scans 3 and 5 lie 180 mm apart")
    assert doubt.endswith("stay to each other as they came: scans 1, 2 and 3 | scans 4 and 5")
    checked = check_poses(photographs)
    assert tuple(tuple(network.group.poses) for network in checked.groups) == corrected_photographs.groups
    across = {pair.scans for pair in checked.pairs if pair.verdict is Verdict.AMBIGUOUS}
    assert across == corrected_photographs.refused
    assert pose_doubts(checked.checked) == [doubt]
    for pose, scan_given in zip(checked.world_poses(photographs), photographs, strict=True):
        np.testing.assert_allclose(pose.matrix, scan_given.world_from_sensor.matrix, atol=1e-9)


@pytest.mark.long
@requires_data
def test_frames_are_the_same_two_groups_from_any_start(photographs, corrected_photographs):
    free = register_scans(photographs)
    assert tuple(tuple(network.group.poses) for network in free.groups) == corrected_photographs.groups
    across = {pair.scans for pair in free.pairs if pair.verdict is not Verdict.REGISTERED}
    assert across == corrected_photographs.refused
    check_agreement(photographs, corrected_photographs, free)
