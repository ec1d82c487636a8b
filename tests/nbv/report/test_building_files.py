# SPDX-License-Identifier: MIT
"""What a surveyor takes along: the list of stations, and a floor plan of each storey to scale."""

import csv
import io
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from nbv.cover.pipeline import CoverOptions
from nbv.plan.plan import aim_of
from nbv.plan.planning import plan_views
from nbv.plan.station_list import STATION_COLUMNS, station_csv, stations_of
from nbv.report.blocks.room_tables import storey_plans, write_building_files
from nbv.report.coverage_report import plan_page
from nbv.report.figures.floor_plan import sheets_pdf
from nbv.scanning.sensor import PinholeSensor, View
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.samples import sample_surface
from nbv.visibility.site_options import SiteOptions
from scenes.pose import Pose
from tests.helpers.buildings import house

HEIGHT_M = 1.5


@pytest.fixture(scope="module")
def made():
    """A house of two storeys and a plan of it."""
    scene = house(31, storeys=2, slab_m=0.25).scene("the house")
    plan = plan_views(
        scene,
        load_sensor("panorama"),
        method="cover",
        target=0.9,
        site=SiteOptions(heights_m=(HEIGHT_M,), spacing_m=1.0),
        samples=sample_surface(scene.mesh, 0.5),
        budgets=CoverOptions(polish_steps=0),
        rng=0,
        n_threads=1,
    )
    return scene, plan


def rows_of(plan):
    return list(csv.DictReader(io.StringIO(station_csv(stations_of(plan)))))


def test_list_names_room_storey_and_height_of_each_station(made):
    _, plan = made
    rows = rows_of(plan)
    assert tuple(rows[0]) == STATION_COLUMNS
    assert [int(row["station"]) for row in rows] == list(range(1, len(plan.views) + 1))
    assert sorted(int(row["visit"]) for row in rows) == list(range(1, len(rows) + 1))
    by_room = {number: room["name"] for room in plan.rooms for number in room["stations"]}
    for number, (row, view) in enumerate(zip(rows, plan.views, strict=True), start=1):
        where = [float(row[name]) for name in ("x_m", "y_m", "z_m")]
        assert where == pytest.approx(view.world_from_sensor.translation, abs=5e-4)
        assert row["room"] == by_room[number]
        assert float(row["height_m"]) == pytest.approx(HEIGHT_M)
        assert row["storey"] == ("1" if where[2] < 2 else "2")
        assert row["heading_deg"] == row["pitch_deg"] == ""  # a panorama has none
    assert {row["storey"] for row in rows} == {"1", "2"}


def test_views_of_a_camera_from_one_place_are_one_station_with_its_headings(made):
    _, plan = made
    camera, place = (
        PinholeSensor(fov_deg=60, width=80, height=80),
        plan.views[0].world_from_sensor.translation,
    )
    looks = [np.array(way) for way in ([1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, -1.0])]
    views = [View(Pose.looking_at(place, place + way), camera) for way in looks]
    views.insert(1, View(Pose.looking_at(place + [0, 0, 0.5], place + [1, 0, 0.5]), camera))
    rows = rows_of(replace(plan, sensor=camera, views=tuple(views), stations=None))
    assert [row["views"] for row in rows] == ["1 3 4", "2"]
    assert rows[0]["heading_deg"] == "90.0 0.0 270.0"
    assert rows[0]["pitch_deg"] == "0.0 0.0 -45.0"
    assert float(rows[0]["heading_deg"].split()[0]) == aim_of(views[0].world_from_sensor).heading_deg
    assert [row["visit"] for row in rows] == ["", ""]


