# SPDX-License-Identifier: MIT
"""A check in one call: files that appear together, bands of accuracy, changes, inference beside verdicts."""

import json
from dataclasses import replace

import numpy as np
import pytest

from completion.asbuilt.findings import SAMPLE_STATES
from nbv.inspection import inference
from nbv.inspection.checking import (
    CheckedDesign,
    check_design,
    compare_with,
    in_frame_of,
    open_design,
    read_earlier,
    read_loa_bands,
)
from nbv.inspection.record import check_record
from nbv.run import showing
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from scenes.checks import InputError
from scenes.io.scan_request import GivenScans
from scenes.io.scene_files import save_scene
from scenes.mesh.orientation import world_from_file_up
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from scenes.world.scene import Scene
from tests.completion.asbuilt.designs import boxes, scanned
from tests.completion.asbuilt.test_beams import ROOM
from tests.nbv.inspection.checks import example_check

CHECK = example_check()


def test_a_room_that_is_as_designed_has_nothing_to_report():
    room, camera = builtin_scene("two_occluders"), PinholeSensor(fov_deg=70, width=72, height=60)
    views = [
        View(Pose.looking_at((5.0, 1.5, 1.4), (2.0, 2.0, 0.6)), camera),
        View(Pose.looking_at((1.0, 4.4, 1.5), (3.0, 2.0, 0.6)), camera),
    ]
    scans = [scan_scene(room, view, noise="gaussian-2mm", rng=k) for k, view in enumerate(views)]
    checked = check_design(room, scans, 0.02, n_threads=1)
    assert {one.verdict for one in checked.elements} <= {"within", "undecided", "hidden", "not seen"}
    assert sum(one.verdict == "within" for one in checked.elements) >= 5
    assert checked.extra == ()
    assert checked.findings.scans == ("scan 1", "scan 2")
    strict = check_design(room, scans, 0.02, tolerances={"floor": 0.0005}, n_threads=1)
    assert strict.elements[0].verdict == "undecided"  # its interval is wider than that


def test_a_design_with_another_axis_up_than_its_scans_is_refused_with_the_axis(tmp_path):
    """And where both have the same up, nothing is said of it."""
    design = boxes(ROOM)
    scene = Scene.from_mesh(design.mesh)
    save_scene(
        replace(scene, mesh=design.mesh.transform(world_from_file_up("y").inverse())), tmp_path / "y.obj"
    )
    save_scene(scene, tmp_path / "z.obj")
    scans = [scanned(design, (1.2, 1.2, 1.4), n_pixels=4000)]
    given = GivenScans(tuple(scans), (), ())
    with pytest.raises(
        InputError,
        match=r"y: the up axes of the scans and .* with z of its file up, 100% with y; give --up y",
    ):
        in_frame_of(open_design(str(tmp_path / "y.obj")), given)
    for file, up in (("z.obj", None), ("y.obj", "y")):
        opened = open_design(str(tmp_path / file), up=up)
        assert not any("up" in text or "mode" in text for text in opened.warnings)
        framed, told = in_frame_of(opened, given)
        assert bool(told) == (up == "y")
        assert framed.scans[0] is scans[0]


def test_scans_are_all_paths_or_none():
    scan = scan_scene(builtin_scene("two_occluders"), Pose.identity(), PinholeSensor(70, 8, 8))
    with pytest.raises(InputError, match="1 of 2 scans are no paths; give paths or RangeImages"):
        check_design(CHECK.design, [scan, "s1.npz"])


def test_saved_files_appear_together(tmp_path):
    CheckedDesign(CHECK, changes=()).save(tmp_path / "out")
    files = {path.name for path in (tmp_path / "out").iterdir() if not path.name.startswith(".")}
    assert files == {"check.json", "elements.csv", "deviation.ply", "design.glb", "issues.bcf"}
    record = json.loads((tmp_path / "out/check.json").read_text())
    assert record["changes"] == []
    assert [one["verdict"] for one in record["elements"]] == [one.verdict for one in CHECK.elements]
    again = tmp_path / "again"
    CheckedDesign(CHECK, changes=()).save(again)
    assert all((again / name).read_bytes() == (tmp_path / "out" / name).read_bytes() for name in files)


