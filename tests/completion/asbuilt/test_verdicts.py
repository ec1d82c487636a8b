# SPDX-License-Identifier: MIT
"""Verdicts: truth tables over evidence made by hand, at the borders of each."""

import numpy as np
import pytest

from completion.asbuilt.alignment import Aligned
from completion.asbuilt.deviation import Judged
from completion.asbuilt.faces import N_COLUMNS, find_faces
from completion.asbuilt.findings import HALF_95, BeamEvidence, FaceFinding, Hider, Interval, Shares
from completion.asbuilt.verdicts import ElementEvidence, decide, quantile
from scenes.mesh.design import Element
from tests.completion.asbuilt.designs import boxes

T, SD, Z, THICK_M = 0.010, 0.0005, 3.7, 0.2
WALL = boxes({"wall": ((0, 0, 0), (4, THICK_M, 2.5))})
FACES = find_faces(WALL.mesh, 1.0)
FRONT, BACK, END = (
    int(np.flatnonzero(FACES.normal @ np.array(way, float) > 0.999)[0])
    for way in ((0, -1, 0), (0, 1, 0), (1, 0, 0))
)
EIGHT = np.pi / 4 * np.arange(8)
PLACES = np.vstack([np.column_stack([np.cos(EIGHT), np.sin(EIGHT)]), [0, 0]])


def face(
    offset=0.0, *, of=FRONT, row=0, tilt=0.0, bow=None, sd=SD, measured_m2=None, support=0.9, n_beams=900,
    is_tested=True, is_flat=True, is_far=False,
) -> Judged:  # fmt: skip
    """A judged face whose deviation is an offset, a tilt along u (at its end) and the rise of its middle."""
    curve = 0.0 if bow is None else bow
    delta = offset + tilt * PLACES[:, 0] + curve * (1 - np.square(PLACES[:, 0]))
    columns = np.column_stack([np.ones(9), PLACES, np.square(PLACES)])
    worst, area = delta[np.argmax(np.abs(delta))], float(FACES.area[of])

    def interval(value):
        return Interval(float(value), float(value - HALF_95 * sd), float(value + HALF_95 * sd), along)

    along = (0.0, -1.0, 0.0)
    turn = abs(tilt) / FACES.half[of, 0]
    finding = FaceFinding(
        0, "plane", is_main=of != END, centre=FACES.centre[of], normal=FACES.normal[of], area_m2=area,
        measured_m2=0.8 * area if measured_m2 is None else measured_m2, n_beams=n_beams, support=support,
        is_tested=is_tested, deviation=interval(worst), offset=interval(delta[-1]),
        tilt=Interval(turn, turn - 1e-4, turn + 1e-4), bow=None if bow is None else interval(bow),
        place=FACES.centre[of],
    )  # fmt: skip
    return Judged(
        finding,
        of,
        row,
        delta=delta,
        sd=np.full(9, sd),
        columns=columns,
        is_flat_enough=is_flat,
        is_far=is_far,
    )


def aligned_of(*faces: Judged, sd=SD) -> Aligned:
    """Faces that are known independently, poses exactly."""
    x = np.zeros((len(faces), N_COLUMNS))
    x[:, 0] = [one.delta[-1] for one in faces]
    block = np.tile(sd**2 * np.eye(N_COLUMNS), (len(faces), 1, 1))
    return Aligned(
        faces=np.array([one.face for one in faces]), x=x, own_x=x, own_covariance=block, tau_m=0.001,
        motion=np.zeros((2, 6)), covariance=np.zeros((24, 24)), inverse=block,
        coupling=np.zeros((len(faces), N_COLUMNS, 24)), prior=np.full(len(faces), 1e-3),
    )  # fmt: skip


def verdict(
    *faces, z=Z, rivals=(), far=(), beams=None, share=0.8, hidden=(), not_seen=None, kind="IfcWall",
    is_open=False,
):  # fmt: skip
    known = ElementEvidence(
        0, Element("wall", kind), T, faces=tuple(faces), far=tuple(far), beams=beams or BeamEvidence(),
        share=Shares(share, 0.0, 1 - share), exposed_m2=20.0, hidden=tuple(hidden), not_seen=not_seen or {},
        rivals=dict.fromkeys(rivals, True), back_m=0.7 * THICK_M, is_open=is_open,
    )  # fmt: skip
    return decide(known, aligned_of(*faces), FACES, z=z, scale=1.0)


CLOSE = 1e-5


