# SPDX-License-Identifier: MIT
"""Report of the demo: many views without inference against a few with it; the truth is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.result.completion import Completion
from nbv.coverage.coverage import Coverage, share_error
from nbv.coverage.measurement import measured_samples, visibility_history
from nbv.plan.plan import Plan
from nbv.report.blocks.coverage_tables import curve, reasons, stations, views_table
from nbv.report.blocks.page import (
    Bar,
    BarShare,
    Block,
    Cell,
    Gallery,
    Headline,
    Legend,
    Page,
    PageSection,
    State,
    Table,
    Text,
    headline_of,
)
from nbv.report.blocks.room_tables import set_apart
from nbv.report.completion_report import (
    before_and_after,
    decision_sections,
    scan_pictures,
    scans_of,
    surface_blocks,
)
from nbv.report.figures import picture
from nbv.report.figures.surface_values import StateMarks, state_pictures
from nbv.report.viewer.markers import view_markers
from nbv.report.viewer.scene_view import colours_of_views, scene_view
from nbv.run.wording import count, percent, percent_within, square_metres
from nbv.visibility.limits import CLOSE_M
from nbv.visibility.samples import SurfaceSamples
from scenes.checks import BoolArray
from scenes.mesh.labelled_mesh import LabelledMesh, triangle_areas
from scenes.mesh.triangle_distance import distances
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

UNKNOWN, INFERRED, MEASURED = 0, 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """What a few scans and the completion give of the true surface.

    `state` (n,) is of its samples: `MEASURED` by some scan at any incidence, `INFERRED` within 2 cm, or
    `UNKNOWN`. `within_close` is the share of the inferred area that lies within 2 cm of the true surface,
    `median_m` its median distance from it in metres; 1 and 0 where nothing was inferred.
    """

    samples: SurfaceSamples
    state: NDArray[np.int8]
    within_close: float
    median_m: float

    def share(self, state: int, where: BoolArray | None = None) -> float:
        """Return the share of the true area in `state`, of all samples or of those at `where` (n,)."""
        area = self.samples.areas if where is None else self.samples.areas * where
        return float(area[self.state == state].sum() / area.sum())

    def share_within(self, state: int) -> tuple[float, float]:
        """Return the share of the true area in `state`, and its standard error."""
        return self.share(state), share_error(self.samples, self.state == state)


def compare(
    completion: Completion, scans: Sequence[RangeImage], truth: LabelledMesh, samples: SurfaceSamples
) -> Comparison:
    """Compare a completion of `scans` with the true mesh, on samples of it."""
    state = np.full(len(samples), UNKNOWN, np.int8)
    for scan in scans:
        state[measured_samples(scan, samples)[0]] = MEASURED
    mesh = completion.hypothesised
    if not len(mesh.faces):
        return Comparison(samples, state, 1.0, 0.0)
    corners = completion.world_from_reference.apply(mesh.vertices)[mesh.faces]
    open_ = np.flatnonzero(state == UNKNOWN)
    state[open_[distances(samples.points[open_], corners) <= CLOSE_M]] = INFERRED
    off = distances(corners.mean(axis=1), truth.corners)
    area = triangle_areas(corners)
    order = np.argsort(off)
    middle = int(np.searchsorted(np.cumsum(area[order]), area.sum() / 2))
    return Comparison(
        samples, state, float(area[off <= CLOSE_M].sum() / area.sum()), float(off[order][middle])
    )


_STATES: tuple[tuple[State, int], ...] = (
    ("measured", MEASURED),
    ("inferred", INFERRED),
    ("unknown", UNKNOWN),
)
_LEAST_TOLD = 0.0005  # smaller shares would read "<0.1 %"
_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")


def demo_page(
    scene: Scene,
    plan: Plan,
    chosen: Sequence[int],
    completion: Completion,
    comparison: Comparison,
    n_threads: int | None,
) -> Page:
    """Return the report of the demo."""
    coverage = plan.coverage
    if not isinstance(coverage, Coverage):
        raise TypeError("the demo's report needs a fresh plan, with its full coverage")
    measured, inferred = comparison.share(MEASURED), comparison.share(INFERRED)
    sentences = {state: percent_within(*comparison.share_within(state)) for state in (MEASURED, INFERRED)}
    met_told = percent_within(coverage.met, coverage.standard_errors()["met"])
    met = [view.met_fraction or 0.0 for view in plan.views]
    few = _NUMBERS[len(chosen)] if len(chosen) < len(_NUMBERS) else str(len(chosen))
    unreached = unreached_share(coverage)
    hidden = f", and no view reaches {unreached} % of it" if unreached else ""
    summary = (
        f"A scanner alone needs {count(len(plan.views), 'view')} to measure {met_told} % "
        f"of this room well{hidden}. {few.capitalize()} of these views measure {sentences[MEASURED]} %; "
        f"completion infers {sentences[INFERRED]} % more from them, and of all that it inferred "
        f"{percent(comparison.within_close)} % lies within 2 cm of the true surface."
    )
    poses = [view.world_from_sensor for view in plan.views]
    seen = coverage.history or visibility_history(
        scene.ray_caster(n_threads), coverage.samples, plan.requirement, plan.views
    )
    markers = view_markers(poses, [plan.sensor] * len(poses), colours_of_views(len(poses), chosen))
    return Page(
        title="A room with two occluders",
        kicker="Scan what can be scanned, infer what cannot",
        summary=summary,
        headlines=_headlines(len(plan.views), few, comparison),
        bar=_bar(comparison, sum(coverage.apart_m2.values())),
        sections=(
            PageSection("Before and after", before_and_after(completion, n_threads)),
            PageSection("Compared with the truth", _truth(scene, comparison, n_threads)),
            PageSection(
                "What the scanner alone would need",
                (
                    scene_view(scene, coverage, seen, markers=markers),
                    Gallery(
                        (
                            curve(
                                met, coverage, plan.target, None, (len(chosen), measured, measured + inferred)
                            ),
                            stations(scene, poses, plan.sensor, chosen),
                        ),
                        2,
                    ),
                    Text(f"The plan ends because: {plan.stopped_because}.", is_note=True),
                    views_table(plan),
                ),
            ),
            PageSection("What no view reaches, and why", (*reasons(coverage), *set_apart(coverage))),
            *decision_sections(completion.decisions()),
            PageSection(f"What the {few} scans saw", (*scan_pictures(completion), scans_of(completion))),
            PageSection("Surfaces that were recognised", surface_blocks(completion)),
        ),
    )


def _headlines(n_views: int, few: str, comparison: Comparison) -> tuple[Headline, ...]:
    """Views that the scanner alone needs, and the shares that a few of them and completion reach."""
    close = percent(comparison.within_close)
    return (
        Headline(str(n_views), "views", "the scanner alone needs", "measured"),
        headline_of(*comparison.share_within(MEASURED), f"measured by {few} of them", "measured"),
        headline_of(*comparison.share_within(INFERRED), "more, inferred behind the occluders", "inferred"),
        Headline(close, "%", "of the inferred area is within 2 cm", "inferred"),
        headline_of(*comparison.share_within(UNKNOWN), "stays unknown", "unknown"),
    )


def unreached_share(coverage: Coverage) -> str:
    """Return the percentage of the area that no view reaches; nothing where it rounds to none."""
    return percent(coverage.unreachable) if coverage.unreachable >= _LEAST_TOLD else ""


def _bar(comparison: Comparison, apart_m2: float) -> Bar:
    total = comparison.samples.total_m2
    apart = f"; {square_metres(apart_m2)} m\u00b2 that bound no room are set apart" if apart_m2 > 0 else ""
    return Bar(
        f"All {square_metres(total)} m\u00b2 of true surface that bound the room{apart}",
        tuple(
            BarShare(name, name, share, f"{percent(share)} %")
            for name, share in ((name, comparison.share(state)) for name, state in _STATES)
        ),
    )


def _truth(scene: Scene, comparison: Comparison, n_threads: int | None) -> tuple[Block, ...]:
    """The true room by state, and a row for each of its surfaces."""
    colours = {MEASURED: picture.MEASURED, INFERRED: picture.INFERRED, UNKNOWN: picture.UNKNOWN}
    pictures = state_pictures(
        scene,
        comparison.samples,
        state=comparison.state,
        marks=StateMarks(colours=colours, hatched=UNKNOWN),
        title="The true room",
        n_threads=n_threads,
    )
    ids = comparison.samples.surface
    rows = []
    for surface in np.unique(ids[comparison.samples.areas > 0]):
        here = ids == surface
        area = float(comparison.samples.areas[here].sum())
        cells = [Cell(scene.surface_names[surface]), Cell(square_metres(area))]
        for name, state in _STATES:
            share = comparison.share(state, here)
            cells.append(Cell(percent(share), share=share, state=name))
        rows.append(tuple(cells))
    columns = ("True surface", "#area, m\u00b2", "#measured, %", "#inferred, %", "#unknown, %")
    median = f"{1000 * comparison.median_m:.2g} mm" if comparison.median_m > 1e-5 else "0.01 mm"
    note = (
        "Inferred means: within 2 cm of a surface that the completion put there. Half of the inferred area "
        f"lies within {median} of the truth (the demo scans without noise). \u00b1 is one standard error "
        "of a share, of the samples on which it was measured."
    )
    return Legend(), Gallery(pictures, 2), Text(note, is_note=True), Table(columns, tuple(rows))