def test_a_check_shows_its_report(monkeypatch, tmp_path):
    shown = []
    monkeypatch.setattr(
        showing, "_registered", [lambda thing, *_more, **_named: shown.append(thing) or tmp_path]
    )
    checked = CheckedDesign(CHECK)
    assert checked.show() == tmp_path
    assert shown == [checked]
    assert (checked.elements, checked.extra, checked.warnings) == (
        CHECK.elements,
        CHECK.extra,
        CHECK.warnings,
    )


def test_an_earlier_check_is_read_and_compared(tmp_path):
    path = tmp_path / "check.json"
    path.write_text(json.dumps(check_record(CHECK)))
    earlier = read_earlier(path)
    assert list(compare_with(path, earlier, CHECK)) == []
    with pytest.raises(InputError, match=r"check\.json: .*damaged"):
        compare_with(path, {**earlier, "elements": [1]}, CHECK)
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(InputError, match=r"other\.json: is no check of a design; name the check\.json"):
        read_earlier(tmp_path / "other.json")


@pytest.mark.parametrize(("name", "text"), [
    ("a.toml", "fine = 0.003\ncoarse = 0.02\n"), ("a.json", '{"coarse": 0.02, "fine": 0.003}'),
    ("b.toml", "[bands]\nfine = 0.003\ncoarse = 0.02\n"),
])  # fmt: skip
def test_bands_are_read(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    assert list(read_loa_bands(tmp_path / name).items()) == [("fine", 0.003), ("coarse", 0.02)]


@pytest.mark.parametrize(("text", "cause"), [
    ("# none", "holds no bands; write 1 to 20 lines like LOA30 = 0.015"),
    ("a = -1", "a ends at -1; write its upper end in metres"),
    ("a = true", "a ends at True"),
    ("a = 'wide'", "a ends at 'wide'"),
    ("a = inf", "a ends at inf"),
    ("a = 0.01\nb = 0.01", "a and b both end at 0.01 m"),
    ("a = ", "a.toml"),
])  # fmt: skip
def test_bands_that_cannot_be_used_are_refused(tmp_path, text, cause):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError, match=r"a\.toml") as told:
        read_loa_bands(tmp_path / "a.toml")
    assert cause in str(told.value)


class Continued:
    """Completion that continues one square, 4 mm before the eastern wall, with probability 0.8."""

    @classmethod
    def of(cls, _scans, **_options):
        return cls()

    def inferred_mesh(self):
        corners = np.array([[3.996, y, z] for y in (-1.0, 5.0) for z in (-1.0, 5.0)])
        return corners, np.array([[0, 1, 3], [0, 3, 2]], np.int32), np.full(2, 0.8)


def infer(check, monkeypatch):
    monkeypatch.setattr(inference, "KnownSurfaces", Continued)
    return inference.infer_elements(check, ())


def test_inference_stands_beside_the_verdict_and_changes_none(monkeypatch):
    check = replace(CHECK, alignment=replace(CHECK.alignment, poses=()))
    found = infer(check, monkeypatch)
    assert [one.verdict for one in found.elements] == [one.verdict for one in CHECK.elements]
    wall, before = found.elements[3], CHECK.elements[3]
    on_it = (CHECK.samples.element == 3) & (CHECK.samples.normals @ (-1.0, 0, 0) > 0.9)
    area = CHECK.samples.area_m2
    assert wall.inference.probability == pytest.approx(0.8)
    assert wall.inference.share == pytest.approx(area[on_it].sum() / area[CHECK.samples.element == 3].sum())
    assert "within 10 mm" in wall.inference.sentence
    assert wall.share.measured == before.share.measured
    assert wall.share.measured + wall.share.inferred + wall.share.unknown == pytest.approx(1)
    assert found.samples.state[on_it].tolist() == [SAMPLE_STATES.index("inferred")] * on_it.sum()
    assert (found.samples.state[CHECK.samples.state == 0] == 0).all()  # measured stays measured


def test_continued_surface_beyond_the_tolerance_says_nothing(monkeypatch):
    strict = tuple(replace(one, tolerance_m=0.003) for one in CHECK.elements)
    check = replace(CHECK, elements=strict, alignment=replace(CHECK.alignment, poses=()))
    found = infer(check, monkeypatch)
    assert found.elements[3].inference == CHECK.elements[3].inference
