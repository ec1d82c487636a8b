# SPDX-License-Identifier: MIT
"""Plain words: what people read where files hold the short names of a method."""

from __future__ import annotations

import numpy as np

WHY_INFERRED = {
    "measured": "measured",
    "interior": "hole behind something",
    "between": "between two measured parts",
    "edges": "inside its own edges, continued",
    "architectural": "up to the next wall, floor or ceiling",
    "full-turn": "around the back of a round surface",
    "user": "stated by a person",
    "no-return": "no beam came back",
    "feature": "side of a recognised opening or feature",
}
"""Why a place is in the model, by its provenance."""

WHY_IT_ENDS = {
    "crease": "meets another surface",
    "edge": "its own edge was seen",
    "frame": "the image ends",
    "no-return": "no beam came back",
    "occluded": "something stands before it",
}
"""Why a surface ends, by the kind of its boundary."""

HOW_ITS_END_IS_KNOWN = {
    "measured": "seen",
    "shadow-limit": "inferred: what is hidden ends here, or the surface is no longer probable",
    "architectural": "inferred: the next wall, floor or ceiling is here",
    "intersection": "inferred: it was seen to meet another surface",
    "collinear": "inferred: an edge seen on both sides goes on between",
    "convergent": "inferred: an edge goes on behind what hides it",
    "circular": "inferred: an arc goes on behind what hides it",
    "closure": "inferred: the edge turns by a right angle at a seen corner",
    "full-turn": "inferred: a round surface closes around its back",
    "merging": "inferred: parts on both sides are one surface",
    "relations": "inferred: its relation to another surface says so",
    "feature": "inferred: a recognised opening or feature ends it",
    "user": "stated by a person",
}
"""How the end of a surface is known, by the provenance of its boundary."""

_RAISED = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")


def odds_text(evidence: float) -> str:
    """Return evidence in nats as a power of ten: how many times likelier the points are with than without.

    Examples
    --------
    >>> odds_text(41.4), odds_text(0.7), odds_text(float("nan"))
    ('10¹⁸', '2', '-')
    """
    if not np.isfinite(evidence):
        return "-"
    power = float(evidence / np.log(10))
    return "10" + f"{power:.0f}".translate(_RAISED) if abs(power) >= 2 else f"{10**power:.2g}"


def chance_text(p: float) -> str:
    """Return a probability as percent, without the sign, to three digits; "" where there is none.

    Examples
    --------
    >>> chance_text(1.0), chance_text(0.0321), chance_text(1e-9), chance_text(float("nan"))
    ('100', '3.21', '<0.0001', '')
    """
    return "" if np.isnan(p) else f"{100 * p:.3g}" if p >= 1e-6 else "<0.0001"
