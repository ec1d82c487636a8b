# SPDX-License-Identifier: MIT
"""Relations within `complete`: a strip of wall that a square room tells more of, and files of relations."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from completion import CompletionOptions, complete
from completion.edits.edit import Anchor
from completion.relations.graph import misfit_of
from completion.relations.options import BUILT
from completion.relations.relation import (
    RelationStatus,
    StatedRelation,
    read_part_relations,
    read_scan_relations,
)
from completion.result.record import completion_record
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.run.atomic import json_text
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

SIGMA = 0.003
PLAIN = CompletionOptions(texture=False)
CAMERA = PinholeProjection.from_fov(160, 120, 70)
EYE = np.array([0.0, 0.0, 1.4])
WALLS = (
    Plane((-1.2, 2.5, 1.2), (1.0, 0, 0)),
    Plane((0, 3.4, 1.2), (0, -1.0, 0)),
    Plane((0, 2.0, 0), (0, 0, 1.0)),
    Plane((1.3, 2.5, 1.2), (-1.0, 0, 0)),
)


def room_seen(seed: int = 0, turn_deg: float = 0.0, hides: bool = True) -> RangeImage:
    """A corridor's end: of the wall on the right, which may be turned, only a strip shows past a board."""
    pose = Pose.looking_at(EYE, (0.0, 3.0, 1.1))
    rays = CAMERA.directions().reshape(-1, 3) @ pose.rotation.T
    turn = np.radians(turn_deg)
    right = Plane(WALLS[3].point, (-np.cos(turn), np.sin(turn), 0))
    surfaces = [*WALLS[:3], right]
    every = np.stack([one.ray_ranges(EYE, rays) for one in surfaces])
    every = np.where(np.isfinite(every) & (every > 0), every, np.inf)
    ranges = every.min(axis=0)
    places = EYE + ranges[:, None] * rays
    if hides:
        before = (places[:, 0] > 0.7) & (places[:, 1] < 2.9)
        board = Plane((0.7, 1.5, 1.2), (-0.75, -0.6, 0.28)).ray_ranges(EYE, rays)
        ranges = np.where(before & np.isfinite(board) & (board < ranges), board, ranges)
    ranges = ranges + SIGMA * np.random.default_rng(seed).normal(size=len(rays))
    return RangeImage(ranges.reshape(CAMERA.shape), CAMERA, pose, sigma_m=SIGMA, name="corridor")


def right_wall(found):
    """The surface that is the wall on the right."""
    world = found.world_from_reference
    for number, patch in enumerate(found.patches, start=1):
        plane = patch.source.fit.surface.transform(world)
        if isinstance(plane, Plane) and abs(plane.normal_direction[0]) > 0.9 and plane.point[0] > 1.0:
            return number, plane
    raise AssertionError("the wall was not found")


@pytest.fixture(scope="module")
def related():
    return complete(room_seen(), PLAIN, rng=0)


def test_walls_of_a_square_room_are_square(related):
    graph = related.relations.graph
    holding = {one.kind for one in graph.relations if one.holds}
    assert {"parallel", "perpendicular"} <= holding
    assert {one.kind for one in graph.relations if one.status is RelationStatus.REJECTED} <= {
        "angle"
    }  # of the board
    assert max(graph.moved_sd) < 3.0
    for one in graph.accepted:
        assert misfit_of(one, graph.fits).angle_deg < 0.02
    assert graph.options.tolerance_deg < 0.05


@pytest.mark.long
def test_a_strip_is_known_better_with_relations_than_without(related):
    """Over ten noises the strip's direction errs less, and less is stated of it."""
    errors = {True: [], False: []}
    for seed in range(10):
        scan = room_seen(seed)
        for on in errors:
            found = complete(scan, replace(PLAIN, relations=BUILT if on else None), rng=0)
            _, plane = right_wall(found)
            errors[on].append(np.degrees(np.arccos(min(1.0, abs(plane.normal_direction[0])))))
    assert np.mean(np.square(errors[True])) < 0.5 * np.mean(np.square(errors[False]))


def test_a_wall_that_is_off_square_stays_so():
    found = complete(room_seen(turn_deg=2.0, hides=False), PLAIN, rng=0)
    _, plane = right_wall(found)
    assert np.degrees(np.arccos(abs(plane.normal_direction[0]))) == pytest.approx(2.0, abs=0.1)
    assert all(one.p > 1e-4 for one in found.relations.graph.accepted)


