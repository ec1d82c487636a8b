# SPDX-License-Identifier: MIT
"""Cards of plans and coverages: what a notebook shows of them, the curve as SVG in the page's colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from nbv.run.wording import count
from scenes.card.card import INFERRED, MEASURED, UNKNOWN, UNREACHABLE, Card, CardPicture, Share

if TYPE_CHECKING:
    from nbv.coverage.coverage import Coverage, CoverageSummary
    from nbv.plan.plan import Plan

_WIDTH, _HEIGHT = 240, 120  # of the curve, CSS pixels
_WORST = 5  # surfaces that are listed


def card_of_plan(plan: Plan) -> Card:
    """Return views, measured share, bound and reason of the end, with the coverage curve."""
    figures = [
        ("views", f"{len(plan.views)} of {plan.n_candidates} candidates"),
        ("sensor", plan.sensor.name),
        ("counts as measured", plan.requirement.describe()),
    ]
    coverage, pictures = plan.coverage, []
    if coverage is not None:
        figures += [("measured", f"{100 * coverage.met:.1f} % of {coverage.total_m2:.1f} m\u00b2")]
        met = [view.met_fraction or 0.0 for view in plan.views]
        before = (plan.resumed_from.met_fraction or 0.0) if plan.resumed_from else 0.0
        pictures = [CardPicture(_curve([before, *met], coverage.reachable), _caption(met), _WIDTH)]
    if plan.lower_bound is not None:
        figures += [("lower bound", count(plan.lower_bound.views, "view"))]
    if plan.stations is not None:
        figures += [("tour", f"{plan.stations.tour.length_m:.1f} m")]
    note = f"stopped because: {plan.stopped_because}"
    return Card(
        "View plan", f"method {plan.method}", figures, bar=_bar(coverage), pictures=pictures, note=note
    )


def card_of_coverage(coverage: Coverage) -> Card:
    """Return measured, missed and unreachable area, and the surfaces that are missed most."""
    total = coverage.total_m2
    figures = [
        ("surface", f"{total:.2f} m\u00b2, {len(coverage.samples)} samples"),
        ("counts as measured", coverage.requirement.describe()),
        ("measured", f"{100 * coverage.met:.1f} %, {coverage.met * total:.2f} m\u00b2"),
        ("of what can be reached", f"{100 * coverage.met_of_reachable:.1f} %"),
    ]
    figures += [
        (f"unreachable: {name.replace('_', ' ')}", f"{100 * share:.1f} %")
        for name, share in coverage.reasons().items()
        if share >= 0.0005
    ]
    missed = sorted(coverage.by_surface(), key=lambda row: (row.met - row.reachable) * row.area_m2)
    figures += [
        (f"missed on {row.name}", f"{(row.reachable - row.met) * row.area_m2:.2f} m\u00b2")
        for row in missed[:_WORST]
        if row.reachable - row.met > 0.0005
    ]
    return Card("Coverage", "which surface is measured as required", figures, bar=_bar(coverage))


def _bar(coverage: Coverage | CoverageSummary | None) -> tuple[Share, ...]:
    """The whole area by state."""
    if coverage is None:
        return ()
    known = coverage.met + coverage.modelled + coverage.inferred
    return (
        Share("measured", coverage.met, MEASURED),
        Share("modelled or inferred", coverage.modelled + coverage.inferred, INFERRED),
        Share("reachable, not measured", max(coverage.reachable - known, 0.0), UNKNOWN),
        Share("out of reach", max(min(coverage.unreachable, 1 - known), 0.0), UNREACHABLE),
    )


def _caption(met: Sequence[float]) -> str:
    if not met:
        return "no view"
    return f"share measured after each of {count(len(met), 'view')}, up to {100 * met[-1]:.1f} %"


def _curve(met: Sequence[float], reachable: float) -> str:
    """Steps of the measured share (n + 1,) as SVG; a dashed line is what can be reached."""
    n, top = max(len(met) - 1, 1), _HEIGHT - 2
    x = [_WIDTH * k / (n + 0.6) for k in (*range(len(met)), len(met) - 0.4)]
    y = [top - (top - 4) * share for share in met]
    steps = f"M0,{y[0]:.1f}" + "".join(
        f"H{right:.1f}V{height:.1f}" for right, height in zip(x[1:-1], y[1:], strict=True)
    )
    level = top - (top - 4) * reachable
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="coverage curve" '
        f'viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" height="{_HEIGHT}">'
        f'<path d="{steps}H{x[-1]:.1f}V{top}H0Z" fill="{MEASURED}" fill-opacity=".35"/>'
        f'<path d="{steps}H{x[-1]:.1f}" fill="none" stroke="currentColor" stroke-width="1.8"/>'
        f'<path d="M0,{level:.1f}H{_WIDTH}" stroke="{UNKNOWN}" stroke-width="1.4" stroke-dasharray="5 4"/>'
        f'<path d="M0,{top}H{_WIDTH}" stroke="currentColor" stroke-opacity=".4"/></svg>'
    )
