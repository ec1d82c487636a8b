# SPDX-License-Identifier: MIT
"""Display: full reports of scans, plans, coverage, completions and checks, in the browser or a notebook."""

from __future__ import annotations

import sys
import tempfile
import webbrowser
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from completion.result.completion import Completion
from nbv.coverage.coverage import Coverage
from nbv.coverage.measurement import measure_coverage, visibility_history
from nbv.inspection.checking import CheckedDesign
from nbv.online.exploration import Exploration
from nbv.plan.plan import Plan
from nbv.report.blocks.page import Gallery, Headline, Page, PageSection, Text
from nbv.report.check_report import check_page
from nbv.report.completion_report import completion_page
from nbv.report.coverage_report import coverage_page, plan_page
from nbv.report.figures.picture import Picture, picture_of, range_colours
from nbv.report.scans_report import scan_coverage_page
from nbv.run.showing import register
from nbv.scanning.sensor import Sensor, View
from nbv.scanning.sensor_profile import load_sensor
from nbv.scans.scan_coverage import cover_by_scans
from nbv.scans.scan_map import ScanMap
from nbv.scans.state_mesh import StateMesh
from scenes.checks import InputError
from scenes.scan.colour import colour_bytes
from scenes.scan.range_image import RangeImage
from scenes.scan.thumbnail import upright
from scenes.world.scene import Mode, Scene

_FRAME_PX = 720  # height of a report in a notebook


def show(
    thing: Plan | Coverage | Completion | CheckedDesign | Exploration | RangeImage,
    scene: Scene | None = None,
    stations: Sequence[View] | Sequence[RangeImage] = (),
    *,
    title: str | None = None,
    seed: int = 0,
    n_threads: int | None = None,
) -> Path:
    """Write the full report of `thing` to a temporary folder and show it.

    In a notebook the report appears below the cell, elsewhere in the browser.

    Parameters
    ----------
    thing : Plan, Coverage, Completion, CheckedDesign, Exploration or RangeImage
        What to report on.
    scene : Scene, optional
        What a plan or a coverage is of; these need it.
    stations : sequence of View or of RangeImage
        What a coverage was measured by, in the order of the curve.
    title : str, optional
        Heading of a completion's or a check's report; the name of the first scan or of the design when not
        given.
    seed : int
        What the report is to say of its seed; a plan knows its own, other things do not keep it.
    n_threads : int, optional
        Threads that draw; the report does not depend on it.

    Returns
    -------
    Path
        The report, one file that needs nothing else; it stays until the system clears its temporary files.

    Raises
    ------
    InputError
        A plan or coverage without its scene, a plan that continues scans where no scene is known, a thing
        that there is no report of.
    """
    page = _page_of(thing, scene, stations, title, n_threads)
    if isinstance(thing, Plan) and thing.seed is not None:
        seed = thing.seed
    path = Path(tempfile.mkdtemp(prefix="unseen-")) / "report.html"
    replace(page, seed=seed).write(path)
    if not _show_inline(path):
        webbrowser.open(path.as_uri())
    return path


def _page_of(
    thing: object,
    scene: Scene | None,
    stations: Sequence[View] | Sequence[RangeImage],
    title: str | None,
    n_threads: int | None,
) -> Page:
    """Return the report."""
    if isinstance(thing, Completion):
        asked: dict[str, Any] = {"mode": thing.mode, "scans": [seen.scan.name for seen in thing.observations]}
        page = completion_page(thing, title or thing.observations[0].scan.name, n_threads=n_threads)
        return replace(page, options=asked)
    if isinstance(thing, RangeImage):
        return scan_page(thing)
    if isinstance(thing, CheckedDesign):
        return check_page(thing, title or thing.findings.design.name, n_threads=n_threads)
    if isinstance(thing, Exploration):
        return _exploration_page(thing, title or "Exploration", n_threads)
    if not isinstance(thing, Plan | Coverage):
        raise InputError(
            f"there is no report of a {type(thing).__name__}; "
            "show a Plan, a Coverage, a Completion, a CheckedDesign, an Exploration or a RangeImage"
        )
    if scene is None:
        kind = type(thing).__name__.lower()
        raise InputError(f"a {kind} is shown with its scene: show({kind}, scene)")
    if isinstance(thing, Plan):
        return _page_of_plan(thing, scene, n_threads)
    return _page_of_coverage(thing, scene, stations, n_threads)


def _page_of_plan(plan: Plan, scene: Scene, n_threads: int | None) -> Page:
    """Return the report of a plan; what a plan read from a file does not hold is measured again."""
    coverage = plan.coverage
    if not isinstance(coverage, Coverage):
        coverage = measure_coverage(
            scene, plan.views, plan.requirement, sensor=plan.sensor, n_threads=n_threads
        )
    asked = {"method": plan.method, "sensor": plan.sensor.name, "target": plan.target, "mode": scene.mode}
    return replace(plan_page(scene, plan, coverage, n_threads), options=asked)


