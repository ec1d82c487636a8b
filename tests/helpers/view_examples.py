# SPDX-License-Identifier: MIT
"""A small 3-D view of which everything is known, and pages of each kind of report."""

import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from completion.options import CompletionOptions
from completion.pipeline import complete
from nbv.cover.pipeline import CoverOptions
from nbv.coverage.measurement import visibility_history
from nbv.inspection.checking import CheckedDesign
from nbv.online.planner import PlannerOptions
from nbv.plan.planning import plan_views
from nbv.report.blocks.page import Cell, Page, PageSection, Table
from nbv.report.check_report import check_page
from nbv.report.completion_report import completion_page
from nbv.report.coverage_report import coverage_page, plan_page
from nbv.report.demo_report import compare, demo_page
from nbv.report.figures import picture
from nbv.report.scans_report import next_stations_page, scan_coverage_page
from nbv.report.study_report import study_page
from nbv.report.viewer.layers import Category, Classes, Layer, Lines, Marker, Numbers, Sightings, Viewer
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, SphericalSensor, View
from nbv.scans.next_stations import plan_next_stations
from nbv.scans.scan_coverage import cover_by_scans
from nbv.scans.scan_map import ScanMap
from nbv.scans.scan_record import record_scans
from nbv.scans.state_mesh import StateMesh
from nbv.study.pipeline import run_study
from nbv.study.spec import read_study
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from tests.helpers.study_examples import write_study
from tests.nbv.inspection.checks import example_check

EVIL = "<img src=x onerror=alert(1)></script><!-- \"'"
UTM = np.array([500_000.25, 5_000_000.5, 100.125])
TURNS = np.radians(np.arange(0, 360, 45))
CANDIDATES = Candidates(
    np.array([[x, y, 1.6] for x in (0.6, 3.4, 5.4) for y in (0.6, 3.4, 4.4)]),
    np.column_stack([np.cos(TURNS), np.sin(TURNS), np.full(8, -0.4)]),
)
MEASURED = Category("measured", picture.MEASURED)
UNKNOWN = Category("unknown", picture.UNKNOWN, "hatched")
INFERRED = Category("inferred", picture.INFERRED)


def floor(x, size=2.0):
    """A square on the ground, seen from above, its corner at x."""
    corners = np.array([[x, 0, 0], [x + size, 0, 0], [x + size, size, 0], [x, size, 0]], float) + UTM
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def known_view():
    """Left a measured square that the second view measures, right an inferred one, a station above each."""
    left, faces = floor(0.0)
    right, _ = floor(3.0)
    two = np.zeros(2, np.uint16)
    measured = Layer(
        "measured", "", left, faces, MEASURED,
        channels=(
            Classes("state", "State", (MEASURED, UNKNOWN), two, np.array([2, 2]), 1, can_hide=True),
            Numbers("quality", "Best incidence", "\u00b0", np.array([40.0, 40.0]), 0, 90, 1, limit=60.0),
            Numbers("sd", "Standard deviation", "mm", np.array([1.25, 1.25]), 0, 5, 2),
            Classes("surface", "Surface", (Category(EVIL, (0.2, 0.5, 0.3)),), two),
        ),
        sightings=Sightings(np.array([0, 2, 4]), np.array([1, 2, 1, 2]), np.array([70.0, 40.0, 70.0, 40.0])),
    )  # fmt: skip
    inferred = Layer("inferred", "hypothesised (inferred)", right, faces, INFERRED, facts={"Why": "between"})
    markers = tuple(
        Marker(name, UTM + [x, 1.0, 1.5], np.diag([1.0, -1.0, -1.0]), (0.5, 0.5))
        for name, x in (("1", 1.0), ("2", 4.0))
    )
    lines = (Lines("openings", "openings", left[None, :2], (0.1, 0.5, 0.4)),)
    pictures = (picture.picture_of(np.full((60, 90, 3), 0.5), "Instead."),)
    return Viewer(
        EVIL, (measured, inferred), markers=markers, lines=lines, met=(0.0, 0.0, 0.5), pictures=pictures
    )


