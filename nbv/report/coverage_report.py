# SPDX-License-Identifier: MIT
"""Report of coverage and of plans: what stations measure as required, what they miss, and why."""

from __future__ import annotations

from collections.abc import Sequence

from nbv.coverage.coverage import MET, REACHABLE, UNREACHABLE, Coverage, VisibilityHistory, share_error
from nbv.coverage.measurement import visibility_history
from nbv.plan.baselines import Baseline
from nbv.plan.plan import Plan, cost_sentences
from nbv.plan.rules import RuleOutcome
from nbv.report.blocks.coverage_tables import (
    curve,
    reasons,
    stations,
    stations_table,
    surfaces_table,
    views_table,
)
from nbv.report.blocks.inference import (
    PlanFindings,
    baselines_section,
    measured_sentence,
    met_before,
    with_inference,
)
from nbv.report.blocks.page import (
    Bar,
    Block,
    Gallery,
    Headline,
    Page,
    PageSection,
    State,
    Text,
    headline_of,
    shares_bar,
)
from nbv.report.blocks.room_tables import rooms_section, rules_section, set_apart, storey_plans
from nbv.report.figures.picture import MEASURED, UNKNOWN, Picture
from nbv.report.figures.surface_values import StateMarks, state_pictures
from nbv.report.viewer.markers import (
    Look,
    given_markers,
    opening_lines,
    tour_lines,
    view_markers,
    zone_lines,
)
from nbv.report.viewer.scene_view import PALE, scene_view
from nbv.run.wording import count, percent_within, square_metres
from nbv.scanning.sensor import Sensor, View
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene


def plan_page(
    scene: Scene,
    plan: Plan,
    coverage: Coverage,
    n_threads: int | None,
    baselines: Sequence[Baseline] = (),
    rules: Sequence[RuleOutcome] = (),
    scans: Sequence[RangeImage] = (),
) -> Page:
    """Return the report of a plan, with what simple planners and rules of thumb reach beside it.

    `scans` are those that the plan was resumed from; the page does not depend on the number of threads.
    """
    find = with_inference if plan.shares else by_views
    findings = find(scene, plan, coverage, n_threads, baselines)
    ended = f"The plan ends because: {plan.stopped_because}."
    if plan.lower_bound:
        ended += f" {plan.lower_bound.describe().capitalize()}."
    ended += "".join(f" {sentence[0].upper()}{sentence[1:]}." for sentence in cost_sentences(plan))
    before = plan.resumed_from.poses if plan.resumed_from else ()
    tour = plan.stations.tour if plan.stations else None
    poses = [view.world_from_sensor for view in plan.views]
    if len(plan.rooms) > 1:
        where = [sheet.picture() for sheet in storey_plans(scene, plan, by_views=True)]
    else:
        where = [stations(scene, poses, plan.sensor, given=before, tour=tour, zones=plan.zones)]
    view = _plan_view(
        scene, plan, coverage=coverage, pictures=findings.pictures, n_threads=n_threads, scans=scans
    )
    return Page(
        title=scene.name,
        kicker="View plan",
        summary=findings.summary,
        headlines=(Headline(str(len(plan.views)), "", "views"), *findings.headlines),
        bar=findings.bar,
        sections=(
            *findings.meanings,
            PageSection(findings.overview, (view, Text(findings.note, is_note=True))),
            PageSection(
                "Views", (Gallery((findings.curve, *where), 2), Text(ended, is_note=True), views_table(plan))
            ),
            *rooms_section(plan),
            *baselines_section(plan, baselines),
            *rules_section(plan, rules),
            PageSection("What cannot be reached, and why", (*reasons(coverage), *set_apart(coverage))),
            PageSection("Surface by surface", (findings.surfaces,)),
        ),
        warnings=(*scene.warnings, *(plan.site.warnings if plan.site else ())),
    )


def _plan_view(
    scene: Scene,
    plan: Plan,
    coverage: Coverage,
    pictures: tuple[Picture, ...],
    n_threads: int | None,
    scans: Sequence[RangeImage],
) -> Block:
    """The 3-D view of a plan."""
    seen = coverage.history or visibility_history(
        scene.ray_caster(n_threads), coverage.samples, plan.requirement, plan.views, scans
    )
    before = plan.resumed_from.poses if plan.resumed_from else ()
    given = looks_of(scans) or [plan.sensor] * len(before)
    poses = [view.world_from_sensor for view in plan.views]
    return scene_view(
        scene,
        coverage,
        seen,
        markers=(*given_markers(before, given), *view_markers(poses, looks_of(plan.views))),
        lines=(
            *opening_lines([opening.outline for opening in scene.openings]),
            *tour_lines(plan.stations.tour if plan.stations else None),
            *zone_lines(plan.zones),
        ),
        zones=plan.zones,
        pictures=pictures,
        cut_m=plan.site.cut_m if plan.site else None,
    )


def by_views(
    scene: Scene, plan: Plan, coverage: Coverage, n_threads: int | None, baselines: Sequence[Baseline] = ()
) -> PlanFindings:
    """Return what views alone achieve."""
    met = [view.met_fraction or 0.0 for view in plan.views]
    bound = plan.lower_bound.views if plan.lower_bound else None
    return PlanFindings(
        summary=f"{measured_sentence(plan, coverage)} {_rest(coverage)}",
        headlines=coverage_headlines(coverage),
        bar=coverage_bar(coverage),
        meanings=(),
        curve=curve(met, coverage, plan.target, bound, start=met_before(plan), others=baselines[1:]),
        overview="Where the surface is measured",
        pictures=overview_pictures(
            scene, coverage, n_threads, zones=plan.zones, cut_m=plan.site.cut_m if plan.site else None
        ),
        note=_NOTE,
        surfaces=surfaces_table(coverage),
    )


