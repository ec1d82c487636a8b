# SPDX-License-Identifier: MIT
"""Colours of verdicts, the same in reports, plans and files.

Any two differ by at least 15 (CIEDE2000) to a normal eye and under the three dichromacies by Machado,
Oliveira & Fernandes (2009). What is hidden is hatched and what was not seen is dotted, for grey prints.
"""

from __future__ import annotations

from collections.abc import Mapping

from completion.asbuilt.findings import Verdict

VERDICT_COLOURS: Mapping[Verdict, str] = {
    "within": "#35b779",
    "deviates": "#d1331e",
    "undecided": "#fbcf4f",
    "missing": "#8a1c7c",
    "hidden": "#737b81",
    "not seen": "#abb2b6",
    "not tested": "#f1f4f5",
}
EXTRA_COLOUR = "#2f62c4"


def rgb_of(colour: str) -> tuple[float, float, float]:
    """Return red, green and blue, 0..1, of a CSS colour.

    Examples
    --------
    >>> rgb_of("#ff0033")
    (1.0, 0.0, 0.2)
    """
    red, green, blue = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue
