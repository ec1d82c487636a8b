# SPDX-License-Identifier: MIT
"""Parts of the cards of coverages and plans: the area by state, and the curve as SVG."""

from __future__ import annotations

from collections.abc import Sequence

from nbv.run.wording import count
from scenes.card import INFERRED, MEASURED, UNKNOWN, UNREACHABLE, CardPicture, CardShare

_WIDTH, _HEIGHT = 240, 120  # of the curve, CSS pixels


def area_bar(*, met: float, inferred: float, reachable: float) -> tuple[CardShare, ...]:
    """Return the whole area by state, as fractions of it: measured, modelled or inferred, reachable."""
    known = met + inferred
    return (
        CardShare("measured", met, MEASURED),
        CardShare("modelled or inferred", inferred, INFERRED),
        CardShare("reachable, not measured", max(reachable - known, 0.0), UNKNOWN),
        CardShare("out of reach", max(min(1.0 - reachable, 1 - known), 0.0), UNREACHABLE),
    )


def coverage_curve(met: Sequence[float], reachable: float) -> CardPicture:
    """Return the measured share before the first view and after each, (n + 1,), as a picture.

    A dashed line is the share that can be reached.
    """
    caption = "no view"
    if len(met) > 1:
        n_views = count(len(met) - 1, "view")
        caption = f"share measured after each of {n_views}, up to {100 * met[-1]:.1f} %"
    return CardPicture(_steps(met, reachable), caption, _WIDTH)


def _steps(met: Sequence[float], reachable: float) -> str:
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