def _page_of_coverage(
    coverage: Coverage,
    scene: Scene,
    stations: Sequence[View] | Sequence[RangeImage],
    n_threads: int | None,
) -> Page:
    """Return the report of a coverage, with what each station adds."""
    seen, sensor = coverage.history, _sensor_of(stations)
    if seen is None or len(seen.met) != len(stations) + 1:  # other stations than it was measured by
        caster = scene.ray_caster(n_threads)
        seen = visibility_history(caster, coverage.samples, coverage.requirement, stations)
    asked = {"sensor": sensor.name, "requirement": coverage.requirement.describe(), "mode": scene.mode}
    page = coverage_page(scene, coverage, stations, seen, sensor, n_threads=n_threads)
    return replace(page, options=asked)


def _sensor_of(stations: Sequence[View] | Sequence[RangeImage]) -> Sensor:
    """Return the views' sensor; of scans, whose sensor is not known, the one their coverage reckons with."""
    first = next(iter(stations), None)
    return first.sensor if isinstance(first, View) else load_sensor("generic60")


def _show_inline(path: Path) -> bool:
    """Show the report below the cell of a notebook; tell whether there is one."""
    interactive = sys.modules.get("IPython")
    shell = interactive.get_ipython() if interactive else None
    if shell is None or not hasattr(shell, "kernel"):
        return False
    page = escape(path.read_text("utf-8"))
    frame = f'<iframe srcdoc="{page}" style="width:100%;height:{_FRAME_PX}px;border:0"></iframe>'
    display: Any = sys.modules["IPython.display"]
    display.display(display.HTML(f"<div>{frame}</div>"))
    return True


def _exploration_page(thing: Exploration, title: str, n_threads: int | None) -> Page:
    """The report of what the scans of an exploration measured, and where the unknown begins."""
    scans = [*thing.given, *thing.scans]
    if not any(scan.valid.any() for scan in scans):
        raise InputError("the exploration has no scan with a return yet; take one before it is shown")
    mode: Mode = "object" if thing.from_outside else "room"
    scan_map = ScanMap.of(scans, thing.sensor, mode=mode, requirement=thing.requirement)
    coverage = cover_by_scans(scan_map, thing.requirement)
    return scan_coverage_page(coverage, StateMesh.of(coverage), thing.sensor, title, n_threads)


def scan_page(scan: RangeImage) -> Page:
    """Return the page of a scan: ranges, colours, and where there is truth, incidence and range error."""
    known = scan.ranges[scan.valid]
    rows, columns = scan.shape
    pictures = tuple(_pictures(scan))
    return Page(
        title=scan.name,
        kicker="Scan",
        summary=(
            f"{known.size} of {scan.ranges.size} pixels brought a range back, {_span(scan)}. "
            "What no beam reached is not in it."
        ),
        headlines=(
            Headline(f"{rows} x {columns}", "", "pixels, rows x columns"),
            Headline(f"{100 * known.size / scan.ranges.size:.1f}", "%", "of them with a return", "measured"),
            Headline(*_noise(scan), "standard deviation of the range noise"),
        ),
        bar=None,
        sections=(
            PageSection("What the scanner saw", (Gallery(pictures, min(len(pictures), 2)),)),
            *(
                (PageSection("How far it erred", (Text(_range_error(scan)),)),)
                if scan.truth is not None
                else ()
            ),
        ),
        options={
            "projection": scan.projection.kind,
            "stands_at_m": [round(float(part), 4) for part in scan.origin],
            "sensor": scan.sensor or "not known",
            "effects": scan.noise or "not known",
        },
    )


def _pictures(scan: RangeImage) -> list[Picture]:
    """The scan's channels as a person would see them."""
    colours, low, high = range_colours(upright(scan.ranges, scan.projection))
    note = f"{low:.2f} m (yellow) to {high:.2f} m (violet); empty where nothing came back."
    pictures = [picture_of(colours, "Range", note)]
    if scan.colour is not None:
        pictures.append(picture_of(colour_bytes(upright(scan.colour, scan.projection)), "Colour"))
    if scan.truth is not None:
        angle = np.where(scan.valid, np.degrees(scan.truth.incidence), np.inf)
        colours, low, high = range_colours(upright(angle, scan.projection))
        note = f"{low:.0f}\u00b0 (yellow) to {high:.0f}\u00b0 (violet) between ray and normal."
        pictures.append(picture_of(colours, "True incidence", note))
    return pictures


def _span(scan: RangeImage) -> str:
    known = scan.ranges[scan.valid]
    return f"{known.min():.3f} to {known.max():.3f} m" if known.size else "so there is nothing to show"


def _noise(scan: RangeImage) -> tuple[str, str]:
    """Value and unit of the headline."""
    return ("not known", "") if scan.sigma_m is None else (f"{1000 * scan.sigma_m:.3g}", "mm")


def _range_error(scan: RangeImage) -> str:
    """Measured against true ranges, in a sentence."""
    error = scan.range_error()
    error = error[np.isfinite(error)]
    if not error.size:
        return "No pixel has both a measured and a true range."
    rms, worst = np.sqrt(np.mean(error**2)), np.abs(error).max()
    return (
        f"Measured minus true range over {error.size} pixels: mean {1000 * error.mean():.3f} mm, "
        f"root mean square {1000 * rms:.3f} mm, largest {1000 * worst:.3f} mm."
    )


register(show)
