# SPDX-License-Identifier: MIT
"""Check of a small room: what moved, what is missing, and the same findings wherever the room stands."""

from dataclasses import asdict
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from completion.asbuilt.pipeline import CheckOptions, check_against_design
from scenes.checks import InputError
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from tests.completion.asbuilt.designs import boxes, scanned
from tests.completion.asbuilt.test_beams import ROOM

SIGMA_M, MOVED_M = 0.002, 0.03
PIERS = {"pier": ((2.2, 3.2, 0), (3.4, 3.35, 2.5)), "screen": ((2.4, 1.2, 0.0), (2.45, 2.4, 2.0))}
DESIGN = boxes(ROOM | PIERS, classes={"screen": "IfcPlate"})
EYES = ((1.2, 1.2, 1.4), (1.4, 4.0, 1.5))
SEEN = {"floor", "ceiling", "west", "east", "south", "north", "pier", "screen"}
OPTIONS = CheckOptions(registration=(0.001, 0.003))


@cache
def scans(east_m=0.0, screen=True, wrong=(0.0, 0.0, 0.0), eyes=EYES, sigma_m=SIGMA_M):
    """Two scans of 60,000 pixels of a room whose east wall moved inwards, and which may lack its screen."""
    solids = ROOM | PIERS | {"east": ((4 - east_m, 0, 0), (4.2 - east_m, 5, 2.5))}
    built = boxes({name: box for name, box in solids.items() if screen or name != "screen"})
    move = Pose.from_parts(np.eye(3), np.array(wrong))
    return tuple(
        scanned(built, eye, sigma_m=sigma_m, rng=k, name=f"s{k + 1}", wrong=move)
        for k, eye in enumerate(eyes)
    )


@cache
def checked(**state):
    return check_against_design(DESIGN, scans(**state), OPTIONS, n_threads=1)


def verdicts(check):
    return {one.element.name: one.verdict for one in check.elements}


def offsets(check):
    return {one.element.name: one.offset.value for one in check.elements if one.offset is not None}


def moved(design, given, pose):
    """A design and its scans elsewhere."""
    mesh = design.mesh.transform(pose)
    there = [scan.with_facts(world_from_sensor=pose @ scan.world_from_sensor) for scan in given]
    return ElementMesh(mesh, design.elements, design.name), there


def test_a_room_as_designed_is_within() -> None:
    check = checked()
    assert verdicts(check) == dict.fromkeys(SEEN, "within")
    assert check.extra == ()
    tested = [face for one in check.elements for face in one.faces if face.is_tested and face.is_main]
    assert len(tested) >= len(SEEN)
    held = [face.offset.low <= 0 <= face.offset.high for face in tested]
    assert np.mean(held) > 0.85
    assert np.median([face.offset.high - face.offset.low for face in tested]) < 0.004
    assert check.alignment.tau_m < 0.002


def test_a_wall_that_moved_deviates_with_an_interval_that_holds() -> None:
    check = checked(east_m=MOVED_M)
    assert verdicts(check) == dict.fromkeys(SEEN, "within") | {"east": "deviates"}
    east = next(one for one in check.elements if one.element.name == "east")
    assert east.kind == "offset"
    assert east.offset.low <= MOVED_M <= east.offset.high
    assert east.offset.high - east.offset.low < 0.006
    assert east.offset.along == pytest.approx((-1, 0, 0))
    assert np.abs(check.alignment.shift_m).max() < 0.002
    near = check.cloud.deviation_m[(check.cloud.element == east.surface) & (check.cloud.points[:, 0] < 4.0)]
    assert np.nanmedian(near) == pytest.approx(MOVED_M, abs=0.002)


@pytest.mark.parametrize(
    ("east_m", "expected"), [(0.004, "within"), (0.01, "undecided"), (0.018, "deviates")]
)
def test_verdicts_follow_the_tolerance(east_m: float, expected: str) -> None:
    assert verdicts(checked(east_m=east_m))["east"] == expected


def test_what_is_not_there_is_missing_and_what_no_scan_saw_is_not_seen() -> None:
    assert verdicts(checked(screen=False)) == dict.fromkeys(SEEN, "within") | {"screen": "missing"}
    far = boxes(ROOM | PIERS | {"shed": ((9, 0, 0), (9.2, 2, 2))})
    found = check_against_design(far, scans(), OPTIONS, n_threads=1)
    assert verdicts(found)["shed"] == "not seen"