def known_page():
    """The view and a table to sort."""
    texts = (("b", "9.5"), ("a", "10"), (EVIL, ">99.9"), ("c", "<0.1"), ("d", ""))
    table = Table(("Name", "#Value"), tuple(tuple(Cell(text) for text in row) for row in texts))
    sections = (PageSection("View", (known_view(),)), PageSection("Table", (table,)))
    return Page(EVIL, "Test", EVIL, (), None, sections, {EVIL: EVIL}, 0)


KINDS = (
    "plan-nbv",
    "plan-cover",
    "coverage",
    "completion",
    "demo",
    "next-stations",
    "scan-coverage",
    "study",
    "check",
)
FEW = ("plan-nbv", "completion", "next-stations")  # the others are put together of the same parts
ROOM = builtin_scene("two_occluders")
CAMERA = PinholeSensor(fov_deg=80, width=80, height=80, name="small")
AROUND = SphericalSensor(width=240, height=90, name="around")
COARSE = PlannerOptions(voxel_m=0.2)
PLAIN = CompletionOptions(texture=False)
ASKED = {"scene": "builtin:two_occluders", "sensor": "small", "max_incidence_deg": 60.0}


SHARED = {
    "samples": sample_surface(ROOM.mesh, 0.3), "candidates": CANDIDATES, "rng": 0, "n_threads": 1,
}  # fmt: skip


@cache
def online_plan():
    """A short plan."""
    return plan_views(ROOM, CAMERA, views=5, options=COARSE, **SHARED)


def page_of_study():
    """The report of a small study."""
    with tempfile.TemporaryDirectory() as folder:
        spec = read_study(write_study(folder))
        outcomes = run_study(spec, Path(folder) / "plans")
    return study_page(spec, outcomes, "study")[0]


def report_page(kind):
    """The report of a kind, of a small scene, with some options."""
    return replace(plain_page(kind), options=ASKED)


def plain_page(kind):
    """The report of a kind, of a small scene."""
    if kind == "plan-cover":
        budgets = CoverOptions(polish_steps=0)
        plan = plan_views(ROOM, CAMERA, method="cover", views=6, budgets=budgets, **SHARED)
        return plan_page(ROOM, plan, plan.coverage, 1)
    if kind == "study":
        return page_of_study()
    if kind == "check":
        return check_page(CheckedDesign(example_check()), "room.ifc", n_threads=1)
    if kind in ("next-stations", "scan-coverage"):
        return page_of_scans(kind)
    plan = online_plan()
    if kind == "plan-nbv":
        return plan_page(ROOM, plan, plan.coverage, 1)
    if kind == "coverage":
        seen = visibility_history(ROOM.ray_caster(1), SHARED["samples"], plan.requirement, plan.views)
        return coverage_page(ROOM, plan.coverage, plan.views, seen, CAMERA, 1)
    scans = [scan_scene(ROOM, plan.views[k], rng=0, name=f"view {k + 1}") for k in (0, 1)]
    model = complete(scans, PLAIN, rng=0, n_threads=1)
    if kind == "completion":
        return completion_page(model, "two scans", n_threads=1)
    return demo_page(ROOM, plan, [0, 1], model, compare(model, scans, ROOM.mesh, SHARED["samples"]), 1)


def page_of_scans(kind):
    """The report of a scan without a model of the scene."""
    stood = View(Pose.looking_at((1.0, 1.0, 1.5), (5.0, 4.0, 1.2)), AROUND)
    scan_map = ScanMap.of([scan_scene(ROOM, stood, rng=0, name="first")], AROUND, options=COARSE)
    coverage = cover_by_scans(scan_map, completion=complete(scan_map.scans, PLAIN, rng=0))
    if kind == "scan-coverage":
        return scan_coverage_page(coverage, StateMesh.of(coverage), AROUND, "one scan", 1)
    plan = plan_next_stations(scan_map, AROUND, coverage.requirement, views=2, options=COARSE, n_threads=1)
    return next_stations_page(plan, coverage, record_scans(coverage), "one scan", n_threads=1)