@pytest.mark.parametrize(
    ("offset", "expected"),
    [
        (0.0, "within"),
        (T - HALF_95 * SD - CLOSE, "within"),
        (T - HALF_95 * SD + CLOSE, "undecided"),
        (T, "undecided"),
        (T + Z * SD - CLOSE, "undecided"),
        (T + Z * SD + CLOSE, "deviates"),
        (-(T - HALF_95 * SD - CLOSE), "within"),
        (-(T + Z * SD + CLOSE), "deviates"),
        (0.05, "deviates"),
    ],
)
def test_offsets_at_the_borders_of_the_tolerance(offset: float, expected: str) -> None:
    found = verdict(face(offset))
    assert found.verdict == expected
    assert found.kind == ("offset" if expected == "deviates" else "")
    assert found.offset is not None
    assert found.offset.value == pytest.approx(offset)
    assert found.directions_measured == ((0.0, -1.0, 0.0),)


def test_more_tests_ask_for_more_certainty() -> None:
    assert quantile(1, 0.05) == pytest.approx(1.96, abs=1e-3)
    assert quantile(247, 0.05) == pytest.approx(3.7, abs=0.03)
    levels = [quantile(m, 0.05) for m in (1, 10, 100, 1000)]
    assert (np.diff(levels) > 0.4).all()
    offset = T + 3 * SD
    assert [verdict(face(offset), z=quantile(m, 0.05)).verdict for m in (1, 1000)] == [
        "deviates",
        "undecided",
    ]


@pytest.mark.parametrize("fields", [{"support": 0.4}, {"is_flat": False}, {"is_tested": False}, {"of": END}])
def test_what_is_shown_badly_does_not_deviate(fields) -> None:
    """Little support, a rough surface, no test, a minor face."""
    sound = face(0.0, of=END, row=1, measured_m2=8.0)
    assert verdict(face(0.03), sound).verdict == "deviates"
    assert verdict(face(0.03, **fields), sound).verdict != "deviates"


def test_less_than_a_third_of_what_looks_the_same_way_does_not_deviate() -> None:
    back = face(0.0, of=BACK, row=1, measured_m2=8.0)
    assert verdict(face(0.03), back).verdict == "deviates"
    assert verdict(face(0.03, measured_m2=2.0), back).verdict != "deviates"
    assert (
        verdict(face(0.03, measured_m2=2.0), face(0.0, of=END, row=1, measured_m2=8.0)).verdict == "deviates"
    )


def test_most_of_an_element_and_a_main_face_must_be_within() -> None:
    doubtful = {"of": BACK, "row": 1}
    assert verdict(face(), face(T, measured_m2=3.0, **doubtful)).verdict == "within"
    assert verdict(face(), face(T, measured_m2=4.0, **doubtful)).verdict == "undecided"
    ends = verdict(face(of=END))
    assert ends.verdict == "undecided"
    assert ends.sentence == "only smaller faces of it are measured"


def test_deviations_have_the_kind_that_most_of_them_is_made_of() -> None:
    tilted = verdict(face(0.001, tilt=0.02))
    assert (tilted.verdict, tilted.kind) == ("deviates", "tilt")
    assert "it is turned by 0.5730 deg" in tilted.sentence
    bowed = verdict(face(bow=0.02))
    assert (bowed.verdict, bowed.kind) == ("deviates", "bow")
    assert "its middle bows by 20.00 mm" in bowed.sentence
    assert verdict(face(0.02, tilt=0.005)).kind == "offset"


@pytest.mark.parametrize(("front", "back", "expected"), [
    (0.0, 0.03, "thickness"), (0.008, 0.008, "thickness"), (0.02, -0.02, "offset"), (0.0, 0.0, ""),
    (0.004, 0.004, ""),
])  # fmt: skip
def test_thickness_is_what_both_sides_add_up_to(front: float, back: float, expected: str) -> None:
    found = verdict(face(front), face(back, of=BACK, row=1))
    assert found.kind == expected
    assert found.thickness is not None
    assert found.thickness.value == pytest.approx(front + back, abs=1e-5)
    half = (found.thickness.high - found.thickness.low) / 2
    assert half == pytest.approx(HALF_95 * np.sqrt(2) * SD, rel=0.01)


@pytest.mark.parametrize(
    ("on", "through", "hidden", "expected"),
    [
        (0.0, 1.0, 0.0, "missing"),
        (0.9, 1.0, 0.0, "missing"),
        (1.1, 1.0, 0.0, "undecided"),
        (0.0, 0.019, 0.0, "not seen"),
        (0.0, 1.0, 8.9, "missing"),
        (0.0, 1.0, 9.1, "hidden"),
        (0.0, 0.0, 5.0, "hidden"),
        (0.06, 0.0, 0.0, "undecided"),
        (0.0, 0.0, 0.0, "not seen"),
    ],
)
def test_beams_through_a_body_on_it_and_before_it(on, through, hidden, expected) -> None:
    beams = BeamEvidence(on, through, hidden, 500)
    assert verdict(beams=beams, share=0.0, not_seen={"out of view": 1.0}).verdict == expected


def test_a_face_where_its_back_should_be_is_none_of_it() -> None:
    """A wall of 0.2 m whose front is 0.15 m behind its place is the surface behind a wall that is missing."""
    assert verdict(face(-0.15)).verdict == "missing"
    assert verdict(face(-0.13)).verdict == "deviates"
    assert verdict(face(-0.15), face(0.0, of=BACK, row=1)).verdict != "missing"