def asked(given, **options):
    """The check with other options."""
    chosen = CheckOptions(registration=OPTIONS.registration, **options)
    return check_against_design(DESIGN, given, chosen, n_threads=1)


def test_tolerances_are_by_class_or_name() -> None:
    given = scans(east_m=0.018)
    assert verdicts(asked(given, tolerances={"IfcW*": 0.03}))["east"] == "within"
    assert verdicts(asked(given, tolerances={"east": 0.03, "IfcW*": 0.01}))["east"] == "deviates"


def test_elements_are_asked_for_or_left_out() -> None:
    given = scans(east_m=0.018)
    assert set(verdicts(asked(given, only=("east", "IfcPlate")))) == {"east", "screen"}
    found = asked(given, without=("screen",))
    assert "screen" not in verdicts(found)
    assert len(found.extra) == 1


def test_scans_that_may_not_move_show_what_is_off() -> None:
    assert verdicts(asked(scans(wrong=(0.02, 0.0, 0.0)), align=False))["west"] == "deviates"


def test_scans_three_centimetres_off_are_aligned() -> None:
    wrong = np.array([0.03, -0.02, 0.01])
    check = checked(wrong=tuple(wrong.tolist()))
    assert verdicts(check) == dict.fromkeys(SEEN, "within")
    assert check.alignment.shift_m == pytest.approx(-wrong, abs=0.002)
    assert (np.abs(check.alignment.shift_m + wrong) < 3 * check.alignment.shift_sd_m).all()


def test_scans_that_are_all_off_alike_are_told() -> None:
    (told,) = checked(wrong=(0.1, 0.0, 0.0)).warnings
    assert told.startswith(
        "all 2 scans were moved alike by (-100.0 ± 1.5, 0.0 ± 1.5, 0.0 ± 1.7) mm and turned"
    )
    assert "the survey's origin is wrong, or the building stands elsewhere" in told
    assert checked().warnings == checked(wrong=(0.008, 0.0, 0.0)).warnings == ()  # 10 mm may be


def test_beams_too_noisy_leave_what_they_met_undecided() -> None:
    check = check_against_design(DESIGN, scans(sigma_m=0.05), OPTIONS, n_threads=1)
    assert verdicts(check) == dict.fromkeys(SEEN, "undecided")
    west = check.elements[2].sentence
    assert west.startswith("too noisy: sigma 50.0 mm at 1.")
    assert west.endswith("where 30.0 mm is the most that tells anything of this design; tolerance 10.0 mm")


def test_far_from_the_origin_nothing_changes() -> None:
    """500 km away, as surveyors' frames are: the same findings to a micrometre."""
    here, move = checked(east_m=MOVED_M), Pose.from_parts(np.eye(3), np.array([5e5, -4e5, 300.0]))
    there = check_against_design(*moved(DESIGN, scans(east_m=MOVED_M), move), OPTIONS, n_threads=1)
    assert verdicts(there) == verdicts(here)
    assert offsets(there) == pytest.approx(offsets(here), abs=2e-5)
    assert there.alignment.shift_m == pytest.approx(here.alignment.shift_m, abs=2e-5)
    assert len(there.samples.points) == pytest.approx(len(here.samples.points), abs=1)  # a rounded number


def test_a_turned_room_has_the_same_findings() -> None:
    here = checked(east_m=MOVED_M)
    turn = Rotation.from_euler("zx", [37.0, 12.0], degrees=True).as_matrix()
    pose = Pose.from_parts(turn, np.array([20.0, -3.0, 7.0]))
    there = check_against_design(*moved(DESIGN, scans(east_m=MOVED_M), pose), OPTIONS, n_threads=1)
    assert verdicts(there) == verdicts(here)
    assert offsets(there) == pytest.approx(offsets(here), abs=5e-4)
    assert there.alignment.shift_m == pytest.approx(turn @ here.alignment.shift_m, abs=1e-3)


