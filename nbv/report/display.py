# SPDX-License-Identifier: MIT
"""Display: the full report of a scan, a plan, a coverage or a completion, in the browser or the notebook."""

from __future__ import annotations

import sys
import tempfile
import webbrowser
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

from completion.result.completion import Completion
from nbv.coverage.coverage import Coverage
from nbv.coverage.measurement import measure_coverage, visibility_history
from nbv.plan.plan import Plan
from nbv.report.completion_report import completion_page
from nbv.report.coverage_report import coverage_page, plan_page
from nbv.report.page.page import Page
from nbv.report.scan_page import scan_page
from nbv.run.showing import register
from nbv.scanning.sensors.sensor import Sensor
from nbv.scanning.sensors.sensor_profile import load_sensor
from nbv.scanning.view import View
from scenes.checks import InputError
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

_FRAME_PX = 720  # height of a report in a notebook


def show(
    thing: Plan | Coverage | Completion | RangeImage,
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
    thing : Plan, Coverage, Completion or RangeImage
        What to report on.
    scene : Scene, optional
        What a plan or a coverage is of; these need it.
    stations : sequence of View or of RangeImage
        What a coverage was measured by, in the order of the curve.
    title : str, optional
        Heading of a completion's report; the first scan's name when not given.
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
    page = _page_of(thing, scene, stations=stations, title=title, seed=seed, n_threads=n_threads)
    path = Path(tempfile.mkdtemp(prefix="unseen-")) / "report.html"
    page.write(path)
    if not _show_inline(path):
        webbrowser.open(path.as_uri())
    return path


def _page_of(
    thing: object,
    scene: Scene | None,
    stations: Sequence[View] | Sequence[RangeImage],
    title: str | None,
    seed: int,
    n_threads: int | None,
) -> Page:
    """Return the report."""
    if isinstance(thing, Completion):
        asked: dict[str, Any] = {"mode": thing.mode, "scans": [seen.scan.name for seen in thing.observations]}
        return completion_page(thing, title or thing.observations[0].scan.name, asked, seed, n_threads)
    if isinstance(thing, RangeImage):
        return scan_page(thing, seed)
    if not isinstance(thing, Plan | Coverage):
        raise InputError(
            f"there is no report of a {type(thing).__name__}; "
            "show a Plan, a Coverage, a Completion or a RangeImage"
        )
    if scene is None:
        kind = type(thing).__name__.lower()
        raise InputError(f"a {kind} is shown with its scene: show({kind}, scene)")
    if isinstance(thing, Plan):
        return _page_of_plan(thing, scene, seed, n_threads)
    return _page_of_coverage(thing, scene, stations, seed, n_threads)


def _page_of_plan(plan: Plan, scene: Scene, seed: int, n_threads: int | None) -> Page:
    """Return the report of a plan; what a plan read from a file does not hold is measured again."""
    coverage = plan.coverage
    if not isinstance(coverage, Coverage):
        coverage = measure_coverage(
            scene, plan.views, plan.requirement, sensor=plan.sensor, n_threads=n_threads
        )
    asked = {"method": plan.method, "sensor": plan.sensor.name, "target": plan.target, "mode": scene.mode}
    return plan_page(
        scene,
        plan,
        coverage=coverage,
        options=asked,
        seed=seed if plan.seed is None else plan.seed,
        n_threads=n_threads,
    )


def _page_of_coverage(
    coverage: Coverage,
    scene: Scene,
    stations: Sequence[View] | Sequence[RangeImage],
    seed: int,
    n_threads: int | None,
) -> Page:
    """Return the report of a coverage, with what each station adds."""
    seen, sensor = coverage.history, _sensor_of(stations)
    if seen is None or len(seen.met) != len(stations) + 1:  # other stations than it was measured by
        caster = scene.ray_caster(n_threads)
        seen = visibility_history(caster, coverage.samples, coverage.requirement, stations)
    asked = {"sensor": sensor.name, "requirement": coverage.requirement.describe(), "mode": scene.mode}
    return coverage_page(
        scene,
        coverage,
        given=stations,
        seen=seen,
        sensor=sensor,
        options=asked,
        seed=seed,
        n_threads=n_threads,
    )


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


register(show)
