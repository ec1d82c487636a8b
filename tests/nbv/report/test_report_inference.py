# SPDX-License-Identifier: MIT
"""Plans in which completion stood in for views: classes add up, and the report tells them apart."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from nbv.commands.plan import lines_of, summary_of
from nbv.coverage.surface_classes import INFERRED, MET, MODELLED, UNKNOWN, ClassShares, KnownSurfaces
from nbv.online.planner import PlannerOptions
from nbv.plan.baselines import Baseline
from nbv.plan.planning import plan_views
from nbv.report.blocks.inference import baselines_section, class_pictures, class_table, layers
from nbv.report.coverage_report import plan_page
from nbv.report.figures.drawing import mark_modelled
from nbv.report.figures.picture import INFERRED as INFERRED_COLOUR
from nbv.report.figures.picture import MEASURED, dots
from nbv.report.figures.picture import MODELLED as MODELLED_COLOUR
from nbv.report.figures.picture import UNKNOWN as UNKNOWN_COLOUR
from nbv.report.figures.plots import class_curve
from nbv.report.scans_report import stations_table
from nbv.run.wording import percent_within
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from nbv.scans.next_stations import plan_next_stations
from nbv.scans.scan_map import ScanMap
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.zones import Box, Zones
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from tests.nbv.commands.test_cli import contents, succeed

ROOM = builtin_scene("two_occluders")
SAMPLES = sample_surface(ROOM.mesh, 0.2)
SENSOR = PinholeSensor(fov_deg=80, width=120, height=120, name="small")
COARSE = PlannerOptions(voxel_m=0.2)
TURNS = np.radians(np.arange(0, 360, 45))
CANDIDATES = Candidates(
    np.array([[x, y, 1.6] for x in (0.6, 3.4, 5.4) for y in (0.6, 3.4, 4.4)]),
    np.column_stack([np.cos(TURNS), np.sin(TURNS), np.full(8, -0.4)]),
)

BLUENESS = {MET: (-12, 12), MODELLED: (-12, 12), INFERRED: (60, 255), UNKNOWN: (-255, -50)}  # of 8-bit pixels


@pytest.fixture(scope="module")
def plan():
    return plan_views(
        ROOM, SENSOR, views=3, candidates=CANDIDATES, samples=SAMPLES, options=COARSE, infer=True, rng=0,
        n_threads=1,
    )  # fmt: skip


@pytest.fixture(scope="module")
def html(plan):
    return plan_page(ROOM, plan, plan.coverage, 1).to_html()


@pytest.mark.long
def test_the_classes_of_each_surface_add_up_to_those_of_the_scene(plan):
    rows, coverage = plan.coverage.by_surface(), plan.coverage
    assert all(row.met + row.modelled + row.inferred + row.unknown == pytest.approx(1) for row in rows)
    for kind in ("met", "modelled", "inferred", "unknown"):
        whole = sum(getattr(row, kind) * row.area_m2 for row in rows) / coverage.total_m2
        assert whole == pytest.approx(getattr(coverage, kind))
        assert whole == pytest.approx(getattr(plan.shares[-1], kind))
    assert min(coverage.modelled, coverage.inferred) > 0.02
    assert [row["unknown"] for row in coverage.to_json()["surfaces"]] == [row.unknown for row in rows]


def test_without_classes_all_that_is_not_met_is_unknown(plan):
    for row in replace(plan.coverage, classes=None).by_surface():
        assert row.modelled == row.inferred == 0
        assert row.unknown == pytest.approx(1 - row.met)


def test_layers_are_the_shares_where_scans_were_completed_and_never_below_what_is_met(plan):
    tops = layers(plan)
    assert tops.shape == (3, len(plan.views) + 1)
    assert (np.diff(tops, axis=0) >= 0).all()
    assert tops[0, 1:].tolist() == [view.met_fraction for view in plan.views]
    for shares in plan.shares:
        assert tops[2, shares.views] == pytest.approx(shares.known)
        assert tops[1, shares.views] == pytest.approx(shares.met + shares.modelled)


def test_between_completions_layers_keep_what_was_known(plan):
    early = replace(plan, shares=(ClassShares(1, 0.02, 0.03, 0.05, 0.9, 0.1, 4.0, 3.0),))
    tops = layers(early)
    met = [view.met_fraction for view in plan.views]
    assert tops[:, 0].tolist() == [0, 0, 0]
    assert tops[2, 1:] == pytest.approx(np.maximum(met, 0.10))
    assert tops[1, 1:] == pytest.approx(np.maximum(met, 0.05))


def test_the_report_names_the_classes_and_how_much_of_the_inferred_is_right(plan, html):
    shares = plan.shares[-1]
    errors = plan.coverage.standard_errors()
    for kind in ("met", "modelled", "inferred", "unknown"):
        share, error = percent_within(getattr(shares, kind), errors[kind]).split(" ", 1)
        assert f"<dd>{share}" in html
        assert error in html
    assert "What counts as what" in html
    assert "within 2 cm of the true surface" in html
    assert "standard deviation there is 20 mm or less" in html
    assert "reachable, not yet measured" not in html
    assert html == plan_page(ROOM, plan, plan.coverage, 2).to_html()
    wrong = replace(shares, inferred_m2=8.0, right_m2=6.0)
    page = plan_page(ROOM, replace(plan, shares=(wrong,)), plan.coverage, 1)
    assert "Of 8.00 m\u00b2 that it infers in all, 75.0 % lies within 2 cm" in page.summary
    assert "75.0 % lies within 2 cm of the true surface and 2.00 m\u00b2 elsewhere" in note_of(page)
    assert "beyond it" not in note_of(page)
    nothing = replace(shares, inferred_m2=0.0, right_m2=0.0)
    page = plan_page(ROOM, replace(plan, shares=(nothing,)), plan.coverage, 1)
    assert "Nothing was inferred." in page.summary
    assert note_of(page).endswith("Nothing was inferred.")
    assert len(page.headlines) == 5
    knowing = plan_page(ROOM, replace(plan, method="cover"), plan.coverage, 1)
    assert "knows the scene, but not beforehand" in note_of(knowing)
    zones = Zones(Box((0, 0, 0), (3, 5, 2.7)))
    page = plan_page(ROOM, replace(plan, zones=zones), plan.coverage, 1)
    assert "in the region and beyond it" in note_of(page)


def note_of(page):
    return page.sections[0].blocks[-1].text


def test_a_plan_by_views_alone_is_reported_as_before(plan):
    plain = replace(plan, shares=(), coverage=replace(plan.coverage, classes=None))
    page = plan_page(ROOM, plain, plain.coverage, 1)
    assert [one.label for one in page.headlines] == [
        *("views", "of the area measured as required", "of what can be reached"),
        *("reachable, not yet measured", "out of reach of any candidate"),
    ]
    assert [section.title for section in page.sections] == [
        *("Where the surface is measured", "Views", "What cannot be reached, and why", "Surface by surface"),
    ]
    with pytest.raises(TypeError, match="by views alone has no classes"):
        class_pictures(ROOM, plain.coverage, 1)


def test_the_table_of_surfaces_holds_a_column_for_each_class(plan):
    table = class_table(plan.coverage)
    assert [cell.state for cell in table.rows[0][2:]] == ["measured", "modelled", "inferred", "unknown"]
    for row in table.rows:
        assert sum(cell.share for cell in row[2:]) == pytest.approx(1)


def test_baselines_say_that_only_what_is_measured_counts(plan):
    found = [Baseline("this plan", False, np.array([[0.1, 0.2, 0.3]]))]
    inferring, plain = (
        baselines_section(one, found)[0].blocks[-1].text for one in (plan, replace(plan, shares=()))
    )
    assert "counts for none of them" in inferring
    assert "counts for none of them" not in plain


def test_pictures_show_each_class_in_its_colour(plan):
    classes = plan.coverage.classes
    areas = {kind: SAMPLES.areas[classes == kind].sum() for kind in (MET, MODELLED, INFERRED, UNKNOWN)}
    assert min(areas.values()) > 0
    for kind, (low, high) in BLUENESS.items():
        only = replace(plan.coverage, classes=np.full(len(SAMPLES), kind, np.int8))
        red, _, blue, alpha = np.moveaxis(pixels_of(class_pictures(ROOM, only, 1)), 2, 0)
        drawn = (blue - red)[alpha > 0]
        assert low < drawn.min() <= drawn.max() < high


def pixels_of(pictures):
    with Image.open(io.BytesIO(pictures[0].png)) as opened:
        return np.array(opened).astype(int)


def test_tones_stay_apart_in_a_grey_print():
    """Luma of solid colours, and of the dotted mean, by Rec. 601."""
    covered = float(dots((80, 80)).mean())
    dotted = (1 - covered) * np.array(MODELLED_COLOUR) + covered * 0.85 * np.array(MEASURED)
    luma = np.sort(np.array([MEASURED, dotted, INFERRED_COLOUR, UNKNOWN_COLOUR]) @ [0.299, 0.587, 0.114])
    assert 0.1 < covered < 0.4
    assert (
        np.delete(np.diff(luma), 1).min() > 0.05
    )  # measured and unknown, which is hatched, may be as bright


def test_dots_mark_only_what_is_modelled():
    image, where = np.ones((40, 40, 4)), np.zeros((40, 40), dtype=bool)
    where[:20] = True
    marked = mark_modelled(image, where, np.ones((40, 40)))
    assert (marked[20:] == 1).all()
    assert marked[:20, :, :3].min() < 0.6 < 0.99 < marked[:20, :, :3].max()


def test_the_stacked_curve_is_the_same_bytes_again_and_shows_each_layer(plan):
    tops = layers(plan)
    one, again = (class_curve(tops, 0.9, 0.99) for _ in range(2))
    assert one == again
    for layer in (1, 2):
        flat = tops.copy()
        flat[layer] = tops[layer - 1]
        assert class_curve(flat, 0.9, 0.99).light != one.light
    assert class_curve(tops, 0.9, None).light != one.light


def test_the_summary_and_the_lines_hold_the_last_shares(plan):
    shares = plan.shares[-1]
    assert summary_of(plan)["inference"] == shares.to_json()
    line = lines_of(plan)[0]
    errors = plan.coverage.standard_errors()
    modelled = percent_within(shares.modelled, errors["modelled"])
    inferred = percent_within(shares.inferred, errors["inferred"])
    unknown = percent_within(shares.unknown, errors["unknown"])
    assert f"modelled {modelled} %, inferred {inferred} %, unknown {unknown} %" in line
    assert line.endswith("m2 inferred lies within 2 cm of the true surface")
    nothing = replace(plan, shares=(replace(shares, inferred_m2=0.0, right_m2=0.0),))
    assert lines_of(nothing)[0].endswith(f"unknown {unknown} %")


@pytest.mark.long
def test_next_stations_know_what_completion_makes_of_the_scans():
    poses = [
        Pose.looking_at(np.array(eye), np.array(target))
        for eye, target in (((0.6, 0.6, 1.6), (5.0, 4.0, 0.8)), ((5.2, 0.8, 1.6), (1.0, 4.0, 0.6)))
    ]
    scan_map = ScanMap.of([scan_scene(ROOM, pose, SENSOR, rng=0) for pose in poses], SENSOR, options=COARSE)
    fixed = {"views": 2, "candidates": CANDIDATES, "options": COARSE, "n_threads": 1}
    completed = KnownSurfaces.of(scan_map.scans, n_threads=1)
    plain, knowing = (
        plan_next_stations(scan_map, SENSOR, completed=one, **fixed) for one in (None, completed)
    )
    assert plain.views[0].predicted_gain_m2 != knowing.views[0].predicted_gain_m2
    assert len(knowing.views) == 2
    again = plan_next_stations(scan_map, SENSOR, completed=completed, **{**fixed, "n_threads": 2})
    assert [view.to_json() for view in again.views] == [view.to_json() for view in knowing.views]
    notes = [stations_table(knowing, infers=infers)[-1].text for infers in (False, True)]
    assert "likely to be news" not in notes[0]
    assert "likely to be news" in notes[1]


@pytest.mark.long
@pytest.mark.parametrize("where", ["scene", "scans"])
def test_the_command_line_takes_infer(where, tmp_path):
    (tmp_path / "small.toml").write_text(
        'kind = "pinhole"\nname = "small"\nfov_deg = 80.0\nwidth = 96\nheight = 96\n'
    )
    np.savez(tmp_path / "few.npz", positions=CANDIDATES.positions, directions=CANDIDATES.directions)
    sensor, out = ("--sensor", tmp_path / "small.toml"), tmp_path / "out"
    given = ["builtin:two_occluders", "--candidates", tmp_path / "few.npz"]
    if where == "scans":
        given = ["--scans", tmp_path / "a.npz"]
        at = ("--at", "0.6,0.6,1.6", "--look", "5,4,0.8")
        succeed("scan", "builtin:two_occluders", *at, *sensor, "-o", tmp_path / "a.npz", "-q")
    said = succeed("plan", *given, *sensor, "--infer", "--views", 2, "-o", out, "--json").stdout
    summary, manifest = json.loads(said), json.loads((out / "manifest.json").read_text())
    assert manifest["options"]["infer"] is True
    assert summary["views"] == 2
    html = contents(out)["report.html"].decode()
    assert ("What counts as what" if where == "scene" else "likely to be news") in html
    if where == "scans":
        assert summary["surface"]["inferred_m2"] > 0
        assert "inferred surface" in html
    else:
        written = json.loads((out / "plan.json").read_text())
        assert written["inference"][-1] == summary["inference"]
        assert {"right_m2", "inferred_m2", "modelled"} <= set(summary["inference"])
        surfaces = json.loads((out / "coverage.json").read_text())["surfaces"]
        assert all({"inferred", "modelled", "unknown"} <= set(surface) for surface in surfaces)
