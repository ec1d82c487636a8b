# SPDX-License-Identifier: MIT
"""Several scans: what the others say of the first one's inference, and poses that are a little off."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from completion import Completion, EvidenceOptions, Finding, complete, verify
from completion.evidence.evidence import Scans
from completion.merging import scan_surfaces
from completion.pipeline import verify_first
from completion.result import verification
from completion.result.verification import counterpart
from nbv.cli import app
from nbv.report.blocks.page import Page
from nbv.report.completion_report import verification_sections
from nbv.run.wording import square_metres
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.checks import InputError
from scenes.io.scan_files import write_scan
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from tests.helpers.completion_examples import PLAIN, completed, example, scene
from tests.helpers.long_cases import first_in_gate

OTHER_CORNER = Pose.looking_at((5.5, 0.6, 1.7), (1.5, 3.5, 0.5))
CAMERA = PinholeProjection.from_fov(120, 90, 60)


@pytest.fixture(scope="module")
def first() -> RangeImage:
    return example("two_occluders", "gaussian-2mm", pixels=120)


@pytest.fixture(scope="module")
def other() -> RangeImage:
    sensor = PinholeSensor(fov_deg=65, width=120, height=120)
    return scan_scene(scene("two_occluders"), OTHER_CORNER, sensor, noise="gaussian-2mm", rng=1)


@pytest.fixture(scope="module")
def alone() -> Completion:
    return completed("two_occluders", "gaussian-2mm", pixels=120)


@pytest.fixture(scope="module")
def both(first, other) -> Completion:
    return complete([first, other], PLAIN)


def wall_with_board(wall_behind_board: bool) -> tuple[RangeImage, RangeImage]:
    """A wall z = 3 behind a board z = 2 seen from the left, and from the right, where it may have a hole."""
    scans = []
    for x in (-0.6, 0.6):
        rays = CAMERA.directions()
        depth = np.full(CAMERA.shape, 3.0)
        at_wall, at_board = x + 3.0 * rays[..., 0] / rays[..., 2], x + 2.0 * rays[..., 0] / rays[..., 2]
        height = 3.0 * rays[..., 1] / rays[..., 2]
        if not wall_behind_board:
            depth[(np.abs(at_wall - 0.25) < 0.2) & (np.abs(height) < 0.3)] = 6.0
        depth[(np.abs(at_board) < 0.15) & (np.abs(height / 1.5) < 0.5)] = 2.0
        pose = Pose.from_parts(np.eye(3), np.array([x, 0.0, 0.0]))
        scans.append(RangeImage(depth / rays[..., 2], CAMERA, pose, sigma_m=0.0))
    return scans[0], scans[1]


def test_a_wall_that_goes_on_is_confirmed():
    first, other = wall_with_board(wall_behind_board=True)
    one = complete(first, PLAIN)
    said = verify(one, [other])
    inferred = one.patches[0].hypothesised_m2
    assert inferred > 0.3
    assert said.area_m2(Finding.CONFIRMED) > 0.9 * inferred
    assert said.area_m2(Finding.REFUTED) == 0


def test_a_hole_that_was_inferred_to_be_wall_is_refuted_and_not_in_the_joint_model():
    first, other = wall_with_board(wall_behind_board=False)
    one = complete(first, PLAIN)
    (wall,) = (surface for surface in verify(one, [other]).surfaces if surface.patch.observed_m2 > 3)
    points = wall.patch.grid.centres().reshape(*wall.finding.shape, 3) + first.origin
    inferred = wall.patch.hypothesised
    deep = (np.abs(points[..., 0] - 0.25) < 0.15) & (np.abs(points[..., 1]) < 0.25) & inferred
    assert deep.sum() > 50
    assert (wall.finding[deep] == Finding.REFUTED).all()
    both = complete([first, other], PLAIN)
    assert both.free_space_violation_m2 == 0
    centres = both.hypothesised.vertices[both.hypothesised.faces].mean(axis=1) + first.origin
    assert not ((np.abs(centres[:, 0] - 0.25) < 0.15) & (np.abs(centres[:, 1]) < 0.25)).any()


def test_findings_share_out_all_that_was_inferred(alone, other):
    said = verify(alone, [other])
    shares = [said.area_m2(finding) for finding in (Finding.CONFIRMED, Finding.REFUTED, Finding.HIDDEN)]
    assert sum(shares) == pytest.approx(sum(patch.hypothesised_m2 for patch in alone.patches))
    assert shares[0] > 3  # the floor behind the low box
    assert shares[1] < 0.05 * shares[0]
    assert shares[2] > 5
    again = verify(alone, [other, other])
    assert again.area_m2(Finding.CONFIRMED) == shares[0]


def test_scans_are_made_ready_once_for_all_surfaces(alone, other, monkeypatch):
    made = []
    monkeypatch.setattr(
        verification, "Scans", lambda *parts, **known: made.append(known) or Scans(*parts, **known)
    )
    assert len(verify(alone, [other]).surfaces) > 1
    assert len(made) == 1


def test_verification_takes_the_regions_of_the_first_scan_as_they_are(both, monkeypatch):
    for name in ("segment", "observe"):
        monkeypatch.setattr(scan_surfaces, name, lambda *_: pytest.fail("the scan is prepared again"))
    surfaces = verify_first(both, PLAIN, n_threads=1).surfaces
    assert sum(surface.area_m2(Finding.CONFIRMED) for surface in surfaces) > 3


def test_verification_is_that_of_the_first_scan_completed_by_itself(both, alone, other):
    assert not both.registration.is_moved
    errors = [seen.pose_error_m for seen in both.observations[1:]]
    evidence = EvidenceOptions(flatness_m=alone.flatness_m)
    apart = verify(alone, [other], evidence, registration_m=np.array(errors))
    together = verify_first(both, PLAIN, n_threads=1)
    for mine, yours in zip(together.surfaces, apart.surfaces, strict=True):
        np.testing.assert_array_equal(mine.finding, yours.finding)


def test_findings_are_what_rays_in_the_true_scene_say(alone, other):
    """A ray from the other scanner ends at what is confirmed, before what is hidden, beyond the refuted."""
    beyond: dict[Finding, list[np.ndarray]] = {finding: [] for finding in Finding}
    for surface in verify(alone, [other]).surfaces:
        for finding in Finding:
            cells = surface.patch.grid.centres()[(surface.finding == finding).ravel()]
            world = alone.world_from_reference.apply(cells)
            world = world[np.isfinite(other.pixels(world)).all(axis=-1)]
            away = np.linalg.norm(world - other.origin, axis=-1)
            rays = (world - other.origin) / away[:, None]
            hits = scene("two_occluders").ray_caster().first_hit(other.origin[None], rays)
            beyond[finding].append(hits.ranges - away)
    confirmed, hidden, refuted = (
        np.concatenate(beyond[finding]) for finding in (Finding.CONFIRMED, Finding.HIDDEN, Finding.REFUTED)
    )
    assert len(confirmed) > 2000
    assert len(hidden) > 2000
    assert len(refuted) > 10
    assert np.mean(np.abs(confirmed) < 0.02) > 0.95
    assert np.mean(hidden < -0.02) > 0.9
    assert np.mean(refuted > 0.02) > 0.8


def test_tolerances_decide_what_is_refuted(alone, other):
    usual = verify(alone, [other])
    strict = verify(alone, [other], EvidenceOptions(n_sigma=0.5), registration_m=0.0)
    assert strict.area_m2(Finding.REFUTED) > usual.area_m2(Finding.REFUTED)
    own = verify(alone, [other], EvidenceOptions(n_sigma=0.5, registration_m=0.0))
    assert own.area_m2(Finding.REFUTED) == strict.area_m2(Finding.REFUTED)
    flat = verify(alone, [other], EvidenceOptions(n_sigma=0.5, registration_m=0.0, flatness_m=0.05))
    assert flat.area_m2(Finding.REFUTED) < strict.area_m2(Finding.REFUTED)
    vague = verify(alone, [other], sigma_m=0.05)  # 4 sigma is more than any beam may be off and still speak
    assert vague.area_m2(Finding.CONFIRMED) == vague.area_m2(Finding.REFUTED) == 0


@pytest.mark.parametrize("seed", first_in_gate(1, range(2)))
def test_poses_five_millimetres_off_still_merge_and_violate_nothing(first, other, both, seed):
    """The law of the registration error: surfaces stay one, and no beam goes through what is inferred."""
    rng = np.random.default_rng(seed)
    shift = rng.normal(size=3)
    shift *= 0.005 / np.linalg.norm(shift)
    moved = Pose.from_parts(other.world_from_sensor.rotation, other.world_from_sensor.translation + shift)
    off = complete([first, replace(other, world_from_sensor=moved)], PLAIN)
    assert off.free_space_violation_m2 == 0
    large = [sum(patch.observed_m2 > 0.5 for patch in found.patches) for found in (both, off)]
    assert large[1] == large[0]
    assert off.hypothesised_m2 == pytest.approx(both.hypothesised_m2, rel=0.15)


def test_a_scan_more_never_adds_violation(alone, both):
    assert both.free_space_violation_m2 <= alone.free_space_violation_m2 + 1e-12


def test_no_other_scan_is_refused(alone):
    with pytest.raises(InputError, match="give at least one other scan"):
        verify(alone, [])


def test_complete_tells_what_the_second_scan_says_of_the_first(alone, first, other, tmp_path, monkeypatch):
    pages = []

    def keep_page(_completion, _title, _decisions, **given):
        pages.append(given["first_scan"])
        return Page("", "", "", (), None, (), {}, 0)

    monkeypatch.setattr("nbv.report.completion_report.completion_page", keep_page)
    for name, scan in (("a.npz", first), ("b.npz", other)):
        write_scan(scan, tmp_path / name)
    scans = [str(tmp_path / "a.npz"), str(tmp_path / "b.npz")]
    arguments = ["complete", *scans, "--no-texture", "--registration", "0.01", "-o", str(tmp_path)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.stderr
    held = json.loads((tmp_path / "completion.json").read_text())
    said = held["first_scan"]
    expected = verify(alone, [other], registration_m=0.005)  # of 0.01 stated: both show that it is less
    assert said["confirmed_m2"] == pytest.approx(expected.area_m2(Finding.CONFIRMED))
    numbers = {surface["id"] for surface in held["surfaces"]}
    assert {surface["surface"] for surface in said["surfaces"]} <= {0, *numbers}
    assert said["confirmed_m2"] == pytest.approx(sum(one["confirmed_m2"] for one in said["surfaces"]))
    assert "the others confirm" in result.stdout
    (section,) = verification_sections(pages[0])
    rows = section.blocks[0].rows
    assert [cell.text for cell in rows[-1]][:2] == ["all", square_metres(said["confirmed_m2"])]
    assert len(rows) - 1 <= len(said["surfaces"])
    assert verification_sections(None) == ()


def test_surfaces_are_followed_into_the_joint_model(alone, both, other):
    """Each has a counterpart of its own, fitted to the same place; where the model has none, it is 0."""
    surfaces = verify(alone, [other]).surfaces
    numbers = [counterpart(surface, both) for surface in surfaces]
    assert len(surfaces) > 6
    assert len(set(numbers)) == len(surfaces)
    for number, surface in zip(numbers, surfaces, strict=True):
        found = both.patches[number - 1].grid.surface
        assert found.kind == surface.patch.grid.surface.kind
        measured = surface.patch.source.points(alone.observations)
        world = alone.world_from_reference.apply(measured)
        here = both.world_from_reference.inverse().apply(world)
        assert np.median(np.abs(found.distance(here))) < 4 * 0.002
    nobody = both.completed.scans.with_owners([np.zeros_like(owners) for owners in both.owners])
    without = replace(both, completed=replace(both.completed, scans=nobody))
    assert counterpart(surfaces[0], without) == 0
