# SPDX-License-Identifier: MIT
"""Accepted: found openings as what completion takes for open, side by side as sure as it was seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from completion.edits.application import EditedSurface
from completion.edits.edit import FittedOpening
from completion.templates.engine.template import Side, Status, TemplateFit

_ORDER = ("bottom", "right", "top", "left")  # sides from each corner to the next


def with_openings(surfaces: Sequence[EditedSurface], features: Sequence[TemplateFit]) -> list[EditedSurface]:
    """Return the surfaces with the openings that were found in them; others change nothing.

    A side that nobody saw lies where beams still went through, and may lie farther out.
    """
    out = list(surfaces)
    for number, fit in enumerate(features, start=1):
        if fit.status is not Status.FOUND or fit.geometry.get("is_closed"):
            continue
        index = int(str(fit.geometry["surface"])) - 1
        one = out[index]
        edits = replace(one.edits, fitted=(*one.edits.fitted, _fitted(fit, number)))
        out[index] = replace(one, edits=edits)
    return out


def _fitted(fit: TemplateFit, number: int) -> FittedOpening:
    corners = np.asarray(fit.geometry["corners"], dtype=np.float64)
    sides: dict[str, Side] = {side.name: side for side in fit.sides}
    slack = cast(Mapping[str, tuple[float, float]], fit.geometry["slack"])
    off = np.array([slack[name] for name in _ORDER])
    deviation = np.array([sides[name].deviation for name in _ORDER])
    seen = np.array([sides[name].is_seen * sides[name].confirmed / sides[name].total for name in _ORDER])
    return FittedOpening(corners, deviation, seen, off, number)
