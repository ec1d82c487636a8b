# SPDX-License-Identifier: MIT
"""Report of a check against a design: a verdict on each element with its evidence, one file."""

from __future__ import annotations

from collections import Counter

from completion.asbuilt.findings import VERDICTS, DesignCheck
from nbv.inspection.checking import CheckedDesign
from nbv.report.blocks.check_tables import (
    alignment_blocks,
    alignment_sentence,
    cards,
    changes_blocks,
    counts_table,
    elements_table,
    extras_blocks,
    loa_blocks,
    meanings_table,
    next_blocks,
    numbered,
    verdict_bar,
)
from nbv.report.blocks.page import Block, Gallery, Headline, Page, PageSection
from nbv.report.blocks.verdict_plans import design_storeys, verdict_plans
from nbv.report.viewer.check_view import check_view
from nbv.report.viewer.markers import view_markers
from nbv.run.wording import count, percent

_EYE_M = 1.5  # above the highest floor: where the view is cut at first
_LABELLED = ("deviates", "missing", "undecided", "hidden")


def check_page(checked: CheckedDesign, title: str, *, n_threads: int | None = None) -> Page:
    """Return the report of a checked design."""
    check, numbers = checked.findings, numbered(checked.findings)
    shown = {one.surface: numbers[one.surface] for one in check.elements if one.verdict in _LABELLED}
    following = checked.next_stations
    views = () if following is None else following.plan.views
    poses = [view.world_from_sensor for view in views]
    markers = view_markers(poses, [view.sensor for view in views])
    plans = tuple(
        verdict_plans(check, shown, [(str(k), pose.translation) for k, pose in enumerate(poses, 1)])
    )
    return Page(
        title=title,
        kicker="Check against a design",
        summary=summary(check),
        headlines=_headlines(check),
        bar=verdict_bar(check),
        sections=(
            PageSection("Verdicts by storey and class", (counts_table(check),)),
            *((PageSection("Plans", (Gallery(plans, min(len(plans), 2)),)),) if plans else ()),
            PageSection("In three dimensions", (check_view(check, _cut(check), markers, n_threads),)),
            PageSection("Elements", (
                *elements_table(check, numbers, within=False), *elements_table(check, numbers, within=True),
                meanings_table(),
            )),
            *((PageSection("Evidence", cards(check, numbers)),) if numbers else ()),
            PageSection("Surface that is no element", extras_blocks(check)),
            *((PageSection("Where to stand next", next_blocks(following)),) if following else ()),
            *_changes_section(checked),
            PageSection("Accuracy by level", loa_blocks(check)),
            PageSection("Where the scans lie", alignment_blocks(check)),
        ),
        warnings=check.warnings,
    )  # fmt: skip


def summary(check: DesignCheck) -> str:
    """Return the verdict on the building in a few sentences with numbers."""
    counts = Counter(finding.verdict for finding in check.elements)
    verdicts = ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict])
    tolerances = sorted({1000 * finding.tolerance_m for finding in check.elements}) or [0.0]
    span = " to ".join(f"{end:g}" for end in dict.fromkeys((tolerances[0], tolerances[-1])))
    text = (
        f"{count(len(check.elements), 'element')} at a tolerance of {span} mm: {verdicts}. "
        f"{count(check.faces_tested, 'face was', 'faces were')} tested; {check.false_alarms_expected:g} "
        "wrong \u201cdeviates\u201d are expected in the whole building, so that each test asks for "
        f"{check.z:.2f} standard deviations. "
    )
    where = check.alignment
    moved = f"Alignment: all scans were moved by {where.shift_text}. " if where.is_free else ""
    return text + moved + alignment_sentence(check)


def _headlines(check: DesignCheck) -> tuple[Headline, ...]:
    counts = Counter(finding.verdict for finding in check.elements)
    unseen = counts["hidden"] + counts["not seen"]
    area = sum(finding.exposed_m2 for finding in check.elements)
    measured = sum(finding.exposed_m2 * finding.share.measured for finding in check.elements)
    return (
        Headline(str(counts["within"]), "", "elements within tolerance", "within"),
        Headline(str(counts["deviates"]), "", "deviate", "deviates"),
        Headline(str(counts["missing"]), "", "missing", "missing"),
        Headline(str(counts["undecided"]), "", "undecided", "undecided"),
        Headline(str(unseen), "", "hidden or not seen", "hidden"),
        Headline(percent(measured / area) if area else "0", "%", "of the exposed area measured", "measured"),
    )


def _cut(check: DesignCheck) -> float | None:
    """Height, metres, above which the view shows nothing at first: eye level of the highest storey."""
    top = max((float(finding.centre[2]) for one in check.elements for finding in one.faces), default=None)
    floors = [
        storey.floor_m
        for storey in design_storeys(check.design)
        if top is not None and storey.floor_m + 1 < top
    ]
    return floors[-1] + _EYE_M if floors else None


def _changes_section(checked: CheckedDesign) -> tuple[PageSection, ...]:
    if checked.changes is None:
        return ()
    blocks: tuple[Block, ...] = changes_blocks(checked.changes)
    return (PageSection("Changes since the earlier check", blocks),)