def test_threads_change_nothing() -> None:
    one, two = (check_against_design(DESIGN, scans(east_m=MOVED_M), OPTIONS, n_threads=n) for n in (1, 2))
    assert repr([*map(asdict, one.elements)]) == repr([*map(asdict, two.elements)])
    assert one.cloud.deviation_m.tobytes() == two.cloud.deviation_m.tobytes()
    assert one.samples.reason.tobytes() == two.samples.reason.tobytes()


def test_what_cannot_be_checked_is_refused() -> None:
    with pytest.raises(InputError, match="no scan to check"):
        check_against_design(DESIGN, [])
    with pytest.raises(InputError, match="no element of boxes is like 'IfcDoor'"):
        check_against_design(DESIGN, scans(), CheckOptions(only=("IfcDoor",)))
    with pytest.raises(InputError, match="no element with a surface left"):
        check_against_design(DESIGN, scans(), CheckOptions(without=("Ifc*",)))


def test_an_element_that_is_there_twice_has_the_verdict_of_its_surface() -> None:
    """Each by its own tolerance; the surface is tested once."""
    solids = ROOM | PIERS | {"again": PIERS["pier"], "plate": PIERS["screen"]}
    design = boxes(solids, classes={"again": "IfcDoor"})
    options = CheckOptions(registration=(0.001, 0.003), tolerances={"IfcDoor": 0.0005})
    check = check_against_design(design, scans(screen=False), options, n_threads=1)
    assert verdicts(check) == dict.fromkeys(SEEN, "within") | {
        "screen": "missing", "plate": "missing", "again": "undecided"
    }  # fmt: skip
    same = {one.element.name: one.same_as for one in check.elements if one.same_as}
    assert same == {"again": "pier", "plate": "screen"}
    assert check.elements[-1].sentence == f"lies on screen: {check.elements[-3].sentence}"
    assert check.faces_tested == checked(screen=False).faces_tested
    assert len(check.design.mesh.faces) == len(design.mesh.faces)
    (told,) = check.warnings
    assert told == "elements with the same surface as another, which share what is found on it: 2 of 10"


def sheets(panel_m=0.0, flipped=(), without=()):
    """The inner sides of a room and a panel in it, single faces; which of them look the other way."""
    corners = np.array([*np.ndindex(2, 2, 2)]) * [4.0, 5.0, 2.5]
    sides = {
        "floor": (0, 4, 6, 2), "ceiling": (1, 3, 7, 5), "west": (0, 2, 3, 1), "east": (4, 5, 7, 6),
        "south": (0, 1, 5, 4), "north": (2, 6, 7, 3), "panel": (8, 9, 10, 11),
    }  # fmt: skip
    panel = [(2.4 + panel_m, y, z) for y, z in ((1.2, 0.3), (2.4, 0.3), (2.4, 2.0), (1.2, 2.0))]
    shown = [name for name in sides if name not in without]
    quads = [sides[name][:: -1 if name in flipped else 1] for name in shown]
    faces = np.array([[q[0], q[k], q[k + 1]] for q in quads for k in (1, 2)], np.int32)
    mesh = LabelledMesh(
        np.vstack([corners, panel]), faces, np.repeat(np.arange(len(quads), dtype=np.int32), 2)
    )
    return ElementMesh(mesh, tuple(map(Element, shown)), "sheets")


@pytest.mark.parametrize("flipped", [(), ("west", "panel")])
@pytest.mark.parametrize(
    ("built", "verdict", "kind"),
    [
        ({}, "within", ""),
        ({"panel_m": 0.03}, "deviates", "offset"),
        ({"panel_m": 0.3}, "deviates", "displaced"),
        ({"without": ("panel",)}, "missing", ""),
    ],
)
def test_sheets_are_judged_from_whichever_side_they_are_seen(flipped, built, verdict, kind) -> None:
    given = [
        scanned(sheets(**built), eye, sigma_m=SIGMA_M, rng=k, name=f"s{k}") for k, eye in enumerate(EYES)
    ]
    check = check_against_design(sheets(flipped=flipped), given, OPTIONS, n_threads=1)
    *others, panel = check.elements
    assert {one.verdict for one in others} == {"within"}
    assert min(one.share.measured for one in others) > 0.9
    assert (panel.verdict, panel.kind) == (verdict, kind)
    assert panel.sentence