def test_off_has_no_relations_and_cues_leave_them_out():
    scan = room_seen()
    off = complete(scan, replace(PLAIN, relations=None), rng=0)
    cues = tuple(cue for cue in PLAIN.cues if cue != "relations")
    without = complete(scan, replace(PLAIN, cues=cues), rng=0)
    assert off.relations is None
    assert without.relations is None
    for one, two in zip(off.patches, without.patches, strict=True):
        np.testing.assert_array_equal(one.hypothesised, two.hypothesised)


def test_inferred_area_stays_clear_of_beams(related):
    assert related.free_space_violation_m2 == 0


def test_what_a_person_states_is_imposed_or_rejected_and_told():
    scan = room_seen(turn_deg=2.0, hides=False)
    plain = complete(scan, PLAIN, rng=0)
    number, _ = right_wall(plain)
    left = next(
        k
        for k, patch in enumerate(plain.patches, start=1)
        if patch.source.fit.surface.transform(plain.world_from_reference).normal_direction[0] > 0.9
    )
    walls = Anchor(plain.anchor(number), "plane"), Anchor(plain.anchor(left), "plane")
    says = StatedRelation(kind="parallel", surfaces=walls, source="here")
    found = complete(scan, replace(PLAIN, stated_relations=(says,)), rng=0)
    stated = [one for one in found.relations.graph.relations if one.is_given]
    assert [one.status for one in stated] == [RelationStatus.REJECTED]
    assert any("the stated relation parallel of surface" in text for text in found.warnings)
    never = StatedRelation(kind="perpendicular", surfaces=walls, is_forbidden=True)
    found = complete(scan, replace(PLAIN, stated_relations=(never,)), rng=0)
    assert not [one for one in found.relations.graph.relations if one.is_given]
    floor = replace(says, kind="coaxial")
    with pytest.raises(InputError, match="coaxial relates two axes"):
        complete(scan, replace(PLAIN, stated_relations=(floor,)), rng=0)
    with pytest.raises(InputError, match="imposed where relations are on"):
        replace(PLAIN, stated_relations=(says,), relations=None)


def test_the_record_lists_relations_that_can_be_stated_again(related, tmp_path):
    record = completion_record(related)
    assert {one["status"] for one in record["relations"]} <= {status.value for status in RelationStatus}
    assert record["degrees_of_freedom"]["free"] == related.relations.graph.free
    assert len(record["moved_by_relations"]) == len(related.relations.graph.fits)
    file = tmp_path / "completion.json"
    file.write_text(json_text(record))
    again = read_scan_relations(file)
    assert len(again) == sum(one.holds for one in related.relations.graph.relations)
    found = complete(room_seen(), replace(PLAIN, stated_relations=again), rng=0)
    assert all(one.holds for one in found.relations.graph.relations if one.is_given)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]x", "is no valid JSON"),
        ("{}", 'holds no list "relations"'),
        ('{"format": "other", "relations": []}', "its format is 'other'"),
        ('{"units": "mm", "relations": []}', "its units are 'mm'"),
        ("[3]", 'relation 1: needs a "type" of parallel'),
        ('[{"type": "round", "surfaces": [1]}]', "not 'round'"),
        ('[{"type": "parallel", "surfaces": [1, 2], "colour": 3}]', "knows no 'colour'"),
        ('[{"type": "parallel", "surfaces": 1}]', '"surfaces" are a list'),
        ('[{"type": "angle", "surfaces": [1, 2], "value": "x"}]', '"value" is a number'),
        ('[{"type": "parallel", "surfaces": [1, 2], "forbidden": 1}]', '"forbidden" is true or false'),
        ('[{"type": "parallel", "surfaces": [0, 2]}]', "labels, whole numbers from 1; got 0"),
    ],
)
def test_bad_files_of_relations_are_refused(tmp_path, text, message):
    file = tmp_path / "relations.json"
    file.write_text(text)
    with pytest.raises(InputError, match=message.replace("(", r"\(")) as told:
        read_part_relations(file)
    assert str(file) in str(told.value)


def test_degrees_become_radians_and_bad_numbers_are_told_with_their_source(tmp_path):
    file = tmp_path / "relations.json"
    said = [
        {"type": "angle", "surfaces": [1, 2], "value": 60},
        {"type": "radius", "surfaces": [3], "value": 0.02},
    ]
    file.write_text(json.dumps(said))
    angle, radius = read_part_relations(file)
    assert angle.value == pytest.approx(np.radians(60))
    assert radius.value == 0.02
    assert angle.of([0, 1]).is_given
    with pytest.raises(InputError, match="relation 1: angle is a relation of 2 surfaces, got 1"):
        angle.of([0])