_NOTE = (
    "\u00b1 is one standard error of a share, of the samples on which it was measured. "
    "Unknown, hatched, here means reachable, but not measured as required. Surfaces that face away from the "
    "eye are left out, so that one looks into a room from outside."
)


def coverage_page(
    scene: Scene,
    coverage: Coverage,
    given: Sequence[View] | Sequence[RangeImage],
    seen: VisibilityHistory,
    sensor: Sensor,
    n_threads: int | None,
) -> Page:
    """Return the report of stations that are given, and see `seen`, one after the other.

    By `sensor` was reckoned what is reachable; the page does not depend on the number of threads.
    """
    requirement, noun = coverage.requirement, noun_of(given)
    summary = (
        f"{count(len(given), f'{noun} measures', f'{noun}s measure')} "
        f"{percent_within(coverage.met, coverage.standard_errors()['met'])} % of "
        f"{square_metres(coverage.total_m2)} m\u00b2 at {requirement.describe()}. {_rest(coverage)}"
    )
    poses = [station.world_from_sensor for station in given]
    blocks: tuple[Block, ...] = (Text("None."),)
    if poses:
        where = stations(scene, poses, sensor, looks=looks_of(given))
        plots = Gallery((curve(seen.met[1:], coverage, None, None), where), 2)
        blocks = plots, stations_table(poses, seen.met, coverage.total_m2, what=noun.capitalize())
    view = scene_view(
        scene,
        coverage,
        seen,
        markers=view_markers(poses, looks_of(given)),
        lines=opening_lines([opening.outline for opening in scene.openings]),
        pictures=overview_pictures(scene, coverage, n_threads),
    )
    return Page(
        title=scene.name,
        kicker="Coverage report",
        summary=summary,
        headlines=(Headline(str(len(given)), "", f"{noun}s"), *coverage_headlines(coverage)),
        bar=coverage_bar(coverage),
        sections=(
            PageSection("Where the surface is measured", (view, Text(_NOTE, is_note=True))),
            PageSection(f"{noun.capitalize()}s", blocks),
            PageSection("What cannot be reached, and why", (*reasons(coverage), *set_apart(coverage))),
            PageSection("Surface by surface", (surfaces_table(coverage),)),
        ),
        warnings=scene.warnings,
    )


def noun_of(given: Sequence[View] | Sequence[RangeImage]) -> str:
    """Return what to call these: several views of a sensor that does not look around may share a station."""
    if any(isinstance(image, RangeImage) for image in given):
        return "scan"
    looks_around = all(isinstance(image, View) and image.sensor.kind == "spherical" for image in given)
    return "station" if looks_around else "view"


def looks_of(given: Sequence[View] | Sequence[RangeImage]) -> list[Look]:
    """What tells the field of view of each station."""
    return [image.projection if isinstance(image, RangeImage) else image.sensor for image in given]


def _rest(coverage: Coverage) -> str:
    missed = coverage.state == REACHABLE
    more = percent_within(coverage.reachable - coverage.met, share_error(coverage.samples, missed))
    never = percent_within(coverage.unreachable, coverage.standard_errors()["unreachable"])
    return f"Of the rest, {more} % could be measured by further views, and {never} % by none."


def coverage_headlines(coverage: Coverage) -> tuple[Headline, ...]:
    """Measured, missed and unreachable shares, with their standard errors."""
    missed = coverage.state == REACHABLE
    errors = coverage.standard_errors()
    figures: tuple[tuple[float, float, str, State], ...] = (
        (coverage.met, errors["met"], "of the area measured as required", "measured"),
        (coverage.met_of_reachable, coverage.met_of_reachable_error, "of what can be reached", "measured"),
        (
            coverage.reachable - coverage.met,
            share_error(coverage.samples, missed),
            "reachable, not yet measured",
            "unknown",
        ),
        (coverage.unreachable, errors["unreachable"], "out of reach of any candidate", "unreachable"),
    )
    return tuple(headline_of(*figure) for figure in figures)


def coverage_bar(coverage: Coverage) -> Bar:
    """The whole area by state."""
    missed = coverage.reachable - coverage.met
    parts: tuple[tuple[str, State, float], ...] = (
        ("measured as required", "measured", coverage.met),
        ("reachable, not measured", "unknown", missed),
        ("out of reach", "unreachable", coverage.unreachable),
    )
    return shares_bar(parts, coverage.total_m2)


def overview_pictures(
    scene: Scene,
    coverage: Coverage,
    n_threads: int | None = None,
    *,
    zones: Zones = EVERYWHERE,
    cut_m: float | None = None,
) -> tuple[Picture, ...]:
    """The scene below a cut from two opposite sides, by state; what is off the region in one pale grey."""
    return state_pictures(
        scene,
        coverage.samples,
        state=coverage.state,
        marks=StateMarks(colours={MET: MEASURED, REACHABLE: UNKNOWN, UNREACHABLE: PALE}, hatched=REACHABLE),
        title="Measured, missed, out of reach",
        n_threads=n_threads,
        zones=zones,
        cut_m=cut_m,
    )
