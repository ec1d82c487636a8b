# SPDX-License-Identifier: MIT
"""Advice: whether a dimension may be relied on, by a rule that stands beside it."""

from __future__ import annotations

from typing import Literal

from completion.exchange.dimensions.dimension import Dimension

Advice = Literal["rely", "check", "do not build"]

TOLERANCE_M = 0.010
"""Half an interval up to which dimensions are relied on where nobody says how exact they must be, metres."""

UNKNOWN = "A mesh does not say how wrong it is: no interval is known unless --sigma M says so."
_LEAST_MEASURED, _LEAST_EXISTENCE = 0.5, 0.8


def advice(dimension: Dimension, tolerance_m: float = TOLERANCE_M) -> Advice:
    """Return whether to rely on a dimension, to check it on site, or not to build by it.

    "do not build" where an end of it is there with a probability below 0.8. "rely" where half its 95 %
    interval is within the tolerance and at least half of what it rests on was measured. Else "check". The
    tolerance of an area is what its perimeter makes of it, each side off by half; that of a volume, what its
    surface does.
    """
    if dimension.existence < _LEAST_EXISTENCE:
        return "do not build"
    is_exact = dimension.half <= tolerance_m * dimension.across_m
    return "rely" if is_exact and dimension.measured_share >= _LEAST_MEASURED else "check"


def told_rule(tolerance_m: float) -> str:
    """The rule in plain words."""
    return (
        f"Rely: half the 95 % interval is at most {1000 * tolerance_m:g} mm, and at least half of what the "
        "dimension rests on was measured. Do not build: an end of it is there with a probability below 0.8. "
        "Check on site: all others. An area may be off by what the tolerance makes of its sides, half of it "
        "on each, and a volume by what it makes of its faces."
    )
