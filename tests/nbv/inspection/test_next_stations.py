# SPDX-License-Identifier: MIT
"""Next stations of a check: rooms in which it is known what is open, where to stand and what to move."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nbv.inspection.next_stations import plan_next_stations
from nbv.inspection.obstacles import Obstacles
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.requirement import Requirement
from nbv.visibility.site_options import SiteOptions
from scenes.checks import InputError
from scenes.pose import Pose
from tests.nbv.inspection.rooms import CRATE, PANEL, TWO_ROOMS, cells_of, check_of, design_of

PANORAMA = load_sensor("panorama")
WEST, EAST = (1.0, 1.0, 1.6), (6.0, 2.0, 1.6)


def names(elements):
    return [element.element.name for element in elements]


@pytest.fixture(scope="module")
def one_room_scanned():
    return check_of(design_of(TWO_ROOMS), [WEST])


@pytest.fixture(scope="module")
def panel_hidden():
    return check_of(design_of(TWO_ROOMS | PANEL), [WEST, EAST], [CRATE])


def places(found):
    return np.array([view.world_from_sensor.translation for view in found.plan.views]).reshape(-1, 3)


def test_a_room_that_nobody_scanned_gets_the_station(one_room_scanned) -> None:
    found = plan_next_stations(one_room_scanned, PANORAMA, n_stations=3)
    assert [names(one.elements) for one in found.promised] == [["north 2"]]
    assert found.moves == ()
    assert found.left == ()
    assert found.promised[0].area_m2 == pytest.approx(4.1 * 2.5, rel=0.03)  # all of its inner side
    assert places(found)[0, 0] > 4.0
    assert found.plan.stopped_because == "no station settles more"
    assert found.plan.views[0].predicted_gain_m2 == found.promised[0].area_m2
    assert found.sentences()[0].startswith("Station 1 should settle 1 element (10.")


def test_what_a_crate_hides_from_everywhere_says_to_move_it(panel_hidden) -> None:
    found = plan_next_stations(panel_hidden, PANORAMA, n_stations=3)
    assert found.plan.views == ()
    assert found.left == ()
    assert [(move.extra.name, names(move.elements)) for move in found.moves] == [("extra-1", ["panel"])]
    assert found.moves[0].area_m2 == pytest.approx(1.2 * 1.5, rel=0.02)
    assert found.sentences() == ("Move extra-1 (2.0 x 0.7 x 2.3 m) to see panel: 1.80 m2.",)


def test_a_crate_that_one_can_walk_around_is_not_moved() -> None:
    """Seen from the west side alone, the board on the east wall is behind it; it stands 1.5 m before that.

    What nobody saw behind the crate may be more of it, until a scan from beside it shows that it is not.
    """
    board = {"board": ((8.18, 1.5, 0.5), (8.2, 2.5, 1.5))}
    crate = ((6.0, 1.2, 0.0), (6.6, 2.8, 2.3))
    eyes = [WEST, (5.0, 2.0, 1.6)]
    found = plan_next_stations(check_of(design_of(TWO_ROOMS | board), eyes, [crate]), PANORAMA)
    assert [(one.elements, names(one.hoped)) for one in found.promised] == [((), ["board"])]
    assert found.sentences() == ("Station 1 may settle 1 element behind space that no scan saw: board.",)
    assert found.moves == found.left == ()
    (x, y, _) = places(found)[0]
    assert not (5.7 < x < 6.9 and 0.9 < y < 3.1)  # clear of the crate
    beside = [(8.0, y, z) for y in (0.5, 3.5) for z in (0.5, 1.6, 2.3)]  # too oblique for the board
    seen = check_of(design_of(TWO_ROOMS | board), [*eyes, *beside], [crate])
    hidden = replace(one_open(seen, "board", "hidden"), samples=replace(
        seen.samples, state=np.full_like(seen.samples.state, 2), reason=np.ones_like(seen.samples.reason)
    ))  # fmt: skip
    found = plan_next_stations(hidden, PANORAMA)
    assert [(names(one.elements), one.hoped) for one in found.promised] == [(["board"], ())]


def one_open(check, name, verdict, **fields):
    """The check of one element alone, that is open."""
    (element,) = (one for one in check.elements if one.element.name == name)
    faces = tuple(replace(face, is_tested=False) for face in element.faces)
    return replace(check, elements=(replace(element, verdict=verdict, faces=faces, **fields),))


def test_a_door_whose_leaf_stands_open_is_settled(one_room_scanned) -> None:
    told = "its leaf stands open by 60 deg: it is extra-1"
    check = one_open(one_room_scanned, "north 2", "undecided", related_extra="extra-1", sentence=told)
    found = plan_next_stations(check, PANORAMA)
    assert found.promised == ()
    assert found.left[0].reason == told


def test_holes_between_measured_cells_of_an_extra_let_no_beam_through(panel_hidden) -> None:
    """Cells of its front are missing here and there, as where beams were far apart."""
    cells = cells_of((1.0, 3.2, 0.0), (2.0, 3.9, 2.3))
    place = np.floor(cells[:, [0, 2]] / 0.05).astype(int)
    sparse = cells[(place % 3 > 0).any(axis=1) | (cells[:, 1] > 3.25)]
    assert len(sparse) < len(cells) - 100
    found = Obstacles.of(replace(panel_hidden, extra=(replace(panel_hidden.extra[0], points=sparse),)))
    behind = np.random.default_rng(1).uniform((1.1, 3.4, 0.1), (1.9, 3.8, 2.0), (2000, 3))
    assert found.caster.are_blocked(behind, np.array([WEST])).all()


def test_nothing_open_asks_for_no_station() -> None:
    found = plan_next_stations(check_of(design_of(TWO_ROOMS), [WEST, EAST]), PANORAMA)
    assert found.plan.views == found.promised == found.moves == found.left == ()
    assert found.plan.stopped_because == "there is nothing that a scan would settle"


@pytest.mark.parametrize("how", ["there", "missing", "glass"])
def test_missing_walls_and_glass_do_not_stop_beams(how: str) -> None:
    """A screen shuts the north wall off: the west room is scanned, and nobody may stand behind the screen."""
    screen = {"screen": ((5.0, 3.3, 0), (8.2, 3.4, 2.5)), "side": ((4.9, 3.3, 0), (5.0, 4.0, 2.5))}
    glass = ("screen",) if how == "glass" else ()
    design = design_of(TWO_ROOMS | screen | {"board": ((6, 3.98, 0.5), (7, 4, 1.5))}, glass)
    check = check_of(design, [WEST, EAST], missing=("screen",) if how == "missing" else ())
    verdict = dict(zip(names(check.elements), check.elements, strict=True))["board"].verdict
    assert (verdict == "within") == (how != "there")
    unseen = replace(check, elements=tuple(
        replace(e, verdict="not seen", faces=tuple(replace(f, is_tested=False) for f in e.faces))
        if e.element.name == "board" else e for e in check.elements if e.element.name in ("board", "screen")
    ), samples=replace(check.samples, state=np.full_like(check.samples.state, 2),
                       reason=np.full_like(check.samples.reason, 3)))  # fmt: skip
    found = plan_next_stations(unseen, PANORAMA, site=SiteOptions(clearance_m=0.4))
    if how == "there":
        reasons = {entry.element.element.name: entry.reason for entry in found.left}
        assert reasons["board"] == "it is behind the design from all standing places"
        assert found.moves == ()
        assert (
            "Left open, since it is behind the design from all standing places: board." in found.sentences()
        )
    else:
        assert "board" in names(found.promised[0].elements)


def test_what_lies_at_the_tolerance_asks_for_no_scan(one_room_scanned) -> None:
    design = design_of(TWO_ROOMS)
    near, far = {"west": (0.0098, 0.0012)}, {"west": (0.0085, 0.0017)}
    found = plan_next_stations(check_of(design, [WEST, EAST], doubtful=near), PANORAMA)
    assert found.promised == ()
    assert names([entry.element for entry in found.left]) == ["west"]
    assert "9.8 mm off its place, 0.2 mm from its tolerance" in found.left[0].reason
    assert "after 1 scan leaves +-0.8 mm: do not scan it again" in found.left[0].reason
    found = plan_next_stations(check_of(design, [WEST, EAST], doubtful=far), PANORAMA)  # 8.5 + 1.2 < 10 mm
    assert names(found.promised[0].elements) == ["west"]
    assert found.left == ()


def test_beams_that_passed_would_pass_again(one_room_scanned) -> None:
    held = one_room_scanned.samples
    north = held.element == names(one_room_scanned.elements).index("north 2")
    check = replace(one_room_scanned, samples=replace(held, reason=np.where(north, 6, held.reason)))
    found = plan_next_stations(check, PANORAMA)
    assert found.promised == ()
    assert "met nothing there: another scan would do the same" in found.left[0].reason


def test_settled_elements_count_more_than_area() -> None:
    """Two small boards in the west room, one large wall in the east: the first station settles the boards."""
    boards = {f"board {k}": ((0.5 + k, 3.98, 1), (1.2 + k, 4.0, 1.6)) for k in range(2)}
    door = {"door": ((4.0, 0, 0), (4.2, 1.0, 2.1))}
    check = check_of(design_of(TWO_ROOMS | door | boards), [EAST])
    opened = [
        replace(e, verdict="not seen", faces=tuple(replace(f, is_tested=False) for f in e.faces))
        for e in check.elements if e.element.name in ("board 0", "board 1", "north 2")
    ]  # fmt: skip
    held = replace(check.samples, state=np.full_like(check.samples.state, 2),
                   reason=np.full_like(check.samples.reason, 4))  # fmt: skip
    found = plan_next_stations(replace(check, elements=tuple(opened), samples=held), PANORAMA)
    assert names(found.promised[0].elements) == ["board 0", "board 1"]
    assert found.plan.stopped_because == "the limit of 1 station is reached"
    assert [(names([e.element]), e.reason) for e in found.left] == [
        (["north 2"], "it takes more than 1 station to settle all that can be settled")
    ]


def test_range_and_sensor_bound_what_is_promised(one_room_scanned) -> None:
    short = Requirement(max_incidence_deg=80.0, max_range_m=0.2)
    found = plan_next_stations(one_room_scanned, PANORAMA, short)
    assert found.left[0].reason == "it is out of range of all standing places"
    coarse = replace(PANORAMA, width=12, height=6)
    assert plan_next_stations(one_room_scanned, coarse).promised == ()  # fewer than 50 beams
    camera = plan_next_stations(one_room_scanned, load_sensor("generic60"))
    assert names(camera.promised[0].elements) == ["north 2"]
    with pytest.raises(InputError, match="n_stations must be at least 1, got 0"):
        plan_next_stations(one_room_scanned, PANORAMA, n_stations=0)


def test_an_object_is_looked_at_from_around() -> None:
    box = {"front": ((1, 1, 0.5), (2, 1.1, 1.5)), "back": ((1, 1.9, 0.5), (2, 2, 1.5))}
    found = plan_next_stations(check_of(design_of(box), [(1.5, -1, 1)]), PANORAMA)
    assert names(found.promised[0].elements) == ["back"]
    assert places(found)[0, 1] > 1.2


@pytest.mark.parametrize("degrees", [0.0, 90.0])
def test_a_moved_world_gets_the_moved_plan(one_room_scanned, degrees: float) -> None:
    turn = np.round(Rotation.from_euler("z", degrees, degrees=True).as_matrix(), 12)
    move = Pose.from_parts(turn, np.array([100.0, -50.0, 3.0]))
    panels = design_of(TWO_ROOMS | PANEL)
    found = [plan_next_stations(check_of(panels, [WEST], [CRATE], moved=m), PANORAMA, n_stations=2)
             for m in (None, move)]  # fmt: skip
    here, there = found
    assert [names(one.elements) for one in here.promised] == [names(one.elements) for one in there.promised]
    assert here.moves[0].area_m2 == pytest.approx(there.moves[0].area_m2, abs=0.05)
    assert here.promised[0].area_m2 == pytest.approx(there.promised[0].area_m2, abs=0.2)


def test_threads_change_nothing_and_the_plan_is_written(panel_hidden, one_room_scanned, tmp_path) -> None:
    texts = []
    for n in (1, 2):
        found = plan_next_stations(one_room_scanned, PANORAMA, n_stations=2, n_threads=n)
        found.plan.save(tmp_path / f"{n}.json")
        texts.append((tmp_path / f"{n}.json").read_bytes() + json.dumps(found.to_json()).encode())
    assert texts[0] == texts[1]
    written = plan_next_stations(panel_hidden, PANORAMA).to_json()
    assert written["move"][0]["what"] == "extra-1"
    assert written["stations"] == []


def test_what_no_station_saw_of_an_extra_is_solid(panel_hidden) -> None:
    """Its measured side and top enclose it: a beam along its inside meets something at once."""
    front = cells_of(*CRATE)
    front = front[(front[:, 1] < 3.25) | (front[:, 2] > 2.25)]
    extra = replace(panel_hidden.extra[0], points=front)
    caster = Obstacles.of(replace(panel_hidden, extra=(extra,))).caster
    assert caster.are_blocked(np.array([[0.5, 3.6, 1.0]]), np.array([[3.5, 3.6, 1.0]])).all()