def test_each_storey_shows_its_own_stations_rooms_and_walls_at_the_instrument(made):
    scene, plan = made
    sheets = storey_plans(scene, plan)
    assert [sheet.storey for sheet in sheets] == [1, 2]
    assert sorted(int(number) for sheet in sheets for number, _, _ in sheet.stations) == list(
        range(1, len(plan.views) + 1)
    )
    bounds = scene.mesh.bounds()[:, :2]
    for sheet in sheets:
        assert sheet.cut_m == pytest.approx(HEIGHT_M)
        assert sheet.outline.shape[1:] == (2, 2)
        ends = sheet.outline.reshape(-1, 2)
        assert ((ends >= bounds[0]) & (ends <= bounds[1])).all()
        texts = [text for text, _ in sheet.rooms]
        rooms = [room for room in plan.rooms if room["storey"] == sheet.storey and not room["is_outside"]]
        assert texts == [f"{room['name']}\n{room['floor_m2']:.2f} m\u00b2" for room in rooms]
    labels = np.array([place for sheet in sheets for _, place in sheet.rooms])
    levels = [sheet.storey - 1 for sheet in sheets for _ in sheet.rooms]
    heights = np.array(levels) * 2.85 + 0.5
    of = plan.site.rooms.room_of(np.column_stack([labels, heights]))
    named = [text.partition("\n")[0] for sheet in sheets for text, _ in sheet.rooms]
    assert [f"room {number}" for number in of.tolist()] == named


def test_sheet_is_to_the_scale_it_states(made):
    scene, plan = made
    sheet = storey_plans(scene, plan)[0]
    root = ElementTree.fromstring(sheet.svg())
    scale = int(re.search(r"1:(\d+), cut 1\.50 m above the floor", sheet.svg().decode())[1])
    figure = sheet.sheet()
    plan_axes, bar = figure.axes
    inches = figure.get_size_inches()[0]
    width = plan_axes.get_position().width * inches * 0.0254 * scale
    assert width == pytest.approx(np.ptp(plan_axes.get_xlim()), rel=1e-6)
    assert float(root.get("width")[:-2]) == pytest.approx(72 * inches, rel=1e-4)
    bar_m = float(bar.get_xticklabels()[-1].get_text().removesuffix(" m"))
    assert bar.get_position().width * inches * 0.0254 * scale == pytest.approx(bar_m, rel=1e-6)


def test_files_are_written_and_the_same_again(made, tmp_path):
    scene, plan = made
    written = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.mkdir()
        write_building_files(scene, plan, lambda name, folder=folder: folder / name)
        written.append({file.name: file.read_bytes() for file in folder.iterdir()})
    assert written[0] == written[1]
    assert set(written[0]) == {"stations.csv", "floor-plan-1.svg", "floor-plan-2.svg", "floor-plans.pdf"}
    assert written[0]["floor-plans.pdf"].count(b"/Type /Page ") == 2
    text = written[0]["floor-plan-2.svg"].decode()
    assert "the house, storey 2" in text
    assert re.search(r">room \d<", text)


def test_names_of_strangers_are_texts_and_no_formulas(made):
    scene, plan = made
    sheet = storey_plans(replace(scene, name="$\\frac<b>\u4e16"), plan)[0]
    assert "$\\frac&lt;b&gt;\u4e16, storey 1" in sheet.svg().decode()
    assert sheets_pdf([sheet]).startswith(b"%PDF")


def test_plans_without_rooms_have_no_such_files(made, tmp_path):
    scene, plan = made
    write_building_files(scene, replace(plan, site=None), lambda name: tmp_path / name)
    assert not list(tmp_path.iterdir())
    assert storey_plans(scene, replace(plan, site=None)) == ()


def test_report_shows_each_storey(made):
    scene, plan = made
    page = plan_page(scene, plan, plan.coverage, 1).to_html()
    for storey in (1, 2):
        assert f"Storey {storey}." in page
    assert "Walls are cut 1.50 m above the floor" in page


@pytest.mark.long
def test_each_room_tells_the_shares_of_its_surface_and_they_make_up_the_whole(made):
    scene, plan = made
    rooms = [room for room in plan.rooms if room["is_asked_for"]]
    areas = np.array([room["surface_m2"] for room in rooms])
    assert areas.sum() == pytest.approx(plan.coverage.total_m2)
    for share in ("met", "reachable"):
        parts = np.array([room[share] for room in rooms])
        assert parts @ areas == pytest.approx(getattr(plan.coverage, share) * areas.sum())
        assert all(0 < room[f"{share}_standard_error"] < 0.1 for room in rooms)
    assert all(room["surface_m2"] > 2 * room["floor_m2"] for room in rooms)
    html = plan_page(scene, plan, plan.coverage, 1).to_html()
    assert "of it as required" in html