def test_a_surface_that_looks_another_way_is_no_deviation_of_a_face() -> None:
    assert verdict(face(tilt=0.2)).verdict == "deviates"
    assert verdict(face(tilt=2.0)).verdict == "undecided"


def test_what_is_measured_is_not_missing_whatever_beams_passed() -> None:
    passed = BeamEvidence(0.0, 6.0, 0.0, 5000)
    assert verdict(beams=passed, share=0.1).verdict == "missing"
    found = verdict(beams=passed, share=0.8)
    assert found.verdict == "undecided"
    assert found.sentence == "80% of it is measured, but no face has enough beams for a number"


def test_beams_through_a_measured_wall_leave_it_open() -> None:
    passed = BeamEvidence(0.0, 3.0, 0.0, 500)
    assert verdict(face(), beams=passed).verdict == "undecided"
    assert verdict(face(), beams=BeamEvidence(0.0, 1.0, 0.0, 100)).verdict == "within"


def test_a_deviation_that_something_before_it_explains_hides_it() -> None:
    found = verdict(face(0.06), rivals=(0,), hidden=[Hider("extra-3", ("s1",), 2.5)])
    assert found.verdict == "hidden"
    assert found.sentence == "hidden by extra-3 (2.5 m2)"
    assert not found.faces[0].is_tested


def test_samples_tell_hidden_from_not_seen() -> None:
    crate = [Hider("extra-1", ("s2",), 3.0)]
    most = verdict(share=0.0, hidden=crate, not_seen={"hidden": 0.6, "out of view": 0.4})
    assert (most.verdict, most.sentence) == ("hidden", "hidden by extra-1 (3.0 m2)")
    least = verdict(share=0.0, hidden=crate, not_seen={"hidden": 0.4, "out of view": 0.6})
    assert least.verdict == "not seen"
    assert least.sentence == "no scan looked: 60% of its exposed surface is out of view"


def test_an_empty_body_with_a_like_surface_nearby_is_displaced() -> None:
    empty, far = BeamEvidence(0.0, 6.0, 0.0, 5000), face(0.3, is_far=True)
    found = verdict(share=0.05, beams=empty, far=[far])
    assert (found.verdict, found.kind) == ("deviates", "displaced")
    assert found.offset is not None
    assert found.offset.value == pytest.approx(0.3)
    assert found.sentence.endswith(
        "beside it, 300.00 mm (95 %: 299.02 to 300.98 mm) off along -y of the design"
    )
    assert verdict(share=0.05, beams=empty, far=[far], kind="IfcDoor").verdict == "missing"  # leaves turn
    assert (
        verdict(share=0.05, beams=empty, far=[face(0.3, measured_m2=2.0, is_far=True)]).verdict == "missing"
    )
    assert verdict(share=0.05, beams=empty, far=[face(0.3, tilt=0.1, is_far=True)]).verdict == "missing"
    assert verdict(face(), far=[far]).verdict == "within"


def test_an_open_body_is_not_displaced_by_the_side_that_it_lacks() -> None:
    empty, far = BeamEvidence(0.0, 0.0, 6.0, 5000), face(0.2, is_far=True)
    found = verdict(beams=empty, far=[far], is_open=True)
    assert (found.verdict, found.kind) == ("undecided", "")
    assert found.sentence.startswith(
        "its body in the design is not closed: what lies before it may be the side"
    )
    crate = [Hider("extra-1", ("s2",), 3.0)]
    hidden = verdict(beams=empty, hidden=crate, not_seen={"hidden": 0.6}, share=0.0, is_open=True)
    assert hidden.verdict == "hidden"
    assert hidden.sentence.startswith("hidden by extra-1 (3.0 m2); its body in the design is not closed")


def test_an_undecided_element_says_by_how_much_and_why() -> None:
    near = verdict(face(T))
    assert near.sentence.startswith("a corner is off by 10.00 mm (95 %: 9.02 to 10.98 mm), neither surely")
    assert near.sentence.endswith("within nor surely beyond 10.0 mm")
    loose = verdict(face(0.001, sd=0.05))
    assert loose.sentence.endswith(": hardly any other surface holds the scans this way")


@pytest.mark.parametrize(("fields", "why"), [
    ({"support": 0.4}, "beams met only 40% of what they could of that face"),
    ({"is_flat": False}, "what was measured there is not flat: rms 0"),
])  # fmt: skip
def test_a_large_number_that_is_no_deviation_has_its_reason(fields, why) -> None:
    found = verdict(face(0.03, **fields))
    assert found.verdict == "undecided"
    assert found.sentence.startswith("a corner is off by 30.00 mm (95 %: 29.02 to 30.98 mm), but " + why)
