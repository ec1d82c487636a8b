# SPDX-License-Identifier: MIT
"""Found features as what completion takes for open, or ended, as sure as each part of them was seen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from completion.edits.application import EditedSurface
from completion.edits.fitted import FittedHole, FittedJoint, FittedOpening
from completion.templates.applied.file import PATTERNS
from completion.templates.applied.reveals import AROUND
from completion.templates.engine.template import Side, Status, TemplateFit
from scenes.surfaces.catalogue import Plane


def with_features(surfaces: Sequence[EditedSurface], features: Sequence[TemplateFit]) -> list[EditedSurface]:
    """Return the surfaces with the openings, holes and joints that were found in them.

    Features that are not found change nothing. A side that nobody saw lies where beams still went through,
    and may lie farther out; holes of a pattern that nobody saw, or that are filled, are none.
    """
    edits = [one.edits for one in surfaces]
    for number, fit in enumerate(features, start=1):
        if fit.status is not Status.FOUND or fit.geometry.get("is_closed"):
            continue
        for surface, plane in cast(Sequence[tuple[int, Plane]], fit.geometry.get("ends", ())):
            one = edits[surface - 1]
            edits[surface - 1] = replace(one, joints=(*one.joints, FittedJoint(plane, number)))
        if "surface" not in fit.geometry:
            continue
        index = int(str(fit.geometry["surface"])) - 1
        one = edits[index]
        if fit.kind in PATTERNS:
            edits[index] = replace(one, holes=(*one.holes, *_holes(fit, number)))
        else:
            edits[index] = replace(one, fitted=(*one.fitted, _fitted(fit, number)))
    return [replace(one, edits=said) for one, said in zip(surfaces, edits, strict=True)]


def _holes(fit: TemplateFit, number: int) -> Iterator[FittedHole]:
    """The holes of a pattern that were seen, all of one radius."""
    radius, axis = float(str(fit.geometry["radius"])), np.asarray(fit.geometry["axis"])
    for centre, side in zip(np.asarray(fit.geometry["centres"]), fit.sides, strict=True):
        if side.is_seen:
            seen = side.confirmed / side.total
            yield FittedHole(centre, axis, radius, side.deviation, seen=seen, number=number)


def _fitted(fit: TemplateFit, number: int) -> FittedOpening:
    corners = np.asarray(fit.geometry["corners"], dtype=np.float64)
    sides: dict[str, Side] = {side.name: side for side in fit.sides}
    slack = cast(Mapping[str, tuple[float, float]], fit.geometry["slack"])
    off = np.array([slack[name] for name in AROUND])
    deviation = np.array([sides[name].deviation for name in AROUND])
    seen = np.array([sides[name].is_seen * sides[name].confirmed / sides[name].total for name in AROUND])
    return FittedOpening(corners, deviation, seen, off, number)
